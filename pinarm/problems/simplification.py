"""A free motion solved with the joints locked that it holds still, and the outcome put back into the whole mechanism.

A joint that follows a constant law is locked: with what it carries it becomes one body with its parent. One stays that
is part of a coupling or a sum of coordinates, or that is watched; of mechanisms with other constraints all stay.
Joints are named by their index in v.

Back in the whole, locked joints have the efforts that inverse dynamics of the whole gives them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np
import pinocchio as pin
from msgspec.structs import replace as replace_fields

from pinarm.arrays import Array, Indices
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.outcome import Outcome, RelayedMotion, SolvedMotion, positions_by_interval
from pinarm.engine.motion.trajectory import EventRecord, Trajectory
from pinarm.errors import AssemblyError, DynamicsError, InputError, NumericsError, Place, listed
from pinarm.mechanics.ball_joints import ball_coordinates, balls_of
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate
from pinarm.mechanics.couplings.coupling import Coupling
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.geometry.kinematics import new_data
from pinarm.mechanics.joints import joints_of
from pinarm.mechanics.laws import Constant, Over
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.problems import Problem
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.loads import Force, bind_loads
from pinarm.records import Record, ValueRecord, replace

if TYPE_CHECKING:
    from pinarm.problems.forward import Forward


def without(problem: Forward, names: Collection[str]) -> Forward:
    """Return a problem on a mechanism that lacks some coordinates, which follow laws and are not watched.

    Its loads, which are forces of that mechanism, are left out.
    """
    left = {key: {name: x for name, x in getattr(problem, key).items() if name not in names} for key in LEFT_OUT}
    return replace_fields(problem, **left, loads={})


LEFT_OUT = ("motion", "start")
"""What a problem says of coordinates that follow laws."""


class Locking(Record, frozen=True):
    """Joints that are locked.

    Attributes:
        positions: Joint -> where it stands [rad or m].
        laws: Those of the joints that follow a law of their own.
        couplings: Those that hold the others, one each.
        drives: Coordinates that follow laws, those of locked joints too.
    """

    positions: Mapping[int, float]
    laws: Sequence[int]
    couplings: Mapping[str, Coupling]
    drives: Sequence[str]


def locking(problem: Forward, mechanism: Mechanism) -> Locking | None:
    """Return the joints that a problem may lock; ``None`` without any."""
    coordinates, closure = mechanism.coordinates, mechanism.closure
    prescribed = {name: coordinates[name] for name in problem.motion}
    couplings = {tie.name: tie for tie in mechanism.constraints if isinstance(tie, Coupling)}
    sums = all(isinstance(coordinate, LinearCoordinate) for coordinate in prescribed.values())
    if not sums or closure.redundant or len(couplings) < len(mechanism.constraints):
        return None  # with loops the error of a step is measured over all coordinates: fewer of them take other steps
    own = {name: v for name, coordinate in prescribed.items() if (v := _own_joint(coordinate)) is not None}
    constants = ((v, problem.motion[name]) for name, v in own.items())
    positions = {v: float(law.value) for v, law in constants if isinstance(law, Constant)}
    settled = _settled(couplings, positions, own.values())
    moving: list[Coordinate] = [tie.coordinate for name, tie in couplings.items() if name not in settled]
    moving += [coordinate for name, coordinate in prescribed.items() if name not in own]
    stay = {v for coordinate in (*moving, *_watched(problem, mechanism)) for v in _joints_in(coordinate)}
    stay |= set(range(mechanism.model.nv)) - positions.keys()
    while torn := [name for name, tie in settled.items() if stay & _joints_in(tie.coordinate)]:
        stay |= {v for name in torn for v in _joints_in(settled.pop(name).coordinate)}
    positions = {v: position for v, position in positions.items() if v not in stay}
    laws = sorted(positions.keys() & {*own.values()})
    return Locking(positions, laws, settled, [*prescribed]) if stay and positions else None


def _settled(
    couplings: Mapping[str, Coupling], positions: dict[int, float], driven: Collection[int]
) -> dict[str, Coupling]:
    """Return couplings that leave one of their joints nothing but to stand still, and add where it stands."""
    settled, count = dict[str, Coupling](), -1
    while count < len(settled):
        count = len(settled)
        for name, coupling in couplings.items():
            weights, joints = coupling.coordinate.weights, _joints_in(coupling.coordinate)
            left = joints - positions.keys()
            if len(left) == 1 and not left & {*driven}:
                (v,) = left
                others = sum(weights[known] * positions[known] for known in joints - left)
                positions[v], settled[name] = float((coupling.constant - others) / weights[v]), coupling
    return settled


def _watched(problem: Forward, mechanism: Mechanism) -> Iterator[Coordinate]:
    """Yield the coordinates that events, controllers and profiles look at."""
    names = [event.when for event in problem.events.values()]
    names += [name for controller in (*problem.control, *mechanism.control) for name in controller.names]
    names += [law.of for law in problem.motion.values() if isinstance(law, Over)]
    for name in names:
        yield mechanism.coordinates[mechanism.drives[name].coordinate if name in mechanism.drives else name]


def _own_joint(coordinate: Coordinate) -> int | None:
    """Return the joint whose own coordinate it is; ``None`` of another one."""
    return coordinate.joint if isinstance(coordinate, LinearCoordinate) else None


def _joints_in(coordinate: Coordinate) -> set[int]:
    """Return the joints in a sum: its weights are numbers of the input, however small; none of another coordinate."""
    return set(np.flatnonzero(coordinate.weights).tolist()) if isinstance(coordinate, LinearCoordinate) else set()


class LockedMechanism(Record, frozen=True):
    """A mechanism with joints locked: the part that is left of it.

    Attributes:
        elements: Force elements of the part.
    """

    whole: Mechanism
    forces: Mapping[str, ForceElement]
    locking: Locking
    elements: Mapping[str, ForceElement] = {}

    @classmethod
    def of(
        cls, whole: Mechanism, forces: Mapping[str, ForceElement], loads: Mapping[str, Force], locking: Locking
    ) -> LockedMechanism | None:
        """Return a mechanism with joints locked; ``None`` where a force element cannot be had without them.

        Args:
            forces: All force elements of the run, by name.
            loads: Definitions of those of the problem, by name.
        """
        part = cls(whole, forces, locking)
        elements = part._elements({**whole.description.forces, **loads})
        return None if elements is None else replace(part, elements=elements)

    def spread(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return states of the part as those of the whole, shapes (.., nq) and (.., nv)."""
        whole_q = np.broadcast_to(self.configuration, (*q.shape[:-1], len(self.configuration))).copy()
        whole_v = np.zeros((*v.shape[:-1], self.whole.model.nv))
        whole_q[..., self.kept_q], whole_v[..., self.kept_v] = q, v
        return whole_q, whole_v

    def restored(self, outcome: Outcome) -> Outcome:
        motion = outcome.motion and RestoredMotion(self, outcome.motion, outcome.rows.grid.cuts)
        events = [self._event(event) for event in outcome.events]
        return replace(outcome, rows=self.restored_rows(outcome.rows), motion=motion, events=events)

    def _event(self, event: EventRecord) -> EventRecord:
        q, v = self.spread(event.q, event.v)
        return replace(event, q=q, v=v)

    def restored_rows(self, run: Trajectory) -> Trajectory:
        own, nv = self.locking, self.whole.model.nv
        (q, v), (_, a), (_, tau) = (self.spread(run.q, x) for x in (run.v, run.a, run.tau))
        names = [constraint.name for constraint in run.closure.constraints[len(run.mechanism.constraints) :]]
        driven = np.isin(np.arange(nv), [*self.kept_v[run.driven], *own.laws])
        back = replace(
            run, mechanism=self.whole, q=q, v=v, a=a, dynamics=Dynamics.of(self.whole.model, self.forces),
            closure=self.whole.closure.with_guides(names, [self.whole.coordinate(name) for name in names]),
            driven=driven, drives=(*dict.fromkeys((*own.drives, *run.drives)),),
        )  # fmt: skip
        return self._with_efforts(back, tau)

    def _with_efforts(self, run: Trajectory, tau: Array) -> Trajectory:
        """Return a run of the whole with the efforts of the joints that are locked; ``tau`` has the others.

        With the couplings W that are removed ``tau + W^T lam`` is what the motion asks at locked joints.
        """
        laws, couplings, locked = self.locking.laws, self.locking.couplings, sorted(self.locking.positions)
        demand = run.gather(lambda part, rows: part.inverse(run.grid.t[rows], run.q[rows], run.v[rows], run.a[rows]))
        weights = [coupling.coordinate.weights for coupling in couplings.values()]
        ways = np.array([*np.eye(self.whole.model.nv)[laws], *weights])[:, locked]
        efforts = np.linalg.solve(ways.T, demand[:, locked].T).T
        tau[:, laws] = efforts[:, : len(laws)]
        gone = np.zeros(run.lam.shape[1] + len(couplings), dtype=bool)
        gone[[self.whole.closure.slices[name].start for name in couplings]] = True
        lam = np.empty((len(run), len(gone)))
        lam[:, gone], lam[:, ~gone] = efforts[:, len(laws) :], run.lam
        return replace(run, tau=tau, lam=lam)

    @cached_property
    def configuration(self) -> Array:
        """A configuration of the whole in which the locked joints are where they are locked, shape (nq,)."""
        q = np.asarray(pin.neutral(self.whole.model)).copy()
        for v, position in self.locking.positions.items():
            q[self._places_in_q[v]] = position
        return q

    @cached_property
    def _places_in_q(self) -> dict[int, int]:
        return {joint.v: joint.q for joint in self.whole.joints.values()}

    @cached_property
    def kept_q(self) -> Indices:
        """Places of the part's configuration in that of the whole, shape (nq of the part,)."""
        gone = [self._places_in_q[v] for v in self.locking.positions]
        return np.delete(np.arange(self.whole.model.nq), gone)

    @cached_property
    def kept_v(self) -> Indices:
        """Places of the part's velocity in that of the whole, shape (nv of the part,)."""
        return np.delete(np.arange(self.whole.model.nv), list(self.locking.positions))

    @cached_property
    def mechanism(self) -> Mechanism:
        whole, model = self.whole, self.model
        joints = joints_of(model)
        left = (constraint for constraint in whole.constraints if constraint.name not in self.locking.couplings)
        constraints = tuple(self._coupling(tie) for tie in left if isinstance(tie, Coupling))
        drives = {name: drive for name, drive in whole.drives.items() if drive.joint in joints}
        return replace(
            whole, model=model, joints=joints, balls=balls_of(model), coordinates=self._coordinates(),
            constraints=constraints, drives=drives, forces=self.elements,
        )  # fmt: skip

    def _elements(self, definitions: Mapping[str, Force]) -> dict[str, ForceElement] | None:
        """Return the force elements of the part; ``None`` where one is not known of it, or jumps where it would stay.

        Those at locked joints are left out.
        """
        from pinarm.mechanics.forces.joint_forces import SpringDamper

        elements, part = dict[str, ForceElement](), self.mechanism
        for name, force in self.forces.items():
            if isinstance(force, SpringDamper):
                elements[name] = force.within(self.kept_q, self.kept_v)
                continue
            if name not in definitions:
                return None
            try:
                elements[name] = definitions[name].bind(part.model, part.joints, part.coordinates)
            except InputError:  # at a locked joint
                if force.jumps or getattr(definitions[name], "joint", None) not in self.whole.joints:
                    return None
        return elements

    @cached_property
    def model(self) -> pin.Model:
        """Pinocchio's model of the part, its frames numbered as in the whole.

        ``pin.buildReducedModel`` looks frames up by name and refuses a link that is called like a joint.
        """
        whole, model = self.whole.model, pin.Model()
        model.name, model.gravity = whole.name, whole.gravity
        data = new_data(whole)
        pin.forwardKinematics(whole, data, self.configuration)
        places = [(0, pin.SE3.Identity())]  # for every joint the one that moves its bodies, and where it is in that
        for index in range(1, whole.njoints):
            joint, (parent, before) = whole.joints[index], places[whole.parents[index]]
            if joint.idx_v in self.locking.positions:
                places.append((parent, before * data.liMi[index]))
            else:
                own = model.addJoint(parent, joint, before * whole.jointPlacements[index], whole.names[index])
                places.append((own, pin.SE3.Identity()))
            model.appendBodyToJoint(places[index][0], whole.inertias[index], places[index][1])
        for frame in list(whole.frames)[1:]:
            carrier, place = places[frame.parentJoint]
            model.addFrame(pin.Frame(frame.name, carrier, frame.parentFrame, place * frame.placement, frame.type))
        model.armature[:] = whole.armature[self.kept_v]
        return model

    def _coordinates(self) -> dict[str, Coordinate]:
        """Return the coordinates that no locked joint has a part in, but for those of frames, which all stay."""
        gone, balls = list(self.locking.positions), balls_of(self.model)
        coordinates = {
            name: self._sum(known) if isinstance(known, LinearCoordinate) else known
            for name, known in self.whole.coordinates.items()
            if not (isinstance(known, LinearCoordinate) and known.weights[gone].any())
        }
        return {**coordinates, **ball_coordinates(self.model, balls)}

    def _coupling(self, coupling: Coupling) -> Coupling:
        """Return a coupling of the part, its forces as efforts: reactions are asked of the whole."""
        follower = None if coupling.follower is None else int(np.searchsorted(self.kept_v, coupling.follower))
        return replace(coupling, coordinate=self._sum(coupling.coordinate), follower=follower, transmission=None)

    def _sum(self, coordinate: LinearCoordinate) -> LinearCoordinate:
        places = np.zeros(self.model.nv, dtype=np.intp)
        for joint in joints_of(self.model).values():
            places[joint.v] = joint.q
        return replace(coordinate, weights=coordinate.weights[self.kept_v], places=places)


