"""Places where long code in a cell of a table may go on in the next line: tables stay within the page."""

from __future__ import annotations

import re

LONGEST = 24
"""Letters of code that stay in one line."""

_CELL = re.compile(r"<td.*?</td>", re.DOTALL)
_CODE = re.compile(r"(?<=<code>)[^<]+(?=</code>)")
_SIGN = re.compile(r"(?<=[\w)\]])[./,+*=](?=[A-Za-z(])")


def with_breaks(page: str) -> str:
    """Return HTML in which long code in cells may be divided after the signs between its names."""
    return _CELL.sub(lambda cell: _CODE.sub(_broken, cell[0]), page)


def _broken(code: re.Match[str]) -> str:
    return _SIGN.sub(r"\g<0><wbr>", code[0]) if len(code[0]) > LONGEST else code[0]
