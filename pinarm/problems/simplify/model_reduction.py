"""A part of a mechanism that moves as it does in the whole, and the way back to the whole.

Joints whose motion is known from the start need not be solved for. One that stands still is locked: what it carries
becomes one body with what carries it. One that moves, and whose motion nothing that is solved depends on, is dropped,
with its bodies. What is left is a mechanism of its own. Back in the whole, the joints that were removed have the
positions of their laws, and the efforts that inverse dynamics of the whole gives them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.outcome import Outcome, RelayedMotion, SolvedMotion, positions_by_interval
from pinarm.engine.motion.standstill import law_directions, lossy
from pinarm.engine.motion.trajectory import EventRecord, Trajectory
from pinarm.mechanics.ball_joints import ball_angles, ball_coordinates, balls_of
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate
from pinarm.mechanics.couplings.coupling import Coupling
from pinarm.mechanics.forces.force_element import Edge, ForceElement
from pinarm.mechanics.geometry.pinocchio_data import new_data
from pinarm.mechanics.joints import joints_of
from pinarm.mechanics.laws.motion_law import Grid, MotionLaw
from pinarm.problems.simplify.removal import Removed
from pinarm.records import replace

CARRIED = "laws of the whole"
"""Name of the element that knows the laws of joints that are dropped."""


@dataclass(frozen=True, eq=False)
class ReducedMechanism:
    """A part of a mechanism.

    Attributes:
        whole: The mechanism.
        forces: All force elements of the run, those of the whole.
        removed: What the part does without.
        answered: Joints whose effort carries what the motion of the whole asks at them, and nothing else: indices in v.
    """

    whole: Mechanism
    forces: Mapping[str, ForceElement]
    removed: Removed
    answered: Indices

    @cached_property
    def joints(self) -> dict[int, int]:
        return {joint.v: joint.q for joint in self.whole.joints.values()}

    @cached_property
    def configuration(self) -> Array:
        """A configuration of the whole in which the removed joints stand where they begin, shape (nq,)."""
        q = np.asarray(pin.neutral(self.whole.model)).copy()
        for v, law in self.removed.laws.items():
            q[self.joints[v]] = law.on(0.0, 0.0)(np.zeros(1))[0][0]
        return q

    @cached_property
    def kept_q(self) -> Indices:
        """Places of the part's configuration in that of the whole, shape (nq of the part,)."""
        return np.delete(np.arange(self.whole.model.nq), [self.joints[v] for v in self.removed.laws])

    @cached_property
    def kept_v(self) -> Indices:
        """Places of the part's velocity in that of the whole, shape (nv of the part,)."""
        return np.delete(np.arange(self.whole.model.nv), list(self.removed.laws))

    @cached_property
    def mechanism(self) -> Mechanism:
        whole = self.whole
        model = self._model()
        joints, balls = joints_of(model), balls_of(model)
        left = (constraint for constraint in whole.constraints if constraint.name not in self.removed.couplings)
        constraints = tuple(
            self._coupling(model, constraint) if isinstance(constraint, Coupling) else constraint for constraint in left
        )
        drives = {name: drive for name, drive in whole.drives.items() if drive.joint in joints}
        within = {name: force.within(self.kept_q, self.kept_v) for name, force in self.forces.items()}
        forces = {name: force for name, force in within.items() if force is not None}
        carried = partial(Carried, configuration=self.configuration, kept_q=self.kept_q, kept_v=self.kept_v,
                          nv=whole.model.nv, carriers=tuple(carrier for carrier, _ in self._places))  # fmt: skip
        forces |= {name: carried((force,), ()) for name, force in self.forces.items() if name not in forces}
        if self.removed.dropped:
            forces[CARRIED] = carried((), tuple(self.removed.dropped.values()))
        return replace(
            whole, model=model, joints=joints, balls=balls, coordinates=self._coordinates(model),
            constraints=constraints, drives=drives, forces=forces,
        )  # fmt: skip

    @cached_property
    def _places(self) -> list[tuple[int, pin.SE3]]:
        """For every joint of the whole the joint of the part that moves its bodies, and where it is in that."""
        model, data = self.whole.model, new_data(self.whole.model)
        pin.forwardKinematics(model, data, self.configuration)
        places, count = [(0, pin.SE3.Identity())], 0
        for index in range(1, model.njoints):
            if model.joints[index].idx_v in self.removed.laws:
                carrier, place = places[model.parents[index]]
                places.append((carrier, place * data.liMi[index]))
            else:
                count += 1
                places.append((count, pin.SE3.Identity()))
        return places

    def _model(self) -> pin.Model:
        """Return Pinocchio's model of the part, its frames numbered as in the whole.

        ``pin.buildReducedModel`` looks frames up by name and refuses a link that is called like a joint.
        """
        whole, model = self.whole.model, pin.Model()
        model.name, model.gravity = whole.name, whole.gravity
        for index in range(1, whole.njoints):
            (carrier, place), joint = self._places[index], whole.joints[index]
            if joint.idx_v not in self.removed.laws:
                parent, before = self._places[whole.parents[index]]
                model.addJoint(parent, joint, before * whole.jointPlacements[index], whole.names[index])
            if joint.idx_v not in self.removed.dropped:
                model.appendBodyToJoint(carrier, whole.inertias[index], place)
        for frame in list(whole.frames)[1:]:
            carrier, place = self._places[frame.parentJoint]
            model.addFrame(pin.Frame(frame.name, carrier, frame.parentFrame, place * frame.placement, frame.type))
        model.armature[:] = whole.armature[self.kept_v]
        return model

    def _coordinates(self, model: pin.Model) -> dict[str, Coordinate]:
        """Return the coordinates that no removed joint has a part in, but for those of frames, which all stay."""
        gone = list(self.removed.laws)
        found = {
            name: self._sum(model, known) if isinstance(known, LinearCoordinate) else self._counting(model, known)
            for name, known in self.whole.coordinates.items()
            if not (isinstance(known, LinearCoordinate) and known.weights[gone].any())
        }  # fmt: skip
        balls = balls_of(model)
        return {**found, **ball_coordinates(model, balls), **ball_angles(balls)}

    def _coupling(self, model: pin.Model, one: Coupling) -> Coupling:
        """Return a coupling of the part, its forces as efforts: reactions are asked of the whole."""
        follower = None if one.follower is None else int(np.searchsorted(self.kept_v, one.follower))
        return replace(one, coordinate=self._sum(model, one.coordinate), follower=follower, transmission=None)

    def _counting(self, model: pin.Model, one: Coordinate) -> Coordinate:
        """Return a coordinate of frames; of an angle at a loop joint, joints that are removed count as they stand."""
        from pinarm.mechanics.loops.relative import TurnedAbout  # most have none

        turns = one.turns if isinstance(one, TurnedAbout) else None
        if not isinstance(one, TurnedAbout) or turns is None:
            return one
        gone = list(self.removed.laws)
        held = float(turns.weights[gone] @ self.configuration[turns.places[gone]])
        return replace(one, turns=self._sum(model, turns), offset=one.offset + held)

    def _sum(self, model: pin.Model, one: LinearCoordinate) -> LinearCoordinate:
        places = np.zeros(model.nv, dtype=np.intp)
        for joint in joints_of(model).values():
            places[joint.v] = joint.q
        return replace(one, weights=one.weights[self.kept_v], places=places)

    def spread(self, grid: Grid, q: Array, v: Array) -> tuple[Array, Array]:
        """Return states of the part as those of the whole, shapes (..., n, nq) and (..., n, nv)."""
        whole_q = np.broadcast_to(self.configuration, (*q.shape[:-1], len(self.configuration))).copy()
        whole_v = np.zeros((*v.shape[:-1], self.whole.model.nv))
        whole_q[..., self.kept_q], whole_v[..., self.kept_v] = q, v
        for i, law in self.removed.laws.items():
            whole_q[..., self.joints[i]], whole_v[..., i], _ = grid.evaluate(law)
        return whole_q, whole_v

    def restored(self, outcome: Outcome) -> Outcome:
        """Return what came out for the part as what comes out for the whole."""
        motion = outcome.motion and RestoredMotion(self, outcome.motion, outcome.rows.grid.cuts)
        events = [self._event(event) for event in outcome.events]
        return replace(outcome, rows=self.restored_rows(outcome.rows), motion=motion, events=events)

    def restored_rows(self, run: Trajectory) -> Trajectory:
        """Return states of the part as those of the whole, with the efforts of the joints that are removed."""
        grid, n = run.grid, len(run)
        (q, v), (a, tau) = self.spread(grid, run.q, run.v), np.zeros((2, n, self.whole.model.nv))
        a[:, self.kept_v], tau[:, self.kept_v] = run.a, run.tau
        for i, law in self.removed.laws.items():
            a[:, i] = grid.evaluate(law)[2]
        names = [constraint.name for constraint in run.closure.constraints[len(run.mechanism.constraints) :]]
        closure = self.whole.closure.with_guides(names, [self.whole.coordinate(name) for name in names])
        driven = None if run.driven is None else self._driven(run.driven)
        back = replace(
            run, mechanism=self.whole, q=q, v=v, a=a, tau=tau, closure=closure,
            dynamics=Dynamics.of(self.whole.model, self.forces), driven=driven, directions=self._directions(run),
        )  # fmt: skip
        if run.no_efforts:
            return replace(back, lam=self._multipliers(run.lam, np.zeros((n, len(self.removed.couplings)))))
        return self._with_efforts(back)

    def _driven(self, part: Flags) -> Flags:
        """Return the joints of the whole that drives act on, from those of the part."""
        found = np.zeros(self.whole.model.nv, dtype=bool)
        found[self.kept_v] = part
        found[self.answered] = True
        return found

    def _directions(self, run: Trajectory) -> Array | None:
        """Return the directions of the joints of the whole, those that are removed by their laws, shape (n, nv)."""
        if not lossy(self.whole):
            return None
        found = np.zeros((len(run), self.whole.model.nv))
        if run.directions is not None:
            found[:, self.kept_v] = run.directions
        for i, law in self.removed.laws.items():
            found[:, i] = law_directions(law, run.grid)
        return found

    def _with_efforts(self, run: Trajectory) -> Trajectory:
        """Return a run of the whole with the efforts of the joints that are removed, or that carry what is.

        Where couplings W are removed, ``tau + W^T lam`` is what the motion asks at their joints.
        """
        demand = run.gather(lambda part, rows: part.inverse(run.grid.t[rows], run.q[rows], run.v[rows], run.a[rows]))
        tau = run.tau.copy()
        tau[:, self.answered] = demand[:, self.answered]
        if not self.removed.couplings:
            return replace(run, tau=tau)
        removed = (coupling for coupling in self._couplings if coupling.name in self.removed.couplings)
        geared = np.array([coupling.coordinate.weights for coupling in removed])
        tied = np.flatnonzero(geared.any(axis=0))
        driven = self.answered[geared[:, self.answered].any(axis=0)]
        ways = np.vstack([np.eye(self.whole.model.nv)[driven], geared])[:, tied]
        found = np.asarray(np.linalg.solve(ways.T, demand[:, tied].T).T, dtype=np.float64)
        tau[:, driven] = found[:, : len(driven)]
        return replace(run, tau=tau, lam=self._multipliers(run.lam, found[:, len(driven) :]))

    @property
    def _couplings(self) -> list[Coupling]:
        return [constraint for constraint in self.whole.constraints if isinstance(constraint, Coupling)]

    def _multipliers(self, lam: Multipliers, geared: Array) -> Multipliers:
        """Return the multipliers of the whole from those of the part and of the couplings removed, shape (n, k)."""
        gone = np.zeros(self.whole.closure.size, dtype=bool)
        for name in self.removed.couplings:
            gone[self.whole.closure.slices[name]] = True

        def own(rows: Indices) -> Array:
            found = np.empty((len(rows), len(gone)))
            found[:, gone], found[:, ~gone] = geared[rows], lam.own(rows)
            return found

        return Multipliers(own, lam.along) if gone.any() else lam

    def _event(self, one: EventRecord) -> EventRecord:
        q, v = self.configuration.copy(), np.zeros(self.whole.model.nv)
        instant = Grid(np.array([one.t]), (one.t, one.t), (0, 1))
        q[self.kept_q], v[self.kept_v] = one.q, one.v
        for i, law in self.removed.laws.items():
            (q[self.joints[i]],), (v[i],), _ = instant.evaluate(law)
        return replace(one, q=q, v=v)


