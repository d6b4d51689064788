"""Base class of the families of quantities, and components of vectors by the last word of a name."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from typing import ClassVar

import numpy as np

from pinarm.arrays import Array, length
from pinarm.engine.constraints.nullspace import ACTS
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.evaluation import Evaluation
from pinarm.engine.series import Series
from pinarm.errors import InputError, several
from pinarm.input.units import unit
from pinarm.mechanics.geometry.vectors import crossed
from pinarm.mechanics.joints import METRE
from pinarm.records import AbstractRecord, ValueRecord

AXES = ("x", "y", "z", "norm")
ALONG_AXIS = ("axial", "radial")
"""Components of a force or moment F by an axis u: ``F . u``, and ``|F - (F . u) u|``."""

MOMENTS = ("moment", "angular")
"""Parts that depend on the point about which they are taken."""

RATES = ("position", "velocity", "acceleration")
SECOND, JOULE, WATT, NEWTON, NEWTON_METRE = unit("s"), unit("J"), unit("W"), unit("N"), unit("N*m")
ANGULAR = unit("rad"), unit("rad/s"), unit("rad/s^2")


class UnknownQuantity(InputError):
    """There is no quantity of this name."""

    def __init__(self, name: str, expected: str = "", hint: str = "") -> None:
        super().__init__(f"there is no quantity '{name}'", expected=expected, hint=hint)
        self.name = name


class Asked(ValueRecord, frozen=True):
    """A name that has been asked, such as ``joint.knee.moment.about.foot.x``.

    Attributes:
        words: Its words after the family's, those of a joint's or link's own name together: ``knee``, ``moment``,
            ``about``, ``foot``, ``x``.
    """

    name: str
    words: tuple[str, ...]

    @property
    def of(self) -> str:
        """Name of the joint, link, element, ... that is meant."""
        return self.words[0]

    @property
    def part(self) -> str:
        """Part that is asked, such as ``moment``: the second word; empty where there is none."""
        return self.words[1] if len(self.words) > 1 else ""

    @property
    def unknown(self) -> UnknownQuantity:
        """The error that there is no such quantity."""
        return UnknownQuantity(self.name)


class Offered(ValueRecord, frozen=True):
    """A quantity of a family, with its components.

    Attributes:
        element: The joint, link, element, ... that it is a quantity of; empty for the whole mechanism.
        part: Which quantity of it: a key of ``Family.meanings``.
        components: Last words of its names; empty for a scalar.
    """

    element: str
    part: str
    components: tuple[str, ...] = ()

    def names(self) -> list[str]:
        """Return its names, without the family's word."""
        base = ".".join(filter(None, (self.element, self.part)))
        return [f"{base}.{component}" for component in self.components] or [base]


class Family(AbstractRecord, frozen=True):
    """Quantities whose names begin with the same word.

    Attributes:
        element: Letter that stands for what the quantities are of, for documentation.
        meanings: Part -> what it is, in words.
        undetermined: Whether rigid bodies may leave some of them undetermined.
        of_variants: Whether they can be told of variants of a mechanism, whose arrays have an axis after the first.
    """

    element: ClassVar[str]
    meanings: ClassVar[Mapping[str, str]]
    undetermined: ClassVar[bool] = False
    of_variants: ClassVar[bool] = False
    evaluation: Evaluation

    @property
    def run(self) -> Trajectory:
        return self.evaluation.run

    @abstractmethod
    def entries(self) -> Iterator[Offered]:
        """Yield its quantities."""

    def names(self) -> list[str]:
        """Return the names of its quantities, without the family's word."""
        return [name for entry in self.entries() for name in entry.names()]

    @abstractmethod
    def series(self, asked: Asked) -> Series:
        """Return a quantity over the rows."""

    def require_efforts(self, asked: Asked) -> None:
        """Raise where the run has no efforts."""
        if self.run.no_efforts:
            hint = self.run.remedy if self.run.unknown else "kind: inverse"
            raise InputError(f"'{asked.name}': {self.run.no_efforts}", hint=hint)

    def rate(self, asked: Asked, coordinate_name: str, rate: str) -> Series:
        """Return a coordinate or a derivative of it; ``rate`` is one of ``RATES``."""
        coordinate = self.run.mechanism.coordinates.get(coordinate_name)
        if coordinate is None or rate not in RATES:
            raise asked.unknown
        order = RATES.index(rate)
        values = self.evaluation.rate(coordinate_name, coordinate, order)
        units = [METRE, METRE / SECOND, METRE / SECOND**2] if coordinate.unit == METRE else ANGULAR
        return Series(asked.name, units[order], values)

    def about(self, asked: Asked, otherwise: Array) -> Array:
        """Return the points that a moment is asked about [m], world axes, shape (n, 3)."""
        words = asked.words
        if "about" not in words[2:-2]:
            return otherwise
        return self.evaluation.frame(words[words.index("about", 2) + 1])[..., 0, :]

    def component(self, asked: Asked, vectors: Array) -> Array:
        """Return the component of vectors that the last word names, in the axes that ``along`` names, shape (n,)."""
        axis, extra = asked.words[-1], asked.words[2:-1]
        if "about" in extra[::2] and asked.part not in MOMENTS:
            raise _about_a_point(asked)
        if axis in ALONG_AXIS and extra[::2] in ((), ("about",)):
            return _split(vectors, self.axes(asked), axis)
        if axis not in AXES or len(extra) % 2 or not set(extra[::2]) <= {"about", "along"}:
            raise asked.unknown
        if axis == "norm":
            return length(vectors)
        if "along" in extra[::2]:
            turns = self.evaluation.turn(extra[extra.index("along") + 1])
            return np.asarray((turns[..., AXES.index(axis)] * vectors).sum(axis=-1))
        return vectors[..., AXES.index(axis)]

    def axes(self, asked: Asked) -> Array:
        """Return the axis by which ``axial`` and ``radial`` are meant, world axes, shape (n, 3); of joints only."""
        raise asked.unknown


