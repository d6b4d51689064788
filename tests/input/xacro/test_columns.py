"""Columns of arguments: the text of every row is that of the row alone, to the last digit; alone it is that of xacro."""
# ruff: noqa: E501

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pinarm.errors import PinarmError
from pinarm.input.xacro.expander import expand, expand_columns
from tests.input.xacro.test_expansion import content, plainly

ROOT = Path(__file__).parents[3]
HEAD = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">\n'


def write(folder: Path, body: str, name: str = "model.urdf.xacro") -> Path:
    path = folder / name
    path.write_text(f"{HEAD}{body}\n</robot>\n")
    return path


def filled(xml: str, columns: dict[str, np.ndarray], row: int) -> str:
    """Return a text with the numbers of one row in the place of its words."""
    for word, column in columns.items():
        xml = xml.replace(word, str(float(column[row])))
    return xml


def compared(path: Path, rows: list[dict[str, float]]) -> int:
    """Compare the rows of columns with each row alone; return how many rows the columns hold for."""
    columns = {name: np.array([row[name] for row in rows], dtype=float) for name in rows[0]}
    try:
        expanded = expand_columns(path, rows[0], columns, root=ROOT if path.is_relative_to(ROOT) else path.parent)
    except PinarmError:
        return 0
    if expanded is None:
        return 0
    for k in range(len(rows)):
        if expanded.holds[k]:
            alone = expand(path, rows[k], root=ROOT if path.is_relative_to(ROOT) else path.parent)
            assert filled(expanded.xml, dict(expanded.columns), k) == alone.xml
            for name, text in alone.arguments.items():
                told = expanded.arguments[name]
                assert (told if isinstance(told, str) else str(float(told[k]))) == text
    return int(expanded.holds.sum())


@pytest.mark.parametrize("path", sorted(ROOT.glob("models/*/*.urdf.xacro")), ids=lambda path: path.parent.name)
def test_the_models_of_this_project_are_followed(path: Path) -> None:
    choose = random.Random(1)
    defaults = expand(path, {}, root=ROOT).arguments
    if not defaults:
        pytest.skip("nothing to vary")
    rows = [{name: float(value) * choose.uniform(0.9, 1.1) for name, value in defaults.items()} for _ in range(4)]
    assert compared(path, rows) >= 2


BODIES = {
    "a property": '<xacro:property name="p" value="$(arg a)"/><x v="${p} ${p*2} ${-p**2} ${p}"/>',
    "text around": '<x v="0 0 $(arg a)" w="-$(arg a)" u="${b}${b}" t="$(arg a)$(arg b)"/>',
    "digits around": '<xacro:property name="p" value="1$(arg b)"/><x v="${p}" w="${p + 1}"/>',
    "a power of ten": '<xacro:property name="p" value="$(arg a)e2"/><xacro:if value="${p}"><x v="${p}"/></xacro:if>',
    "a sign before": '<xacro:property name="p" value="-$(arg a)"/><x v="${p}" w="${p + 1}"/>',
    "quoted": "<xacro:property name=\"p\" value=\"'$(arg a)'\"/><x v=\"${p}\" w=\"${p + 1}\"/>",
    "in an expression": '<x v="${2*$(arg a)}" w="${$(arg a)**2}" u="${$(arg b) + $(arg a)}"/>',
    "beside a digit": '<x v="${1 + $(arg a)5}"/>',
    "in quotes": "<xacro:if value=\"${'$(arg a)' == '$(arg b)'}\"><same/></xacro:if>",
    "a condition": '<xacro:if value="${$(arg a) > 1}"><big/></xacro:if><xacro:unless value="${b == 0}"><y/></xacro:unless>',
    "a choice": '<x v="${1/b if b else 0}" w="${a and b or 7}" u="${not a}" t="${0 &lt; a &lt; 1}"/>',
    "functions": '<x v="${max(a, b)} ${round(a, 2)} ${int(a)} ${str(a) + str(b)} ${sin(a)} ${len(str(a))}"/>',
    "an error": '<x v="${sqrt(a)} ${1/b}"/>',
    "another argument": '<xacro:arg name="c" default="${2*$(arg a)}"/><xacro:property name="c" value="$(arg c)"/><x v="${c + 1}"/>',
    "a macro": '<xacro:macro name="m" params="k l:=${a} *block"><x v="${k*l}"/><xacro:insert_block name="block"/></xacro:macro>'
    '<xacro:m k="$(arg b)"><y v="${a}"/></xacro:m><xacro:m k="${b}" l="3"><y/></xacro:m>',
    "a macro's default": '<xacro:macro name="m" params="a:=^ b:=^|5"><x v="${a*b}"/></xacro:macro><xacro:m/>',
    "greedy": '<xacro:property name="p" value="${a*2}" lazy_eval="false"/><x v="${p + 1}"/>',
    "text between": "<x>${a} $(arg b)</x><y>${a + b}</y>",
    "the name of an element": '<xacro:element xacro:name="n${int(b)}" v="${a}"/>',
    "the name of an attribute": '<x v="${a}" n2="0"><xacro:attribute name="n${int(b)}" value="1"/><xacro:attribute name="m" value="${a}"/></x>',
    "the name of a macro": '<xacro:macro name="m0"><x/></xacro:macro><xacro:call macro="m${int(b)}"/>',
    "the name of a property": '<xacro:property name="p${int(b)}" value="3"/><x v="${p1}"/>',
    "a file": '<xacro:include filename="part${int(b)}.xacro"/><x v="${a}"/>',
    "an optional file": '<xacro:include filename="part.xacro" optional="true"/><x v="${a}"/>',
    "a block": '<xacro:property name="s"><z v="${a}"/></xacro:property><x><xacro:insert_block name="s"/></x>',
}  # fmt: skip
GIVEN = (
    '<xacro:arg name="a" default="1"/><xacro:arg name="b" default="1"/>'
    '<xacro:property name="a" value="$(arg a)"/><xacro:property name="b" value="$(arg b)"/>'
)
NUMBERS = [(2.5, 1.0), (2.5, 1.0), (2.5, 2.5), (-1.5, 1.0), (0.0, 0.0), (1e300, 1e20), (3.0, 2.0)]


