"""The evaluated state of a tree of links, and Pinocchio's buffers of a size in proportion to the model.

``model.createData()`` allocates tensors of second derivatives with nv^3 numbers each, matrices of nv^2, and a matrix of
6 nv numbers for every joint: 46 to 65 nv^3 bytes, 8 TB for a chain of 5,000 links. The algorithms that are called for
every mechanism need none of these: forward kinematics, placements of frames, Jacobians of joints and frames, ``rnea``,
``nonLinearEffects``, ``computeGeneralizedGravity``, ``aba``, and energies, all of them as they are called here, in the
convention ``LOCAL``. ``crba`` needs two of them.

Sizes and first values are those of the constructor ``DataTpl(const Model &)`` (Pinocchio 4.1,
``multibody/data.hxx``). An algorithm that needs what is left out writes beyond empty arrays: all others take buffers of
``createData``.
"""

from __future__ import annotations

import os
import weakref
from collections.abc import Callable, Sequence
from functools import cache, cached_property, update_wrapper
from threading import RLock
from typing import TypeVar

import numpy as np
import pinocchio as pin
from msgspec import Struct, field

from pinarm.arrays import Array, Flags
from pinarm.errors import ModelError
from pinarm.mechanics.geometry.vectors import cross
from pinarm.records import Record

T = TypeVar("T")

WIDE = 64
"""Velocities up to which Pinocchio's own buffers are as good: they take 17 MB and 6 ms."""

MOTIONS, FORCES, PLACEMENTS = ("a", "a_gf", "v", "ov"), ("f", "h", "oh"), ("oMi", "liMi", "iMf")
VECTORS, COLUMNS = ("tau", "nle", "g", "ddq"), ("J", "dJ", "Ag")

LOCAL = pin.ReferenceFrame.LOCAL

KEPT = 4
"""Number of unused buffers of a model that are kept: more at once are rare, and buffers may be large."""

_UNUSED: dict[int, list[pin.Data]] = {}
"""Identity of a model -> its buffers that nobody owns."""


def cached_by_model(compute: Callable[[pin.Model], T]) -> Callable[[pin.Model], T]:
    """Return a function of a model that computes its value once for each model.

    Models are told apart by identity, since Pinocchio compares them number by number. A model must not change any more
    once the function has been called with it, and the value must not refer to it: neither would ever be freed.
    """
    known: dict[int, T] = {}

    def value(model: pin.Model) -> T:
        try:
            return known[id(model)]
        except KeyError:
            known[id(model)] = answer = compute(model)
            weakref.finalize(model, known.pop, id(model), None)
            return answer

    return update_wrapper(value, compute)


def new_data(model: pin.Model) -> pin.Data:
    """Return buffers for the algorithms named above, of a size in proportion to that of the model."""
    return model.createData() if model.nv <= WIDE else _prototype(model).copy()


def require_depth_first(model: pin.Model) -> None:
    """Raise where the joints beyond one are not numbered next to it.

    ``crba`` and the derivatives of ``rnea`` and ``aba`` take the velocities beyond a joint for those that follow its
    own, and are wrong without a word where they do not.
    """
    path, names = list[int](), model.names
    for joint, carrier in list(enumerate(model.parents.tolist()))[1:]:
        while path and path[-1] != carrier:
            path.pop()
        if carrier and not path:
            raise ModelError(
                f"joint '{names[joint]}' is numbered {joint}, apart from '{names[carrier]}' ({carrier}), its carrier",
                expected="joints numbered depth-first: all beyond a joint directly after it",
                hint="pinarm.Mechanism.of(model), which numbers them anew",
            )
        path.append(joint)


def with_masses(model: pin.Model, data: pin.Data) -> pin.Data:
    """Return the buffers after making room in them for ``crba``: 56 nv^2 bytes."""
    if data.M.shape != (model.nv, model.nv):
        data.M = np.zeros((model.nv, model.nv))
        data.Fcrb = _filled(pin.StdVec_Matrix6x(), model.njoints, np.zeros((6, model.nv)))
    return data


