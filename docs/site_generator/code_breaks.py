"""Where long code may go on in the next line: in cells of tables, and in blocks but for those that are tables."""

from __future__ import annotations

import re

LONGEST = 24
"""Letters of code that stay in one line."""

_CELL = re.compile(r"<td.*?</td>", re.DOTALL)
_CODE = re.compile(r"(?<=<code>)[^<]+(?=</code>)")
_SIGN = re.compile(r"(?<=[\w)\]])[./,+*=](?=[A-Za-z(])")
_PRINTED = re.compile(r'(?<=<div class="language-text highlight">).*?(?=</pre>)', re.DOTALL)
_COLUMNS = re.compile(r"^.*(?:[│┃━─]| {2,}\S[^\n]*? {2,}\S[^\n]*? {2,}\S).*$", re.MULTILINE)


def with_columns(page: str) -> str:
    """Return HTML in which lines of printed tables are of the class ``columns``: they are not broken."""
    return _PRINTED.sub(lambda block: _COLUMNS.sub(r'<span class="columns">\g<0></span>', block[0]), page)


def with_breaks(page: str) -> str:
    """Return HTML in which long code in cells may be divided after the signs between its names."""
    return _CELL.sub(lambda cell: _CODE.sub(_broken, cell[0]), page)


def _broken(code: re.Match[str]) -> str:
    return _SIGN.sub(r"\g<0><wbr>", code[0]) if len(code[0]) > LONGEST else code[0]
