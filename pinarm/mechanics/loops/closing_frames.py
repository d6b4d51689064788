"""Frames at which exporters open a loop, ``closing_NAME_1`` and ``closing_NAME_2``, without the kind of its joint.

onshape-to-robot writes them as links of a URDF, or sites of an MJCF: where a mate of the drawing closes a loop, one on
each of its two parts. Their z axes are that of the mate, about which a revolute mate turns and along which a slider
slides. Source: documentation of onshape-to-robot, design-time considerations, kinematic loops.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Literal

import pinocchio as pin

from pinarm.errors import InputError, choices

if TYPE_CHECKING:
    from pinarm.mechanics.loops.loop_joints import LoopJoint

CLOSING = "closing_"
"""Beginning of their names."""

DIGITS = 9
"""Decimals of a place [m] up to which two frames have one origin."""

Closure = Literal["fixed", "revolute", "prismatic", "cylindrical", "spherical", "planar"]
"""Kinds of joint that need no more than the frames."""


def closing_frames(model: pin.Model, loops: Sequence[LoopJoint]) -> dict[str, tuple[str, str]]:
    """Return the pairs of frames that no loop joint ties: name of the closure -> names of its frames."""
    kinds = (pin.FrameType.BODY, pin.FrameType.OP_FRAME)
    frames = {frame.name: index for index, frame in enumerate(model.frames) if frame.type in kinds}
    tied = {frozenset(_point(model, frame) for frame in (loop.first, loop.second)) for loop in loops}
    pairs = {}
    for first, index in frames.items():
        base = first.removesuffix("_1")
        second = f"{base}_2"
        paired = first.startswith(CLOSING) and base != first and second in frames
        if paired and frozenset(_point(model, frame) for frame in (index, frames[second])) not in tied:
            pairs[base.removeprefix(CLOSING)] = first, second
    return pairs


def _point(model: pin.Model, frame: int) -> tuple[float, ...]:
    point = model.frames[frame]
    return (point.parentJoint, *(round(float(x), DIGITS) for x in point.placement.translation))


def closures_of(
    model: pin.Model, kinds: Closure | Mapping[str, Closure], loops: Sequence[LoopJoint]
) -> list[LoopJoint]:
    """Return the joints between closing frames.

    Args:
        kinds: Kind of all of them, or name of the closure -> its kind.
    """
    from pinarm.mechanics.loops.kinds import LOOP_KINDS

    pairs = closing_frames(model, loops)
    if not pairs:
        raise InputError(
            "the model has no two frames that no loop joint ties and that are called closing_NAME_1 and closing_NAME_2",
            expected="such frames, as onshape-to-robot leaves them",
            hint="loops: {NAME: {kind: revolute, axis: z, between: [LINK, LINK]}}",
        )
    named = dict.fromkeys(pairs, kinds) if isinstance(kinds, str) else dict(kinds)
    for name in named:
        if name not in pairs:
            expected, hint = choices(name, pairs)
            raise InputError(
                f"there are no two frames closing_{name}_1 and closing_{name}_2 that no loop joint ties",
                expected=expected,
                hint=hint,
            )
        if any(loop.name == name for loop in loops):
            raise InputError(f"there is a loop joint '{name}' already", expected="a name of its own")
    return [LOOP_KINDS[kind](between=pairs[name]).bind(model, name) for name, kind in named.items()]


def proposals(model: pin.Model, loops: Sequence[LoopJoint]) -> Iterator[str]:
    """Yield a note on each pair of frames that no loop joint ties."""
    for name, (first, second) in closing_frames(model, loops).items():
        yield (
            f"an exporter opened a loop at {first} and {second}, and the file does not say by which joint: "
            f"'closures: revolute' in the mechanism file closes all of them by joints about z, "
            f"'closures: {{{name}: revolute}}' this one, as does "
            f"'loops: {{{name}: {{kind: revolute, axis: z, between: [{first}, {second}]}}}}'"
        )