@pytest.mark.parametrize("body", BODIES.values(), ids=BODIES)
def test_whatever_a_number_does_the_text_of_a_row_is_that_of_the_row_alone(tmp_path: Path, body: str) -> None:
    path = write(tmp_path, GIVEN + body)
    for begin in range(len(NUMBERS)):
        compared(path, [{"a": a, "b": b} for a, b in NUMBERS[begin:]])


TERMS = st.recursive(
    st.sampled_from(["a", "b", "1", "2.5", "'t'", "$(arg a)", "0"]),
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from([" + ", " - ", "*", "/", "**", "//", " % ", " > ", " == ", " and ", " or "]), inner).map(
            lambda parts: f"({''.join(parts)})".replace(">", "&gt;")
        ),
        inner.map("-{}".format), inner.map("not {}".format), inner.map("abs({})".format), inner.map("str({})".format),
        st.tuples(inner, inner, inner).map(lambda parts: "({} if {} else {})".format(*parts)),
    ),
    max_leaves=6,
)  # fmt: skip


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(TERMS, min_size=1, max_size=3), st.lists(st.sampled_from(NUMBERS), min_size=3, max_size=4))
def test_any_arithmetic_is_that_of_xacro(tmp_path: Path, terms: list[str], numbers: list[tuple[float, float]]) -> None:
    chain = "".join(f'<xacro:property name="p{k}" value="${{{term}}}"/>' for k, term in enumerate(terms))
    used = " ".join(f"${{p{k}}}" for k in range(len(terms)))
    path = write(tmp_path, f'{GIVEN}{chain}<x v="{used}"/>')
    compared(path, [{"a": a, "b": b} for a, b in numbers])
    a, b = numbers[0]
    try:
        wanted = content(plainly(path, a=str(a), b=str(b)))
    except Exception:  # xacro raises whatever Python does
        return
    try:
        found = content(expand(path, {"a": a, "b": b}, root=tmp_path).xml)
    except PinarmError:  # refused: numbers that are too large, text where a number belongs
        return
    assert found == wanted


def test_a_division_by_zero_in_a_column_is_an_error(tmp_path: Path) -> None:
    given = '<xacro:arg name="a" default="1"/><xacro:property name="a_" value="$(arg a)"/>'
    path = write(tmp_path, f'{given}<link name="l" at="${{1/a_}}"/>')
    with pytest.raises(PinarmError, match="division"):
        expand_columns(path, {"a": 1.5}, {"a": np.array([1.5, 0.0])}, root=tmp_path)
