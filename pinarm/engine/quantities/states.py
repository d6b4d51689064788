"""States of their own, asked for by a library's user: arrays of q, v and a in, every named quantity out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags, real
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.constraint import one_sided
from pinarm.engine.constraints.constraint_rows import BLOCK, EvaluatedRows
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.equation import accelerations
from pinarm.engine.dynamics.masses import require_masses
from pinarm.engine.motion.standstill import directions, lossy, row_paces
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.broadcasting import LeadingAxes, refuse_foreign
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.series import Series, require_unit
from pinarm.engine.statics.actuation import Actuation, actuation, everywhere
from pinarm.errors import InputError, require_map
from pinarm.input.units import Unit, unit
from pinarm.mechanics.ball_joints import configuration, places_of, positions_of, unit_of, velocities_of
from pinarm.mechanics.laws.motion_law import SECOND, Grid
from pinarm.mechanics.loading.pinocchio_layout import UNIT
from pinarm.records import replace

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pinarm.engine.mechanism import Mechanism

CLOSED = 1e-8
"""How far a given state may tear a loop, relative to ``1 +`` the terms of the row: typed digits explain as much."""

OPENED = 1e-9
"""Part of the loads by which a cable may push, or a cam pull: rounding of what they cancel explains as much."""

PER_TIME = {"positions": "", "velocities": "/s", "accelerations": "/s^2"}
SINGULAR = ", whatever the efforts: the position is singular, or so near one that it is not told from it"

NO_DRIVES = "the mechanism has loops, and no drives are named that carry the load: drives=[...]"


@dataclass(frozen=True, eq=False)
class States:
    """The quantities of states by name.

    Attributes:
        rows: The same, one row for every state.
        leading: The leading axes that the states were given in.
    """

    rows: Quantities
    leading: LeadingAxes

    def __getitem__(self, name: str) -> Series:
        """Return a quantity by its name, a symbol, or a formula, its values with the leading axes of the states.

        Raises:
            InputError: There is no such quantity; the message lists what there is.
        """
        series = self.rows[name]
        return replace(series, values=self.leading.unfold(series.values))

    def __repr__(self) -> str:
        """Return of which mechanism they are, and the shape in which they were given."""
        return f"<States of '{self.rows.trajectory.mechanism.title}': shape {self.leading.shape}>"

    def names(self) -> list[str]:
        """Return the names of all quantities."""
        return self.rows.names()


def configurations(mechanism: Mechanism, positions: Mapping[str, ArrayLike]) -> Array:
    """Return configurations from joint coordinates by name.

    Args:
        mechanism: The mechanism.
        positions: Joint -> values [rad or m], arrays of one shape (...) or single numbers; what is not named is 0. Ball
            joints by their components, as in ``mechanics.balls.configuration``.

    Returns:
        q, shape (..., nq).

    Raises:
        InputError: A joint does not exist, or the shapes differ.
    """
    require_map(positions, "positions", "{'knee': 0.5}")
    model, joints, balls = mechanism.model, mechanism.joints, mechanism.balls
    shape, columns = columns_of(positions, {name: (of,) for name, of in positions_of(joints, balls).items()})
    if all(name in joints for name in positions):
        rows = np.tile(np.asarray(pin.neutral(model)), (*shape, 1))
        for name, column in columns.items():
            rows[..., joints[name].q] = column
        return rows
    named = [dict(zip(columns, row, strict=True)) for row in zip(*map(np.ravel, columns.values()), strict=True)]
    found = np.array([configuration(model, joints, balls, values) for values in named])
    return found.reshape(*shape, model.nq)


def rates(mechanism: Mechanism, values: Mapping[str, ArrayLike]) -> Array:
    """Return velocities, accelerations or efforts of joints by name, shape (..., nv); see ``configurations``.

    Those of a ball joint J are ``J.angular_velocity.x`` and so on, in the axes of the link, whatever they are.
    """
    require_map(values, "values of joints", "{'knee': 0.5}")
    known, places = velocities_of(mechanism.joints, mechanism.balls), places_of(mechanism.joints, mechanism.balls)
    for name in values:
        unit_of(name, known)
    effort = {unit("m/s"): unit("N")}
    measures = {name: (rate, rate / unit("s"), effort.get(rate, unit("N*m"))) for name, rate in known.items()}
    shape, columns = columns_of(values, measures)
    rows = np.zeros((*shape, mechanism.model.nv))
    for name, column in columns.items():
        rows[..., places[name]] = column
    return rows


def columns_of(
    values: Mapping[str, ArrayLike], units: Mapping[str, Sequence[Unit]]
) -> tuple[tuple[int, ...], dict[str, Array]]:
    """Return the shape that values share, and each of them in it, in SI.

    Args:
        values: Values by name.
        units: Name -> what it may be measured in; others are refused elsewhere.

    Raises:
        InputError: Their shapes do not go together, or they are no numbers.
        UnitError: They measure something else.
    """
    for name, value in values.items():
        if name in units:
            require_unit(value, name, *units[name])
    given = [real(value, name) for name, value in values.items()]
    try:
        columns = np.broadcast_arrays(*given)
    except ValueError:
        shapes = ", ".join(f"{name}: {np.shape(value)}" for name, value in values.items())
        raise InputError(f"the arrays have the shapes {shapes}", expected="one shape, or single numbers") from None
    return columns[0].shape if columns else (), dict(zip(values, columns, strict=True))


def instant(t: float) -> float:
    """Return an instant [s].

    Raises:
        InputError: It is no finite number.
        UnitError: It has a unit that is none of time.
    """
    require_unit(t, "t", SECOND)
    found = real(t, "t")
    if found.ndim or not np.isfinite(found):
        raise InputError("t is not an instant", expected="one finite number [s]")
    return float(found)


def quantities(
    mechanism: Mechanism, q: Array, v: Array | None, a: Array | None, tau: Array | None, drives: Sequence[str], t: float
) -> States:
    """Return the quantities of states; see ``Mechanism.at``."""
    nq, nv, t = mechanism.model.nq, mechanism.model.nv, instant(t)
    if a is not None and tau is not None:
        raise InputError("accelerations and efforts are given", expected="one of them: the other one follows")
    rates = {name: (x, nv) for name, x in (("v", v), ("a", a), ("tau", tau)) if x is not None}
    refuse_foreign(mechanism, q, v=v, a=a, tau=tau)
    leading, rows = LeadingAxes.fold(q=(q, nq), **rates)
    check_quaternions(mechanism, leading, rows[0])
    named = {name: x.copy() for name, x in zip(("q", *rates), rows, strict=True)}  # quantities are computed when asked
    found = _quantities(mechanism, leading, named, drives, t)
    return States(found, leading)


def _quantities(
    mechanism: Mechanism, leading: LeadingAxes, given: Mapping[str, Array], drives: Sequence[str], t: float
) -> Quantities:
    """Return the quantities of rows of states: q, and what is given of v, a and tau."""
    q, still = given["q"], np.zeros((len(given["q"]), mechanism.model.nv))
    v, tau, after = given.get("v", still), given.get("tau"), float(np.nextafter(t, np.inf))
    dynamics, closure = mechanism.dynamics.on(t, after), mechanism.closure
    friction, others = _frictions(mechanism, dynamics, t, q, v, tau)
    loads = _friction_loads(mechanism, q, friction)
    a = given.get("a", still) if tau is None else _forward(mechanism, dynamics, t, q, v, tau + loads)
    check = _check_closed if tau is None else _check_found
    check(closure, leading, q, v, a)
    run = _rows(mechanism, t, q, v, a)
    demand = dynamics.inverse(t, q, v, a)
    if lossy(mechanism):
        terms = a if tau is None else np.maximum(np.abs(a), np.abs(_forward(mechanism, dynamics, t, q, v, still)))
        paces = row_paces(mechanism, v, terms)  # efforts that hold leave accelerations of their rounding
        run = replace(run, directions=directions(v, a, paces, np.ones(len(q)), still))
    if tau is not None:
        run = _under(replace(run, tau=tau), demand - tau, friction, others)
        if one_sided(mechanism.constraints):
            _check_sides(dynamics, leading, run, demand)
        return Quantities(run)
    acting = actuation(mechanism, drives, drives) if drives else everywhere(mechanism)
    if acting is None:
        return Quantities(replace(run, no_efforts=NO_DRIVES))
    run = replace(run, closure=acting.closure, driven=acting.driven, drives=(*acting.coordinates(mechanism),))
    return Quantities(_driven(run, acting, demand))


def _under(run: Trajectory, demand: Array, friction: Array, others: Sequence[tuple[Array, Flags]]) -> Trajectory:
    """Return states with their friction and multipliers, and with others that hold as well; see ``filled``."""
    if not run.mechanism.frictions:
        return replace(run, lam=Multipliers.least(run.mechanism.closure, run.q, demand, np.zeros((len(run), 0))))
    from pinarm.engine.friction.columns import friction_columns
    from pinarm.engine.friction.extremes import held_part

    def under(friction: Array) -> Trajectory:
        held = demand - _friction_loads(run.mechanism, run.q, friction)
        lam = Multipliers.least(run.mechanism.closure, run.q, held, np.zeros((len(run), 0)))
        return replace(run, lam=lam, columns=friction_columns(run.mechanism.frictions, friction))

    rows, found = under(friction), list[Trajectory]()
    for other, endless in others:
        part = held_part(run.mechanism.closure, rows.lam, under(other).lam)
        far = endless & (part == 1.0)
        within = under(friction + part[:, None] * (other - friction))
        found.append(replace(within, endless=far if far.any() else None))
    return replace(rows, others=tuple(found))


def _driven(run: Trajectory, acting: Actuation, demand: Array) -> Trajectory:
    """Return states with the efforts of drives, and with friction that sticks."""
    if run.mechanism.frictions:
        from pinarm.engine.motion.known_friction import KnownFriction

        paces = row_paces(run.mechanism, run.v, run.a)
        return KnownFriction(run, acting, demand, paces, np.ones(len(run)), np.zeros_like(run.v)).solved()
    tau, lam = acting.efforts(run.grid.t, run.q, demand)
    return replace(run, tau=tau, lam=lam)


def _frictions(
    mechanism: Mechanism, dynamics: Dynamics, t: float, q: Array, v: Array, tau: Array | None
) -> tuple[Array, list[tuple[Array, Flags]]]:
    """Return the friction under efforts, shape (n, k), and others that hold as well; 0 where efforts are not given."""
    contacts = mechanism.frictions
    if tau is None or not contacts:
        return np.zeros((len(q), len(contacts))), []
    from pinarm.engine.friction.given_efforts import friction_under

    return friction_under(contacts, dynamics, mechanism.closure, t, q, v, tau)


def _friction_loads(mechanism: Mechanism, q: Array, friction: Array) -> Array:
    """Return friction along the slips as generalised loads, shape (n, nv)."""
    if not mechanism.frictions:
        return np.zeros((len(q), mechanism.model.nv))
    from pinarm.mechanics.friction.contact import slip_rows

    return np.asarray(np.vecmat(friction, slip_rows(mechanism.model, mechanism.frictions, q)))


def _rows(mechanism: Mechanism, t: float, q: Array, v: Array, a: Array) -> Trajectory:
    """Return states of their own as a table, without efforts."""
    closure = mechanism.closure
    grid = Grid(np.full(len(q), float(t)), (float(t), float(np.nextafter(t, np.inf))), (0, len(q)))
    return Trajectory(
        mechanism, "t", unit("s"), grid, q, v, a, np.zeros_like(v), Multipliers.zero(len(q), closure.size), closure,
        mechanism.dynamics, separate=True,
    )  # fmt: skip


def inverse(mechanism: Mechanism, q: Array, v: Array, a: Array, drives: Sequence[str], t: float) -> Array:
    """Return the efforts of the drives; see ``Mechanism.inverse``."""
    acting = actuation(mechanism, drives, drives) if drives else everywhere(mechanism)
    if acting is None:
        names = ", ".join(constraint.name for constraint in mechanism.constraints)
        raise InputError(f"the joints of this mechanism are tied by {names}", expected="drives that carry the load",
                         hint="inverse(q, v, a, drives=[...])")  # fmt: skip
    nv, t = mechanism.model.nv, instant(t)
    refuse_foreign(mechanism, q, v=v, a=a)
    leading, (q, v, a) = LeadingAxes.fold(q=(q, mechanism.model.nq), v=(v, nv), a=(a, nv))
    check_quaternions(mechanism, leading, q)
    dynamics = mechanism.dynamics.on(t, np.nextafter(t, np.inf))
    demand = dynamics.inverse(t, q, v, a)
    _check_closed(mechanism.closure, leading, q, v, a)
    sided = one_sided(mechanism.constraints)
    if not mechanism.frictions and not sided:
        return leading.unfold(acting.efforts(np.full(len(q), float(t)), q, demand)[0])
    run = _driven(replace(_rows(mechanism, t, q, v, a), closure=acting.closure), acting, demand)
    if sided:
        _check_sides(dynamics, leading, run, demand)
    return leading.unfold(run.tau)


def forward(mechanism: Mechanism, q: Array, v: Array, tau: Array | None, t: float) -> Array:
    """Return the accelerations under efforts; see ``Mechanism.forward``."""
    t, nv = instant(t), mechanism.model.nv
    dynamics = mechanism.dynamics.on(t, np.nextafter(t, np.inf))
    given = {} if tau is None else {"tau": (tau, nv)}
    refuse_foreign(mechanism, q, v=v, tau=tau)
    leading, (q, v, *efforts) = LeadingAxes.fold(q=(q, mechanism.model.nq), v=(v, nv), **given)
    check_quaternions(mechanism, leading, q)
    tau = efforts[0] if efforts else np.zeros_like(v)
    friction = _frictions(mechanism, dynamics, t, q, v, tau)[0]
    a = _forward(mechanism, dynamics, t, q, v, tau + _friction_loads(mechanism, q, friction))
    _check_found(mechanism.closure, leading, q, v, a)
    if one_sided(mechanism.constraints):
        demand = dynamics.inverse(t, q, v, a)
        run = _under(replace(_rows(mechanism, t, q, v, a), tau=tau), demand - tau, friction, [])
        _check_sides(dynamics, leading, run, demand)
    return leading.unfold(a)


def check_quaternions(mechanism: Mechanism, leading: LeadingAxes, q: Array) -> None:
    """Raise where a quaternion has not the length 1.

    Raises:
        InputError: Says which.
    """
    for ball in mechanism.balls.values():
        lengths = np.linalg.norm(ball.quaternion(q), axis=1)
        for row in np.flatnonzero(np.abs(lengths - 1.0) > UNIT)[:1]:
            said = f"{leading.place(int(row))}: the quaternion of '{ball.name}' has the length {lengths[row]:.6g}"
            raise InputError(said, expected="(x, y, z, w) of length 1", hint="configurations({...}) makes them")


def _forward(mechanism: Mechanism, dynamics: Dynamics, t: float, q: Array, v: Array, tau: Array) -> Array:
    """Return the accelerations under efforts, shape (n, nv): of open chains by ``aba``.

    Raises:
        DynamicsError: Something without mass is free to move.
    """
    if not mechanism.massive:
        require_masses(mechanism.closure, q, t)
    closure = mechanism.closure
    return accelerations(dynamics, closure, t, q, v, tau) if closure.size else dynamics.forward(t, q, v, tau)


def _check_sides(dynamics: Dynamics, leading: LeadingAxes, run: Trajectory, demand: Array) -> None:
    """Raise where a cable would have to push, or a cam that pushes only to pull, however constraints share the load.

    Args:
        dynamics: The forces at the instant of the states.
        leading: The leading axes of the states.
        run: The states with their multipliers.
        demand: ``M a + nle - loads``, shape (n, nv).

    Raises:
        InputError: Says which, in which state, and with what.
    """
    closure = run.mechanism.closure
    lam, sided = np.asarray(run.lam)[:, : closure.size], one_sided(run.mechanism.constraints)
    at_rest = dynamics.inverse(float(run.grid.t[0]), run.q, run.v, np.zeros_like(run.v))
    loads = np.maximum(np.abs(demand), np.abs(at_rest)).max(axis=1)
    sides = {closure.slices[one.name].start: one.side for one in sided}
    for one, k in zip(sided, sides, strict=True):
        for i in np.flatnonzero(one.side * lam[:, k] < 0.0).tolist():
            rows = np.asarray(closure.rows(closure.state(run.q[i])))
            if np.abs(lam[i, k] * rows[k]).max() <= OPENED * loads[i] or _is_shared(rows, lam[i], sides):
                continue
            size = abs(float(one.push(run.q[i : i + 1], lam[i : i + 1, k])[0]))
            act = f"{'push' if one.kind == 'cable' else 'pull'} with {size:.6g} {one.push_unit()}"
            said = f"{leading.place(i)}: {one.kind} '{one.name}' would have to {act}: {one.opens}"
            raise InputError(said, expected="states and efforts under which it holds",
                             hint="a scenario of the kind forward, in which it may open")  # fmt: skip


def _is_shared(rows: Array, lam: Array, sides: Mapping[int, float]) -> bool:
    """Tell whether other multipliers give the same loads, without one against its side.

    Args:
        rows: G, shape (m, nv).
        lam: Multipliers, shape (m,).
        sides: Row -> sign that its multiplier may have.
    """
    if np.linalg.matrix_rank(rows) == len(rows):
        return False
    from scipy.optimize import lsq_linear

    least, most = np.full(len(lam), -np.inf), np.full(len(lam), np.inf)
    for row, side in sides.items():
        (least if side > 0.0 else most)[row] = 0.0
    load = rows.T @ lam
    found = lsq_linear(rows.T, load, (least, most), tol=1e-14)
    return bool(np.abs(found.fun).max() <= OPENED * np.abs(load).max())


class _Tear(NamedTuple):
    """What of a state tears a loop or a coupling, and in words which, in which row, and by how much."""

    what: str
    said: str


def _check_closed(closure: Closure, leading: LeadingAxes, q: Array, v: Array, a: Array) -> None:
    """Raise where a given state tears a loop or a coupling.

    Raises:
        InputError: Says which, in which row, and by how much.
    """
    for tear in _tears(closure, leading, q, v, a):
        raise InputError(tear.said, expected="states that the loops and couplings allow")


def _check_found(closure: Closure, leading: LeadingAxes, q: Array, v: Array, a: Array) -> None:
    """Raise as ``_check_closed`` does, where accelerations have been found of efforts.

    These tear loops at singular positions only, where velocities are not along one of the motions that meet there, and
    next to them.

    Raises:
        InputError: As there.
    """
    for tear in _tears(closure, leading, q, v, a):
        if tear.what == "accelerations":
            raise InputError(tear.said + SINGULAR, expected="velocities along one of the motions that meet there")
        raise InputError(tear.said, expected="states that the loops and couplings allow")


def _tears(closure: Closure, leading: LeadingAxes, q: Array, v: Array, a: Array) -> Iterator[_Tear]:
    """Yield what tears a loop or a coupling, row by row: positions before rates."""
    for i in _suspects(closure, q, v, a):
        state = closure.state(q[i], v[i])
        rows, gap, drift = closure.rows(state), closure.gap(state), closure.drift(state)
        sizes = np.abs(rows)
        for what, left, terms in (
            ("positions", gap, np.zeros_like(gap)), ("velocities", rows @ v[i], sizes @ np.abs(v[i])),
            ("accelerations", rows @ a[i] + drift, sizes @ np.abs(a[i]) + np.abs(drift)),
        ):  # fmt: skip
            excess = np.abs(left) - CLOSED * (1.0 + terms)
            worst = int(excess.argmax())
            if excess[worst] > 0.0:
                constraint, row = closure.owners()[worst]
                torn = f"tear '{constraint.name}' by {abs(left[worst]):.3g} {constraint.unit(row)}"
                yield _Tear(what, f"{leading.place(i)}: the {what} {torn}{PER_TIME[what]}")


def _suspects(closure: Closure, q: Array, v: Array, a: Array) -> Iterator[int]:
    """Yield the rows that may tear a loop or a coupling: those beyond half of what typed digits explain."""
    for start in range(0, len(q) if closure.size else 0, BLOCK):
        part = slice(start, start + BLOCK)
        yield from (start + np.flatnonzero(_torn(closure.constraint_rows.at(q[part]), v[part], a[part]))).tolist()


def _torn(measured: EvaluatedRows, v: Array, a: Array) -> Flags:
    """Return which configurations, velocities and accelerations, each of shape (n, nv), are suspect, shape (n,)."""
    torn, drifts = (np.abs(measured.gaps) > 0.5 * CLOSED).any(axis=1), measured.drifts(v)
    for rates, left in ((v, np.zeros_like(drifts)), (a, drifts)):
        total, terms = measured.times(rates)
        torn |= (np.abs(total + left) > 0.5 * CLOSED * (1.0 + terms + np.abs(left))).any(axis=1)
    return np.asarray(torn)


def from_pinocchio(mechanism: Mechanism, q: ArrayLike, v: ArrayLike | None) -> tuple[Array, Array]:
    """Return q and v from those of ``pin.buildModelFromUrdf``; see ``Mechanism.from_pinocchio``."""
    layout = mechanism.pinocchio_layout
    leading, rows = _states(q, v, layout.p_nq, layout.p_nv)
    positions, velocities = layout.take(*rows)
    return leading.unfold(positions), leading.unfold(velocities)


def to_pinocchio(mechanism: Mechanism, q: ArrayLike, v: ArrayLike | None) -> tuple[Array, Array]:
    """Return q and v of ``pin.buildModelFromUrdf``; see ``Mechanism.to_pinocchio``."""
    layout = mechanism.pinocchio_layout
    leading, rows = _states(q, v, layout.nq, layout.nv)
    positions, velocities = layout.give(*rows)
    return leading.unfold(positions), leading.unfold(velocities)


def _states(q: ArrayLike, v: ArrayLike | None, nq: int, nv: int) -> tuple[LeadingAxes, list[Array]]:
    """Return the leading axes of q and v, and both as rows; velocities that are left out are 0."""
    if v is None:
        leading, (rows,) = LeadingAxes.fold(q=(q, nq))
        return leading, [rows, np.zeros((len(rows), nv))]
    return LeadingAxes.fold(q=(q, nq), v=(v, nv))
