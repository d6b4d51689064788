"""Torsors of a run: static, kinematic, kinetic and dynamic, at any point and in any basis, with the shape of the joint.

A torsor has a resultant R and a moment M(P) at a point: ``M(Q) = M(P) + QP x R``. The comoment of two, ``R1 . M2 + R2 .
M1`` at one point, does not depend on it; that of a static and a kinematic torsor is a power.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pinocchio as pin
from msgspec import field

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.nullspace import ACTS
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.series import Series
from pinarm.errors import InputError, choices
from pinarm.input.units import Unit, unit
from pinarm.language import Language, decimals, in_language, said, spoken, writing
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.vectors import joined, moved, rotated
from pinarm.mechanics.joints import frame_of, links_of
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.records import Record, replace
from pinarm.use.method.actions import bodies_of, held, per_unit
from pinarm.use.result.result import Result

LETTERS: Mapping[str, tuple[Sequence[str], str, str]] = {
    "static": ("XYZLMN", "N", "N*m"),
    "kinematic": ("pqruvw", "rad/s", "m/s"),
    "kinetic": (("P_x", "P_y", "P_z", "σ_x", "σ_y", "σ_z"), "kg*m/s", "kg*m^2/s"),
    "dynamic": (("D_x", "D_y", "D_z", "δ_x", "δ_y", "δ_z"), "N", "N*m"),
}
"""Letters of the six components, and the units of resultant and moment, of every kind."""

HEADING = "{kind} torsor of {of} at {point}, axes of {basis}"

NOTHING = 1e-12
"""Component, relative to the largest of the run, that is rounding."""


class Torsor(Record, frozen=True):
    """A torsor over the rows of a run.

    Attributes:
        of: Of the joint, loop joint, coupling or link.
        kind: ``static``, ``kinematic``, ``kinetic`` or ``dynamic``.
        point: Name of the point of the moment.
        basis: Name of the link in whose axes components are.
        parameter: What runs along the rows.
        parts: [R; M], world axes, shape (n, 6).
        place: The point [m], world axes, shape (n, 3).
        turn: Columns are the axes of the basis, shape (n, 3, 3).
        possible: Wrenches that the joint can transmit, of which zeros of the shape follow, shape (k, n, 6).
        added: What self-stresses of a hyperstatic mechanism add, shape (k, n, 6).
        extent: Length of the longest branch of links [m], which compares moments with forces.
        language: Language of its words.
    """

    unshown = ("parts", "place", "turn", "possible", "added", "parameter")

    of: str
    kind: str
    point: str
    basis: str
    parameter: Series
    parts: Array
    place: Array
    turn: Array
    possible: Array
    added: Array
    extent: float
    language: Language = field(default_factory=spoken)

    def __repr__(self) -> str:
        return f"<{self.kind} torsor of '{self.of}' at {self.point}, axes of {self.basis}: {' '.join(self.shape)}>"

    @property
    def units(self) -> tuple[Unit, Unit]:
        """Units of the resultant and of the moment."""
        _, resultant, moment = LETTERS[self.kind]
        return unit(resultant), unit(moment)

    @property
    def components(self) -> Array:
        """Components of R and M in the basis [SI], shape (n, 6); NaN where rigid bodies do not determine them."""
        return np.where(self.undetermined, np.nan, _in_basis(self.parts, self.turn))

    @property
    def resultant(self) -> Array:
        """Components of R in the basis [SI], shape (n, 3)."""
        return self.components[:, :3]

    @property
    def moment(self) -> Array:
        """Components of M in the basis [SI], shape (n, 3)."""
        return self.components[:, 3:]

    @property
    def undetermined(self) -> Flags:
        """Mask of the components that self-stresses change, shape (6,)."""
        return np.asarray(np.abs(_in_basis(self.added, self.turn)).max(axis=(0, 1), initial=0.0) > ACTS)

    @property
    def shape(self) -> tuple[str, ...]:
        """Letters of the components; ``0`` of those that the joint cannot transmit, or a run does not have."""
        scale = np.repeat([1.0, 1.0 / self.extent], 3)
        free = _acting(self.parts * scale, self.turn) | _acting(self.possible * scale, self.turn)
        return tuple(letter if there else "0" for letter, there in zip(LETTERS[self.kind][0], free, strict=True))

    def moved_to(self, place: Array, point: str) -> Torsor:
        """Return the torsor at another point [m], world axes, shape (n, 3) or (3,), with its name."""
        arm = self.place - place
        parts, possible, added = (
            moved(each, np.broadcast_to(arm, each[..., :3].shape)) for each in (self.parts, self.possible, self.added)
        )
        place = np.broadcast_to(place, self.place.shape)
        return replace(self, parts=parts, possible=possible, added=added, place=place, point=point)

    def comoment(self, other: Torsor) -> Array:
        """Return the comoment with another torsor of the same rows, shape (n,): of an action and a motion its power."""
        there = other.moved_to(self.place, self.point).parts
        return np.asarray((self.parts[:, :3] * there[:, 3:] + self.parts[:, 3:] * there[:, :3]).sum(axis=1))

    def _written(self, value: float | None) -> tuple[str, list[list[str]]]:
        """Return heading and table: letters with numbers in the row nearest to a value of the parameter, or the first.

        The heading has kind, point, axes, and the row; the two columns of the table are resultant and moment.
        """
        t, components = self.parameter, self.components
        row = 0 if value is None else int(np.argmin(np.abs(t.values - value)))
        with writing(self.language):
            basis = said("ground") if self.basis == "ground" else self.basis
            words = said(HEADING, kind=said(self.kind), of=self.of, point=self.point, basis=basis)
            cells = []
            for k, letter in enumerate(self.shape):
                number = decimals(f"{components[row, k]:.6g} {self.units[k // 3]}")
                number = said("undetermined") if self.undetermined[k] else number
                cells.append("0" if letter == "0" else f"{letter} = {number}")
            rows = [[axis, cells[k], cells[3 + k]] for k, axis in enumerate("xyz")]
            heading = f"{words}, {t.name} = {decimals(f'{t.values[row]:.6g}')} {t.unit}"
            return heading, [["", said("resultant"), said("moment")], *rows]

    def text(self, value: float | None = None) -> str:
        """Return it as text: shape, then numbers in the row nearest to a value of the run's parameter."""
        heading, rows = self._written(value)
        widths = [max(len(row[k]) for row in rows) for k in range(3)]
        return "\n".join([heading, *("  ".join(map(str.ljust, cells, widths)).rstrip() for cells in rows)])

    def __str__(self) -> str:
        return self.text()

    def _repr_html_(self) -> str:
        from pinarm.use.show.text import lines

        return lines(str(self))


