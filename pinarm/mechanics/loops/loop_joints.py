"""Loop joints of one mechanism, the keys that all of them have in files, and frames at which exporters open loops.

onshape-to-robot writes frames ``closing_NAME_1`` and ``closing_NAME_2``, links of a URDF or sites of an MJCF, where a
mate of the drawing closes a loop: one on each of its two parts, without the kind of the joint. Their z axes are that of
the mate, about which a revolute mate turns and along which a slider slides. Source: documentation of onshape-to-robot,
design-time considerations, kinematic loops.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Literal

import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError, choices
from pinarm.input.units import Unit
from pinarm.input.yaml.schema import InputStruct
from pinarm.mechanics.coordinates import Constraint, HeldCoordinate, Parts, PathLength
from pinarm.mechanics.geometry.pairs import Pair, TiedFrames
from pinarm.mechanics.joints import METRE, RADIAN, frame_of


class LoopJoint(TiedFrames, Constraint, frozen=True, kw_only=True):
    """A loop joint of one mechanism, ready for evaluation."""

    name: str
    kind: str

    @property
    def parts(self) -> Parts:
        return [(1.0, self)]

    def unit(self, row: int) -> Unit:
        return RADIAN if self.pair.kinds[row] == "w" else METRE

    def helical(self, row: int) -> bool:
        return self.pair.kinds[row] == "h"


class LoopDefinition(InputStruct, frozen=True):
    """What every loop joint says.

    Attributes:
        between: The two links whose frames the joint ties; a fixed link without mass serves as a named frame.
    """

    between: tuple[str, str]

    def pair(self) -> Pair:
        raise NotImplementedError

    def bind(self, model: pin.Model, name: str) -> LoopJoint:
        first, second = (frame_of(model, link) for link in self.between)
        if model.frames[first].parentJoint == model.frames[second].parentJoint:
            raise InputError(
                f"{' and '.join(self.between)} belong to one rigid body: a joint between them closes no loop",
                expected="links that move against each other",
            )
        kind = str(self.__struct_config__.tag)
        return LoopJoint(first, second, self.pair(), name=name, kind=kind)


class CableLoop(HeldCoordinate, frozen=True, kw_only=True):
    """A cable of one mechanism: the constraint ``w(q) = offset`` of its path, which can only be shorter.

    The multiplier lam pushes the points apart: the tension is ``-lam``.
    """

    coordinate: PathLength
    offset: float
    kind: str = "cable"
    side: float = -1.0
    opens: str = "it goes slack"

    @property
    def path(self) -> PathLength:
        return self.coordinate

    def push(self, q: Array, lam: Array) -> Array:
        return -lam


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
