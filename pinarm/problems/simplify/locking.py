"""Locked joints of a mechanism, by problem. Joints are named by their index in v.

A joint at rest, by a law, by a value of ``hold`` or through a coupling, is locked, unless it is part of a loop or a sum
of coordinates, or a force is asked at it. No joint is locked where named drives act along other coordinates than those
that follow laws.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from functools import cached_property

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.statics.actuation import followers_of
from pinarm.input.formulas.expressions import Expression
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate
from pinarm.mechanics.couplings.coupling import Coupling, JointRelation
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.laws import Constant, Over
from pinarm.problems.declaration import Declaration
from pinarm.records import Record

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
