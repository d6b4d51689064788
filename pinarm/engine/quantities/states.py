"""Quantities, efforts and accelerations of single states: arrays of q, v and a in, every named quantity out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, nextafter
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.closure import BLOCK, Closure
from pinarm.engine.constraints.constraint_rows import one_sided
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.equation import accelerations, require_masses
from pinarm.engine.motion.known_motion import with_efforts
from pinarm.engine.motion.standstill import Beside, directions, lossy, row_paces
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.quantities.state_arrays import RATES, LeadingAxes, instant, states_of
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
    given = {name: x.copy() for name, x in rows.items()}  # quantities are computed when asked
    still = np.zeros((len(given["q"]), mechanism.model.nv))
    state = t, given["q"], given.get("v", still)
    if tau is not None:
        return States(Quantities(_under_efforts(mechanism, leading, *state, given["tau"])), leading)
    run = _rows(mechanism, *state, given.get("a", still))
    check_closed(mechanism.closure, leading, run.q, run.v, run.a)
    acting = actuation(mechanism, drives, drives) if drives else everywhere(mechanism)
    if acting is None:
        return States(Quantities(replace(run, no_efforts=NO_DRIVES)), leading)
    run = replace(run, driven=acting.driven, drives=(*acting.coordinates(mechanism),))
    return States(Quantities(_driven(_directed(run, np.abs(run.a)), acting)), leading)


def _rows(mechanism: Mechanism, t: float, q: Array, v: Array, a: Array) -> Trajectory:
    closure = mechanism.closure
    grid = Grid(np.full(len(q), t), (t, nextafter(t, inf)), (0, len(q)))
    return Trajectory(
        mechanism, "t", unit("s"), grid, q, v, a, np.zeros_like(v), np.zeros((len(q), closure.size)), closure,
        mechanism.dynamics, separate=True,
    )  # fmt: skip


def _directed(run: Trajectory, terms: Array) -> Trajectory:
    """Return states with the directions of joints where losses of gears ask for them; ``terms`` are those of a."""
    if not lossy(run.mechanism):
        return run
    paces, still = row_paces(run.mechanism, run.v, terms), np.zeros_like(run.v)
    return replace(run, directions=directions(run.v, run.a, paces, np.ones(len(run)), still))


def _driven(run: Trajectory, acting: Actuation, *, bands: bool = True) -> Trajectory:
    """Return states with the efforts of drives that carry the load; see ``with_efforts``."""
    beside = Beside(row_paces(run.mechanism, run.v, run.a), np.ones(len(run)), np.zeros_like(run.v))
    return with_efforts(replace(run, closure=acting.closure), acting, beside, bands=bands)


def _under_efforts(mechanism: Mechanism, leading: LeadingAxes, t: float, q: Array, v: Array, tau: Array) -> Trajectory:
    """Return states with their accelerations, friction and multipliers, and with others that hold as well."""
    dynamics = mechanism.dynamics.on(t, nextafter(t, inf))
    friction, loads, others = _friction(mechanism, dynamics, t, q, v, tau)
    a = _accelerations(mechanism, dynamics, t, q, v, tau + loads)
    check_closed(mechanism.closure, leading, q, v, a, found=True)
    run = replace(_rows(mechanism, t, q, v, a), tau=tau)
    if lossy(mechanism):  # efforts that hold leave accelerations of their rounding
        alone = _accelerations(mechanism, dynamics, t, q, v, np.zeros_like(v))
        run = _directed(run, np.maximum(np.abs(a), np.abs(alone)))
    run = _rubbed(run, dynamics.inverse(t, q, v, a) - tau, friction, others)
    _check_sides(leading, run)
    return run


def _rubbed(run: Trajectory, demand: Array, friction: Array, others: Sequence[tuple[Array, Flags]]) -> Trajectory:
    """Return states with their friction and multipliers, and with others that hold as well; see ``filled``."""
    closure = run.mechanism.closure
    if not run.mechanism.frictions:
        return replace(run, lam=closure.multipliers(run.q, demand))
    from pinarm.engine.friction.columns import friction_columns
    from pinarm.engine.friction.complementarity import held_part

    def under(friction: Array) -> Trajectory:
        rubbed = replace(run, columns=friction_columns(run.mechanism.frictions, friction))
        return replace(rubbed, lam=closure.multipliers(run.q, demand - rubbed.friction_loads))

    rows, tables = under(friction), list[Trajectory]()
    for other, endless in others:
        part = held_part(closure, rows.lam, under(other).lam)
        far = endless & (part == 1.0)
        within = under(friction + part[:, None] * (other - friction))
        tables.append(replace(within, endless=far if far.any() else None))
    return replace(rows, others=tuple(tables))


def _friction(
    mechanism: Mechanism, dynamics: Dynamics, t: float, q: Array, v: Array, tau: Array
) -> tuple[Array, Array, list[tuple[Array, Flags]]]:
    """Return the friction under efforts, shape (n, k), its generalised loads, (n, nv), and others that hold as well."""
    contacts = mechanism.frictions
    if not contacts:
        return np.zeros((len(q), 0)), np.zeros_like(v), []
    from pinarm.engine.friction.given_efforts import friction_under
    from pinarm.mechanics.friction.contact import slip_rows

    friction, others = friction_under(contacts, dynamics, mechanism.closure, t, q, v, tau)
    return friction, np.vecmat(friction, slip_rows(mechanism.model, contacts, q)), others


def inverse(mechanism: Mechanism, q: Array, v: Array, a: Array, drives: Sequence[str], t: float) -> Array:
    """Return the efforts of the drives; see ``Mechanism.inverse``."""
    acting = actuation(mechanism, drives, drives) if drives else everywhere(mechanism)
    if acting is None:
        tied = f"{', '.join(constraint.name for constraint in mechanism.constraints)} tie joints"
        raise InputError(f"{tied}, and no drives are named that carry the load", hint="inverse(q, v, a, drives=[...])")
    t = instant(t)
    leading, rows = states_of(mechanism, q, v=v, a=a)
    q, v, a = rows.values()
    check_closed(mechanism.closure, leading, q, v, a)
    if mechanism.frictions or one_sided(mechanism.constraints):
        run = _driven(_rows(mechanism, t, q, v, a), acting, bands=False)
        _check_sides(leading, run)
        tau, lam = run.tau, run.lam
    else:
        dynamics = mechanism.dynamics.on(t, nextafter(t, inf))
        tau, lam = acting.efforts(np.full(len(q), t), q, dynamics.inverse(t, q, v, a))
    if lam.shape[1] > (own := mechanism.closure.size):  # drives of tasks act by J^T, as along a point
        tau = tau + np.vecmat(lam[:, own:], acting.closure.at(q)[1][:, own:])
    return leading.unfold(tau)


def forward(mechanism: Mechanism, q: Array, v: Array, tau: Array | None, t: float) -> Array:
    """Return the accelerations under efforts; see ``Mechanism.forward``."""
    t = instant(t)
    leading, rows = states_of(mechanism, q, v=v, tau=tau)
    q, v = rows["q"], rows["v"]
    tau = rows["tau"] if "tau" in rows else np.zeros_like(v)
    if one_sided(mechanism.constraints):
        return leading.unfold(_under_efforts(mechanism, leading, t, q, v, tau).a)
    dynamics = mechanism.dynamics.on(t, nextafter(t, inf))
    total = tau + _friction(mechanism, dynamics, t, q, v, tau)[1] if mechanism.frictions else tau
    a = _accelerations(mechanism, dynamics, t, q, v, total)
    check_closed(mechanism.closure, leading, q, v, a, found=True)
    return leading.unfold(a)


def _accelerations(mechanism: Mechanism, dynamics: Dynamics, t: float, q: Array, v: Array, tau: Array) -> Array:
    """Return the accelerations under efforts, shape (n, nv): of open chains by ``aba``."""
    if not mechanism.massive:
        require_masses(mechanism.closure, q, t)
    closure = mechanism.closure
    return accelerations(dynamics, closure, t, q, v, tau) if closure.size else dynamics.forward(t, q, v, tau)


def _check_sides(leading: LeadingAxes, run: Trajectory) -> None:
    """Raise where a cable would have to push, or a cam that pushes only to pull, however constraints share the load."""
    closure, sided = run.mechanism.closure, one_sided(run.mechanism.constraints)
    if not sided:
        return
    lam, at_rest = run.lam[:, : closure.size], replace(run, a=np.zeros_like(run.a))
    loads = np.maximum(np.abs(run.demand()), np.abs(at_rest.demand())).max(axis=1)
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


def check_closed(closure: Closure, leading: LeadingAxes, q: Array, v: Array, a: Array, *, found: bool = False) -> None:
    """Raise where states tear a loop or a coupling, by positions, or else by rates.

    Accelerations that have been ``found`` of efforts do so at singular positions only, where velocities are not along
    one of the motions that meet there, and next to them.
    """
    for start in range(0, len(q) if closure.size else 0, BLOCK):
        _check_closed(closure, leading, start, *(x[start : start + BLOCK] for x in (q, v, a)), found=found)


def _check_closed(
    closure: Closure, leading: LeadingAxes, start: int, q: Array, v: Array, a: Array, *, found: bool
) -> None:
    gap, rows, drift = closure.terms(q, v)
    sizes = np.abs(rows)
    left = np.abs([gap, np.matvec(rows, v), np.matvec(rows, a) + drift])
    terms = np.array([0.0 * gap, np.matvec(sizes, np.abs(v)), np.matvec(sizes, np.abs(a)) + np.abs(drift)])
    excess = left - CLOSED * (1.0 + terms)
    if not (excess > 0.0).any():
        return
    i = int((excess > 0.0).any(axis=(0, 2)).argmax())
    part = int((excess[:, i] > 0.0).any(axis=1).argmax())
    worst, what = int(excess[part, i].argmax()), [*RATES][part]
    constraint, row = closure.owners()[worst]
    torn = f"tear '{constraint.name}' by {left[part, i, worst]:.3g} {constraint.unit(row)}{RATES[what]}"
    said = f"{leading.place(start + i)}: the {what} {torn}"
    if found and what == "accelerations":
        raise InputError(said + SINGULAR, expected="velocities along one of the motions that meet there")
    raise InputError(said, expected="states that the loops and couplings allow", hint=CLOSING)