def _in_basis(parts: Array, turn: Array) -> Array:
    """Return components of torsors, shape (..., n, 6), along the columns of rotations, shape (n, 3, 3)."""
    back = turn.swapaxes(-1, -2)
    return joined(rotated(back, parts[..., :3]), rotated(back, parts[..., 3:]))


def _acting(parts: Array, turn: Array) -> Flags:
    """Return a mask of the components that are not rounding, shape (6,), of torsors with lengths near 1."""
    sizes = np.abs(_in_basis(parts, turn).reshape(-1, 6)).max(axis=0, initial=0.0)
    return np.asarray(sizes > NOTHING * sizes.max())


def shapes(mechanism: Mechanism, q: Array) -> dict[str, str]:
    """Return the shape of what each joint and loop joint transmits without drives, at a configuration, shape (nq,).

    At the joint's own point; in the axes of the child, or of the second frame of a loop joint.
    """
    model, links = mechanism.model, LinkPlacements.at(mechanism.model, q[None])
    spaces = {str(model.names[k]): (held(model, links, k), links.turns[:, k], links.places[:, k])
              for k in bodies_of(mechanism)}  # fmt: skip
    for constraint in mechanism.constraints:
        if isinstance(constraint, LoopJoint):
            wrenches = per_unit(constraint, links)[_second(model, constraint)]
            spaces[constraint.name] = (wrenches, *links.frame(constraint.second))
    scale, letters = np.repeat([1.0, 1.0 / mechanism.closure.extent], 3), {}
    for name, (wrenches, turn, place) in spaces.items():
        free = _acting(moved(wrenches, -place[:, None]).swapaxes(0, 1) * scale, turn)
        letters[name] = " ".join(letter if there else "0" for letter, there in zip("XYZLMN", free, strict=True))
    return letters


def _second(model: pin.Model, loop: LoopJoint) -> int:
    return int(model.frames[loop.second].parentJoint)


@in_language
def torsor(result: Result, of: str, at: str, along: str, kind: str) -> Torsor:
    """Return a torsor of a run; see ``Result.torsor``."""
    quantities, run = result.quantities, result.trajectory
    kind = kind or ("kinematic" if of in links_of(run.mechanism.model) and not _is_tie(quantities, of) else "static")
    if kind not in LETTERS:
        raise InputError(f"there is no kind of torsor '{kind}'", expected=", ".join(LETTERS))
    still = np.broadcast_to(np.eye(3), (len(run), 3, 3))
    parts, place, added = _static(quantities, of) if kind == "static" else _moving(quantities, of, kind)
    possible = _possible(run, of, place) if kind == "static" else np.zeros((0, len(run), 6))
    own = parts, place, still, possible, added, float(run.mechanism.closure.extent)
    found = Torsor(of, kind, of, "ground", quantities.parameter, *own)
    if at:
        found = found.moved_to(_point(quantities, at), at)
    return replace(found, basis=along, turn=quantities.evaluation.turn(along)) if along else found


def _is_tie(quantities: Quantities, of: str) -> bool:
    mechanism, reactions = quantities.trajectory.mechanism, quantities.reactions
    return any(of in names for names in (mechanism.joints, mechanism.balls, reactions.loops, reactions.couplings))


