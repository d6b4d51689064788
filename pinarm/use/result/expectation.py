"""One entry of an answer key."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Literal

import msgspec

from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError, choices, within
from pinarm.input.units import read_quantity
from pinarm.input.yaml.schema import InputStruct, in_si
from pinarm.use.result.row_lookup import located

if TYPE_CHECKING:
    from pinarm.engine.series import Series
    from pinarm.use.result.section import Numbered

Verdict = Literal["agrees", "rounding", "reading", "misprint", "model_error"]
ERRATA = ("misprint", "model_error")
"""Verdicts on what is wrong in print."""

PLACES = ("all", "start", "end", "max", "min", "largest")


class Expectation(InputStruct, frozen=True):
    """What a quantity must be, and what was published of it.

    Attributes:
        quantity: A quantity, a symbol or a formula; or a number of a section, such as ``loads.B.life.time``; or a
            formula of numbers of the run, such as ``C_B @ max - C_B @ min``.
        at: ``all`` for every row; ``start``, ``end``; ``max``, ``min``, ``largest`` (the value of the largest amount,
            with its sign) over the run; an instant: ``{t: 1.5 s, side: left}``, ``{phi: 0 deg, occurrence: 1}``; or a
            figure of the curve over the run: ``mean``, ``rms``, ``integral``, ``peak``, or a percentile such as
            ``p95``.
        value: The right value, from a closed form or a derivation that does not use this program, such as ``12.5 N*m``.
        formula: The same as a formula of symbols, arguments and quantities.
        rtol: Relative tolerance of value and formula; of a formula in all rows relative to its largest size there.
        atol: Absolute tolerance, with its unit. Where neither is given a value must be met to half a unit of its last
            digit, and a formula to 1e-10; 0 without decimals needs one of them.
        published: What is printed, with its digits and unit, as text.
        published_formula: What is printed, where it is a formula.
        because: A formula that gives the printed figure from what its authors used: rounded figures, a misprinted one,
            or the wrong assumption of a ``model_error``, which needs it.
        verdict: What is claimed of the published figure; a ``reading`` was taken off a plot, a ``model_error`` is
            printed as its authors meant it, from a model that leaves out or misplaces something.
        erratum: Name of a misprint or model error, such as ``table 11-2, sign``; entries with one name, in all
            scenarios that are checked, are one.
        source: Where the value or the published figure comes from, such as ``Norton, table 11-2``.
        note: What to know, such as ``read off the plot``.
    """

    quantity: str
    source: str
    at: str | dict[str, str | int | float] = "all"
    value: str | float | None = None
    formula: str | None = None
    rtol: Annotated[float, msgspec.Meta(ge=0, le=1)] | None = None
    atol: str | float | None = None
    published: str | None = None
    published_formula: str | None = None
    because: str | None = None
    verdict: Verdict = "agrees"
    erratum: str = ""
    note: str = ""

    def check(self) -> None:
        """Refuse entries that say too little, or contradict themselves.

        Raises:
            InputError: Says what is missing.
        """
        if self.published is not None:
            with within("published"):
                read_quantity(self.published)
        self._check_place()
        independent = [given for given in (self.value, self.formula) if given is not None]
        printed = [given for given in (self.published, self.published_formula) if given is not None]
        if max(len(independent), len(printed)) > 1:
            raise InputError("give a value or a formula, not both; of what is published, too", hint="an entry for each")
        if not independent and not printed:
            raise InputError("an expectation needs a value, a formula or a published figure")
        if self.verdict != "agrees" and not independent:
            said = self.verdict.replace("_", " ")
            raise InputError(f"a {said} can only be confirmed by an independent value or formula")
        if self.verdict == "model_error" and self.because is None:
            raise InputError(
                "a model error is confirmed by what it assumes", expected="because: the formula of that model"
            )
        if self.erratum and self.verdict not in ERRATA:
            raise InputError(
                f"an erratum is a misprint or a model error, not '{self.verdict}'",
                expected="verdict: misprint, or model_error",
            )

    def _check_place(self) -> None:
        if isinstance(self.at, dict) or self.at in PLACES:
            return
        from pinarm.use.result.curve_figures import FIGURES, is_figure

        if not is_figure(self.at):
            expected, hint = choices(self.at, [*PLACES, *FIGURES])
            with within("at"):
                raise InputError(
                    f"there is no place '{self.at}' on a run",
                    hint=hint,
                    expected=f"{expected}, a percentile such as p95, or an instant such as {{t: 1.5 s}}",
                )

    def check_names(self, quantities: Quantities, sections: Mapping[str, Numbered]) -> None:
        """Check its names and units against the quantities of a run, and the numbers of its sections, by key.

        Raises:
            InputError: A quantity does not exist, or a value has another dimension than its quantity.
        """
        with within("quantity"):
            measured = self._described(quantities, sections).unit
        for key, text in (("value", self.value), ("atol", self.atol), ("published", self.published)):
            with within(key):
                _ = None if text is None else in_si(text, measured)
        for key, formula in (("published_formula", self.published_formula), ("because", self.because)):
            with within(key):
                _ = None if formula is None else quantities.figure(formula)
        with within("formula"):
            _ = None if self.formula is None else quantities[self.formula]
        self.check_place(quantities)

    def check_place(self, quantities: Quantities) -> None:
        """Check the coordinate of an instant, and its unit, against the quantities of a run.

        Raises:
            InputError: There is no such coordinate, or its value has another dimension.
        """
        if isinstance(self.at, dict):
            with within("at"):
                located(self.at, quantities)

    def _described(self, quantities: Quantities, sections: Mapping[str, Numbered]) -> Series:
        """Return its name and unit as a series."""
        if not sections and "@" not in self.quantity:
            return quantities[self.quantity]
        from pinarm.use.result.numbers import names_number, read_number

        if not names_number(self.quantity, sections):
            return quantities[self.quantity]
        if self.at != "all":
            raise InputError(f"'{self.quantity}' is one number: it has no place on the run", hint="leave 'at' out")
        return read_number(self.quantity).described(quantities, sections)
