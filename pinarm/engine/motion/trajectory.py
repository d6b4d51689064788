"""A table of states: configurations, velocities, accelerations and efforts, row by row, and other columns by name."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, cast

import numpy as np
from msgspec import field

from pinarm.arrays import Array, Flags, Indices, in_one, vecmat
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.dynamics.dynamics import Dynamics, parts
from pinarm.engine.series import Series
from pinarm.input.units import Unit
from pinarm.mechanics.coordinates import LinearCoordinate
from pinarm.mechanics.couplings.coupling import JointRelation
from pinarm.mechanics.geometry.link_placements import LinkPlacements, moving
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import Record, replace

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.mechanics.forces.along_coordinate import AlongCoordinate

ROW = "row"
"""Parameter of rows that are only numbered."""


class EventRecord(Record, frozen=True):
    """An event of a run, or an impact.

    Attributes:
        name: Of the event, or of the end stop.
        t: When [s].
        q: Configuration, shape (nq,).
        v: Velocity, just after an impact, shape (nv,).
        before: Velocity just before an impact, shape (nv,); ``None`` of an event, at which it does not jump.
    """

    name: str
    t: float
    q: Array
    v: Array
    before: Array | None = None


class Trajectory(Record, frozen=True):
    """States of a mechanism, a row each: of one motion, of a path of positions, or each of its own.

    Of variants of a mechanism arrays have an axis after the first, of length k, or 1 where all are alike.

    Attributes:
        parameter: Name of what runs along the rows: ``t``, the coordinate that is swept, or ``row`` for their number.
        grid: Its values, with the intervals between jumps.
        tau: Efforts of the drives at joints, what accelerates rotors and what end stops push included [N*m or N], shape
            (n, nv).
        lam: Multipliers of the constraints, and efforts of drives along task coordinates [N or N*m].
        closure: The constraints that they belong to: those of the mechanism, then guided task coordinates.
        dynamics: The equation of motion with all the forces of the run.
        no_efforts: Why there are no efforts; empty where there are.
        columns: What the problem found beside the states, by name, a value a row.
        separate: Whether velocities are given row by row, and the rows are not one motion.
        driven: Joints that drives act on, shape (nv,); ``None`` where all efforts are given as they are.
        drives: Names of the coordinates that drives act along; those that follow laws, of forward problems.
        directions: Directions of the joints, 1, 0 or -1, where drives have losses, shape (n, nv); see
            ``motion.standstill``.
        rate_errors: Errors of velocities that are not known to rounding, shape (n, nv); ``None`` where all are.
        sampled: Whether the rows were given, and nothing is known between them.
        opened: Whether a one-sided constraint, such as a cable, is open, shape (n,); ``None`` where none ever is.
        unknown: Why velocities or accelerations, which are NaN then, are not known; empty where they are.
        remedy: What to try where they are not.
        others: The same motion with other efforts, multipliers and frictions that hold it as well: quantities that
            differ in them are not determined by rigid bodies, and lie between.
        endless: Of such a motion, in which rows, shape (n,), it only tells the direction in which quantities have no
            end, or none that is known; ``None`` for none.
    """

    mechanism: Mechanism
    parameter: str
    unit: Unit
    grid: Grid
    q: Array
    v: Array
    a: Array
    tau: Array
    lam: Array
    closure: Closure
    dynamics: Dynamics
    no_efforts: str = ""
    columns: Mapping[str, Series] = field(default_factory=dict)
    separate: bool = False
    driven: Flags | None = None
    drives: tuple[str, ...] = ()
    directions: Array | None = None
    rate_errors: Array | None = None
    sampled: bool = False
    opened: Flags | None = None
    unknown: str = ""
    remedy: str = ""
    others: tuple[Trajectory, ...] = ()
    endless: Flags | None = None

    @classmethod
    def schema_row(
        cls, mechanism: Mechanism, q: Array, parameter: str, measured: Unit, closure: Closure | None = None
    ) -> Trajectory:
        """Return one row, at rest: enough to see which quantities there are, and which are determined."""
        q, idle = np.atleast_2d(q), np.zeros((1, mechanism.model.nv))
        dynamics, grid = mechanism.dynamics, Grid(np.zeros(1), (0.0, 0.0), (0, 1))
        closure = closure or mechanism.closure
        lam = np.zeros((1, closure.size))
        return cls(mechanism, parameter, measured, grid, q, idle, idle, idle, lam, closure, dynamics)

    @cached_property
    def link_motion(self) -> tuple[LinkPlacements, Array, Array, Array]:
        """The motion of the links in all rows; see ``moving``."""
        return moving(self.mechanism.model, self.q, self.v, self.a)

    def __repr__(self) -> str:
        return f"<Trajectory of {self.mechanism.title or 'a mechanism'}: {len(self)} rows along {self.parameter}>"

    def __len__(self) -> int:
        return len(self.grid.t)

    def looked_at(self, rows: Indices) -> Trajectory:
        """Return some of the rows, ascending, each once; the last ones are kept, since checks look at the same rows."""
        if len(rows) == len(self):
            return self
        asked = rows.tobytes()
        if asked not in self._looked:
            self._looked.clear()
            self._looked[asked] = self.some(rows)
        return self._looked[asked]

    @cached_property
    def demands(self) -> Array:
        """Wrenches that the motion of the links demands in all rows; see ``LinkPlacements.demands``."""
        links, twists, rates, _ = self.link_motion
        return links.demands(twists, rates)

    @cached_property
    def _looked(self) -> dict[bytes, Trajectory]:
        return {}

    @cached_property
    def row_axes(self) -> tuple[int, ...]:
        """Shape of what is the same in all variants, (n,), or (n, 1) where there are several."""
        return len(self), *(1,) * (self.q.ndim - 2)

    @property
    def parameters(self) -> Array:
        """Values of the parameter, shape (n,), or (n, 1) where there are several variants, (n, k) where it varies."""
        return self.grid.t if self.grid.t.ndim > 1 else self.grid.t.reshape(self.row_axes)

    @property
    def numbered(self) -> bool:
        """Whether the rows are only numbered, ``row``: there is nothing between them."""
        return self.parameter == ROW

    @property
    def isolated(self) -> bool:
        """Whether there is nothing between the rows."""
        return self.numbered or self.sampled

    def some(self, rows: Indices) -> Trajectory:
        """Return some of the rows, in their order, shape (n,); one may be there several times."""
        names = ("q", "v", "a", "tau", "lam", "directions", "rate_errors", "opened", "endless")
        arrays = {name: None if (x := getattr(self, name)) is None else x[rows] for name in names}
        columns = {name: replace(series, values=series.values[rows]) for name, series in self.columns.items()}
        others = tuple(other.some(rows) for other in self.others)
        return replace(self, grid=self.grid.some(rows), columns=columns, others=others, **arrays)

    @cached_property
    def friction(self) -> Array:
        """Friction at the mechanism's contacts, along their slips [N*m or N], shape (n, k); 0 where none is told."""
        none = np.zeros(len(self))
        names = [contact.quantity for contact in self.mechanism.frictions]
        columns = [self.columns[name].values if name in self.columns else none for name in names]
        return np.array(columns).reshape(-1, len(self)).T

    @cached_property
    def friction_loads(self) -> Array:
        """Friction at the contacts as generalised loads [N*m or N], shape (n, nv)."""
        if not self.mechanism.frictions:
            return np.zeros_like(self.v)
        from pinarm.mechanics.friction.contact import slip_rows

        return np.asarray(vecmat(self.friction, slip_rows(self.mechanism.model, self.mechanism.frictions, self.q)))

    def intervals(self) -> list[tuple[slice, Dynamics]]:
        """Return the rows between jumps, where there are any, each with the dynamics that holds there."""
        return [(rows, dynamics) for rows, dynamics in parts(self.dynamics, self.grid) if rows.start < rows.stop]

    def gather(self, value: Callable[[Dynamics, slice], Array]) -> Array:
        """Return an array over all rows from a function of the dynamics on each interval and its rows."""
        return in_one([value(dynamics, rows) for rows, dynamics in self.intervals()])

    def demand(self) -> Array:
        """Return ``M a + nle - loads`` in all rows, without friction that sticks [N*m or N], shape (n, nv)."""
        t, q, v, a = self.grid.t, self.q, self.v, self.a
        return self.gather(lambda dynamics, part: dynamics.inverse(t[part], q[part], v[part], a[part]))

    def couplings_at(self, joint: int) -> dict[str, Array]:
        """Return the couplings that move a joint without a drive, by its index in v.

        Name -> coefficient of the joint in the row of G, shape (n,).
        """
        if self.driven is None or self.driven[joint]:
            return {}
        tied = (tie for tie in self.mechanism.constraints if isinstance(tie, JointRelation) and joint in tie.joints)
        return {tie.name: tie.rows_at(self.q)[:, joint] for tie in tied}

    def effort(self, joint: int) -> Array:
        """Return the effort along a joint [N*m or N], by its index in v, shape (n,).

        That of its drive, with what accelerates its rotor; of a joint without one, what couplings do along it, with
        their friction: ``sum_k G_k lam_k + J_k f_k``. Where a motor acts on a rotor that is a joint of its own, its
        effort less the losses of the gear; behind an elastic gear ``k w + c w'``, what the gear gives, and what drives
        the joint itself beside it. Of a joint that nothing of this moves, what its end stops push.
        """
        drive, driven = self._rotor_of(joint), self.driven
        if drive is not None and (elasticity := self.mechanism.drives[drive].elasticity) is not None:
            gear = cast("AlongCoordinate", self.mechanism.forces[f"elasticity of {drive}"])
            lost = self._lost_in_gear(drive) if elasticity.shaft == "input" else 0.0
            return self.supplied[..., joint] - gear.efforts(self.grid.t, self.q, self.v) + lost
        if driven is not None and driven[joint]:
            return self.supplied[..., joint]
        if drive is not None and driven is not None and driven[rotor := self.mechanism.driven_joint(drive).v]:
            return self.supplied[..., rotor] + self._lost_in_gear(drive)
        if not (acting := self.couplings_at(joint)):
            return self.tau[..., joint]
        lam, places = self.lam, self.closure.slices
        effort = np.asarray(sum(weight * lam[:, places[name].start] for name, weight in acting.items()))
        return effort + self._friction_in(acting, joint) if self.mechanism.frictions else effort

    def _friction_in(self, couplings: Collection[str], joint: int) -> Array:
        """Return the effort along a joint, by its index in v, of friction between members of couplings, shape (n,)."""
        from pinarm.mechanics.friction.contact import slip_rows

        contacts, names = self.mechanism.frictions, {f"coupling.{name}" for name in couplings}
        between = np.array([contact.name in names for contact in contacts])
        return np.asarray((slip_rows(self.mechanism.model, contacts, self.q)[..., joint] * self.friction) @ between)

    def armature(self, joint: int) -> float:
        """Return the inertia of rotors that ``effort`` of a joint accelerates too [kg*m^2 or kg], by its index in v."""
        drive = self.mechanism.drives.get(self._rotor_of(joint) or "")
        own = drive.armature if drive is not None and drive.elasticity is None else 0.0
        return own + float(self.mechanism.model.armature[joint])

    def _lost_in_gear(self, drive: str) -> Array | float:
        """Return the friction in the gear of a drive [N*m or N], shape (n,); 0 where it has none in this run."""
        friction = self.columns.get(f"drive.{drive}.friction")
        return 0.0 if friction is None else friction.values

    def _rotor_of(self, joint: int) -> str | None:
        """Return the drive of a joint whose rotor is a joint of its own, by the index in v of the driven joint."""
        turning = {
            name: drive.joint for name, drive in self.mechanism.drives.items() if drive.joint and drive.turns_rotor
        }
        return next((name for name, driven in turning.items() if self.mechanism.joints[driven].v == joint), None)

    def effort_along(self, name: str) -> Array | None:
        """Return the effort of a drive along a joint or a sum of joints [N*m or N], shape (n,); ``None`` without one.

        Drives e along coordinates with the weights W give joints ``tau = W^T e``.
        """
        known = self.mechanism.coordinates
        linear = {drive: known[drive] for drive in self.drives if drive in known}
        weights = {
            coordinate: along.weights for coordinate, along in linear.items() if isinstance(along, LinearCoordinate)
        }
        if name not in weights:
            return None
        tau = self.supplied.reshape(-1, self.tau.shape[-1])
        efforts = np.linalg.lstsq(np.array([*weights.values()]).T, tau.T)[0]
        return np.asarray(efforts[[*weights].index(name)].reshape(self.tau.shape[:-1]))

    def drive_effort(self, joint: str) -> Array:
        """Return the effort of the drive at a joint, without drives along sums that act through it too, shape (n,)."""
        v, known = self.mechanism.joints[joint].v, self.mechanism.coordinates
        others = (known.get(drive) for drive in self.drives if drive != joint)
        shared = any(isinstance(other, LinearCoordinate) and other.weights[v] for other in others)
        own = self.effort_along(joint) if shared else None
        return self.supplied[..., v] if own is None else own

    @cached_property
    def supplied(self) -> Array:
        """Efforts of the drives at joints: all efforts less the pushes of end stops [N*m or N], shape (n, nv)."""
        pushed = {name: column for name, column in self.columns.items() if name.endswith(".stop")}
        if not pushed:
            return self.tau
        supplied = self.tau.copy()
        for name, joint in self.mechanism.joints.items():
            if (column := pushed.get(f"joint.{name}.stop")) is not None:
                supplied[..., joint.v] -= column.values
        return supplied

    def direction(self, index: int) -> Array:
        """Return the direction of a joint's motion at every row, 1, 0 or -1, shape (n,); see ``motion.standstill``.

        0 where no gear has losses: nothing depends on it.
        """
        known = self.directions
        return np.zeros_like(self.v[..., index]) if known is None else known[..., index]
