"""What is prescribed in variants: states, efforts and the kinds of drives that are followed."""

from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.engine.mechanism import mechanism_variants
from pinarm.engine.motion.prescribed_motion import PrescribedMotion
from pinarm.engine.motion.variants import PrescribedVariants
from pinarm.use.mechanism import Mechanism

SCENARIOS = Path(__file__).parents[3] / "scenarios"
ROUNDING = 1e-12


def solved(name: str, *values: str) -> tuple[pinarm.Scenario, PrescribedMotion, pinarm.Result]:
    scenario = pinarm.load(SCENARIOS / f"{name}.yaml", list(values))
    result = scenario.run()
    motion = result.outcome.motion
    assert isinstance(motion, PrescribedMotion)
    return scenario, motion, result


def variants_of(motion: PrescribedMotion, result: pinarm.Result, mechanism: Mechanism) -> PrescribedVariants:
    table = result.scenario.prescribed_table(result.scenario)
    assert table is not None
    return PrescribedVariants(motion, result.trajectory, mechanism, [table] * len(mechanism.model))


@pytest.mark.parametrize(
    ("name", "argument", "factors"),
    [("crank_rocker_turning", "b", (1.0, 1.05, 0.97)), ("gen411_arm_vertical", "l1", (1.0, 1.02, 0.99))],
)  # fmt: skip
def test_states_and_efforts_are_those_of_each_alone(name: str, argument: str, factors: tuple[float, ...]) -> None:
    scenario, motion, result = solved(name)
    nominal, unit = scenario.mechanism.arguments[argument], scenario.mechanism.argument_units[argument]
    given = {argument: nominal}
    variants, _ = mechanism_variants(scenario.mechanism, given, {argument: [nominal * factor for factor in factors]})
    rows, sound = variants_of(motion, result, variants).rows()
    assert sound.all()
    for k, factor in enumerate(factors):
        alone = solved(name, f"arguments.{argument}={nominal * factor!r} {unit}")[2].trajectory
        for own, other in ((rows.q, alone.q), (rows.v, alone.v), (rows.a, alone.a), (rows.tau, alone.tau)):
            of_variant = own[:, min(k, own.shape[1] - 1)]
            np.testing.assert_allclose(of_variant, other, atol=ROUNDING * max(1.0, np.abs(other).max()))
        lam = np.asarray(rows.lam)
        np.testing.assert_allclose(
            lam[:, min(k, lam.shape[1] - 1)], np.asarray(alone.lam),
            atol=ROUNDING * np.abs(alone.tau).max() * 100,  # forces [N] of torques at levers of 0.1 m
        )  # fmt: skip
