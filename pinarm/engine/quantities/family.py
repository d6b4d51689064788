"""Arrays over the rows of a trajectory, and the base class of the families of quantities computed from them."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from pinarm.arrays import Array, length
from pinarm.engine.constraints.constraint_rows import ConstraintRows
from pinarm.engine.constraints.nullspace import ACTS
from pinarm.engine.friction.columns import BANDS
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.series import Series
from pinarm.errors import InputError, several
from pinarm.input.units import unit
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate
from pinarm.mechanics.geometry.vectors import crossed, moved
from pinarm.mechanics.joints import METRE, frame_of
from pinarm.records import AbstractRecord, Record, ValueRecord

if TYPE_CHECKING:
    from pinarm.engine.constraints.self_stresses import Mobility
    from pinarm.engine.quantities.reactions import Reactions


class Evaluation(Record, frozen=True):
    """Coordinates, frames, energies, momenta and reactions of a trajectory.

    Attributes:
        undetermined: ``refuse`` components of reactions that rigid bodies do not determine, or give those of the least
            multipliers.
    """

    run: Trajectory
    undetermined: str = "refuse"
    judged: bool = True

    @cached_property
    def reactions(self) -> Reactions:
        from pinarm.engine.quantities.reactions import SAMPLE, Reactions

        return Reactions(self.run, SAMPLE if self.judged else 0)

    @cached_property
    def mobility(self) -> Mobility:
        from pinarm.engine.constraints.self_stresses import mobility_of

        return mobility_of(self.run.mechanism, np.real(self.run.q[0]))

    @property
    def doubtful(self) -> bool:
        """Whether rigid bodies may leave something undetermined: loads of constraints, or of frictions."""
        return bool(self.run.closure.constraints or self.run.mechanism.frictions)

    @cached_property
    def friction_doubts(self) -> Mapping[str, str]:
        """Doubts about frictions whose loads may be those of the least multipliers, and about what rests on them."""
        some = [contact for contact in self.run.mechanism.frictions if contact.shared and contact.law.loaded]
        if not some or not self.reactions.degree:
            return {}
        names = ", ".join(dict.fromkeys(contact.name for contact in some))
        doubt = f"least multipliers; rigid bodies may not determine the load of {names}"
        bands = [name for name in self.run.columns if name.endswith(tuple(f".effort.{part}" for part in BANDS))]
        return dict.fromkeys([*(contact.quantity for contact in some), "power.friction", *bands], doubt)

    def rate(self, name: str, coordinate: Coordinate, order: int) -> Array:
        """Return a coordinate, or its first or second derivative, shape (n, ..)."""
        run = self.run
        if isinstance(coordinate, LinearCoordinate):
            return coordinate.rate((run.v, run.a)[order - 1]) if order else coordinate.at(run.q)
        if name not in self._coordinates:
            self._coordinates[name] = self._derivatives(coordinate)
        return np.asarray(self._coordinates[name][..., order])

    @cached_property
    def _coordinates(self) -> dict[str, Array]:
        return {}

    def _derivatives(self, coordinate: Coordinate) -> Array:
        """Return a coordinate with its two derivatives, shape (n, .., 3)."""
        here = ConstraintRows.of(self.run.mechanism.model, [coordinate]).at(self.run.q)
        row = here.matrices[..., 0, :]
        speed, growth = ((row * x).sum(axis=-1) for x in (self.run.v, self.run.a))
        return np.stack([here.gaps[..., 0], speed, growth + here.drifts(self.run.v)[..., 0]], axis=-1)

    def frame(self, name: str) -> Array:
        """Return a link's position, velocity, acceleration, angular velocity and acceleration, shape (n, .., 5, 3).

        Of its origin, in world axes [m, m/s, m/s^2, rad/s, rad/s^2]. With the velocity u and the angular velocity
        omega of the joint's origin, and the arm r from there: ``u + omega x r``, and
        ``u' + omega x u + alpha x r + omega x (omega x r)`` with the derivative ``[u'; alpha]`` of the twist.
        """
        return self._frame(name)[0]

    def turn(self, name: str) -> Array:
        """Return a link's rotation matrices, columns its axes in the world's, shape (n, .., 3, 3)."""
        return self._frame(name)[1]

    @cached_property
    def _frames(self) -> dict[str, tuple[Array, Array]]:
        return {}

    def _frame(self, name: str) -> tuple[Array, Array]:
        if name in self._frames:
            return self._frames[name]
        model = self.run.mechanism.model
        frame = frame_of(model, name)
        joint = model.frames[frame].parentJoint
        links, twists, rates, _ = self.run.link_motion
        (turns, places), turned = links.frame(frame), links.turns[..., joint, :, :]
        arms = places - links.places[..., joint, :]
        parts = (part for x in (twists, rates) for part in (x[..., joint, :3], x[..., joint, 3:]))
        u, omega, du, alpha = (np.matvec(turned, part) for part in parts)
        swept = crossed(omega, arms)
        rows = places, u + swept, du + crossed(omega, u) + crossed(alpha, arms) + crossed(omega, swept), omega, alpha
        self._frames[name] = np.stack(np.broadcast_arrays(*rows), axis=-2), turns
        return self._frames[name]

    @cached_property
    def energies(self) -> Array:
        """Kinetic energy, potential energy and their sum [J], springs and rotors included, shape (3, n)."""
        kinetic, potential = self.run.dynamics.energy(self.run.q, self.run.v)
        return np.array([kinetic, potential, kinetic + potential])

    @cached_property
    def momenta(self) -> Array:
        """Momentum of each link and its rate, shape (2, n, njoints, 6).

        [linear; angular] about the world's origin, world axes [kg*m/s, kg*m^2/s] and [N, N*m].
        """
        links, twists, rates, _ = self.run.link_motion
        growth, turning, _ = links.demands(twists, rates)
        parts = links.momenta(twists), growth + turning
        return np.array([moved(links.outwards(part), links.places) for part in parts])

    @cached_property
    def body_energies(self) -> tuple[Array, Array]:
        """Kinetic energy, and potential energy of its weight [J], of each link, shape (n, njoints)."""
        links, twists, _, _ = self.run.link_motion
        return links.energies(twists)

    @cached_property
    def gravity_power(self) -> Array:
        """Power of the weights [W], shape (n,)."""
        links, twists, _, _ = self.run.link_motion
        return links.gravity_power(twists)


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
        return self.words[0]

    @property
    def unknown(self) -> UnknownQuantity:
        return UnknownQuantity(self.name)

    @property
    def part(self) -> str:
        """Part that is asked, such as ``moment``: the second word; empty where there is none."""
        return self.words[1] if len(self.words) > 1 else ""


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
        base = ".".join(filter(None, (self.element, self.part)))
        return [f"{base}.{component}" for component in self.components] or [base]


class Family(AbstractRecord, frozen=True):
    """Quantities whose names begin with the same word.

    Attributes:
        meanings: Part -> what it is, in words.
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
        return [name for entry in self.entries() for name in entry.names()]

    @abstractmethod
    def series(self, asked: Asked) -> Series:
        """Return a quantity over the rows."""

    def require_efforts(self, asked: Asked) -> None:
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
            raise asked.unknown
        if axis in ALONG_AXIS and extra[::2] in ((), ("about",)):
            axes = self.axes(asked)
            axial = np.asarray((vectors * axes).sum(axis=-1))
            return axial if axis == "axial" else length(vectors - axial[..., None] * axes)
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
        mobility = self.evaluation.mobility
        names = several(list(mobility.undetermined))
        shared = f", only what {names} carry together" if names else ""
        looser = f": {mobility.loosenings[0]}" if mobility.loosenings else ""
        return InputError(
            f"'{asked.name}': {doubt}{shared}",
            expected=f"a component that is determined, or looser joints{looser}",
            hint=f"{asked.name.removesuffix('norm')}radial, the size of what is across the axis"
            if asked.words[-1] == "norm"
            else "undetermined: minimum_norm, for the least multipliers",
        )


def acts(component: Array) -> bool:
    """Tell whether wrenches of length 1 act on a component, given what they add to it, shape (n,)."""
    return bool(np.abs(component).max(initial=0.0) > ACTS)


def components(parts: tuple[str, ...] = WRENCH) -> list[str]:
    """Return the names of the components of a force and a moment."""
    return [f"{part}.{axis}" for part in parts for axis in AXES]