@cached_by_model
def _prototype(model: pin.Model) -> pin.Data:
    data, n, nv = pin.Data(), model.njoints, model.nv
    joints = pin.StdVec_JointDataVector()
    for joint in model.joints:
        joints.append(joint.createData())
    data.joints = joints
    for name in MOTIONS:
        setattr(data, name, _filled(pin.StdVec_Motion(), n, pin.Motion.Zero()))
    for name in FORCES:
        setattr(data, name, _filled(pin.StdVec_Force(), n, pin.Force.Zero()))
    for name in PLACEMENTS:
        setattr(data, name, _filled(pin.StdVec_SE3(), n, pin.SE3.Identity()))
    data.oMf = _filled(pin.StdVec_SE3(), model.nframes, pin.SE3.Identity())
    data.Ycrb, data.oYcrb = (_filled(pin.StdVec_Inertia(), n, pin.Inertia.Zero()) for _ in range(2))
    data.Yaba = _filled(pin.StdVec_Matrix6(), n, np.zeros((6, 6)))
    for name in VECTORS:
        setattr(data, name, np.zeros(nv))
    for name in COLUMNS:
        setattr(data, name, np.zeros((6, nv)))
    _order(model, data)
    return data


def _order(model: pin.Model, data: pin.Data) -> None:
    """Write on which velocities joints and rows of J depend: ``computeNvSubtree``, ``computeParents_fromRow``."""
    parents, joints = model.parents.tolist(), model.joints.tolist()
    beyond = [joint.nv if k else 0 for k, joint in enumerate(joints)]
    before = [-1] * model.nv
    for k in range(model.njoints - 1, 0, -1):
        if parents[k]:
            beyond[parents[k]] += beyond[k]
            before[joints[k].idx_v] = joints[parents[k]].idx_v + joints[parents[k]].nv - 1
        for row in range(1, joints[k].nv):
            before[joints[k].idx_v + row] = joints[k].idx_v + row - 1
    owners = [int(joint.id) for joint in joints[1:] for _ in range(joint.nv)]
    inner = [row - 1 if row and owner == owners[row - 1] else -1 for row, owner in enumerate(owners)]
    data.nvSubtree, data.parents_fromRow, data.non_mimic_parents_fromRow = (
        _integers(numbers) for numbers in (beyond, before, before)
    )
    data.mimic_parents_fromRow, data.idx_vExtended_to_idx_v_fromRow = _integers(inner), _integers(range(model.nv))


def _integers(numbers: Sequence[int]) -> pin.StdVec_int:
    vector = pin.StdVec_int()
    vector.extend(list(numbers))
    return vector


def _filled(vector: pin.StdVec_Motion, count: int, value: pin.Motion) -> pin.StdVec_Motion:
    """Return a vector of Pinocchio's after appending a value to it ``count`` times."""
    vector.extend([value] * count)
    return vector


def take(model: pin.Model) -> pin.Data:
    """Return buffers of a model that nobody owns; what is in them is left from another use."""
    unused = _UNUSED.get(id(model))
    if unused is None:
        unused = _UNUSED[id(model)] = []
        weakref.finalize(model, _UNUSED.pop, id(model), None)
    try:
        return unused.pop()
    except IndexError:
        return new_data(model)


def give_back(model: pin.Model, data: pin.Data) -> None:
    """Let others use buffers that ``take`` has returned; views of their arrays change from now on."""
    unused = _UNUSED.get(id(model))
    if unused is not None and len(unused) < KEPT:
        unused.append(data)


@cached_by_model
def moved_by(model: pin.Model) -> Flags:
    """Mask of velocities that move each link, shape (njoints, nv): row j is true for joints on the path to j."""
    moves = np.zeros((model.njoints, model.nv), dtype=bool)
    for joint, (carrier, own) in enumerate(zip(model.parents.tolist(), model.joints, strict=True)):
        if joint:
            moves[joint] = moves[carrier]
            moves[joint, own.idx_v : own.idx_v + own.nv] = True
    return moves


