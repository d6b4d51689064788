"""Quantities, efforts and accelerations of single states: arrays of q, v and a in, every named quantity out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.constraint_rows import one_sided
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.equation import accelerations
from pinarm.engine.dynamics.mass_matrix import require_masses
from pinarm.engine.motion.known_motion import with_efforts
from pinarm.engine.motion.standstill import Beside, directions, lossy, row_paces
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.quantities.state_arrays import LeadingAxes, instant, states_of
from pinarm.engine.series import Series
from pinarm.engine.statics.actuation import Actuation, actuation, everywhere
from pinarm.errors import InputError
from pinarm.input.units import unit
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism

CLOSED = 1e-8
"""Largest gap of a loop in a given state, relative to ``1 +`` the terms of the row: typed digits explain as much."""

OPENED = 1e-9
"""Part of the loads by which a cable may push, or a cam pull: rounding of what they cancel explains as much."""

PER_TIME = {"positions": "", "velocities": "/s", "accelerations": "/s^2"}
SINGULAR = ", whatever the efforts: the position is singular, or so near one that it is not told from it"

CLOSING = "q, v, a = mechanism.close({'knee': 0.5}, {'knee': 1.0}, {'knee': 0.0}), which closes the loops"

NO_DRIVES = "the mechanism has loops, and no drives are named that carry the load: drives=[...]"


@dataclass(frozen=True, eq=False)
class States:
    """The quantities of states by name."""

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


def quantities(
    mechanism: Mechanism, q: Array, v: Array | None, a: Array | None, tau: Array | None, drives: Sequence[str], t: float
) -> States:
    """Return the quantities of states; see ``Mechanism.at``."""
    t = instant(t)
    if a is not None and tau is not None:
        raise InputError("accelerations and efforts are given", expected="one of them: the other one follows")
    leading, rows = states_of(mechanism, q, v=v, a=a, tau=tau)
    copies = {name: x.copy() for name, x in rows.items()}  # quantities are computed when asked
    return States(_quantities(mechanism, leading, copies, drives, t), leading)


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
    check = _check_closed if tau is None else check_found
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
    beside = Beside(row_paces(mechanism, v, a), np.ones(len(run)), still)
    return Quantities(with_efforts(run, acting, beside))


def _under(run: Trajectory, demand: Array, friction: Array, others: Sequence[tuple[Array, Flags]]) -> Trajectory:
    """Return states with their friction and multipliers, and with others that hold as well; see ``filled``."""
    if not run.mechanism.frictions:
        return replace(run, lam=run.mechanism.closure.multipliers(run.q, demand))
    from pinarm.engine.friction.columns import friction_columns
    from pinarm.engine.friction.complementarity import held_part

    def under(friction: Array) -> Trajectory:
        held = demand - _friction_loads(run.mechanism, run.q, friction)
        lam = run.mechanism.closure.multipliers(run.q, held)
        return replace(run, lam=lam, columns=friction_columns(run.mechanism.frictions, friction))

    rows, tables = under(friction), list[Trajectory]()
    for other, endless in others:
        part = held_part(run.mechanism.closure, rows.lam, under(other).lam)
        far = endless & (part == 1.0)
        within = under(friction + part[:, None] * (other - friction))
        tables.append(replace(within, endless=far if far.any() else None))
    return replace(rows, others=tuple(tables))


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
    closure = mechanism.closure
    grid = Grid(np.full(len(q), float(t)), (float(t), float(np.nextafter(t, np.inf))), (0, len(q)))
    return Trajectory(
        mechanism, "t", unit("s"), grid, q, v, a, np.zeros_like(v), np.zeros((len(q), closure.size)), closure,
        mechanism.dynamics, separate=True,
    )  # fmt: skip


def inverse(mechanism: Mechanism, q: Array, v: Array, a: Array, drives: Sequence[str], t: float) -> Array:
    """Return the efforts of the drives; see ``Mechanism.inverse``."""
    acting = actuation(mechanism, drives, drives) if drives else everywhere(mechanism)
    if acting is None:
        names = ", ".join(constraint.name for constraint in mechanism.constraints)
        raise InputError(
            f"the joints of this mechanism are tied by {names}",
            expected="drives that carry the load",
            hint="inverse(q, v, a, drives=[...])",
        )
    t = instant(t)
    leading, rows = states_of(mechanism, q, v=v, a=a)
    q, v, a = rows.values()
    dynamics = mechanism.dynamics.on(t, np.nextafter(t, np.inf))
    demand = dynamics.inverse(t, q, v, a)
    _check_closed(mechanism.closure, leading, q, v, a)
    sided, own = one_sided(mechanism.constraints), mechanism.closure.size
    if not mechanism.frictions and not sided:
        tau, lam = acting.efforts(np.full(len(q), float(t)), q, demand)
        return leading.unfold(_at_joints(acting, q, tau, lam[:, own:]))
    run = replace(_rows(mechanism, t, q, v, a), closure=acting.closure)
    if mechanism.frictions:
        from pinarm.engine.motion.known_friction import KnownFriction

        beside = Beside(row_paces(mechanism, v, a), np.ones(len(q)), np.zeros_like(v))
        run = KnownFriction(run, acting, demand, beside).moving()
    else:
        tau, lam = acting.efforts(run.grid.t, q, demand)
        run = replace(run, tau=tau, lam=lam)
    if sided:
        _check_sides(dynamics, leading, run, demand)
    return leading.unfold(_at_joints(acting, q, run.tau, run.lam[:, own:]))


def _at_joints(acting: Actuation, q: Array, tau: Array, along: Array) -> Array:
    """Return the efforts of all drives at the joints, shape (n, nv); task drives act by ``J^T``, as along a point."""
    return tau + np.vecmat(along, acting.closure.at(q)[1][:, -along.shape[-1] :]) if along.size else tau


def forward(mechanism: Mechanism, q: Array, v: Array, tau: Array | None, t: float) -> Array:
    """Return the accelerations under efforts; see ``Mechanism.forward``."""
    t = instant(t)
    dynamics = mechanism.dynamics.on(t, np.nextafter(t, np.inf))
    leading, rows = states_of(mechanism, q, v=v, tau=tau)
    q, v = rows["q"], rows["v"]
    tau = rows["tau"] if "tau" in rows else np.zeros_like(v)
    friction = _frictions(mechanism, dynamics, t, q, v, tau)[0]
    a = _forward(mechanism, dynamics, t, q, v, tau + _friction_loads(mechanism, q, friction))
    check_found(mechanism.closure, leading, q, v, a)
    if one_sided(mechanism.constraints):
        demand = dynamics.inverse(t, q, v, a)
        run = _under(replace(_rows(mechanism, t, q, v, a), tau=tau), demand - tau, friction, [])
        _check_sides(dynamics, leading, run, demand)
    return leading.unfold(a)


def _forward(mechanism: Mechanism, dynamics: Dynamics, t: float, q: Array, v: Array, tau: Array) -> Array:
    """Return the accelerations under efforts, shape (n, nv): of open chains by ``aba``."""
    if not mechanism.massive:
        require_masses(mechanism.closure, q, t)
    closure = mechanism.closure
    return accelerations(dynamics, closure, t, q, v, tau) if closure.size else dynamics.forward(t, q, v, tau)


def _check_sides(dynamics: Dynamics, leading: LeadingAxes, run: Trajectory, demand: Array) -> None:
    """Raise where a cable would have to push, or a cam that pushes only to pull, however constraints share the load."""
    closure = run.mechanism.closure
    lam, sided = run.lam[:, : closure.size], one_sided(run.mechanism.constraints)
    at_rest = dynamics.inverse(float(run.grid.t[0]), run.q, run.v, np.zeros_like(run.v))
    loads = np.maximum(np.abs(demand), np.abs(at_rest)).max(axis=1)
    sides = {closure.slices[constraint.name].start: constraint.side for constraint in sided}
    for constraint, k in zip(sided, sides, strict=True):
        for i in np.flatnonzero(constraint.side * lam[:, k] < 0.0).tolist():
            rows = np.asarray(closure.rows(closure.state(run.q[i])))
            if np.abs(lam[i, k] * rows[k]).max() <= OPENED * loads[i] or _is_shared(rows, lam[i], sides):
                continue
            size = abs(float(constraint.push(run.q[i : i + 1], lam[i : i + 1, k])[0]))
            act = f"{'push' if constraint.kind == 'cable' else 'pull'} with {size:.6g} {constraint.push_unit()}"
            said = f"{leading.place(i)}: {constraint.kind} '{constraint.name}' would have to {act}: {constraint.opens}"
            raise InputError(
                said,
                expected="states and efforts under which it holds",
                hint="a scenario of the kind forward, in which it may open",
            )


def _is_shared(rows: Array, lam: Array, sides: Mapping[int, float]) -> bool:
    """Tell whether other multipliers give the same loads, without one against its side."""
    if np.linalg.matrix_rank(rows) == len(rows):
        return False
    from scipy.optimize import lsq_linear

    least, most = np.full(len(lam), -np.inf), np.full(len(lam), np.inf)
    for row, side in sides.items():
        (least if side > 0.0 else most)[row] = 0.0
    load = rows.T @ lam
    solution = lsq_linear(rows.T, load, (least, most), tol=1e-14)
    return bool(np.abs(solution.fun).max() <= OPENED * np.abs(load).max())


class _Tear(NamedTuple):
    """Gap of a loop or coupling in a state: positions or a rate, and a text with the constraint, row and size."""

    what: str
    said: str


def _check_closed(closure: Closure, leading: LeadingAxes, q: Array, v: Array, a: Array) -> None:
    for tear in _tears(closure, leading, q, v, a):
        raise InputError(tear.said, expected="states that the loops and couplings allow", hint=CLOSING)


def check_found(closure: Closure, leading: LeadingAxes, q: Array, v: Array, a: Array) -> None:
    """Raise as ``_check_closed`` does, where accelerations have been found of efforts.

    These tear loops at singular positions only, where velocities are not along one of the motions that meet there, and
    next to them.
    """
    for tear in _tears(closure, leading, q, v, a):
        if tear.what == "accelerations":
            raise InputError(tear.said + SINGULAR, expected="velocities along one of the motions that meet there")
        raise InputError(tear.said, expected="states that the loops and couplings allow", hint=CLOSING)


def _tears(closure: Closure, leading: LeadingAxes, q: Array, v: Array, a: Array) -> Iterator[_Tear]:
    """Yield the gaps of loops and couplings, state by state: positions before rates."""
    for i in range(len(q) if closure.size else 0):
        state = closure.state(q[i], v[i])
        rows, gap, drift = closure.rows(state), closure.gap(state), closure.drift(state)
        sizes = np.abs(rows)
        left = np.array([gap, rows @ v[i], rows @ a[i] + drift])
        terms = np.array([0.0 * gap, sizes @ np.abs(v[i]), sizes @ np.abs(a[i]) + np.abs(drift)])
        excess = np.abs(left) - CLOSED * (1.0 + terms)
        for part in np.flatnonzero((excess > 0.0).any(axis=1)).tolist():
            worst, what = int(excess[part].argmax()), [*PER_TIME][part]
            constraint, row = closure.owners()[worst]
            torn = f"tear '{constraint.name}' by {abs(left[part, worst]):.3g} {constraint.unit(row)}"
            yield _Tear(what, f"{leading.place(i)}: the {what} {torn}{PER_TIME[what]}")
