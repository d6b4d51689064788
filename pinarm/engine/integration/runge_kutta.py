"""Explicit Runge-Kutta methods: their coefficients, stages, error, step control, dense output.

Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, 2nd edition.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pinarm.arrays import Array, Indices
from pinarm.records import Record

SAFETY, GAIN, SLOWEST, FASTEST = 0.8, 0.8, 1 / 3, 6.0
"""Safety factor, gain of the step controller, and bounds of the factor by which a step changes.
Measured on double pendulums at errors of 1e-4 to 1e-10: 14 % of the steps are refused and 10 to 13 % fewer evaluations
needed than with the 0.9 and 1 of Hairer, Norsett and Wanner, section II.4, by which 25 % are refused. More caution than
this saves no more, and loses where rounding is blown up."""

LOST, HUGE = 0.1, 1e300
"""Factor of the step after an error above ``HUGE`` or NaN."""

TINY = 1e-300
"""Smallest error in powers and quotients, which keeps them finite."""

SHORTEST = 16.0
"""Smallest step, in units in the last place of t: in shorter ones ``t + c h`` of some stage equals t."""

NOISE = 1e-6
"""Error of a step, relative to ``1 + |y|``, up to which amplified rounding near a singular position explains it."""

NOISELESS = 1e-8
"""Smallest trial step for the first step, relative to the duration: a state that is 0 but for rounding would give a
smaller one."""

Rates = Callable[[Any, Array], Array]
"""``(t, y) -> slopes`` of states, which are projected onto the manifold in place; shapes (...), (..., n), (..., n)."""


class Tableau(Record, frozen=True):
    """The coefficients of an explicit Runge-Kutta method with dense output, and of its error estimate if it has one.

    Stage i is ``k_i = f(t + c_i h, y + h sum_j a_ij k_j)``; the step is ``y + h sum_i b_i k_i``, and ``k_s``,
    behind the s stages, is the slope at its end, which is also the first slope of the next step.

    Attributes:
        error_order: The error estimate behaves like ``h^(error_order + 1)``; 0 where there is none.
        stability: ``h |lambda|`` just below the end of the stability interval on the negative real axis.
        a: Shape (s, s), strictly lower triangular.
        b: Shape (s,).
        c: Shape (s,).
        error: Weights of the error estimates over ``k_0 .. k_s``, shape (m, s + 1); see ``error_of``.
        dense_a: Further stages that only the dense output needs, shape (e, s + 1 + e).
        dense_c: Their times, shape (e,).
        dense_d: Weights of the higher terms of the interpolant over all stages, shape (d, s + 1 + e).
    """

    name: str
    order: int
    error_order: int
    stability: float
    a: Array
    b: Array
    c: Array
    error: Array
    dense_a: Array
    dense_c: Array
    dense_d: Array

    @property
    def stages(self) -> int:
        """Number of stages, without the slope at the end of the step."""
        return len(self.b)

    @cached_property
    def rows(self) -> list[tuple[Array, float]]:
        """Weights over the earlier slopes, and time, of every stage but the first; last those of the step itself."""
        weights = [self.a[i, :i] for i in range(1, self.stages)]
        return list(zip([*weights, self.b], [*self.c[1:].tolist(), 1.0], strict=True))

    @cached_property
    def dense_rows(self) -> list[tuple[Array, float]]:
        """Weights and times of the stages that only the dense output needs; see ``rows``."""
        known = self.stages + 1
        return [(row[: known + k], float(c)) for k, (row, c) in enumerate(zip(self.dense_a, self.dense_c, strict=True))]


def stages(rows: Sequence[tuple[Array, float]], rates: Rates, t: Any, h: Any, y: Array, slopes: Array) -> Array:
    """Compute further stages ``k_i = f(t + c_i h, y + h sum_j a_ij k_j)``; return the state of the last one.

    Args:
        rows: Weights ``a_ij`` over the earlier slopes, and time ``c_i``, of each stage.
        rates: f.
        t: Starts of the steps [s], shape (...).
        y: States at the starts, shape (..., n).
        slopes: The known slopes; those of the stages are written behind them, shape (..., s, n).
    """
    state, lengths = y, np.asarray(h)[..., None]
    for weights, c in rows:
        i = len(weights)
        state = y + lengths * (weights @ slopes[..., :i, :])
        slopes[..., i, :] = rates(t + c * h, state)
    return state


def error_of(tableau: Tableau, h: float, y: Array, new: Array, slopes: Array, scale: tuple[float, float]) -> float:
    """Return the error of a step from y to ``new``; Hairer, Norsett, Wanner, section II.10, eq. (10.17).

    ``e = |h| rms(error @ k / scale)``; with a second estimate e3 of lower order it is ``e5^2 / sqrt(e5^2 + 0.01
    e3^2)``, which has the order of the step. The scale is a tolerance and a size: an error of 1 is ``tolerance
    (size + max(|y|, |new|))``. Slopes at the stages have the shape (s + 1, n).
    """
    tolerance, size = scale
    errors = (tableau.error @ slopes) / (size + np.maximum(np.abs(y), np.abs(new)))
    first, *lower = map(float, np.vecdot(errors, errors))
    usual = first / max(math.sqrt(first + 0.01 * sum(lower)), TINY)
    return abs(h) / (tolerance * math.sqrt(len(y))) * (usual if first else math.sqrt(sum(lower)))


def growth(error: float, order: int, ceiling: float) -> float:
    """Return the factor of the next step after an accepted one: ``min(ceiling, 0.8 error^(-0.8 / order))``.

    A damped integral controller: Soderlind, Digital filters in adaptive time-stepping, ACM TOMS 29 (2003), section 2.
    """
    return float(min(ceiling, SAFETY * max(error, TINY) ** (-GAIN / order)))


def shrinkage(error: float, order: int) -> float:
    """Return the factor of the next try after a rejected step: ``max(1/3, 0.8 error^(-1 / order))``.

    After errors above ``HUGE`` or NaN it is ``LOST``.
    """
    return float(max(SLOWEST, SAFETY * max(error, TINY) ** (-1.0 / order))) if error < HUGE else LOST


class Steps(Record, frozen=True):
    """Accepted steps of a motion in order of time, column by column.

    Attributes:
        t: Starts [s], shape (n,).
        h: Lengths [s].
        until: Ends [s]: ``t + h`` to rounding, or earlier where an event ended the step.
        y: States at the starts, shape (n, nq + nv).
        slopes: Slopes at the stages of each, shape (n, stages, nq + nv).
        work: Evaluations, rejected and floored steps up to the end of each, shape (n, 3).
    """

    t: Array = np.empty(0)
    h: Array = np.empty(0)
    until: Array = np.empty(0)
    y: Array = np.empty((0, 0))
    slopes: Array = np.empty((0, 0, 0))
    work: Indices = np.empty((0, 3), np.intp)

    def __len__(self) -> int:
        return len(self.t)

    @property
    def columns(self) -> list[NDArray[Any]]:
        return [self.t, self.h, self.until, self.y, self.slopes, self.work]

    def some(self, index: Indices | slice) -> Steps:
        return Steps(*(column[index] for column in self.columns))


def first_step(
    time: tuple[float, float], y: Array, slope: Array, rates: Rates, tolerance: float, order: int, size: float = 1.0
) -> Array:
    """Return the first steps of m motions from ``time[0]`` to ``time[1]`` [s], from the slopes at two states of each.

    With the norm ``|x| = rms(x / (tol (size + |y|)))``: ``h0 = 0.01 |y| / |f|``, ``d2 = |f(t + h0, y + h0 f) - f| /
    h0``, ``h1 = (0.01 / max(|f|, d2))^(1 / (order + 1))``, ``h = min(100 h0, h1)``. Source: Hairer, Norsett,
    Wanner, Solving Ordinary Differential Equations I, section II.4.

    Args:
        y: States at the start, shape (m, n).
        slope: Their slopes, shape (m, n).
        rates: f at instants, shape (m,), of states, shape (m, n).
    """
    (start, end), scale = time, tolerance * y.shape[1] ** 0.5 * (size + np.abs(y))
    d0, d1 = (np.linalg.norm(x / scale, axis=1) for x in (y, slope))
    h0 = np.where(np.minimum(d0, d1) < 1e-5, 1e-6, 0.01 * d0 / np.maximum(d1, 1e-5))
    h0 = np.clip(h0, NOISELESS * (end - start), end - start)
    change = rates(start + h0, y + h0[:, None] * slope) - slope
    steepest = np.fmax(d1, np.linalg.norm(change / scale, axis=1) / h0)
    h1 = (0.01 / np.maximum(steepest, 1e-15)) ** (1.0 / (order + 1))
    return np.minimum(100.0 * h0, np.where(steepest <= 1e-15, np.maximum(1e-6, 1e-3 * h0), h1))


def dense_terms(tableau: Tableau, rates: Rates, steps: Steps) -> Array:
    """Return the terms r of polynomials over n steps, see ``Solution``; Hairer, Norsett, Wanner, section II.6.

    ``r_0 = y_new - y``, ``r_1 = h k_0 - r_0``, ``r_2 = 2 r_0 - h (k_0 + k_s)``; the higher ones are ``h dense_d @ k``
    over all stages, those of ``dense_a`` included. Shape (n, d, nq + nv).
    """
    s = tableau.stages + 1
    known = np.empty((len(steps), s + len(tableau.dense_c), steps.y.shape[1]))
    known[:, :s] = steps.slopes
    stages(tableau.dense_rows, rates, steps.t, steps.h, steps.y, known)
    known *= steps.h[:, None, None]
    change, first, last = tableau.b @ known[:, : s - 1], known[:, 0], known[:, s - 1]
    lowest = np.stack([change, first - change, 2 * change - first - last], axis=1)
    return np.concatenate([lowest, tableau.dense_d @ known], axis=1)


def middle(terms: Array) -> tuple[Array, Array]:
    """Return change and slope of polynomials in the middle of their steps, relative to the start and to 1 / h."""
    change, slope = np.zeros((2, *terms[:, 0].shape))
    for k in reversed(range(terms.shape[1])):
        slope = 0.5 * slope + (-1.0) ** k * (change + terms[:, k])
        change = 0.5 * (change + terms[:, k])
    return change, slope


def _matrix(rows: tuple[tuple[float, ...], ...], width: int) -> Array:
    return np.array([[*row, *(0.0,) * (width - len(row))] for row in rows])


# Dormand and Prince's 8(5,3) pair, dense output of order 7: Hairer, Norsett, Wanner, Solving Ordinary Differential
# Equations I, 2nd edition, section II.5 and II.6; rows 13 to 16 of _A are the stages of the dense output.
# fmt: off
_C = (0, 0.05260015195876773, 0.0789002279381516, 0.1183503419072274, 0.2816496580927726, 0.3333333333333333, 0.25, 0.3076923076923077, 0.6512820512820513, 0.6, 0.8571428571428571, 1.0, 1.0, 0.1, 0.2, 0.7777777777777778)
_A = (
    (),
    (0.05260015195876773,),
    (0.0197250569845379, 0.0591751709536137),
    (0.02958758547680685, 0, 0.08876275643042054),
    (0.2413651341592667, 0, -0.8845494793282861, 0.924834003261792),
    (0.037037037037037035, 0, 0, 0.17082860872947386, 0.12546768756682242),
    (0.037109375, 0, 0, 0.17025221101954405, 0.06021653898045596, -0.017578125),
    (0.03709200011850479, 0, 0, 0.17038392571223998, 0.10726203044637328, -0.015319437748624402, 0.008273789163814023),
    (0.6241109587160757, 0, 0, -3.3608926294469414, -0.868219346841726, 27.59209969944671, 20.154067550477894, -43.48988418106996),
    (0.47766253643826434, 0, 0, -2.4881146199716677, -0.590290826836843, 21.230051448181193, 15.279233632882423, -33.28821096898486, -0.020331201708508627),
    (-0.9371424300859873, 0, 0, 5.186372428844064, 1.0914373489967295, -8.149787010746927, -18.52006565999696, 22.739487099350505, 2.4936055526796523, -3.0467644718982196),
    (2.273310147516538, 0, 0, -10.53449546673725, -2.0008720582248625, -17.9589318631188, 27.94888452941996, -2.8589982771350235, -8.87285693353063, 12.360567175794303, 0.6433927460157636),
    (0.054293734116568765, 0, 0, 0, 0, 4.450312892752409, 1.8915178993145003, -5.801203960010585, 0.3111643669578199, -0.1521609496625161, 0.20136540080403034, 0.04471061572777259),
    (0.056167502283047954, 0, 0, 0, 0, 0, 0.25350021021662483, -0.2462390374708025, -0.12419142326381637, 0.15329179827876568, 0.00820105229563469, 0.007567897660545699, -0.008298),
    (0.03183464816350214, 0, 0, 0, 0, 0.028300909672366776, 0.053541988307438566, -0.05492374857139099, 0, 0, -0.00010834732869724932, 0.0003825710908356584, -0.00034046500868740456, 0.1413124436746325),
    (-0.42889630158379194, 0, 0, 0, 0, -4.697621415361164, 7.683421196062599, 4.06898981839711, 0.3567271874552811, 0, 0, 0, -0.0013990241651590145, 2.9475147891527724, -9.15095847217987),
)
_E = (
    (0.01312004499419488, 0, 0, 0, 0, -1.2251564463762044, -0.4957589496572502, 1.6643771824549864, -0.35032884874997366, 0.3341791187130175, 0.08192320648511571, -0.022355307863886294),
    (-0.18980075407240762, 0, 0, 0, 0, 4.450312892752409, 1.8915178993145003, -5.801203960010585, -0.4226823213237919, -0.1521609496625161, 0.20136540080403034, 0.02265179219836082),
)
_D = (
    (-8.428938276109013, 0, 0, 0, 0, 0.5667149535193777, -3.0689499459498917, 2.38466765651207, 2.117034582445028, -0.871391583777973, 2.2404374302607883, 0.6315787787694688, -0.08899033645133331, 18.148505520854727, -9.194632392478356, -4.436036387594894),
    (10.427508642579134, 0, 0, 0, 0, 242.28349177525817, 165.20045171727028, -374.5467547226902, -22.113666853125306, 7.733432668472264, -30.674084731089398, -9.332130526430229, 15.697238121770845, -31.139403219565178, -9.35292435884448, 35.81684148639408),
    (19.985053242002433, 0, 0, 0, 0, -387.0373087493518, -189.17813819516758, 527.8081592054236, -11.57390253995963, 6.8812326946963, -1.0006050966910838, 0.7777137798053443, -2.778205752353508, -60.19669523126412, 84.32040550667716, 11.99229113618279),
    (-25.69393346270375, 0, 0, 0, 0, -154.18974869023643, -231.5293791760455, 357.6391179106141, 93.40532418362432, -37.45832313645163, 104.0996495089623, 29.8402934266605, -43.53345659001114, 96.32455395918828, -39.17726167561544, -149.72683625798564),
)
# fmt: on

DOP853 = Tableau(
    name="Dormand-Prince 8(5,3)",
    order=8,
    error_order=7,
    stability=6.1,
    a=_matrix(_A[:12], 12),
    b=np.array(_A[12]),
    c=np.array(_C[:12]),
    error=_matrix(_E, 13),
    dense_a=_matrix(_A[13:], 16),
    dense_c=np.array(_C[13:]),
    dense_d=_matrix(_D, 16),
)

# Dormand and Prince's 5(4) pair, dense output of order 4: the same book, table 5.2 and the code DOPRI5 in its appendix.
DOPRI5 = Tableau(
    name="Dormand-Prince 5(4)",
    order=5,
    error_order=4,
    stability=3.25,
    a=_matrix(
        (
            (),
            (1 / 5,),
            (3 / 40, 9 / 40),
            (44 / 45, -56 / 15, 32 / 9),
            (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
            (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
        ),
        6,
    ),
    b=np.array([35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84]),
    c=np.array([0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1]),
    error=np.array([[71 / 57600, 0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40]]),
    dense_a=np.zeros((0, 7)),
    dense_c=np.zeros(0),
    dense_d=np.array([[
        -12715105075 / 11282082432, 0, 87487479700 / 32700410799, -10690763975 / 1880347072,
        701980252875 / 199316789632, -1453857185 / 822651844, 69997945 / 29380423,
    ]]),
)  # fmt: skip

# The classical method of Kutta (1901); the same book, table 1.2. Its dense output is the cubic through both ends.
RK4 = Tableau(
    name="Runge-Kutta 4",
    order=4,
    error_order=0,
    stability=2.7,
    a=_matrix(((), (1 / 2,), (0, 1 / 2), (0, 0, 1)), 4),
    b=np.array([1 / 6, 1 / 3, 1 / 3, 1 / 6]),
    c=np.array([0, 1 / 2, 1 / 2, 1]),
    error=np.zeros((0, 5)),
    dense_a=np.zeros((0, 5)),
    dense_c=np.zeros(0),
    dense_d=np.zeros((0, 5)),
)
