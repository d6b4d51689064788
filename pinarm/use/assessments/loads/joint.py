"""A joint whose loads are asked: of the tree, or one that closes a loop."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.quantities.reactions import loop_axis, tree_axis
from pinarm.errors import InputError, choices, within
from pinarm.mechanics.joints import METRE, RADIAN, moved_links
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.records import Record, replace

UNALIGNED = ("point_on_line", "point_on_plane")
"""Kinds of loop joints whose axis is held in the first link alone."""

TURNED = "coordinate: the name of the coordinate that turns in it"


class LoadedJoint(Record, frozen=True):
    """A joint whose loads are asked.

    Attributes:
        name: As the file has it.
        prefix: Of the names of its quantities, such as ``loop.B``.
        body: The link on which the loads act, in whose axes they are told.
        rings: Links in whose axes the joint's axis stays, as in those of a bearing's rings: name, empty for the world,
            and the axis there, shape (3,). Empty where the joint has no axis.
        turning: The coordinate that turns about it [rad]; empty where there is none.
        sliding: The coordinate that slides along it [m]; empty where there is none.
        open: Whether motions are left in it that no coordinate tells.
    """

    name: str
    prefix: str
    body: str
    rings: tuple[tuple[str, Array], ...] = ()
    turning: str = ""
    sliding: str = ""
    open: bool = False

    @property
    def axis(self) -> bool:
        """Whether it has an axis."""
        return bool(self.rings)

    @classmethod
    def of(cls, mechanism: Mechanism, name: str, coordinate: str | None = None) -> LoadedJoint:
        """Return a joint by its name, with or without ``joint.`` or ``loop.`` before it.

        Args:
            mechanism: The mechanism.
            name: Its name.
            coordinate: What turns in it, where it has no such coordinate of its own.

        Raises:
            InputError: There is no such joint, or two of that name, or no such coordinate.
        """
        known = dict(_known(mechanism, name))
        meant = [full for full in known if name in (full, full.partition(".")[2])]
        if len(meant) != 1:
            expected, hint = choices(name, [full.partition(".")[2] for full in known])
            message = f"'{name}' is a joint of the tree and a loop joint" if meant else f"there is no joint '{name}'"
            raise InputError(message, expected=" or ".join(meant) or expected, hint="" if meant else hint)
        joint = known[meant[0]]
        if coordinate is None:
            return joint
        with within("coordinate"):
            angle = mechanism.coordinates.get(coordinate)
            if angle is None or angle.unit != RADIAN:
                expected, hint = choices(coordinate, [k for k, x in mechanism.coordinates.items() if x.unit == RADIAN])
                raise InputError(f"there is no coordinate '{coordinate}' that turns", expected=expected, hint=hint)
        return replace(joint, turning=coordinate, open=False)

    def check(self, *, bearing: bool, bushing: bool) -> None:
        """Check that it has what is asked of it.

        Raises:
            InputError: It has no axis, or says nothing of how its bearing moves.
        """
        for key in [key for key, asked in (("bearing", bearing), ("bushing", bushing)) if asked]:
            with within(key):
                if not self.axis:
                    raise InputError(f"the joint '{self.name}' has no axis", expected="a joint that turns about one")
                if self.open and not self.turning:
                    raise InputError(f"'{self.prefix}' does not say how it turns", expected=TURNED)
                if key == "bearing" and not self.turning:
                    raise InputError(
                        f"nothing turns in the joint '{self.name}'", expected=f"another joint, or {TURNED}"
                    )

    def rates(self, rows: Quantities) -> tuple[Array, Array]:
        """Return how fast it turns [rad/s] and slides [m/s], each of shape (n,)."""
        turning, sliding = (
            rows[f"coordinate.{name}.velocity"].values if name else np.zeros(len(rows.trajectory))
            for name in (self.turning, self.sliding)
        )
        return turning, sliding


def _known(mechanism: Mechanism, name: str) -> Iterator[tuple[str, LoadedJoint]]:
    """Yield what a name may mean: ``joint.J`` and ``loop.L`` of all joints."""
    model = mechanism.model
    for joint in mechanism.joints.values():
        moved = ("", joint.name) if joint.unit == METRE else (joint.name, "")
        link, rings = moved_links(model, joint.index)[0], _rings(model, joint.index)
        yield f"joint.{joint.name}", LoadedJoint(name, f"joint.{joint.name}", link, rings, *moved)
    for ball in mechanism.balls.values():
        link = moved_links(model, ball.index)[0]
        yield f"joint.{ball.name}", LoadedJoint(name, f"joint.{ball.name}", link)
    for loop in mechanism.constraints:
        if isinstance(loop, LoopJoint):
            own = [f"{loop.name}.{part}" for part in ("angle", "position")]
            turning, sliding = (name_of_part if name_of_part in mechanism.coordinates else "" for name_of_part in own)
            links, axis = [model.frames[frame].name for frame in (loop.second, loop.first)], loop_axis(loop)
            held = links[1:] if loop.kind in UNALIGNED else links
            rings = () if axis is None else tuple((link, axis) for link in held)
            freely = "point_on" in loop.kind
            yield f"loop.{loop.name}", LoadedJoint(name, f"loop.{loop.name}", links[0], rings, turning, sliding, freely)


def _rings(model: pin.Model, joint: int) -> tuple[tuple[str, Array], ...]:
    """Return child and parent of a joint of the tree, each with the joint's axis in its axes."""
    if (axis := tree_axis(model, joint)) is None:
        return ()
    child, parent = moved_links(model, joint)[0], int(model.parents[joint])
    carrier, outwards = moved_links(model, parent)[0] if parent else "", model.jointPlacements[joint].rotation @ axis
    inner, outer = (
        model.frames[model.getBodyId(link)].placement.rotation if link else np.eye(3) for link in (child, carrier)
    )
    return (child, inner.T @ axis), (carrier, outer.T @ outwards)
