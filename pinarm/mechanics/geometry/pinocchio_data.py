"""Pinocchio's buffers of a model, of its own size: those that ``pin.Model.createData`` makes grow as nv^3.

``pin.Data(model)`` allocates tensors of second derivatives with nv^3 numbers each, matrices of nv^2, and a matrix of 6
nv numbers for every joint: 46 to 65 nv^3 bytes, 8 TB for a chain of 5,000 links. The algorithms that are called for
every mechanism need none of these: forward kinematics, placements of frames, Jacobians of joints and frames, ``rnea``,
``nonLinearEffects``, ``computeGeneralizedGravity``, ``aba``, and energies, all of them as they are called here, in the
convention ``LOCAL``. ``crba`` needs two of them.

Sizes and first values are those of the constructor ``DataTpl(const Model &)`` (Pinocchio 4.1,
``multibody/data.hxx``). An algorithm that needs what is left out writes beyond empty arrays: all others take buffers of
``createData``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from pinarm.errors import ModelError
from pinarm.mechanics.geometry.model_cache import cached_by_model

WIDE = 64
"""Velocities up to which Pinocchio's own buffers are as good: they take 17 MB and 6 ms."""

MOTIONS, FORCES, PLACEMENTS = ("a", "a_gf", "v", "ov"), ("f", "h", "oh"), ("oMi", "liMi", "iMf")
VECTORS, COLUMNS = ("tau", "nle", "g", "ddq"), ("J", "dJ", "Ag")


def new_data(model: pin.Model) -> pin.Data:
    """Return buffers for the algorithms named above, of a size in proportion to that of the model."""
    return model.createData() if model.nv <= WIDE else _prototype(model).copy()


def require_depth_first(model: pin.Model) -> None:
    """Raise where the joints beyond one are not numbered next to it.

    ``crba`` and the derivatives of ``rnea`` and ``aba`` take the velocities beyond a joint for those that follow its
    own, and are wrong without a word where they do not.

    Raises:
        ModelError: A joint is numbered apart from the one that carries it.
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
    inner = [row - 1 if row and owner == last else -1 for row, owner, last in _owners(joints)]
    data.nvSubtree, data.parents_fromRow, data.non_mimic_parents_fromRow = (
        _integers(numbers) for numbers in (beyond, before, before)
    )
    data.mimic_parents_fromRow, data.idx_vExtended_to_idx_v_fromRow = _integers(inner), _integers(range(model.nv))


def _owners(joints: Sequence[pin.JointModel]) -> list[tuple[int, int, int]]:
    """Return every index in v with the joint that it belongs to, and the joint of the index before."""
    owners = [int(joint.id) for joint in joints[1:] for _ in range(joint.nv)]
    return list(zip(range(len(owners)), owners, [0, *owners], strict=False))


def _integers(numbers: Sequence[int]) -> pin.StdVec_int:
    vector = pin.StdVec_int()
    vector.extend(list(numbers))
    return vector


def _filled(vector: pin.StdVec_Motion, count: int, value: pin.Motion) -> pin.StdVec_Motion:
    """Return a vector of Pinocchio's after appending a value to it ``count`` times."""
    vector.extend([value] * count)
    return vector