@dataclass(frozen=True, eq=False)
class RestoredMotion(RelayedMotion):
    """A motion of the whole, from that of the part that was solved.

    Attributes:
        part: The part.
        motion: Its motion.
        cuts: Bounds of the intervals between jumps.
    """

    part: ReducedMechanism
    motion: SolvedMotion
    cuts: Sequence[float]

    def at(self, grid: Grid) -> Trajectory:
        return self.part.restored_rows(self.motion.at(grid))

    def positions(self, t: Array) -> Array:
        """Return the configurations of the whole at values of the parameter, shape (n,), of shape (n, nq)."""
        return positions_by_interval(self, self.cuts, t)

    @property
    def relayed(self) -> SolvedMotion:
        """The motion of the part."""
        return self.motion


@dataclass(frozen=True, eq=False)
class Carried(ForceElement):
    """Force elements of a whole as they act on a part of it, the removed joints at rest where they begin.

    Attributes:
        forces: The elements.
        timetable: Laws of joints that are dropped: the instants at which they jump stay in tables.
        configuration: Of the whole, shape (nq,).
        kept_q: Places of the part's configuration in it.
        kept_v: Places of the part's velocity in that of the whole.
        nv: Numbers in the velocity of the whole.
        carriers: Joint of the whole -> joint of the part that moves its bodies.
    """

    forces: tuple[ForceElement, ...]
    timetable: tuple[MotionLaw, ...]
    configuration: Array
    kept_q: Indices
    kept_v: Indices
    nv: int
    carriers: tuple[int, ...]

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        whole_q, whole_v = self._whole(q, v)
        loads = np.zeros_like(whole_v)
        for force in self.forces:
            force.add_load(t, whole_q, whole_v, loads)
        tau += loads[..., self.kept_v]

    def potential_energy(self, q: Array) -> Array:
        whole_q, _ = self._whole(q, np.zeros((*q.shape[:-1], len(self.kept_v))))
        return np.asarray(sum((force.potential_energy(whole_q) for force in self.forces), np.zeros(q.shape[:-1])))

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        whole_q, whole_v = self._whole(q, v)
        powers = (force.dissipated_power(t, whole_q, whole_v) for force in self.forces)
        return np.asarray(sum(powers, np.zeros(q.shape[:-1])))

    @property
    def conservative(self) -> bool:
        return not self.timetable and all(force.conservative for force in self.forces)

    def laws(self) -> list[MotionLaw]:
        return [*(law for force in self.forces for law in force.laws()), *self.timetable]

    def on(self, start: float, end: float) -> Carried:
        return replace(self, forces=tuple(force.on(start, end) for force in self.forces))

    @property
    def in_pieces(self) -> bool:
        return any(force.in_pieces for force in self.forces)

    def passed(self, q: Array, v: Array) -> bool:
        """Return whether a step may have gone past a piece of an element; see ``ForceElement.passed``."""
        whole = self._whole(q, v)
        return any(force.passed(*whole) for force in self.forces)

    def marked(self, laws: Mapping[int, MotionLaw], start: float, end: float) -> list[float]:
        """Return when loads of elements pass points of their pieces; see ``ForceElement.marked``."""
        whole = {int(self.kept_v[v]): law for v, law in laws.items()}
        return [t for force in self.forces for t in force.marked(whole, start, end)]

    def edges(self) -> list[Edge]:
        return [self._edge(edge) for force in self.forces for edge in force.edges()]

    def _edge(self, edge: Edge) -> Edge:
        """Return an edge as a function of states of the part."""
        counts = edge.counts
        return Edge(
            lambda t, q, v: edge.value(t, *self._whole(q, v)),
            counts and (lambda t, q, v: counts(t, *self._whole(q, v))),
        )

    def refusal(self, q: Array) -> str:
        """Return why an element has no load at a configuration of the part; empty where all have one."""
        whole, _ = self._whole(q, np.zeros(len(self.kept_v)))
        return next((said for force in self.forces if (said := force.refusal(whole))), "")

    def wrenches(self, t: float, q: Array, v: Array) -> dict[int, Array]:
        total: dict[int, Array] = {}
        for force in self.forces:
            for joint, wrench in force.wrenches(t, *self._whole(q, v)).items():
                carrier = self.carriers[joint]
                total[carrier] = total.get(carrier, np.zeros(6)) + wrench
        return total

    def _whole(self, q: Array, v: Array) -> tuple[Array, Array]:
        whole_q = np.empty((*q.shape[:-1], len(self.configuration)))
        whole_q[...] = self.configuration
        whole_v = np.zeros((*v.shape[:-1], self.nv))
        whole_q[..., self.kept_q], whole_v[..., self.kept_v] = q, v
        return whole_q, whole_v
