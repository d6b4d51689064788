"""Which joints of a mechanism a question can be answered without. Joints are named by their index in v.

In doubt a joint stays: one that a loop or a sum of coordinates has in it, at which a force is asked, or that an event
looks at; and all of them, where drives are named that act along other coordinates than those that follow laws.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import cached_property

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.statics.actuation import followers_of
from pinarm.errors import Place
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate
from pinarm.mechanics.couplings.coupling import Coupling, JointRelation
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.laws import Constant, Over
from pinarm.mechanics.laws.motion_law import MotionLaw
from pinarm.problems.declaration import Declaration
from pinarm.problems.prescription.prescribed_laws import laws_of
from pinarm.records import Record

ABSENT = 1e-12
"""Entry of a row, relative to the largest, that is 0 but for rounding: the joint has no part in it."""


def known_laws(declared: Declaration, mechanism: Mechanism, place: Place) -> dict[str, MotionLaw]:
    """Return the coordinates whose motion is known beforehand, with their laws.

    Args:
        declared: What a problem says about coordinates.
        mechanism: The mechanism.
        place: Gives errors their place.

    Raises:
        InputError: A law has a mistake.
    """
    held = {name: Constant(value=value) for name, value in declared.held.items()}
    return {**held, **laws_of(mechanism, declared.laws, place, declared.span)}


class Removed(Record, frozen=True):
    """What is removed of a mechanism. Joints are named by their index in v.

    Attributes:
        locked: Joint -> the law that it stands still by.
        dropped: Joint -> the law that it moves by.
        couplings: Names of couplings all of whose joints are locked.
    """

    locked: Mapping[int, MotionLaw]
    dropped: Mapping[int, MotionLaw]
    couplings: Collection[str] = ()

    @property
    def laws(self) -> dict[int, MotionLaw]:
        return {**self.locked, **self.dropped}


class KnownMotion(Record, frozen=True):
    """What is known of the motion of a mechanism before anything is solved.

    Attributes:
        declared: What the problem says about coordinates.
        mechanism: The mechanism.
        laws: Coordinate -> its law.
    """

    declared: Declaration
    mechanism: Mechanism
    laws: Mapping[str, MotionLaw]

    @cached_property
    def own_laws(self) -> dict[int, MotionLaw]:
        """Joints whose own coordinate follows a law."""
        found = {}
        for name, law in self.laws.items():
            one = self.mechanism.coordinates.get(name)
            if isinstance(one, LinearCoordinate) and one.joint is not None:
                found[one.joint] = law
        return found

    @cached_property
    def stationary(self) -> dict[int, Constant]:
        """Joints that stand still: by their own law, or because a coupling leaves them nothing else."""
        found = {v: law for v, law in self.own_laws.items() if isinstance(law, Constant)}
        while True:
            before = len(found)
            for coupling in self._couplings:
                weights = coupling.coordinate.weights
                left = [v for v in _joints_in(coupling.coordinate) if v not in found]
                if len(left) == 1 and left[0] not in self.own_laws:
                    others = sum(weights[v] * law.value for v, law in found.items())
                    found[left[0]] = Constant(value=float((coupling.constant - others) / weights[left[0]]))
            if len(found) == before:
                return found

    @property
    def _couplings(self) -> list[Coupling]:
        return [constraint for constraint in self.mechanism.constraints if isinstance(constraint, Coupling)]

    @cached_property
    def stationary_couplings(self) -> dict[str, set[int]]:
        """Couplings of joints that all stand still, one of them because of it; and their joints."""
        found = {coupling.name: _joints_in(coupling.coordinate) for coupling in self._couplings}
        still = {name: joints for name, joints in found.items() if joints <= set(self.stationary)}
        followers = set(self.stationary) - set(self.own_laws)
        return still if len(still) == len(followers & set().union(*still.values())) else {}

    @cached_property
    def prescribed(self) -> dict[str, Coordinate]:
        return {name: self.mechanism.coordinates[name] for name in self.declared.prescribed}

    @cached_property
    def watched(self) -> dict[str, Coordinate]:
        """Coordinates that have to be there for another reason."""
        drivers = (law.of for law in self.declared.laws.values() if isinstance(law, Over))
        names = [*self.declared.moved, *drivers, *self.declared.watched]
        if self.declared.integrated:
            names += [name for control in self.mechanism.control for name in control.names]
        motors = self.mechanism.drives
        along = [motors[name].coordinate if name in motors else name for name in names]
        return {name: self.mechanism.coordinates[name] for name in along}

    @cached_property
    def guided(self) -> set[str]:
        """Coordinates of a task along which drives may act: these load every joint before the link that they move."""
        drives = self.declared.drives or (
            [] if followers_of(self.mechanism.constraints) is not None else self.prescribed
        )
        return {name for name in drives if not isinstance(self.mechanism.coordinates[name], LinearCoordinate)}

    @cached_property
    def shared_efforts(self) -> set[int]:
        """Joints whose effort is not simply what the motion asks at them: others share in it."""
        sums = [
            coordinate
            for coordinate in self.prescribed.values()
            if isinstance(coordinate, LinearCoordinate) and coordinate.joint is None
        ]
        found = set().union(*map(_joints_in, sums))
        found |= set().union(*(self._joints_moving(self.mechanism.coordinates[name]) for name in self.guided))
        left = [one for one in self.mechanism.constraints if one.name not in self.stationary_couplings]
        for one in left:
            rows = self.mechanism.closure.slices[one.name]
            found |= _joints_in(one.coordinate) if isinstance(one, Coupling) else _joints_of(self._rows[rows])
        return found

    def kept_joints(self, requested: Collection[str]) -> set[int]:
        """Return the joints that have to stay, where forces are asked at those that are named."""
        mechanism = self.mechanism
        stay = self.shared_efforts | (set(range(mechanism.model.nv)) - set(self.own_laws) - set(self.stationary))
        stay |= {mechanism.joints[name].v for name in requested if name in mechanism.joints}
        for coordinate in self.watched.values():
            stay |= self._joints_moving(coordinate) - (
                set() if isinstance(coordinate, LinearCoordinate) else set(self.stationary)
            )
        for coordinate in self.prescribed.values():
            if not isinstance(coordinate, LinearCoordinate):
                stay |= self._joints_moving(coordinate) - set(self.stationary)
        for name, law in self.declared.laws.items():  # a run tells that the joint it is over has no load of it
            if isinstance(law, Over) and law.of in requested:
                stay |= self._joints_moving(self.mechanism.coordinates[name])
        while torn := [joints for joints in self.stationary_couplings.values() if joints & stay and not joints <= stay]:
            stay |= set().union(*torn)
        return stay

    def droppable(self, stay: Collection[int], loaded: Collection[int]) -> dict[int, MotionLaw]:
        """Return joints that move by laws, beyond which no joint stays, and before which none that their mass loads."""
        model = self.mechanism.model
        index = [0] * model.nv
        for joint in list(model.joints)[1:]:
            index[joint.idx_v : joint.idx_v + joint.nv] = [joint.id] * joint.nv
        paths = [{int(j) for j in model.supports[joint]} for joint in range(model.njoints)]
        staying, bearing = ({index[v] for v in joints} for joints in (stay, loaded))
        alone = [v for v in self.own_laws if v not in stay and not paths[index[v]] & bearing
                 and not any(index[v] in paths[joint] for joint in staying)]  # fmt: skip
        return {v: self.own_laws[v] for v in alone if v not in self.stationary}

    @cached_property
    def _rows(self) -> Array:
        """Rows of the constraints at a configuration of no special kind, shape (m, nv)."""
        return self.mechanism.closure.rows(self._state)

    @cached_property
    def _state(self) -> Kinematics:
        """A state at rest of no special kind."""
        model = self.mechanism.model
        anywhere = np.sin(np.arange(1.0, model.nv + 1.0))
        return Kinematics.at(model, pin.integrate(model, pin.neutral(model), anywhere))

    def _joints_moving(self, coordinate: Coordinate) -> set[int]:
        """Return the joints that move a coordinate."""
        if isinstance(coordinate, LinearCoordinate):
            return _joints_in(coordinate)
        return _joints_of(coordinate.row(self._state))


def _joints_in(coordinate: LinearCoordinate) -> set[int]:
    """Return the joints in a sum: its weights are numbers of the input, however small."""
    return set(np.flatnonzero(coordinate.weights).tolist())


def _joints_of(rows: Array) -> set[int]:
    """Return the joints that have a part in computed rows, shape (nv,) or (m, nv)."""
    size = np.abs(np.atleast_2d(rows))
    return set(np.flatnonzero((size > ABSENT * size.max(initial=0.0)).any(axis=0)).tolist())


def removable(
    known: KnownMotion, forces: Mapping[str, ForceElement], requested: Collection[str]
) -> tuple[Removed, Indices] | None:
    """Return what a question can do without, and the joints whose effort is what the motion asks at them.

    Args:
        known: What is known of its motion.
        forces: All force elements of the run.
        requested: Names of the joints at which forces are asked.

    Returns:
        ``None`` where nothing can be removed.
    """
    if not _is_reducible(known):
        return None
    stay = known.kept_joints(requested)
    locked = {v: law for v, law in known.stationary.items() if v not in stay}
    within = _act_within_joints(forces.values())
    dropped = known.droppable(stay, () if known.declared.massless else stay) if within else {}
    settled = [name for name, joints in known.stationary_couplings.items() if not joints & stay]
    gone = {*locked, *dropped}
    left = [
        coordinate
        for coordinate in known.prescribed.values()
        if not (isinstance(coordinate, LinearCoordinate) and coordinate.joint in gone)
    ]
    if not (stay and gone and (left or known.declared.integrated) and _has_same_drives(known, settled)):
        return None
    geared = set().union(*(joints for name, joints in known.stationary_couplings.items() if name not in settled))
    answered = np.array(sorted(set(known.own_laws) - known.shared_efforts - geared), dtype=np.intp)
    return Removed(locked, dropped, settled), answered


def _act_within_joints(forces: Collection[ForceElement]) -> bool:
    """Tell whether all force elements act between the two links of one joint each."""
    if not forces:
        return True
    from pinarm.mechanics.forces.joint_springs import BallSpring, DryFriction, SpringDamper

    return all(isinstance(force, SpringDamper | DryFriction | BallSpring) for force in forces)


def _is_reducible(known: KnownMotion) -> bool:
    """Tell whether joints can be removed at all."""
    drives = set(known.declared.drives)
    if drives and drives != set(known.prescribed):
        return False
    if any(isinstance(one, JointRelation) and not isinstance(one, Coupling) for one in known.mechanism.constraints):
        return False  # what a cam leaves of its joints depends on where they are
    if not known.declared.integrated:
        return True
    # integrated with loops, the error of a step is measured over all coordinates: fewer of them take other steps
    straight = all(isinstance(coordinate, LinearCoordinate) for coordinate in known.prescribed.values())
    couplings = [constraint for constraint in known.mechanism.constraints if isinstance(constraint, Coupling)]
    return straight and len(couplings) == len(known.mechanism.constraints) and not known.mechanism.closure.redundant


def _has_same_drives(known: KnownMotion, settled: Collection[str]) -> bool:
    """Tell whether drives act on the part as on the whole, where none are named."""
    constraints = known.mechanism.constraints
    left = [constraint for constraint in constraints if constraint.name not in settled]
    if known.declared.drives or (followers_of(left) is None) == (followers_of(constraints) is None):
        return True
    return all(
        isinstance(coordinate, LinearCoordinate) and coordinate.joint is not None
        for coordinate in known.prescribed.values()
    )