class RelativeState(Record, frozen=True):
    """Frame 2 of a model seen from frame 1, in the axes of this, in one state.

    Attributes:
        data: Pinocchio's buffers of the state.
    """

    model: pin.Model
    data: pin.Data
    first: int
    second: int

    @cached_property
    def placed(self) -> tuple[Array, Array]:
        """The place p of frame 2's origin [m], shape (3,), and its axes, rows, shape (3, 3)."""
        between = self.data.oMf[self.first].actInv(self.data.oMf[self.second])
        return between.translation, np.asarray(between.rotation.T)

    @cached_property
    def columns(self) -> tuple[Array, Array]:
        """Velocities of this origin, and angular velocities, for unit velocities, shape (3, nv) each.

        What moves both links alike is exactly 0: the difference of their Jacobians leaves rounding there, which would
        fill the rows of a deep tree.
        """
        model, (p, axes), moves = self.model, self.placed, moved_by(self.model)
        first, second = (
            pin.getFrameJacobian(model, self.data, frame, LOCAL).reshape(6, -1) for frame in (self.first, self.second)
        )
        one, other = (moves[model.frames[frame].parentJoint] for frame in (self.first, self.second))
        apart = one != other
        linear = axes.T @ second[:3] - first[:3] + pin.skew(p) @ first[3:]
        return linear * apart, (axes.T @ second[3:] - first[3:]) * apart

    @cached_property
    def rates(self) -> tuple[Array, Array, Array, Array]:
        """``p'`` and ``omega``, and ``p''`` and ``omega'`` for a = 0, shape (3,) each."""
        p, axes = self.placed
        first, second = (
            pin.getFrameVelocity(self.model, self.data, frame, LOCAL) for frame in (self.first, self.second)
        )
        own, other = (
            pin.getFrameClassicalAcceleration(self.model, self.data, frame, LOCAL)
            for frame in (self.first, self.second)
        )
        carried = first.angular
        omega = axes.T @ second.angular - carried
        dp = axes.T @ second.linear - first.linear - cross(carried, p)
        swung = cross(own.angular, p) + cross(carried, cross(carried, p) + 2.0 * dp)
        ddp = axes.T @ other.linear - own.linear - swung
        return dp, omega, ddp, axes.T @ other.angular - own.angular - cross(carried, omega)


class Kinematics(Struct, eq=False):
    """A state (q, v) of a tree of links, evaluated by forward kinematics; accelerations are those for ``a = 0``.

    It owns its buffers for as long as it lives: no other state overwrites them.

    Attributes:
        q: Configuration, shape (nq,).
        v: Velocity, shape (nv,).
        data: Pinocchio's buffers, to be read only: placements of joints and frames, joint Jacobians, twists, and the
            accelerations ``J' v``. Views of its arrays are valid for as long as the state lives.
    """

    model: pin.Model
    q: Array
    v: Array
    data: pin.Data
    _relative: dict[tuple[int, int], RelativeState] = field(default_factory=dict)

    @classmethod
    def at(cls, model: pin.Model, q: Array, v: Array | None = None) -> Kinematics:
        """Return the evaluated state; at rest where the velocity is left out.

        Args:
            q: Configuration, shape (nq,).
            v: Velocity, shape (nv,).
        """
        data, at_rest = take(model), _zeros(model.nv)
        velocity = at_rest if v is None else v
        pin.computeJointJacobians(model, data, q)
        pin.forwardKinematics(model, data, q, velocity, at_rest)
        pin.updateFramePlacements(model, data)
        return cls(model, q, velocity, data)

    def between(self, first: int, second: int) -> RelativeState:
        """Return a frame seen from another one; it is kept, as several coordinates may measure them."""
        relative = self._relative.get((first, second))
        if relative is None:
            relative = self._relative[first, second] = RelativeState(self.model, self.data, first, second)
        return relative

    def __del__(self) -> None:
        """Let another state have the buffers."""
        give_back(self.model, self.data)


@cache
def _zeros(nv: int) -> Array:
    """Return a velocity of 0, shape (nv,), to be read only."""
    zeros = np.zeros(nv)
    zeros.flags.writeable = False
    return zeros


_turn = RLock()
"""Held by the thread that computes."""


def _free_turn() -> None:
    """Let a process that was forked while another thread computed compute itself."""
    global _turn
    _turn = RLock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_free_turn)


def one_run() -> RLock:
    """Return the lock of what computes with the buffers of a mechanism, for a ``with`` block."""
    return _turn
