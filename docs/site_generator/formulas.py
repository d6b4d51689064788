"""Formulas in TeX become MathML, which browsers draw without scripts, fonts and network."""

from __future__ import annotations

import html
import re

from latex2mathml.converter import convert

_MARKED = re.compile(r'<(?P<tag>span|div) class="arithmatex">(?P<tex>.*?)</(?P=tag)>', re.DOTALL)

_ACCENT = re.compile(r"<mover>(<mi>[^<]*</mi>)<mo>(&#x002D9;|&#x000A8;)</mo></mover>")
_FUNCTION = "<mi>(?:sin|cos|tan|arctan|min|max)</mi>"
_AFTER_FACTOR = re.compile(rf"(</m(?:i|n|sub|sup|subsup|over|frac|row)>)(?={_FUNCTION})")
_BEFORE_ARGUMENT = re.compile(rf"({_FUNCTION})(?=<m(?:i|n|sub|sup|subsup|over|frac)\b)")
_SPACE = r'\1<mspace width="0.167em"/>'


def with_mathml(page: str) -> str:
    r"""Return HTML in which formulas ``\(...\)`` and ``\[...\]``, as arithmatex marks them, are MathML."""
    return _MARKED.sub(_formula, page)


def _formula(marked: re.Match[str]) -> str:
    display = "block" if marked["tag"] == "div" else "inline"
    tex = html.unescape(marked["tex"]).strip()[2:-2]
    return f'<{marked["tag"]} class="formula">{_set(convert(tex, display=display))}</{marked["tag"]}>'


def _set(formula: str) -> str:
    """Return MathML with dots of their full size above letters, and spaces around the names of functions, as TeX."""
    accented = _ACCENT.sub(r'<mover accent="true">\1<mo stretchy="false">\2</mo></mover>', formula)
    return _BEFORE_ARGUMENT.sub(_SPACE, _AFTER_FACTOR.sub(_SPACE, accented))
