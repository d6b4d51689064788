"""A joint whose loads are asked, of the tree or one that closes a loop, and numbers of its loads."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.quantities.reactions import loop_axis, tree_axis
from pinarm.engine.series import Series
from pinarm.errors import InputError, choices, within
from pinarm.input.units import Unit
from pinarm.mechanics.joints import METRE, RADIAN, moved_links
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.records import Record, replace
from pinarm.use.result.curve_figures import CurveFigure
from pinarm.use.result.row_lookup import PLATEAU, Lookup


class LoadNumber(CurveFigure, frozen=True):
    """A number, where it stands in the run, and what its quadrature, or the search for its peak, leaves of it.

    Attributes:
        at: The instant, or another parameter of the run; ``None`` for numbers of the whole run.
        direction: Unit vector of the load at its peak, in axes that ``axes`` names; empty where it has none.
        axes: The link.
    """

    at: float | None = None
    direction: str = ""
    axes: str = ""


NOTHING = 1e-9
"""Of the largest force or moment of any joint: below that a component is rounding, and has no worst instant."""

CONSTANT = 1e-9
"""Relative change below which a curve is constant but for rounding, and its peak is at the start."""


def worst_row(run: Lookup, size: Callable[[Quantities], Array], least: float = 0.0) -> tuple[Quantities, float, float]:
    """Return the row of a run at which a size is largest, the first one where it is constant; the size, and its error.

    Args:
        run: The run.
        size: Quantities of n rows -> values that are not negative, shape (n,).
        least: Up to which size it is rounding.
    """
    start = run.at("start", run.run.parameter)
    first = float(size(start)[0])
    worst, error = run.highest(size, "the load", least if float(size(run.quantities).max()) <= least else 0.0)
    largest = float(size(worst)[0])
    if largest <= max(least, (1.0 + CONSTANT) * first):
        return start, first, error + max(largest - first, 0.0)
    return worst, largest, error


def peak(run: Lookup, measured: Unit, size: Callable[[Quantities], Array], least: float = 0.0) -> LoadNumber:
    """Return the largest of a size, see ``worst_row``, and where it is."""
    row, largest, error = worst_row(run, size, least)
    return LoadNumber(largest, error, measured, at=float(row.trajectory.grid.t[0]))


def rounding(run: Lookup, name: str, series: Series) -> float:
    """Return up to which size a component is rounding [N or N*m]: of the largest of any joint, and of its own terms."""
    part = slice(0, 3) if name.startswith("force") else slice(3, 6)
    largest = float(np.linalg.norm(run.quantities.reactions.joints[..., part], axis=-1).max())
    return max(NOTHING * largest, PLATEAU * float(np.max(series.terms)))


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
        return bool(self.rings)

    @classmethod
    def of(cls, mechanism: Mechanism, name: str, coordinate: str | None = None) -> LoadedJoint:
        """Return a joint by its name, with or without ``joint.`` or ``loop.`` before it.

        Args:
            mechanism: The mechanism.
            name: Its name.
            coordinate: What turns in it, where it has no such coordinate of its own.
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
        """Check that it has what is asked of it."""
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
        """Return the rates of turning [rad/s] and sliding [m/s], each of shape (n,); 0 without a coordinate."""
        turning, sliding = (
            rows[f"coordinate.{name}.velocity"].values if name else np.zeros(len(rows.trajectory))
            for name in (self.turning, self.sliding)
        )
        return turning, sliding


def _known(mechanism: Mechanism, name: str) -> Iterator[tuple[str, LoadedJoint]]:
    """Yield all joints with their full names, ``joint.J`` or ``loop.L``; ``name`` is as the file has it."""
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
