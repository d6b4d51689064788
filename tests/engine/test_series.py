"""Quantities take part in numpy's arithmetic as arrays do, and what comes out has the unit that it must have."""

import operator

import numpy as np
import pytest

from pinarm.engine.series import Series
from pinarm.errors import UnitError
from pinarm.input.units import unit

X = np.array([0.5, -1.0, 2.0, 0.25])
TORQUE = Series("M", unit("N*m"), X)
FORCE = Series("F", unit("N"), np.array([1.0, 2.0, -4.0, 0.5]))
ANGLE = Series("phi", unit("rad"), np.array([0.1, 0.2, -0.3, 0.4]))
NUMBER = Series("k", unit("1"), np.array([1.0, 2.0, 3.0, 4.0]))
UNKNOWN = Series("u", None, X)
MILLIMETRES = Series("l", unit("mm"), np.array([1000.0, 2000.0, 500.0, 0.0]))
TALL = Series("l", unit("mm"), np.array(9000.0))
METRES = Series("h", unit("m"), np.array([1.0, 1.0, 0.5, 3.0]))


@pytest.mark.parametrize(
    ("found", "expected", "said"),
    [
        (TORQUE + TORQUE, X + X, "N*m"), (TORQUE - 1.0, X - 1.0, "N*m"), (1.0 - TORQUE, 1.0 - X, "N*m"),
        (-TORQUE, -X, "N*m"),
        (np.float64(3) * TORQUE, 3 * X, "N*m"),
        (TORQUE * FORCE, X * FORCE.values, "kg^2*m^3/s^4"), (TORQUE / FORCE, X / FORCE.values, "m"),
        (1.0 / METRES, 1.0 / METRES.values, "1/m"),
        (FORCE * METRES, FORCE.values * METRES.values, "N*m"), (TORQUE**2, X**2, "kg^2*m^4/s^4"),
        (np.sqrt(FORCE * FORCE), abs(FORCE.values), "N"), (METRES**0.5 * METRES**0.5, METRES.values, "m"),
        (2.0**NUMBER, 2.0**NUMBER.values, "1"),
        (np.sin(ANGLE), np.sin(ANGLE.values), "1"), (np.exp(NUMBER), np.exp(NUMBER.values), "1"),
        (np.arctan2(FORCE, FORCE), np.arctan2(FORCE.values, FORCE.values), "rad"),
        (np.degrees(ANGLE), np.degrees(ANGLE.values), "deg"), (np.radians(ANGLE.to("deg")), ANGLE.values, "rad"),
        (ANGLE.to("deg"), np.degrees(ANGLE.values), "deg"),
        (np.maximum(TORQUE, 0.3), np.maximum(X, 0.3), "N*m"), (np.hypot(TORQUE, TORQUE), np.hypot(X, X), "N*m"),
        (np.clip(TORQUE, 0.0, 1.0), np.clip(X, 0.0, 1.0), None),
        (UNKNOWN * TORQUE, X * X, "?"), (np.sin(UNKNOWN), np.sin(X), "1"),
        (METRES + MILLIMETRES, [2.0, 3.0, 1.0, 3.0], "m"), (MILLIMETRES - METRES, [0.0, 1000.0, 0.0, -3000.0], "mm"),
        (MILLIMETRES * FORCE, [1.0, 4.0, -2.0, 0.0], "N*m"), (MILLIMETRES**2, [1.0, 4.0, 0.25, 0.0], "m^2"),
        (np.sin(ANGLE.to("deg")), np.sin(ANGLE.values), "1"),
        (np.add.accumulate(TORQUE), np.cumsum(X), "N*m"),
        (np.multiply.outer(METRES, FORCE), np.outer(METRES.values, FORCE.values), "N*m"),
    ],
    ids=lambda x: getattr(x, "name", None),
)  # fmt: skip
def test_what_is_computed_has_its_values_and_unit(found, expected, said):
    assert np.asarray(found) == pytest.approx(np.asarray(expected), rel=1e-15)
    if said is not None:
        assert isinstance(found, Series)
        assert ("?" if found.unit is None else str(found.unit)) == said


@pytest.mark.parametrize(
    ("computed", "says"),
    [
        (lambda: TORQUE + FORCE, r"M \+ F: \[N\*m\] and \[N\] do not go together"),
        (lambda: TORQUE == FORCE, "do not go together"),
        (lambda: np.arctan2(TORQUE, FORCE), "do not go together"),
        (lambda: np.sin(TORQUE), r"sin\(M\): a quantity in \[N\*m\] where a number is expected"),
        (lambda: np.floor(TORQUE), "where a number is expected"), (lambda: 2.0**TORQUE, "where a number is expected"),
        (lambda: TORQUE**NUMBER, "to a power that varies"),
        (lambda: np.radians(NUMBER), "is not known"), (lambda: np.radians(TORQUE), "where a number is expected"),
        (lambda: np.heaviside(ANGLE, 0.0), "does not tell a unit"),
        (lambda: ANGLE.to("m"), "do not go together"),
    ],
)  # fmt: skip
def test_what_has_no_unit_is_refused(computed, says):
    with pytest.raises(UnitError, match=says):
        computed()


