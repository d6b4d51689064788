"""The constraints of variants against those of each mechanism alone, by Pinocchio and by pseudo-inverses."""

from pathlib import Path

import numpy as np
import pytest

from pinarm import Mechanism
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.kinematics.variant_motion import VariantClosure
from pinarm.engine.mechanism import mechanism_variants

MODELS = Path(__file__).parents[3] / "models"
ROUNDING = 1e-12
"""Of rows with lengths below 1 m and velocities of about 1."""
CASES = {
    "crank_rocker": {"a": [0.1, 0.11, 0.08], "b": [0.35, 0.37, 0.3], "d": [0.4, 0.38, 0.42]},
    "rssr": {"a": [0.1, 0.12, 0.09], "c": [0.3, 0.33, 0.29]},
    "slider_crank": {"r": [0.05, 0.06, 0.04]},
}


@pytest.fixture(params=CASES)
def both(request: pytest.FixtureRequest) -> tuple[VariantClosure, list[Closure]]:
    """Constraints of variants, and of each of them alone."""
    path = MODELS / request.param / "mechanism.yaml"
    names = Mechanism.load(path).arguments
    columns = {name: values for name, values in CASES[request.param].items() if name in names}
    assert columns
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    variants, possible = mechanism_variants(Mechanism.load(path, rows[0]), rows[0], columns)
    assert possible.all()
    assert isinstance(variants.closure, VariantClosure)
    return variants.closure, [Mechanism.load(path, row).closure for row in rows]


def states(nv: int, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Return configurations and velocities, shape (4, k, nv): more rows than variants, so that none fit by chance."""
    q, v = np.random.default_rng(1).uniform(-1.2, 1.2, (2, 4, k, nv))
    return q, v


def test_gaps_rows_and_drifts_are_those_of_each_alone(both: tuple[VariantClosure, list[Closure]]) -> None:
    closure, alone = both
    q, v = states(closure.model.nv, len(alone))
    gaps, rows, drifts = *closure.at(q), closure.drifts(q, v)
    for k, own in enumerate(alone):
        for i in range(len(q)):
            state = own.state(q[i, k], v[i, k])
            np.testing.assert_allclose(gaps[i, k], own.gap(state), atol=ROUNDING)
            np.testing.assert_allclose(rows[i, k], own.rows(state), atol=ROUNDING)
            np.testing.assert_allclose(drifts[i, k], own.drift(state), atol=ROUNDING)


def test_a_variant_that_loses_rank_has_no_numbers() -> None:
    """The joints of a rhombus in line: two rows of the loop say the same."""
    lengths = {"a": [0.1, 0.2], "b": [0.35, 0.2], "c": [0.25, 0.2], "d": [0.4, 0.2]}
    first = {name: values[0] for name, values in lengths.items()}
    variants, _ = mechanism_variants(Mechanism.load(MODELS / "crank_rocker" / "mechanism.yaml", first), first, lengths)
    closure = variants.closure
    q = np.array([[[0.3, 0.4, 1.2], [1e-9, 0.0, 0.0]]])  # all but in line
    ((_, split),) = closure.splits(q, closure.at(q)[1]).parts
    free = split.free
    assert np.isfinite(free[0, 0]).all()
    assert np.isnan(free[0, 1]).all()


def test_variants_of_another_size_are_told() -> None:
    """A crank-rocker of 1.1 m around is measured in metres, one of 55 mm in millimetres."""
    lengths = {"a": [0.1, 0.005, 0.09], "b": [0.35, 0.0175, 0.3], "c": [0.25, 0.0125, 0.25], "d": [0.4, 0.02, 0.4]}
    path, first = MODELS / "crank_rocker" / "mechanism.yaml", {name: values[0] for name, values in lengths.items()}
    variants, _ = mechanism_variants(Mechanism.load(path, first), first, lengths)
    rows = [dict(zip(lengths, row, strict=True)) for row in zip(*lengths.values(), strict=True)]
    alone = [Mechanism.load(path, row).closure for row in rows]
    assert isinstance(variants.closure, VariantClosure)
    assert variants.closure.alike_in_size.tolist() == [True, False, True]
    assert variants.closure.alike_in_size.tolist() == [(own.measure == alone[0].measure).all() for own in alone]
