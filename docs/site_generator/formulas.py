"""Formulas in TeX become MathML, which browsers draw without scripts, fonts and network."""

from __future__ import annotations

import html
import re

from latex2mathml.converter import convert

_MARKED = re.compile(r'<(?P<tag>span|div) class="arithmatex">(?P<tex>.*?)</(?P=tag)>', re.DOTALL)


def with_mathml(page: str) -> str:
    r"""Return HTML in which formulas ``\(...\)`` and ``\[...\]``, as arithmatex marks them, are MathML."""
    return _MARKED.sub(_formula, page)


def _formula(marked: re.Match[str]) -> str:
    display = "block" if marked["tag"] == "div" else "inline"
    tex = html.unescape(marked["tex"]).strip()[2:-2]
    return f'<{marked["tag"]} class="formula">{convert(tex, display=display)}</{marked["tag"]}>'