@pytest.mark.parametrize("compare", [operator.lt, operator.le, operator.gt, operator.ge, operator.eq, operator.ne])
def test_comparisons_give_masks(compare):
    for other, values in ((0.5, 0.5), (Series("other", unit("J"), X[::-1]), X[::-1]), (X[::-1], X[::-1])):
        found = compare(TORQUE, other)
        assert type(found) is np.ndarray
        assert found.tolist() == compare(X, values).tolist()
    assert (MILLIMETRES == METRES).tolist() == [True, False, True, False]
    assert (np.logical_and(TORQUE > 0, FORCE > 0)).tolist() == [True, False, False, True]
    assert np.isfinite(TORQUE).all()


class TestAnArray:
    def test_indices_slices_and_masks(self):
        assert isinstance(TORQUE[2], float)
        assert TORQUE[2] == 2.0
        for index in (slice(1, 3), TORQUE > 0, [0, 2], slice(None, None, -1), ...):
            assert isinstance(TORQUE[index], Series)
            assert TORQUE[index].tolist() == X[index].tolist()
            assert TORQUE[index].label == "M [N*m]"
        table = Series("A", unit("m"), np.arange(6.0).reshape(2, 3))
        assert table[1].tolist() == [3.0, 4.0, 5.0]
        assert table[:, 1].tolist() == [1.0, 4.0]
        assert table[1, 1] == 4.0
        assert table.T.shape == (3, 2)
        assert [row.tolist() for row in table] == table.values.tolist()
        assert list(TORQUE) == X.tolist()
        with pytest.raises(IndexError):
            _ = TORQUE[4]

    def test_it_never_changes(self):
        sum_ = TORQUE
        sum_ += 1.0
        sum_ *= 2.0
        assert sum_.tolist() == ((X + 1.0) * 2.0).tolist()
        assert TORQUE.tolist() == X.tolist()
        with pytest.raises(TypeError, match="never changed"):
            np.add(TORQUE, 1.0, out=TORQUE)
        with pytest.raises(TypeError, match="never changed"):
            np.add.at(TORQUE, [0], 1.0)
        into = np.zeros(4)
        assert np.add(TORQUE, 1.0, out=into) is into
        assert into.tolist() == (X + 1.0).tolist()


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        (np.concatenate([METRES, MILLIMETRES]), [1, 1, 0.5, 3, 1, 2, 0.5, 0]),
        (np.stack((MILLIMETRES, METRES))[1], [1000, 1000, 500, 3000]),
        (np.where(METRES > 0.9, METRES, MILLIMETRES), [1, 1, 0.5, 3]),
        (np.clip(METRES, 0.8, a_max=MILLIMETRES), [1, 1, 0.5, 0]),
        (np.interp(fp=FORCE[:2], x=METRES[:1], xp=MILLIMETRES[[2, 0]]), [2.0]),
        (np.allclose(METRES, METRES.to("mm")), True),
        (np.interp(METRES[3:], METRES[:2], FORCE[:2], right=Series("k", unit("kN"), np.array(0.007))), [7.0]),
        (np.diff(METRES, prepend=MILLIMETRES[1:2]), [-1, 0, -0.5, 2.5]),
        (METRES.max(initial=TALL), 9.0), (np.add.reduce(METRES, initial=TALL), 14.5),
        (np.unwrap(Series("x", unit("deg"), [0.0, 170.0, -20.0])), [0, 170, 340]),
    ],
)  # fmt: skip
def test_what_is_put_side_by_side_has_the_unit_of_the_first(found, expected):
    assert not isinstance(found, Series)
    assert found == pytest.approx(np.array(expected), abs=1e-12)


@pytest.mark.parametrize(
    "joined",
    [
        lambda: np.concatenate([TORQUE, FORCE]), lambda: np.where(X > 0, METRES, FORCE),
        lambda: np.interp(METRES, ANGLE, FORCE),
        lambda: np.diff(TORQUE, prepend=FORCE[:1]), lambda: np.unwrap(METRES),
    ],
)  # fmt: skip
def test_different_dimensions_do_not_stand_side_by_side(joined):
    with pytest.raises(UnitError, match="do not go together"):
        joined()


def test_a_doubt_stays():
    doubted = Series("F", unit("N"), X, "hyperstatic of degree 1")
    for found in (2.0 * doubted, METRES * doubted, -doubted, doubted[1:], doubted.to("kN"), np.sqrt(doubted * doubted)):
        assert found.doubt == "hyperstatic of degree 1"
    assert (METRES * 2.0).doubt == ""