def _about_a_point(asked: Asked) -> InputError:
    """Return the refusal of what is no moment, about a point."""
    words, word = asked.words, asked.name.partition(".")[0]
    rest = words[words.index("about", 2) + 2 :]
    plain = ".".join((word, *words[:2], *rest))
    moment = f"; the moment about it: {word}.{words[0]}.moment.{'.'.join(words[2:])}" if asked.part == "force" else ""
    return InputError(
        f"'{asked.name}': only moments and angular momenta are taken about a point, no {asked.part.replace('_', ' ')}",
        expected=f"the name without 'about' and its link{moment}",
        hint=plain,
    )


def _split(vectors: Array, axes: Array, part: str) -> Array:
    """Return a component of ``ALONG_AXIS`` of vectors by unit vectors, both of shape (n, 3); shape (n,)."""
    axial = np.asarray((vectors * axes).sum(axis=-1))
    return axial if part == "axial" else length(vectors - axial[..., None] * axes)


WRENCH = ("force", "moment")

SAY_HOW = "in couplings: a gear or rack with its pressure_angle, a belt with its pretension, gears with planets"
"""Hint: entries that make the forces of a coupling known."""


class WrenchFamily(Family, frozen=True):
    """A family of things that transmit wrenches."""

    undetermined: ClassVar[bool] = True

    def wrench(self, asked: Asked, origins: Array, wrench: Array, stresses: list[Array], about: Array) -> Series:
        """Return a component of a wrench.

        Args:
            origins: Where the wrench is taken [m], shape (n, 3).
            wrench: [f; m] there, world axes, shape (n, 6).
            stresses: What each self-stress of length 1 adds to it, shape (n, 6).
            about: The points of moments where the name gives none [m], shape (n, 3).
        """
        values, *added = (self.wrench_component(asked, origins, vectors, about) for vectors in (wrench, *stresses))
        terms = np.linalg.norm(wrench[..., :3], axis=-1)
        if asked.part == "force":
            return Series(asked.name, NEWTON, values, self.doubt(asked, added), terms=terms)
        arms = self.evaluation.reactions.reach + np.linalg.norm(origins - self.about(asked, about), axis=-1)
        terms = np.linalg.norm(wrench[..., 3:], axis=-1) + arms * terms
        return Series(asked.name, NEWTON_METRE, values, self.doubt(asked, added), terms=terms)

    def wrench_component(self, asked: Asked, origins: Array, wrench: Array, about: Array) -> Array:
        """Return the component of wrenches at origins that a name asks for, shape (n,)."""
        if asked.part == "force":
            return self.component(asked, wrench[..., :3])
        arm = origins - self.about(asked, about)
        return self.component(asked, wrench[..., 3:] + crossed(arm, wrench[..., :3]))

    def doubt(self, asked: Asked, added: list[Array]) -> str:
        """Return the doubt about a component; empty where self-stresses add nothing to it."""
        if not any(acts(part) for part in added):
            return ""
        doubt = f"hyperstatic of degree {self.evaluation.reactions.degree}: rigid bodies do not determine it"
        if self.evaluation.undetermined != "minimum_norm":
            raise self._hyperstatic(asked, doubt)
        return f"least multipliers; {doubt}"

    def _hyperstatic(self, asked: Asked, doubt: str) -> InputError:
        """Return the refusal of a component that is not determined, with the joints that share it."""
        mobility = self.evaluation.mobility
        names = several(list(mobility.undetermined))
        shared = f", only what {names} carry together" if names else ""
        looser = f": {mobility.loosenings[0]}" if mobility.loosenings else ""
        flat = self._across_axis(asked)
        return InputError(
            f"'{asked.name}': {doubt}{shared}",
            expected=f"a component that is determined, or looser joints{looser}",
            hint=f"{flat}, the size of what is across the axis"
            if flat
            else "undetermined: minimum_norm, for the least multipliers",
        )

    def _across_axis(self, asked: Asked) -> str:
        """Return the name of the size across the joint's axis in place of a length, where only that is determined."""
        if asked.words[-1] != "norm":
            return ""
        name = f"{asked.name.removesuffix('norm')}radial"
        try:
            self.series(Asked(name, (*asked.words[:-1], "radial")))
        except InputError:
            return ""
        return name


def acts(component: Array) -> bool:
    """Tell whether wrenches of length 1 act on a component, given what they add to it, shape (n,)."""
    return bool(np.abs(component).max(initial=0.0) > ACTS)


def components(parts: tuple[str, ...] = WRENCH) -> list[str]:
    """Return the names of the components of a force and a moment."""
    return [f"{part}.{axis}" for part in parts for axis in AXES]
