"""What is prescribed in variants: states, efforts and the kinds of drives that are followed."""

from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.engine.kinematics.variant_motion import VariantClosure
from pinarm.engine.mechanism import alike_variants, mechanism_variants
from pinarm.engine.motion.prescribed_motion import PrescribedMotion
from pinarm.engine.motion.variants import DrivesOfVariants, PrescribedVariants
from pinarm.mechanics.coordinates import LinearCoordinate
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


def test_efforts_that_are_not_determined_are_no_numbers() -> None:
    """A drive at O alone holds the arm where nothing turns the second rod."""
    mechanism = pinarm.load(SCENARIOS / "gen411_arm_static.yaml").mechanism
    variants = alike_variants(mechanism, 3)
    held = mechanism.coordinates["O"]
    assert isinstance(held, LinearCoordinate) and isinstance(variants.closure, VariantClosure)
    demand = np.array([[[1.0, 0.0], [1.0, 1.0], [2.0, 0.0]]])
    drives = DrivesOfVariants({"O": held}, {}, variants.closure, variants.closure)
    tau, _ = drives.efforts(np.zeros(1), np.zeros((1, 1, 2)), demand)
    np.testing.assert_allclose(tau[0, [0, 2]], demand[0, [0, 2]], rtol=1e-13)
    assert np.isnan(tau[0, 1]).any()
