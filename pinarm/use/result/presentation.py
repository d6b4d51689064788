"""In which units, and by which labels, outputs are shown: as the scenario says, and otherwise angles in degrees.

People get angles in degrees, all else in SI: in the terminal, plots, replays, reports and checks. What programs read,
CSV files, tables of pandas, npz and JSON, is in SI; CSV files and tables of pandas take the units that a scenario asks
for, which stand in their headings.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Container, Mapping, Sequence
from typing import Literal

from msgspec import field

from pinarm.engine.series import Series
from pinarm.input.units import Unit, unit
from pinarm.language import Language
from pinarm.records import ValueRecord

DEGREE = unit("deg")

FOR_PEOPLE = {"rad": DEGREE}
"""Unit, as text -> the unit that people are shown it in where a scenario says nothing."""

UNIT_KINDS: Mapping[str, Sequence[str]] = {
    "length": ("m",), "angle": ("rad",), "time": ("s",), "mass": ("kg",), "inertia": ("kg*m^2",),
    **dict.fromkeys(("speed", "velocity"), ("rad/s", "m/s")), "acceleration": ("rad/s^2", "m/s^2"),
    "force": ("N",), **dict.fromkeys(("torque", "moment"), ("N*m",)), "pressure": ("Pa",), "energy": ("J",),
    "power": ("W",), "current": ("A",), "voltage": ("V",),
}  # fmt: skip
"""Word for all quantities of a kind -> the SI units that they have. ``speed`` is that of which the unit is one."""

ACCENTS = {"dot": "\u0307", "ddot": "\u0308", "dddot": "\u20db", "hat": "\u0302", "bar": "\u0304", "tilde": "\u0303"}
"""Commands of TeX for accents, and the marks of Unicode that combine with the letter before them."""

_ACCENT = r"\\(dddot|ddot|dot|hat|bar|tilde)\s*(?:\{([^{}]*)\}|(\\[A-Za-z]+|[A-Za-z]))"
_LETTER = r"\\(var)?([A-Za-z]+)"
_BEFORE = r"(?:(?:min|max|mean|median|rms|largest|start|end|±|[0-9.]+ %) )?"
_NUMBER = rf"(?P<before>{_BEFORE})(?P<quantity>.*?)(?P<after>(?:\.least|\.greatest)?(?: @ .*)?)"
FURTHER = re.compile(r"((?<![\w.@])(?<!@ )[^\W\d][\w.]*)")
"""A name within a formula of numbers, ``M @ max - C @ min``; places such as ``max`` are none."""
_GROUP = r"([_^])\{([^{}]*)\}"


CsvForm = Literal["commas", "semicolons"]
"""Separator of the columns of CSV files: with semicolons numbers have a decimal comma."""


class Presentation(ValueRecord, frozen=True):
    """Units, labels and language in which the quantities of a scenario are shown.

    Attributes:
        units: Quantity -> the unit that it is shown in.
        labels: Quantity -> its label: text, text with formulas ``$C_A$``, or TeX with a backslash.
        kinds: SI unit, as text -> the unit that all other quantities that have it are shown in.
        lang: Language of documents; that of what surrounds them where it is ``None``.
        csv: Separator of the columns of CSV files.
    """

    units: Mapping[str, Unit] = field(default_factory=dict)
    labels: Mapping[str, str] = field(default_factory=dict)
    kinds: Mapping[str, Unit] = field(default_factory=dict)
    lang: Language | None = None
    csv: CsvForm = "commas"

    @classmethod
    def of(
        cls, units: Mapping[str, str], labels: Mapping[str, str], lang: Language | None = None, csv: CsvForm = "commas"
    ) -> Presentation:
        """Read units by quantity or by a word of ``UNIT_KINDS``, as files have them."""
        kinds, read = dict[str, Unit](), {name: unit(text) for name, text in units.items()}
        for word in UNIT_KINDS.keys() & read.keys():
            kinds |= {text: read[word] for text in UNIT_KINDS[word] if unit(text).dimension == read[word].dimension}
        named = {
            name: unit_of_name
            for name, unit_of_name in read.items()
            if not (name in UNIT_KINDS and unit_of_name in kinds.values())
        }
        return cls(named, labels, kinds, lang, csv)

    def unit(self, series: Series) -> Unit | None:
        """Return the unit that a quantity is shown in to people; ``None`` where it has an unknown one."""
        chosen = self._chosen(series)
        return chosen or (FOR_PEOPLE.get(series.unit.text, series.unit) if series.unit is not None else None)

    def scale(self, series: Series) -> tuple[float, Unit | None]:
        """Return the factor from the values of a series to those shown, and the unit shown."""
        measured = self.unit(series)
        return (series.unit.factor / measured.factor if measured and series.unit else 1.0), measured

    def shown(self, series: Series) -> Series:
        measured = self.unit(series)
        return series.to(measured) if measured is not None and str(measured) != str(series.unit) else series

    def written(self, series: Series) -> Series:
        """Return a quantity in the unit that a table of it is in: the chosen one, else its own."""
        chosen = self._chosen(series)
        return series.to(chosen) if chosen else series

    def label(self, name: str) -> str:
        """Return the label of a quantity where there is no TeX."""
        before, quantity, after = parts(name, self.labels)
        if quantity not in self.labels:
            return name
        after = FURTHER.sub(lambda match: unicode_text(self.labels.get(match[0], match[0])), after)
        return f"{before}{unicode_text(self.labels[quantity])}{after}"

    def _chosen(self, series: Series) -> Unit | None:
        """Return the unit that a scenario asks for; a number such as ``C_B @ max`` has that of its quantity."""
        if series.name in self.units:
            return self.units[series.name]
        chosen = self.units.get(parts(series.name, self.units)[1])
        if series.unit is None:
            return None
        fits = chosen is not None and chosen.dimension == series.unit.dimension
        return chosen if fits else self.kinds.get(str(series.unit.si))


def parts(name: str, known: Container[str]) -> tuple[str, str, str]:
    """Return the quantity of a number such as ``C_B @ max`` or ``min C_B``, with what stands before and after it."""
    match = re.fullmatch(_NUMBER, name)
    if name in known or match is None:
        return "", name, ""
    return match["before"], match["quantity"], match["after"]


def unicode_text(label: str) -> str:
    r"""Return a label without TeX: ``\dot\psi_1`` as ψ̇₁; commands that have no letter keep their names."""
    if "$" in label and tex_label(label):
        return re.sub(r"\$([^$]*)\$", lambda m: unicode_text(m[1]), label)
    text = re.sub(_GROUP, lambda m: m[1] + m[2], unicode_letters(label))
    return re.sub(r"_([0-9]+)", lambda m: m[1].translate(SUBSCRIPTS), text)


def tex_label(label: str) -> str:
    r"""Return a label with its formulas between dollar signs, ``$C_A$`` or ``torque $\tau$``; empty for mere text.

    A label with a backslash and without dollar signs is a formula as a whole.
    """
    if "$" in label:
        return label if label.count("$") % 2 == 0 and "\\$" not in label else ""
    return f"${label}$" if "\\" in label else ""


def unicode_letters(tex: str) -> str:
    """Return a formula without indices by its characters: Greek letters, and marks above letters."""
    text = re.sub(_ACCENT, lambda m: f"{m[2] or m[3]}{ACCENTS[m[1]]}", tex)
    return re.sub(_LETTER, lambda m: _greek(m[2]), text)


SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")


def _greek(name: str) -> str:
    """Return a Greek letter by its name in TeX; the name itself where it is none."""
    kind = "CAPITAL" if name[0].isupper() else "SMALL"
    spelled = {"lambda": "lamda", "Lambda": "Lamda"}.get(name, name)
    try:
        return unicodedata.lookup(f"GREEK {kind} LETTER {spelled.upper()}")
    except KeyError:
        return name