class RestoredMotion(RelayedMotion):
    """A motion of the whole, from that of the part that was solved, with bounds of the intervals between jumps."""

    def __init__(self, part: LockedMechanism, motion: SolvedMotion, cuts: Sequence[float]) -> None:
        self.part, self.motion, self.cuts = part, motion, cuts

    @property
    def relayed(self) -> SolvedMotion:
        return self.motion

    def at(self, grid: Grid) -> Trajectory:
        return self.part.restored_rows(self.motion.at(grid))

    def positions(self, t: Array) -> Array:
        return positions_by_interval(self, self.cuts, t)


class Removal(ValueRecord, frozen=True):
    """A joint that is not solved for.

    Attributes:
        how: ``locked``; files of earlier versions also have ``dropped``, with its bodies.
    """

    joint: str
    how: Literal["locked", "dropped"]
    why: str


class Simplification(Record, frozen=True):
    """A problem, and what is solved in its place.

    Attributes:
        part: What is solved; ``None`` where that is the whole.
    """

    question: Problem
    mechanism: Mechanism
    accuracy: Accuracy
    place: Place
    problem: Problem
    part: LockedMechanism | None = None

    @classmethod
    def whole(cls, problem: Problem, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> Simplification:
        return cls(problem, mechanism, accuracy, place, problem)

    @classmethod
    def required(cls, problem: Problem, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> Simplification:
        """Return the simplification of a problem; its part is ``None`` where nothing can be locked."""
        whole = cls.whole(problem, mechanism, accuracy, place)
        rotors = any(drive.turns_rotor for drive in mechanism.drives.values())
        if problem.kind != "forward" or rotors or mechanism.frictions:
            return whole  # rotors of their own, and friction that sticks, move with several joints
        free = cast("Forward", problem)
        try:
            lock = locking(free, mechanism)
        except KeyError:  # a name that does not exist: the question tells of it when it is solved
            lock = None
        if lock is None:
            return whole
        part = LockedMechanism.of(mechanism, bind_loads(mechanism, free.loads, place), free.loads, lock)
        if part is None:
            return whole
        problem.prepare(mechanism, accuracy, place)
        removed = mechanism.coordinates.keys() - part.mechanism.coordinates.keys()
        return cls(problem, mechanism, accuracy, place, without(free, removed), part)

    def solve(self) -> tuple[Outcome, Outcome]:
        """Return the outcome of the mechanism that was solved, and that of the whole mechanism.

        Where the part cannot be solved, the whole is tried, so that an error refers to the whole.
        """
        if self.part is None:
            return self._as_put()
        try:
            run = self.problem.solve(self.solved, self.accuracy, self.place, self._prepared_part)
        except (InputError, AssemblyError, DynamicsError):
            return self._as_put()
        except NumericsError as error:
            if isinstance(error.partial, Outcome):
                error.partial = self.part.restored(error.partial)
            raise
        return run, self.part.restored(run)

    @property
    def solved(self) -> Mechanism:
        return self.mechanism if self.part is None else self.part.mechanism

    def _as_put(self) -> tuple[Outcome, Outcome]:
        run = self.question.solve(self.mechanism, self.accuracy, self.place, self._prepared)
        return run, run

    @cached_property
    def _prepared(self) -> Any:
        return self.question.prepare(self.mechanism, self.accuracy, self.place)

    @cached_property
    def _prepared_part(self) -> Any:
        return self.problem.prepare(self.solved, self.accuracy, self.place)

    @property
    def removals(self) -> tuple[Removal, ...]:
        if self.part is None:
            return ()
        positions, joints = self.part.locking.positions, self.mechanism.joints.values()
        return tuple(
            Removal(joint.name, "locked", f"held at {positions[joint.v]:.6g} {joint.unit}")
            for joint in joints
            if joint.v in positions
        )


def removal_lines(removals: Sequence[Removal]) -> list[str]:
    """Return a line on the removed joints, many joints counted; empty without any."""
    names = [removal.joint for removal in removals]
    return [f"locked: {listed('joint', names)} (held still)"] if names else []
