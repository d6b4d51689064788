"""A table of everything that can be asked by name: names, units, meanings, and what is refused and why."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, NamedTuple

from pinarm.engine.constraints.nullspace import one_blas_thread
from pinarm.engine.kinematics.assembly import generic_near
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.families import FAMILIES, family
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError
from pinarm.input.units import unit

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism

COLUMNS = {
    ".friction": "friction that sticks, along the coordinate, on the child",
    "joint.*.stop": "push of the end stops of the joint, on the child",
    ".effort.lower": "at rest: effort below which the coordinate begins to move down",
    ".effort.upper": "at rest: effort above which the coordinate begins to move up",
    ".time": "when the event first took place",
    ".count": "how often the event took place",
    "control.*.command": "effort, or voltage or torque of a motor, that a controller asks for, before its limits",
    "control.*.effort": "effort of the controller of a drive, at its joint",
    "control.*.reference": "what a controlled coordinate should be",
    "control.*.voltage": "voltage of a motor, within its limits",
    "control.*.current": "current of a motor",
    "control.*.current_margin": "largest current of a motor less the amount of its current",
    "control.*.torque": "torque of an ideal motor, within its peak torque",
    "control.*.margin": "peak torque of a motor at its speed less the amount of what it gives",
    "control.*.continuous_margin": "continuous torque of a motor at its speed less the amount of what it gives",
    "control.*.error": "reference of a controlled coordinate less the coordinate",
    "equilibrium.starts": "number of starts that led to the equilibrium",
    "equilibrium.stability": "1 stable, 0 indifferent, -1 unstable",
    "equilibrium.frequency2": "squared angular frequency of a small motion, in ascending order",
    "equilibrium.stiffness": "eigenvalue of the stiffness, ascending; of trees whose joints all turn or all slide",
    "equilibrium.end": "coordinate of a joint at one end of the positions that friction holds",
}
"""Part of the names of columns that friction, controllers and kinds of problem add, * for any name -> meaning."""


WORLD = "world axes, .along.LINK"
FRAMES = {
    "joint.*.quaternion": "in the joint's placement",
    "joint.*.angular_*": "axes of the link",
    "joint.*.effort": "axes of the link",
    "joint.*.link_effort": "axes of the link",
    "force.*.moment": WORLD,
    "*.moment": f"{WORLD}, .about.LINK",
    "momentum.*.angular": f"{WORLD}, .about.LINK",
}
"""Names of vectors, * for any name -> their frame, the first that fits; any other one is in that of ``WORLD``."""


class NamedQuantity(NamedTuple):
    """Something that can be asked by name.

    Attributes:
        name: Its name, without the last word where that is a component.
        components: Last words; empty for a scalar.
        unit: Its unit in SI; empty where it is refused.
        meaning: What it is, in words; of a symbol its formula.
        refused: Which components cannot be asked here, and why; empty where all can.
        frame: Axes of a vector, and the words before its component that give it in others: ``.along.LINK`` in those of
            a link, ``.about.LINK``, of moments, about the origin of a link; empty for a scalar.
    """

    name: str
    components: tuple[str, ...]
    unit: str
    meaning: str
    refused: str
    frame: str = ""

    @property
    def names(self) -> list[str]:
        return [f"{self.name}.{component}" for component in self.components] or [self.name]

    def __str__(self) -> str:
        return f"{self.spelled} [{self.unit or '?'}]  {self.words}"

    @property
    def spelled(self) -> str:
        """Its name with its components, such as ``point.A.position.{x,y,z}``."""
        return f"{self.name}.{{{','.join(self.components)}}}" if self.components else self.name

    @property
    def words(self) -> str:
        said = "; ".join(filter(None, (self.meaning, self.frame)))
        return f"{said} (refused: {self.refused})" if self.refused else said


@dataclass(frozen=True, repr=False)
class QuantityCatalogue:
    """Quantities that can be asked by name."""

    title: str
    entries: tuple[NamedQuantity, ...]

    def __iter__(self) -> Iterator[NamedQuantity]:
        return iter(self.entries)

    def __len__(self) -> int:
        return len(self.entries)

    def __str__(self) -> str:
        """Return it as a table: a heading, and a line for each quantity."""
        return "\n".join([self.title, *map(str, self.entries)])

    __repr__ = __str__


def catalogue(quantities: Quantities, title: str, like: str = "") -> QuantityCatalogue:
    """Return the quantities of a trajectory with ``like`` in their name or meaning."""
    wanted = like.casefold()
    asked = (meaning for meaning in _meanings(quantities) if wanted in f"{meaning[0]} {meaning[1]}".casefold())
    with one_blas_thread(quantities.trajectory.mechanism.model.nv):
        return QuantityCatalogue(title, tuple(_entry(quantities, *meaning) for meaning in asked))


def catalogue_of(mechanism: Mechanism, like: str = "") -> QuantityCatalogue:
    """Return the quantities of a mechanism in motion, in a position of no special kind; see ``catalogue``."""
    q = generic_near(mechanism, mechanism.start)
    row = Trajectory.schema_row(mechanism, q, "t", unit("s"), mechanism.closure)
    return catalogue(Quantities(row), mechanism.title, like)


def _meanings(quantities: Quantities) -> Iterator[tuple[str, str, tuple[str, ...]]]:
    run = quantities.trajectory
    mechanism = run.mechanism
    yield run.parameter, "what runs along the rows", ()
    yield "g", "magnitude of gravity", ()
    for name, formula in {**mechanism.symbols, **quantities.symbols}.items():
        yield name, f"symbol: {formula.text}", ()
    for name, value in mechanism.arguments.items():
        yield name, f"argument of the model: {value:g}", ()
    for name in mechanism.coordinates:
        if name not in mechanism.symbols and name not in quantities.symbols and name != run.parameter:
            yield name, "coordinate", ()
    for name in run.columns:
        meaning = next((text for mark, text in COLUMNS.items() if fnmatchcase(name, f"*{mark}*")), "")
        yield name, meaning, ()
    for word in FAMILIES:
        of = family(word, quantities.evaluation)
        for entry in of.entries():
            base = ".".join(filter(None, (word, entry.element, entry.part)))
            yield base, of.meanings[entry.part], entry.components


def _entry(quantities: Quantities, name: str, meaning: str, components: tuple[str, ...]) -> NamedQuantity:
    units, refusals = [], dict[str, list[str]]()
    for component in components or ("",):
        whole = f"{name}.{component}" if component else name
        try:
            units.append(str(quantities[whole].unit))
        except InputError as error:
            refusals.setdefault(error.message.removeprefix(f"'{whole}': "), []).append(component)
    refused = "; ".join(f"{', '.join(those)}: {why}" if units else why for why, those in refusals.items())
    frame = next((frame for names, frame in FRAMES.items() if fnmatchcase(name, names)), WORLD) if components else ""
    return NamedQuantity(name, components, units[0] if units else "", meaning, refused, frame)
