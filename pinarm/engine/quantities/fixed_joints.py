"""Wrenches through fixed joints: of bodies that the model has merged into one, from the motion of those beyond.

Newton's and Euler's equations of the bodies beyond the joint, with the joints and loads that act on them.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.quantities.reactions import Reactions
from pinarm.errors import InputError
from pinarm.mechanics.coordinates import PairCoordinate
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.geometry.model_variants import VariantsDiffer
from pinarm.mechanics.geometry.vectors import moved

MERGED = 1e-9
"""Relative difference of the sum of the links' masses from those of the merged body that is rounding."""


def fixed_joints(model: pin.Model) -> Mapping[str, int]:
    """Return the indices of the frames of the fixed joints of a file, by name."""
    frames = [*enumerate(model.frames)][1:]  # the first is the world
    return {frame.name: index for index, frame in frames if frame.type == pin.FrameType.FIXED_JOINT}


def fixed_wrench(reactions: Reactions, name: str) -> Array:
    """Return the wrench of the parent on the child at a fixed joint's origin, world axes [N, N*m], shape (n, 6).

    Raises:
        InputError: The masses of the links are not known one by one, or a loop, a coupling or a load acts on the merged
            body without saying on which link.
        VariantsDiffer: The model is one of variants, which are then solved one by one.
    """
    run, model, frame = reactions.run, reactions.model, fixed_joints(reactions.model)[name]
    if not isinstance(model, pin.Model):
        raise VariantsDiffer(f"the wrench of the fixed joint '{name}'")
    carrier, links = model.frames[frame].parentJoint, _beyond(model, frame)
    body = _body(model, name, carrier, links)
    total = np.array([_demand(model, body, carrier, *state) for state in zip(run.q, run.v, run.a, strict=True)])
    for child in model.children[carrier].tolist():
        joint = model.getFrameId(model.names[child], pin.FrameType.JOINT)
        if joint == model.nframes:
            raise _unknown(name, f"{model.names[child]} hangs on no single link")
        if model.frames[joint].parentFrame in links:
            total += moved(reactions.joints[:, child], reactions.origins[:, child])
    total -= run.gather(lambda dynamics, part: _loads(reactions, dynamics, np.arange(part.start, part.stop), name))
    return moved(total, -reactions.links.frame(frame)[1])


def _beyond(model: pin.Model, frame: int) -> set[int]:
    """Return a frame and those beyond it that the same joint carries."""
    found, carrier = {frame}, model.frames[frame].parentJoint
    for index, each in enumerate(model.frames.tolist()):  # after those that carry them
        if each.parentFrame in found and each.parentJoint == carrier:
            found.add(index)
    return found


def _body(model: pin.Model, name: str, carrier: int, links: set[int]) -> pin.Inertia:
    """Return the inertia of links, in the frame of the joint that carries them."""
    every, beyond = pin.Inertia.Zero(), pin.Inertia.Zero()
    for index, frame in enumerate(model.frames.tolist()):
        if frame.parentJoint == carrier:
            every += frame.placement.act(frame.inertia)
            beyond += frame.placement.act(frame.inertia) if index in links else pin.Inertia.Zero()
    merged = model.inertias[carrier].toDynamicParameters()
    if np.abs(every.toDynamicParameters() - merged).max() > MERGED * max(np.abs(merged).max(), 1e-300):
        raise _unknown(name, "the masses of the links that it ties are not known one by one")
    return beyond


def _demand(model: pin.Model, body: pin.Inertia, carrier: int, q: Array, v: Array, a: Array) -> Array:
    """Return the rate of the momentum of a body less its weight, [f; m] at the world's origin in one state, (6,)."""
    data = model.createData()
    pin.forwardKinematics(model, data, q, v, a)
    place, twist = data.oMi[carrier], data.v[carrier]
    rate = data.a[carrier] - place.actInv(model.gravity)
    return np.asarray(place.act(body * rate + body.vxiv(twist)).vector)


def _loads(reactions: Reactions, dynamics: Dynamics, rows: Indices, name: str) -> Array:
    """Return what loads do to the links beyond a fixed joint, [f; m] at the world's origin, shape (k, 6)."""
    run, model, total = reactions.run, reactions.model, np.zeros((len(rows), 6))
    frame, links = fixed_joints(model)[name], reactions.links.some(rows)
    carrier, beyond = model.frames[frame].parentJoint, _beyond(model, frame)
    for key, force in dynamics.forces.items():
        acting = force.wrenches(links, run.grid.t[rows], run.v[rows])
        ends = {end for end in _ends(force) if model.frames[end].parentJoint == carrier}
        if (ends & beyond and ends - beyond) or (carrier in acting and not ends):
            raise _unknown(name, f"the force '{key}' acts on links on both sides, or on no single point")
        total += acting[carrier] if carrier in acting and ends & beyond else 0.0
    tied = reactions.closure.wrenches(links, reactions.multipliers[rows])[:, carrier] if reactions.closure.size else 0.0
    slips = [contact.slip.wrenches(links, np.ones(len(rows))) for contact in run.mechanism.frictions]
    if np.any(tied) or any(carrier in slip for slip in slips):
        raise _unknown(name, "a loop, a coupling or friction acts on the links that it ties")
    return total


def _ends(force: ForceElement) -> set[int]:
    """Return the frames on which a force element acts."""
    along = getattr(force, "coordinate", None)
    return {along.way.first, along.way.second} if isinstance(along, PairCoordinate) else {*force.points}


def _unknown(name: str, why: str) -> InputError:
    return InputError(
        f"the wrench of the fixed joint '{name}' is not known: {why}",
        expected="a joint that moves, before or beyond it",
    )
