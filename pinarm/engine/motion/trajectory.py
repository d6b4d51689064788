"""A table of states: configurations, velocities, accelerations and efforts, row by row, and other columns by name."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, cast

import numpy as np
from msgspec import field

from pinarm.arrays import Array, Flags, Indices, in_one, vecmat
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.dynamics.dynamics import Dynamics, parts
from pinarm.engine.series import Series
from pinarm.input.units import Unit
from pinarm.mechanics.coordinates import LinearCoordinate
from pinarm.mechanics.couplings.coupling import JointRelation
from pinarm.mechanics.geometry.link_placements import LinkPlacements, moving
from pinarm.mechanics.geometry.model_variants import ModelVariants
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
        mechanism: What moves.
        parameter: Name of what runs along the rows: ``t``, the coordinate that is swept, or ``row`` for their number.
        unit: Unit of the parameter.
        grid: Its values, with the intervals between jumps.
        q: Configurations, shape (n, nq).
        v: Velocities, shape (n, nv).
        a: Accelerations, shape (n, nv).
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
    lam: Multipliers
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
        lam = Multipliers.known(np.zeros((1, closure.size)), mechanism.closure.size)
        return cls(mechanism, parameter, measured, grid, q, idle, idle, idle, lam, closure, dynamics)

    @cached_property
    def link_motion(self) -> tuple[LinkPlacements, Array, Array, Array]:
        """The motion of the links in all rows; see ``moving``."""
        return moving(self.mechanism.model, self.q, self.v, self.a)

    def __repr__(self) -> str:
        return f"<Trajectory of {self.mechanism.title or 'a mechanism'}: {len(self)} rows along {self.parameter}>"

    def __len__(self) -> int:
        return len(self.grid.t)

    def link_motion_at(self, rows: Indices) -> tuple[LinkPlacements, Array, Array, Array]:
        """Return the same at some rows, shape (k,)."""
        return self.looked_at(rows).link_motion

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
        """What this motion demands of the links in all rows; see ``LinkPlacements.demands``."""
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

    @cached_property
    def value_shapes(self) -> tuple[tuple[int, ...], ...]:
        """Shapes that a quantity may have: (n,), or (n, 1) and (n, k) of k variants."""
        model = self.mechanism.model
        return (self.row_axes, (len(self), len(model))) if isinstance(model, ModelVariants) else (self.row_axes,)

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
        q, v, a, tau = (array[rows] for array in (self.q, self.v, self.a, self.tau))
        columns = {name: replace(series, values=series.values[rows]) for name, series in self.columns.items()}
        directions, errors = (None if x is None else x[rows] for x in (self.directions, self.rate_errors))
        opened, endless = (None if flags is None else flags[rows] for flags in (self.opened, self.endless))
        return replace(
            self, grid=self.grid.some(rows), q=q, v=v, a=a, tau=tau, lam=self.lam.some(rows), columns=columns,
            directions=directions, rate_errors=errors, opened=opened, endless=endless,
            others=tuple(other.some(rows) for other in self.others),
        )  # fmt: skip

    @cached_property
    def friction(self) -> Array:
        """Friction at the mechanism's contacts, along their slips [N*m or N], shape (n, k); 0 where none is told."""
        none = np.zeros(len(self))
        names = [contact.quantity for contact in self.mechanism.frictions]
        found = [self.columns[name].values if name in self.columns else none for name in names]
        return np.array(found).reshape(-1, len(self)).T

    @cached_property
    def friction_loads(self) -> Array:
        """The same as generalised loads [N*m or N], shape (n, nv)."""
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
        return {one.name: one.rows_at(self.q)[:, joint] for one in self._couplings.get(joint, ())}

    @cached_property
    def _couplings(self) -> dict[int, list[JointRelation]]:
        """Couplings by the joints that they move, by their index in v."""
        couplings: dict[int, list[JointRelation]] = {}
        for constraint in self.mechanism.constraints:
            if isinstance(constraint, JointRelation):
                for joint in constraint.joints:
                    couplings.setdefault(joint, []).append(constraint)
        return couplings

    def effort(self, joint: int) -> Array:
        """Return the effort along a joint [N*m or N], by its index in v, shape (n,).

        That of its drive, with what accelerates its rotor; of a joint without one, what couplings do along it, with
        their friction: ``sum_k G_k lam_k + J_k f_k``. Where a motor acts on a rotor that is a joint of its own, its
        effort less the losses of the gear; behind an elastic gear ``k w + c w'``, what the gear gives, and what drives
        the joint itself beside it. Of a joint that nothing of this moves, what its end stops push.
        """
        if (gear := self._elastic_gear_at(joint)) is not None:
            shaft = gear.efforts(self.grid.t, self.q, self.v)
            return self.supplied[..., joint] - shaft + self._lost_behind_shaft(joint)
        if self.driven is not None and self.driven[joint]:
            return self.supplied[..., joint]
        if (drive := self._motor_at(joint)) is not None:
            return self.supplied[..., self.mechanism.driven_joint(drive).v] + self._lost_in_gear(drive)
        if not (acting := self.couplings_at(joint)):
            return self.tau[..., joint]
        lam, places = np.asarray(self.lam), self.closure.slices
        found = np.asarray(sum(weight * lam[:, places[name].start] for name, weight in acting.items()))
        return found + self._friction_in(acting, joint) if self.mechanism.frictions else found

    def _friction_in(self, couplings: Collection[str], joint: int) -> Array:
        """Return what friction between the members of couplings does along a joint, by its index in v, shape (n,)."""
        from pinarm.mechanics.friction.contact import slip_rows

        contacts, names = self.mechanism.frictions, {f"coupling.{name}" for name in couplings}
        between = np.array([contact.name in names for contact in contacts])
        return np.asarray((slip_rows(self.mechanism.model, contacts, self.q)[..., joint] * self.friction) @ between)

    def armature(self, joint: int) -> float:
        """Return the inertia of rotors that ``effort`` of a joint accelerates too [kg*m^2 or kg], by its index in v."""
        drive = self.mechanism.drives.get(self._rotor_of(joint) or "")
        own = drive.armature if drive is not None and drive.elasticity is None else 0.0
        return own + float(self.mechanism.model.armature[joint])

    def _elastic_gear_at(self, joint: int) -> AlongCoordinate | None:
        """Return the spring and damper of the elastic gear at a joint, by its index in v; ``None`` without one."""
        drive = self._rotor_of(joint)
        if drive is None or self.mechanism.drives[drive].elasticity is None:
            return None
        return cast("AlongCoordinate", self.mechanism.forces[f"elasticity of {drive}"])

    def _lost_behind_shaft(self, joint: int) -> Array | float:
        """Return the friction of teeth between an elastic shaft and a joint, by its index in v, shape (n,)."""
        name = self._rotor_of(joint)
        elasticity = self.mechanism.drives[name].elasticity if name else None
        return self._lost_in_gear(name) if elasticity and elasticity.shaft == "input" else 0.0

    def _lost_in_gear(self, drive: str | None) -> Array | float:
        """Return the friction in the gear of a drive [N*m or N], shape (n,); 0 where it has none in this run."""
        friction = self.columns.get(f"drive.{drive}.friction")
        return 0.0 if friction is None else friction.values

    def _motor_at(self, joint: int) -> str | None:
        """Return the drive whose motor moves a joint in this run, by a rotor that is a joint of its own."""
        name, driven = self._rotor_of(joint), self.driven
        if name is None or driven is None:
            return None
        return name if driven[self.mechanism.driven_joint(name).v] and not driven[joint] else None

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
            coordinate: found.weights for coordinate, found in linear.items() if isinstance(found, LinearCoordinate)
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
        """What drives supply at joints: all efforts but what end stops push [N*m or N], shape (n, nv)."""
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
