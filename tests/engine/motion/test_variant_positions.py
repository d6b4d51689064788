"""Motions of variants against closed forms, and against the continuation of each variant alone."""

from pathlib import Path

import numpy as np
import pytest

from pinarm import Mechanism
from pinarm.engine.kinematics.assembly import determining
from pinarm.engine.kinematics.joint_motion import DeterminedMotion
from pinarm.engine.kinematics.newton import start_configuration
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.mechanism import mechanism_variants
from pinarm.engine.motion.variants import VariantMotion, VariantStates
from pinarm.mechanics.laws.kinds import ConstantSpeed
from pinarm.mechanics.laws.motion_law import Grid

PATH = Path(__file__).parents[3] / "models" / "crank_rocker" / "mechanism.yaml"
SPEED, FIRST = 2.0, {"a": 0.10, "b": 0.35, "c": 0.25, "d": 0.40}
START = {"A": 40 * np.pi / 180, "theta4": 80 * np.pi / 180}
ROUNDING = 1e-12
"""Of angles of about 1, four-bars whose transmission angles stay above 15 degrees."""


def law(speed: float = SPEED) -> dict[str, ConstantSpeed]:
    return {"theta2": ConstantSpeed(speed=speed)}


def followed(columns: dict[str, list[float]], rows: int = 120) -> tuple[VariantStates, Grid, PrescribedCoordinates]:
    mechanism = Mechanism.load(PATH, FIRST)
    prescribed = determining(mechanism, law())
    grid = Grid.cover(np.linspace(0.0, np.pi, rows), prescribed.laws)
    start = start_configuration(mechanism, START)
    q = DeterminedMotion(mechanism, prescribed).follow(grid, start).q
    given = {name: [FIRST[name], *values] for name, values in columns.items()}
    variants, possible = mechanism_variants(mechanism, FIRST, given)
    assert possible.all()
    laws = np.array([grid.evaluate(one) for one in prescribed.laws]).transpose(1, 2, 0)[:, :, None]
    motion = VariantMotion.of(variants.closure, prescribed, q[0])
    return motion.follow(grid.t, laws, q[:, None], start[None]), grid, prescribed


def random_lengths(seed: int, count: int) -> dict[str, list[float]]:
    """Return lengths up to a half longer or shorter than those of the first: of crank-rockers, and of others."""
    rng = np.random.default_rng(seed)
    return {name: (length * rng.uniform(0.7, 1.5, count)).tolist() for name, length in FIRST.items()}


def rocker(theta2: np.ndarray, a: float, b: float, c: float, d: float) -> np.ndarray:
    """Return theta4 of the open branch by Freudenstein's equation (Norton, Design of Machinery, section 4.5)."""
    k1, k2, k3 = d / a, d / c, (a**2 - b**2 + c**2 + d**2) / (2 * a * c)
    p, q, r = np.cos(theta2) * (1 - k2) - k1 + k3, -2 * np.sin(theta2), k1 - (k2 + 1) * np.cos(theta2) + k3
    return np.asarray(2 * np.arctan((-q - np.sqrt(q**2 - 4 * p * r)) / (2 * p)))


def turns_fully(a: float, b: float, c: float, d: float) -> bool:
    """Tell whether the crank turns fully and its transmission angle stays above 15 degrees (Grashof)."""
    cosines = [(b**2 + c**2 - (d + sign * a) ** 2) / (2 * b * c) for sign in (-1, 1)]
    return all(abs(cosine) < np.cos(np.pi / 12) for cosine in cosines)


@pytest.mark.parametrize("seed", range(2))
def test_random_four_bars_move_by_freudensteins_equation(seed: int) -> None:
    columns = random_lengths(seed, 25)
    states, grid, _ = followed(columns)
    theta2, closed = SPEED * grid.t, 0
    for k, lengths in enumerate(zip(*columns.values(), strict=True), start=1):
        if not states.sound[k]:
            assert not turns_fully(*lengths)
            continue
        closed += 1
        theta4 = rocker(theta2, *lengths)
        np.testing.assert_allclose(states.q[:, k, 2], theta4, atol=ROUNDING)
        theta3, (a, b, c, _) = states.q[:, k, 0] + states.q[:, k, 1], lengths
        omega3 = a * SPEED / b * np.sin(theta4 - theta2) / np.sin(theta3 - theta4)
        omega4 = a * SPEED / c * np.sin(theta2 - theta3) / np.sin(theta4 - theta3)
        np.testing.assert_allclose(
            states.v[:, k], np.transpose([SPEED + 0 * omega3, omega3 - SPEED, omega4]), atol=1e-11
        )
    assert closed >= 5


@pytest.mark.parametrize("turns", [0.7, 1.8])
def test_variants_with_laws_of_their_own_move_by_freudensteins_equation(turns: float) -> None:
    """Where a variant turns faster than the first one, the first's rows are no guess of its own."""
    mechanism, start = Mechanism.load(PATH, FIRST), start_configuration(Mechanism.load(PATH, FIRST), START)
    prescribed = PrescribedCoordinates.bound(mechanism, law())
    t = np.stack([np.linspace(0.0, 2.0 * np.pi / SPEED, 121), np.linspace(0.0, 2.0 * np.pi * turns / SPEED, 121)], 1)
    theta2 = SPEED * t
    laws = np.array([theta2, np.full_like(t, SPEED), np.zeros_like(t)])[..., None]
    q = DeterminedMotion(mechanism, prescribed).follow(Grid.cover(t[:, 0], prescribed.laws), start).q
    variants, _ = mechanism_variants(mechanism, FIRST, {"b": [0.35, 0.36]})
    motion = VariantMotion.of(variants.closure, prescribed, q[0])
    near = motion.continued(t, laws, q, start[None])
    states = motion.follow(t, laws, near, start[None])
    assert states.sound.all()
    np.testing.assert_allclose(near, states.q, atol=0.01)  # h^3/6 of the third derivative, with h = 0.4 rad
    for k, b in enumerate((0.35, 0.36)):
        theta4 = np.unwrap(rocker(theta2[:, k], FIRST["a"], b, FIRST["c"], FIRST["d"]))
        np.testing.assert_allclose(states.q[:, k, 2], theta4, atol=ROUNDING)


def test_another_branch_at_the_start_is_noticed() -> None:
    """From this start the variant closes on the other side, where its rows near those of the first one are none."""
    mechanism = Mechanism.load(PATH, FIRST)
    prescribed = determining(mechanism, law())
    grid = Grid.cover(np.linspace(0.0, 1.0, 40), prescribed.laws)
    open_start, crossed_start = (start_configuration(mechanism, {"A": s * 0.7, "theta4": s * 1.4}) for s in (1, -1))
    q = DeterminedMotion(mechanism, prescribed).follow(grid, open_start).q
    variants, _ = mechanism_variants(mechanism, FIRST, {"b": [0.35, 0.36]})
    laws = np.array([grid.evaluate(one) for one in prescribed.laws]).transpose(1, 2, 0)[:, :, None]
    motion = VariantMotion.of(variants.closure, prescribed, q[0])
    assert motion.follow(grid.t, laws, q[:, None], open_start[None]).sound.all()
    assert not motion.follow(grid.t, laws, q[:, None], crossed_start[None]).sound.any()
