"""A problem solved with the joints locked that it holds still, and the outcome put back into the whole mechanism.

A joint at rest, by a law, by a value of ``hold`` or through a coupling, is locked, unless it is part of a loop or a sum
of coordinates, or a force is asked at it: with what it carries it becomes one body with its parent. No joint is locked
where named drives act along other coordinates than those that follow laws. Joints are named by their index in v.

Back in the whole, locked joints have the efforts that inverse dynamics of the whole gives them.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, TypeVar, cast

import numpy as np
import pinocchio as pin
from msgspec import field
from msgspec.structs import replace as replace_fields

from pinarm.arrays import Array, Indices
from pinarm.engine.constraints.constraint_rows import joint_ties
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.outcome import Outcome, RelayedMotion, SolvedMotion, positions_by_interval
from pinarm.engine.motion.trajectory import EventRecord, Trajectory
from pinarm.engine.statics.actuation import followers_of
from pinarm.errors import AssemblyError, DynamicsError, InputError, NumericsError, Place, listed
from pinarm.input.formulas.expressions import Expression
from pinarm.mechanics.ball_joints import ball_coordinates, balls_of
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate
from pinarm.mechanics.couplings.coupling import Coupling, JointRelation
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.geometry.kinematics import Kinematics, new_data
from pinarm.mechanics.joints import joints_of
from pinarm.mechanics.laws import Constant, Over
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.problems import Problem
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.loads import Force, bind_loads
from pinarm.records import Record, ValueRecord, replace

if TYPE_CHECKING:
    from pinarm.mechanics.laws import Motion

ValueT = TypeVar("ValueT")


class Declaration(ValueRecord, frozen=True):
    """Declaration of the coordinates that a problem holds, moves, drives and watches.

    Attributes:
        held: Coordinate -> its constant value.
        laws: Coordinate -> the law that it follows.
        watched: Coordinates that the problem looks at, so that they are kept.
        drives: Coordinates along which the drives act; empty for those that the kind of problem chooses.
    """

    held: Mapping[str, float] = field(default_factory=dict)
    moved: Collection[str] = ()
    laws: Mapping[str, Motion] = field(default_factory=dict)
    watched: Collection[str] = ()
    drives: Sequence[str] = ()
    loads: Mapping[str, Force] = field(default_factory=dict)
    integrated: bool = False

    @property
    def prescribed(self) -> list[str]:
        return [*self.held, *self.moved, *self.laws]

    def differs_by_numbers(self, other: Declaration) -> bool:
        """Tell whether another problem says the same of the same coordinates but for numbers.

        Then the same joints can be left out: that depends on what stands still, moves, and is looked at.
        """
        mine, its = (
            [*map(list, (d.held, d.moved, d.watched, d.drives, d.loads))]
            + [(name, type(law), getattr(law, "of", "")) for name, law in d.laws.items()]
            for d in (self, other)
        )
        return mine == its


def others(values: Mapping[str, ValueT], names: Collection[str]) -> dict[str, ValueT]:
    """Return the values of the coordinates that are not among some names."""
    return {name: value for name, value in values.items() if name not in names}


BY_NAME = ("hold", "velocity", "acceleration", "motion", "start")
"""Fields of problems with values of coordinates by name."""


def without(problem: Problem, names: Collection[str]) -> Problem:
    """Return a problem on a mechanism that lacks some coordinates.

    What it says about them is left out, and so are its loads, which are forces of that mechanism.
    """
    fields: Any = problem
    changes: dict[str, Any] = {key: others(getattr(fields, key), names) for key in BY_NAME if hasattr(fields, key)}
    if hasattr(fields, "drives"):
        changes["drives"] = [name for name in fields.drives if name not in names]
    if "loads" in fields.__struct_fields__:
        changes["loads"] = {}
    return cast("Problem", replace_fields(fields, **changes))


ABSENT = 1e-12
"""Entry of a row, relative to the largest, that is 0 but for rounding: the joint has no part in it."""

WORD = re.compile(r"[^\W\d][\w.]*")
JOINT, DRIVE, POINT = re.compile(r"\b(?:joint|coordinate)\."), re.compile(r"\bdrive\."), re.compile(r"\.")

MOTION = re.compile(r"(?:position|velocity|acceleration)\b")
"""Quantities of a joint that are no forces."""


def requested_joints(texts: Iterable[str], symbols: Mapping[str, Expression], mechanism: Mechanism) -> set[str]:
    """Return the names of the joints whose effort, power or reaction is requested, or the torque of whose drive."""
    left, seen = list(texts), set[str]()
    while left:
        text = left.pop()
        if text in seen:
            continue
        seen.add(text)
        for word in WORD.findall(text):
            left += [known[word].text for known in (symbols, mechanism.symbols) if word in known]
    asked = (pair for text in seen for pair in _asked(text, JOINT))
    joints = {name for name, rest in asked if name in mechanism.joints and not MOTION.match(rest)}
    drives = {name for text in seen for name, _ in _asked(text, DRIVE)}
    return joints | {drive.coordinate for name, drive in mechanism.drives.items() if name in drives}


def _asked(text: str, family: re.Pattern[str]) -> Iterator[tuple[str, str]]:
    """Yield possible names behind the word of a family, each with the text behind its point: names may hold points."""
    for word in family.finditer(text):
        for point in POINT.finditer(text, word.end()):
            yield text[word.end() : point.start()], text[point.end() :]


class Locking(Record, frozen=True):
    """Joints that are locked.

    Attributes:
        positions: Joint -> where it stands [rad or m].
        answered: Joints whose effort carries what the motion of the whole asks at them, and nothing else.
    """

    positions: Mapping[int, float]
    couplings: Collection[str]
    answered: Indices


def locking(declared: Declaration, mechanism: Mechanism, requested: Collection[str]) -> Locking | None:
    """Return the joints that a problem may lock, with forces asked at some joints by name; ``None`` without any."""
    known = _KnownMotion(declared, mechanism)
    if not known.still or not known.reducible:
        return None
    stay = known.kept_joints(requested)
    positions = {v: position for v, position in known.still.items() if v not in stay}
    settled = [name for name, joints in known.still_couplings.items() if not joints & stay]
    left = [coordinate for coordinate in known.prescribed.values() if _own_joint(coordinate) not in positions]
    if not (stay and positions and (left or declared.integrated) and known.has_same_drives(settled)):
        return None
    geared = set().union(*(joints for name, joints in known.still_couplings.items() if name not in settled))
    answered = np.array(sorted(known.driven - known.shared_efforts - geared), dtype=np.intp)
    return Locking(positions, settled, answered)


class _KnownMotion(Record, frozen=True):
    """Known motion of a mechanism before anything is solved."""

    declared: Declaration
    mechanism: Mechanism

    @cached_property
    def prescribed(self) -> dict[str, Coordinate]:
        return {name: self.mechanism.coordinates[name] for name in self.declared.prescribed}

    @cached_property
    def driven(self) -> set[int]:
        own = {name: _own_joint(self.prescribed[name]) for name in (*self.declared.held, *self.declared.laws)}
        return {v for v in own.values() if v is not None}

    @cached_property
    def still(self) -> dict[int, float]:
        """Joints that stand still, by their own law or because a coupling leaves them nothing else; and where."""
        laws = {name: law.value for name, law in self.declared.laws.items() if isinstance(law, Constant)}
        own = {_own_joint(self.prescribed[name]): float(x) for name, x in {**self.declared.held, **laws}.items()}
        constants = {v: x for v, x in own.items() if v is not None}
        while True:
            before = len(constants)
            for coupling in self._couplings:
                weights = coupling.coordinate.weights
                left = [v for v in _joints_in(coupling.coordinate) if v not in constants]
                if len(left) == 1 and left[0] not in self.driven:
                    others = sum(weights[v] * position for v, position in constants.items())
                    constants[left[0]] = float((coupling.constant - others) / weights[left[0]])
            if len(constants) == before:
                return constants

    @property
    def _couplings(self) -> list[Coupling]:
        return [constraint for constraint in self.mechanism.constraints if isinstance(constraint, Coupling)]

    @cached_property
    def still_couplings(self) -> dict[str, set[int]]:
        """Couplings of joints that all stand still, one of them because of it; and their joints."""
        couplings = {coupling.name: _joints_in(coupling.coordinate) for coupling in self._couplings}
        still = {name: joints for name, joints in couplings.items() if joints <= set(self.still)}
        followers = set(self.still) - self.driven
        return still if len(still) == len(followers & set().union(*still.values())) else {}

    @cached_property
    def shared_efforts(self) -> set[int]:
        """Joints whose effort is not simply what the motion asks at them: others share in it.

        They have a part in a constraint, in a sum that follows a law, or in a coordinate of a task along which a drive
        acts: that loads every joint before the link that it moves.
        """
        constraints, coordinates = self.mechanism.constraints, self.mechanism.coordinates
        joints = {
            v
            for coordinate in self.prescribed.values()
            if _own_joint(coordinate) is None
            for v in _joints_in(coordinate)
        }
        drives = self.declared.drives or ([] if followers_of(constraints) is not None else self.prescribed)
        rows = [coordinates[name].row(self._state) for name in drives]
        guides = [row for name, row in zip(drives, rows, strict=True) if not _is_sum(coordinates[name])]
        for constraint in constraints:
            if isinstance(constraint, Coupling):
                joints |= _joints_in(constraint.coordinate) if constraint.name not in self.still_couplings else set()
            else:
                guides.append(constraint.rows(self._state))
        return joints.union(*map(_joints_of, guides))

    def kept_joints(self, requested: Collection[str]) -> set[int]:
        mechanism, declared = self.mechanism, self.declared
        stay = self.shared_efforts | (set(range(mechanism.model.nv)) - set(self.still))
        stay |= {mechanism.joints[name].v for name in requested if name in mechanism.joints}
        watched = [*declared.moved, *declared.watched]
        watched += [law.of for law in declared.laws.values() if isinstance(law, Over)]
        watched += (
            [name for controller in mechanism.control for name in controller.names] if declared.integrated else []
        )
        motors = mechanism.drives
        for name in watched:
            stay |= _joints_in(mechanism.coordinates[motors[name].coordinate if name in motors else name])
        while torn := [joints for joints in self.still_couplings.values() if joints & stay and not joints <= stay]:
            stay |= set().union(*torn)
        return stay

    @property
    def reducible(self) -> bool:
        constraints, closure = self.mechanism.constraints, self.mechanism.closure
        if self.declared.drives and {*self.declared.drives} != {*self.prescribed}:
            return False
        if any(
            isinstance(constraint, JointRelation) and not isinstance(constraint, Coupling) for constraint in constraints
        ):
            return False  # what a cam leaves of its joints depends on where they are
        # integrated with loops, the error of a step is measured over all coordinates: fewer of them take other steps
        straight = all(map(_is_sum, self.prescribed.values())) and len(self._couplings) == len(constraints)
        return not self.declared.integrated or (straight and not closure.redundant)

    def has_same_drives(self, settled: Collection[str]) -> bool:
        constraints = self.mechanism.constraints
        left = [constraint for constraint in constraints if constraint.name not in settled]
        if self.declared.drives or (followers_of(left) is None) == (followers_of(constraints) is None):
            return True
        return all(_own_joint(coordinate) is not None for coordinate in self.prescribed.values())

    @cached_property
    def _state(self) -> Kinematics:
        model = self.mechanism.model
        anywhere = np.sin(np.arange(1.0, model.nv + 1.0))
        return Kinematics.at(model, pin.integrate(model, pin.neutral(model), anywhere))


def _is_sum(coordinate: Coordinate) -> bool:
    return isinstance(coordinate, LinearCoordinate)


def _own_joint(coordinate: Coordinate) -> int | None:
    """Return the joint whose own coordinate it is; ``None`` of another one."""
    return coordinate.joint if isinstance(coordinate, LinearCoordinate) else None


def _joints_in(coordinate: Coordinate) -> set[int]:
    """Return the joints in a sum: its weights are numbers of the input, however small; none of another coordinate."""
    return set(np.flatnonzero(coordinate.weights).tolist()) if isinstance(coordinate, LinearCoordinate) else set()


def _joints_of(rows: Array) -> set[int]:
    """Return the joints that have a part in computed rows, shape (nv,) or (m, nv)."""
    size = np.abs(np.atleast_2d(rows))
    return set(np.flatnonzero((size > ABSENT * size.max(initial=0.0)).any(axis=0)).tolist())


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
        own, kept, n = self.locking, self.kept_v, len(run)
        (q, v), (_, a), (_, tau) = (self.spread(run.q, x) for x in (run.v, run.a, run.tau))
        names = [constraint.name for constraint in run.closure.constraints[len(run.mechanism.constraints) :]]
        closure = self.whole.closure.with_guides(names, [self.whole.coordinate(name) for name in names])
        driven, directions = run.driven, run.directions
        if driven is not None:
            driven = np.isin(np.arange(len(v[0])), [*kept[driven], *own.answered])
        if directions is not None:
            directions = self.spread(run.q, directions)[1]
        back = replace(
            run, mechanism=self.whole, q=q, v=v, a=a, tau=tau, closure=closure,
            dynamics=Dynamics.of(self.whole.model, self.forces), driven=driven, directions=directions,
        )  # fmt: skip
        if run.no_efforts:
            return replace(back, lam=self._multipliers(run.lam, np.zeros((n, len(own.couplings)))))
        return self._with_efforts(back)

    def _with_efforts(self, run: Trajectory) -> Trajectory:
        """Return a run of the whole with the efforts of the joints that are locked, or that carry such.

        Where couplings W are removed, ``tau + W^T lam`` is what the motion asks at their joints.
        """
        answered, names = self.locking.answered, self.locking.couplings
        demand = run.gather(lambda part, rows: part.inverse(run.grid.t[rows], run.q[rows], run.v[rows], run.a[rows]))
        tau = run.tau.copy()
        tau[:, answered] = demand[:, answered]
        if not names:
            return replace(run, tau=tau)
        couplings = (
            constraint
            for constraint in self.whole.constraints
            if isinstance(constraint, Coupling) and constraint.name in names
        )
        geared = np.array([coupling.coordinate.weights for coupling in couplings])
        tied = np.flatnonzero(geared.any(axis=0))
        driven = answered[geared[:, answered].any(axis=0)]
        ways = np.vstack([np.eye(self.whole.model.nv)[driven], geared])[:, tied]
        efforts = np.asarray(np.linalg.solve(ways.T, demand[:, tied].T).T, dtype=np.float64)
        tau[:, driven] = efforts[:, : len(driven)]
        return replace(run, tau=tau, lam=self._multipliers(run.lam, efforts[:, len(driven) :]))

    def _multipliers(self, lam: Array, geared: Array) -> Array:
        """Return the multipliers of the whole from those of the part and of the couplings removed, shape (n, k)."""
        gone = np.zeros(lam.shape[1] + geared.shape[1], dtype=bool)
        for name in self.locking.couplings:
            gone[self.whole.closure.slices[name]] = True
        multipliers = np.empty((len(lam), len(gone)))
        multipliers[:, gone], multipliers[:, ~gone] = geared, lam
        return multipliers

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
        constraints = tuple(
            self._coupling(left_name) if isinstance(left_name, Coupling) else left_name for left_name in left
        )
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
        from pinarm.mechanics.forces.kinds import bound

        elements, part = dict[str, ForceElement](), self.mechanism
        for name, force in self.forces.items():
            if isinstance(force, SpringDamper):
                elements[name] = force.within(self.kept_q, self.kept_v)
                continue
            if name not in definitions:
                return None
            try:
                elements[name] = bound(definitions[name], part.model, part.joints, part.coordinates)
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
            name: self._sum(known) if isinstance(known, LinearCoordinate) else self._counting(known)
            for name, known in self.whole.coordinates.items()
            if not (isinstance(known, LinearCoordinate) and known.weights[gone].any())
        }
        return {**coordinates, **ball_coordinates(self.model, balls)}

    def _coupling(self, coupling: Coupling) -> Coupling:
        """Return a coupling of the part, its forces as efforts: reactions are asked of the whole."""
        follower = None if coupling.follower is None else int(np.searchsorted(self.kept_v, coupling.follower))
        return replace(coupling, coordinate=self._sum(coupling.coordinate), follower=follower, transmission=None)

    def _counting(self, coordinate: Coordinate) -> Coordinate:
        """Return a coordinate of frames; of an angle at a loop joint, joints that are locked count as they stand."""
        from pinarm.mechanics.loops.lower_pairs import TurnedAbout  # most have none

        turns = coordinate.turns if isinstance(coordinate, TurnedAbout) else None
        if not isinstance(coordinate, TurnedAbout) or turns is None:
            return coordinate
        gone = list(self.locking.positions)
        held = float(turns.weights[gone] @ self.configuration[turns.places[gone]])
        return replace(coordinate, turns=self._sum(turns), offset=coordinate.offset + held)

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
    def required(
        cls, problem: Problem, mechanism: Mechanism, accuracy: Accuracy, place: Place, requested: Collection[str]
    ) -> Simplification:
        """Return the simplification of a problem; its part is ``None`` where nothing can be locked."""
        declared, whole = problem.declaration(), cls.whole(problem, mechanism, accuracy, place)
        tied = joint_ties(mechanism.constraints) or any(drive.turns_rotor for drive in mechanism.drives.values())
        if declared is None or tied or mechanism.frictions:  # these move, or stick and slip, with several joints
            return whole
        try:
            lock = locking(declared, mechanism, requested)
        except KeyError:  # a name that does not exist: the question tells of it when it is solved
            lock = None
        if lock is None:
            return whole
        forces = bind_loads(mechanism, declared.loads, place)
        part = LockedMechanism.of(mechanism, forces, declared.loads, lock)
        if part is None:
            return whole
        problem.prepare(mechanism, accuracy, place)
        removed = mechanism.coordinates.keys() - part.mechanism.coordinates.keys()
        return cls(problem, mechanism, accuracy, place, without(problem, removed), part)

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
