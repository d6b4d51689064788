"""Names of quantities in pictures: symbols as publications print them, units, and both without TeX."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Literal

from pinarm.engine.series import Series
from pinarm.input.units import Unit, printed
from pinarm.use.result.presentation import DEGREE, FURTHER, SUBSCRIPTS, Presentation, parts, tex_label, unicode_letters

PLAIN = Presentation()
"""Presentation of drawings that belong to no scenario."""

LONG = 70
"""Letters of a name that an axis shows."""

_GREEK = (
    "alpha beta gamma delta epsilon zeta eta theta kappa lambda mu nu xi rho sigma tau phi chi psi omega "
    "Gamma Delta Theta Lambda Xi Sigma Phi Psi Omega"
)
_SYMBOL = re.compile(
    rf"(?P<greek>{_GREEK.replace(' ', '|')})_?(?P<number>\d*)(?P<rate>d{{0,2}})"
    r"|(?P<letter>[A-Za-z])(_(?P<index>[A-Za-z0-9]+)|(?P<digits>\d+))"
)
_DOLLAR = re.compile(r"(?<!\\)\$")
_SCRIPT = re.compile(r"([_^])(?:\{([^{}]*)\}|(\\?[A-Za-z0-9]+))")


TextRun = tuple[str, Literal["", "sub", "sup"], bool]
"""Letters in one style; whether they are on the line, below or above it; whether they are of a formula, slanted."""


def shown(series: Series, how: Presentation = PLAIN) -> tuple[float, Unit | None]:
    """Return the factor to divide by, and the unit of the picture, degrees as ``°``."""
    measured = how.unit(series)
    if measured is None or series.unit is None:
        return 1.0, measured
    scale = measured.factor / series.unit.factor
    return scale, Unit(measured.factor, measured.dimension, "°") if measured == DEGREE else measured


def axis_label(name: str, measured: Unit | None, how: Presentation = PLAIN, longest: int = LONG) -> str:
    """Return the label of an axis: the label of a name, and its unit."""
    text = unit_text(measured)
    label = name_label(name, how, longest)
    return label if text == "" else f"{label} [{plain(text)}]"


def unit_text(measured: Unit | None) -> str:
    """Return a unit as it is printed; nothing for plain numbers."""
    text = printed(str(measured or "?"))
    return {"1": "", "deg": "°"}.get(text, text)


def name_label(name: str, how: Presentation = PLAIN, longest: int = LONG) -> str:
    """Return the label of a name: the scenario's own, else its symbol, shortened to so many letters."""
    before, quantity, after = parts(name, how.labels)
    if quantity in how.labels:
        pieces = [how.labels.get(piece, piece) for piece in (quantity, *FURTHER.split(after))]
        return plain(before) + "".join(tex_label(piece) or plain(piece) for piece in pieces)
    return symbol(name if len(name) <= longest else f"{name[: longest - 3]}...")


def symbol(name: str) -> str:
    """Return a name as publications print it: ``theta21d`` as a Greek letter with dot and index, ``C_B`` with an index.

    Any other name is left as it is.
    """
    match = _SYMBOL.fullmatch(name)
    if match is None:
        return plain(name)
    accent = {0: "", 1: r"\dot", 2: r"\ddot"}[len(match["rate"] or "")]
    letter = match["letter"] or f"\\{match['greek']}"
    letter = f"{accent}{{{letter}}}" if accent else letter
    index = match["number"] or match["index"] or match["digits"]
    return f"${letter}_{{{index}}}$" if index else f"${letter}$"


def plain(text: str) -> str:
    """Return a text without formulas: its dollar signs are escaped."""
    return text.replace("\\", "\\\\").replace("$", r"\$") if "$" in text else text


def runs(label: str) -> list[TextRun]:
    """Return a label without TeX, for HTML: letters of formulas by their characters, indices apart."""
    parts: list[TextRun] = []
    for k, part in enumerate(_DOLLAR.split(label)):
        if k % 2:
            parts += _formula(part)
        elif part:
            parts.append((part.replace(r"\$", "$").replace("\\\\", "\\") if r"\$" in part else part, "", False))
    return parts


def unicode_label(label: str) -> str:
    """Return a label as mere text, indices of digits below the line."""
    return "".join(map(_unicode, runs(label)))


def _unicode(run: TextRun) -> str:
    letters, at, _ = run
    if at == "sub" and letters.isdigit():
        return letters.translate(SUBSCRIPTS)
    return {"": "", "sub": "_", "sup": "^"}[at] + letters


def _formula(tex: str) -> Iterator[TextRun]:
    """Yield a formula: what is between its indices, and these."""
    end = 0
    for script in _SCRIPT.finditer(tex):
        if script.start() > end:
            yield unicode_letters(tex[end : script.start()]), "", True
        yield unicode_letters(script[2] or script[3] or ""), "sub" if script[1] == "_" else "sup", False
        end = script.end()
    if tex[end:]:
        yield unicode_letters(tex[end:]), "", True
