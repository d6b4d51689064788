"""One entry of an answer key."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from pinarm.errors import InputError
from pinarm.input.schema import Model
from pinarm.input.units import read_quantity

Verdict = Literal["agrees", "rounding", "reading", "misprint"]
Extreme = Literal["max", "min", "largest"]


class Expectation(Model, frozen=True):
    """What a quantity must be, and what was published of it.

    Attributes:
        quantity: A quantity, a symbol or a formula.
        at: ``all`` for every row; ``start``, ``end``; ``max``, ``min``, ``largest`` (of the absolute value) over the
            run; or an instant: ``{t: 1.5 s, side: left}``, ``{phi: 0 deg, occurrence: 1}``.
        value: The right value, from a closed form or a derivation that does not use this program.
        formula: The same as a formula of symbols, arguments and quantities.
        rtol: Relative tolerance of value and formula.
        atol: Absolute tolerance, with its unit. Where neither is given a value must be met to half a unit of its last
            digit, and a formula to 1e-10.
        published: What is printed, with its digits and unit, as text.
        published_formula: What is printed, where it is a formula.
        because: A formula that gives the printed number from the rounded figures that its authors used.
        verdict: What is claimed of the published figure; a ``reading`` was taken off a plot.
        source: Where the value or the published figure comes from.
        note: What to know.
    """

    quantity: str
    source: str
    at: Literal["all", "start", "end", "max", "min", "largest"] | dict[str, str | int | float] = "all"
    value: str | float | None = None
    formula: str | None = None
    rtol: Annotated[float, msgspec.Meta(ge=0, le=1)] | None = None
    atol: str | float | None = None
    published: str | None = None
    published_formula: str | None = None
    because: str | None = None
    verdict: Verdict = "agrees"
    note: str = ""

    def check(self) -> None:
        """Refuse entries that say too little, or contradict themselves.

        Raises:
            InputError: Says what is missing.
        """
        if self.published is not None:
            read_quantity(self.published)
        if self.value is not None and self.formula is not None:
            raise InputError("give a value or a formula, not both")
        if self.value is None and self.formula is None and self.published is None and self.published_formula is None:
            raise InputError("an expectation needs a value, a formula or a published figure")
        if self.verdict != "agrees" and self.value is None and self.formula is None:
            raise InputError(f"a {self.verdict} can only be confirmed by an independent value or formula")
