"""Numbers of a scenario that are to be found: what is unknown, and what is wanted of the run.

Either quantities are to take values, see ``searches``, or one number of the run is to be least or largest: ``optimum``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, ClassVar, Literal, Self

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError, within
from pinarm.input.units import Unit
from pinarm.input.yaml.document import require_unit
from pinarm.input.yaml.schema import AnyQuantity, InputStruct, Measured
from pinarm.use.result.numbers import AnyNumber, Condition, names_number, read_conditions, read_number
from pinarm.use.result.section import Numbered

BOUNDS = "[0 kg, 500 kg], or {from: 0 kg, to: 500 kg, start: 100 kg}"


class Unknown(Measured):
    """A number to find: its value is where to start from.

    Attributes:
        low: Lower bound in SI; minus infinity for none.
        high: Upper bound in SI; infinity for none.
    """

    low: float = -math.inf
    high: float = math.inf
    forms: ClassVar[Sequence[Mapping[str, Any]]] = (
        *Measured.forms,
        {"type": "array", "minItems": 2, "maxItems": 2},
        {"type": "object", "required": ["from", "to"]},
    )

    @classmethod
    def read(cls, value: object, *, bare: bool = True) -> Self:
        """Read a start, such as ``100 kg``; two bounds; or bounds and a start: see ``BOUNDS``.

        A number needs no unit here: the number that it replaces may have none.
        """
        if isinstance(value, Sequence) and not isinstance(value, str):
            value = dict(zip(("from", "to"), value, strict=True)) if len(value) == 2 else {}
        if not isinstance(value, Mapping):
            return super().read(value)
        if not {"from", "to"} <= value.keys() <= {"from", "to", "start"}:
            raise InputError("these are no bounds of a number", expected=BOUNDS)
        numbers = {key: AnyQuantity.read(text) for key, text in value.items()}
        units = [number.unit for number in numbers.values() if number.unit]
        for number in numbers.values() if units else ():
            number.check(units[0])
        low, high = float(numbers["from"]), float(numbers["to"])
        start = float(numbers.get("start", 0.5 * low + 0.5 * high))
        unknown = cls._of(start, units[0] if units else None)
        unknown.low, unknown.high = low, high
        if not (low < high and low <= start <= high):
            texts = [unknown.written(bound) for bound in (low, start, high)]
            message = f"the bounds {texts[0]} and {texts[2]} with the start {texts[1]} are not in order"
            raise InputError(message, expected=BOUNDS)
        return unknown

    def written(self, value: float) -> str:
        """Return a value in SI as files write it, in the unit of the start."""
        return f"{float(value / self.unit.factor)!r} {self.unit}" if self.unit else repr(float(value))

    @property
    def factor(self) -> float:
        """SI value of one of its unit."""
        return self.unit.factor if self.unit else 1.0


class Find(InputStruct, frozen=True, rename={"unknown": "for", "wanted": "so_that"}):
    """Numbers to find, and what they are to bring about: ``so_that``, ``minimise`` or ``maximise``.

    Attributes:
        unknown: ``for`` in files: path of a number of the scenario, as ``--set`` writes it -> where to start from; for
            an optimum its bounds, ``[0 kg, 500 kg]``, or ``{from: 0 kg, to: 500 kg, start: 100 kg}``.
        wanted: ``so_that`` in files: quantity or formula -> its value at every row, or number of the run -> its value,
            such as ``{C_B @ rms: 20 N*m}``.
        minimise: Number of the run that is to be least, such as ``C_B @ rms``; of ``C_B @ largest`` the amount.
        maximise: Number of the run that is to be largest, such as ``C_B @ min``.
        subject_to: For an optimum: number of the run -> what it must keep to, such as ``{loop.B.force.norm @ max: < 300
            N}``; an equality is ``= 0.52 m``, and a bound with ``>`` stands in quotes.
        starts: For an optimum: how many points the search starts from, such as ``16``: the given one, or the middle of
            the bounds, and others that fill the space between the bounds evenly.
        search: For an optimum: ``local``, down along the slopes from every start; ``global``, differential evolution
            of a population first, which costs hundreds of runs.
        seed: For an optimum: of the choice of starts, a whole number, such as ``1``.
    """

    unknown: Annotated[dict[str, Unknown], msgspec.Meta(min_length=1)]
    wanted: Annotated[dict[str, AnyQuantity], msgspec.Meta(min_length=1)] | None = None
    minimise: str | None = None
    maximise: str | None = None
    subject_to: dict[str, str] = {}
    starts: Annotated[int, msgspec.Meta(ge=1, le=1000)] = 8
    search: Literal["local", "global"] = "local"
    seed: Annotated[int, msgspec.Meta(ge=0, le=2**32 - 1)] = 0

    def check(self) -> None:
        """Refuse searches that say too little, or contradict themselves."""
        if sum(wish is not None for wish in (self.wanted, self.minimise, self.maximise)) != 1:
            raise InputError("find needs to know what is wanted", expected="one of so_that, minimise, maximise")
        if self.wanted is not None and self.subject_to:
            raise InputError("subject_to belongs to minimise or maximise", hint="leave it out, or add it to so_that")
        _ = self.objective, self.conditions
        for path, unknown in self.unknown.items():
            with within("for", path):
                if (unknown.high < math.inf) != (self.wanted is None):
                    bounded = f"an optimum is searched between bounds, such as {BOUNDS}"
                    rooted = "so_that is solved from one start, without bounds, such as "
                    raise InputError(f"{rooted}{unknown.written(unknown)}" if self.wanted else bounded)

    @property
    def objective(self) -> AnyNumber | None:
        """The number that is to be least or largest, of ``@ largest`` the size; none where values are wanted."""
        with within("minimise" if self.minimise is not None else "maximise"):
            text = self.minimise if self.minimise is not None else self.maximise
            return None if text is None else read_number(text).amount

    @property
    def conditions(self) -> list[Condition]:
        with within("subject_to"):
            return read_conditions(self.subject_to)

    def units(self, quantities: Quantities) -> Mapping[str, Unit | None]:
        """Return the units of the numbers in its section, the objective's left open: see ``Numbered``."""
        units = {path: unknown.unit.si if unknown.unit else None for path, unknown in self.unknown.items()}
        return {**units, "objective": None} if self.objective else {}

    def check_names(
        self, quantities: Quantities, sections: Mapping[str, Numbered], unit_at: Callable[[str], str]
    ) -> None:
        """Check its names and units with nothing solved; ``unit_at`` knows the unit of the number at a path."""
        for path, unknown in self.unknown.items():
            with within("for", path):
                require_unit(unknown, unit_at(path), path)
        for name, value in (self.wanted or {}).items():
            with within("so_that", name):
                measured = self.number(name, sections)
                unit = (measured.described(quantities, sections) if measured else quantities[name]).unit
                if unit:
                    value.check(unit)
        if self.objective:
            with within("minimise" if self.minimise is not None else "maximise"):
                self.objective.described(quantities, sections)
        for condition in self.conditions:
            with within("subject_to", condition.number.label):
                unit = condition.number.described(quantities, sections).unit
                if unit:
                    condition.bound.check(unit)

    @staticmethod
    def number(name: str, sections: Mapping[str, Numbered]) -> AnyNumber | None:
        """Return the number of the run that a key of ``so_that`` names; none where it names a quantity of all rows."""
        return read_number(name) if names_number(name, sections) else None

    def case(self, values: Array) -> dict[str, str | float]:
        """Return values, shape (k,) in SI, by their paths, as files have them, in the units of the starts."""
        pairs = zip(self.unknown.items(), values.tolist(), strict=True)
        return {path: unknown.written(value) if unknown.unit else value for (path, unknown), value in pairs}

    def figures(self, values: Array) -> dict[str, float]:
        """Return values, shape (k,) in SI, by their paths with units, in the units of the starts."""
        named = zip(self.unknown.items(), values, strict=True)
        return {f"{path} [{unknown.unit or '1'}]": float(value) / unknown.factor for (path, unknown), value in named}

    @property
    def start(self) -> Array:
        """Where to start from, in SI, shape (k,)."""
        return np.array([float(unknown) for unknown in self.unknown.values()])

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds, in SI, shapes (k,)."""
        unknowns = self.unknown.values()
        return np.array([unknown.low for unknown in unknowns]), np.array([unknown.high for unknown in unknowns])

    @property
    def sign(self) -> float:
        """1 where the objective is to be least, -1 where it is to be largest."""
        return 1.0 if self.minimise is not None else -1.0