def _point(quantities: Quantities, name: str) -> Array:
    """Return the place of a link, of a joint's origin or of a loop joint's second frame [m], shape (n, 3)."""
    mechanism, reactions = quantities.trajectory.mechanism, quantities.reactions
    if name in links_of(mechanism.model):
        return quantities.evaluation.frame(name)[:, 0]
    if name in reactions.loops:
        return reactions.loop_origins(name)
    joint = mechanism.joints.get(name) or mechanism.balls.get(name)
    if joint is None:
        expected, hint = choices(name, [*links_of(mechanism.model), *mechanism.joints, *reactions.loops])
        raise InputError(f"there is no point '{name}'", expected=expected, hint=hint)
    return reactions.origins[:, joint.index]


def _static(quantities: Quantities, of: str) -> tuple[Array, Array, Array]:
    """Return the action of the parent, or of the first link, on the other; where; and what self-stresses add."""
    run, reactions = quantities.trajectory, quantities.reactions
    if not _is_tie(quantities, of):
        expected, hint = choices(of, [*run.mechanism.joints, *run.mechanism.balls, *reactions.loops])
        raise InputError(f"'{of}' transmits nothing: it is no joint", expected=expected, hint=hint)
    if run.no_efforts:
        raise InputError(f"the torsor of '{of}': {run.no_efforts}", hint=run.remedy or "kind: inverse")
    added: Sequence[Array]
    if of in reactions.couplings:
        if not reactions.couplings[of].transmission:
            raise InputError(f"the wrenches of '{of}' are not known: {reactions.couplings[of].missing}")
        place, parts, added = reactions.transmitted(of)
    elif of in reactions.loops:
        place, parts, added = reactions.loop_origins(of), reactions.loop(of), reactions.stressed_loop(of)
    else:
        index = (run.mechanism.joints.get(of) or run.mechanism.balls[of]).index
        place, parts = reactions.origins[:, index], reactions.joints[:, index]
        added = [*reactions.stressed_joint(index), *reactions.open_wrenches(index)]
    if quantities.undetermined == "minimum_norm":
        added = []
    return parts, place, np.array(added).reshape(-1, len(run), 6)


def _possible(run: Trajectory, of: str, place: Array) -> Array:
    mechanism, links = run.mechanism, LinkPlacements.at(run.mechanism.model, run.q)
    joint = mechanism.joints.get(of) or mechanism.balls.get(of)
    if joint is not None:
        wrenches = held(mechanism.model, links, joint.index)
    else:
        tie = next(constraint for constraint in mechanism.constraints if constraint.name == of)
        acting = per_unit(tie, links)
        wrenches = acting[_second(mechanism.model, tie) if isinstance(tie, LoopJoint) else tie.known.second]  # type: ignore[attr-defined]
    return np.moveaxis(moved(wrenches, -place[:, None]), 1, 0)


def _moving(quantities: Quantities, of: str, kind: str) -> tuple[Array, Array, Array]:
    """Return a torsor of a link, or of a joint the motion of the child in the parent; where; and nothing added."""
    run, mechanism = quantities.trajectory, quantities.trajectory.mechanism
    nothing = np.zeros((0, len(run), 6))
    link = of in links_of(mechanism.model)
    if not link or (kind == "kinematic" and _is_tie(quantities, of)):
        if kind != "kinematic":
            raise InputError(f"'{of}' is no link: a joint has no {kind} torsor", expected="a link, or kind: kinematic")
        place = _point(quantities, of)
        first, second = _links_of_joint(quantities, of)
        return _twist(quantities, second, place) - _twist(quantities, first, place), place, nothing
    frame = quantities.evaluation.frame(of)
    if kind == "kinematic":
        return np.concatenate([frame[:, 3], frame[:, 1]], axis=1), frame[:, 0], nothing
    body = mechanism.model.frames[frame_of(mechanism.model, of)].parentJoint
    momenta = quantities.evaluation.momenta[("kinetic", "dynamic").index(kind)][:, body]
    return moved(momenta, -frame[:, 0]), frame[:, 0], nothing


def _links_of_joint(quantities: Quantities, of: str) -> tuple[int, int]:
    model = quantities.trajectory.mechanism.model
    if (loop := quantities.reactions.loops.get(of)) is not None:
        return model.frames[loop.first].parentJoint, model.frames[loop.second].parentJoint
    index = quantities.trajectory.mechanism.model.getJointId(of)
    return model.parents[index], index


def _twist(quantities: Quantities, body: int, place: Array) -> Array:
    links, twists, _, _ = quantities.trajectory.link_motion
    turn, origin = links.turns[:, body], links.places[:, body]
    omega = rotated(turn, twists[:, body, 3:])
    return joined(omega, rotated(turn, twists[:, body, :3]) + np.cross(omega, place - origin))
