"""Variants of a model by its template are what xacro makes of them, to the last character."""
# ruff: noqa: E501

from __future__ import annotations

import random
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pinarm.errors import PinarmError
from pinarm.input.xacro import expansion as templates
from pinarm.input.xacro.expansion import expand, expand_columns

ROOT = Path(__file__).parents[3]
HEAD = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">\n'


@pytest.fixture(autouse=True)
def _forgetful(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(templates, "_remembered", type(templates._remembered)())


def write(folder: Path, body: str, name: str = "model.urdf.xacro") -> Path:
    path = folder / name
    path.write_text(f"{HEAD}{body}\n</robot>\n")
    return path


def afresh(path: Path, arguments: dict[str, float | str]) -> object:
    """Expand by xacro alone; an error counts as a result."""
    templates._remembered.clear()
    return outcome(path, arguments)


def outcome(path: Path, arguments: dict[str, float | str]) -> object:
    try:
        return expand(path, arguments, root=path.parent)
    except PinarmError as error:
        return str(error)


def known() -> int:
    return sum(len(memory.templates) for memory in templates._remembered.values())


def compare(path: Path, variants: list[dict[str, float | str]]) -> None:
    wanted = [afresh(path, variant) for variant in variants]
    templates._remembered.clear()
    assert [outcome(path, variant) for variant in variants] == wanted


MODELS = [
    pytest.param(path, id=path.parent.name, marks=pytest.mark.slow if "forty" in path.parent.name else ())
    for path in sorted(ROOT.glob("models/*/*.urdf.xacro"))
]


@pytest.mark.parametrize("path", MODELS)
def test_the_models_of_this_project_are_followed(path: Path) -> None:
    choose = random.Random(1)
    defaults = expand(path, {}, root=ROOT).arguments
    if not defaults:
        pytest.skip("nothing to vary")
    variants = [{name: float(value) * choose.uniform(0.5, 2) for name, value in defaults.items()} for _ in range(2)]
    wanted = []
    for variant in variants:
        templates._remembered.clear()
        wanted.append(expand(path, variant, root=ROOT))
    templates._remembered.clear()
    assert [expand(path, variant, root=ROOT) for variant in variants] == wanted
    assert known() == 1
    assert len({expansion.xml for expansion in wanted}) == len(variants)


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
    "a comment": "<!-- ${a} --><x/><!-- xacro:eval-comments --><!-- -${a} -->",
    "the name of an element": '<xacro:element xacro:name="n${int(b)}" v="${a}"/>',
    "the name of an attribute": '<x v="${a}" n2="0"><xacro:attribute name="n${int(b)}" value="1"/><xacro:attribute name="m" value="${a}"/></x>',
    "the name of a macro": '<xacro:macro name="m0"><x/></xacro:macro><xacro:call macro="m${int(b)}"/>',
    "the name of a property": '<xacro:property name="p${int(b)}" value="3"/><x v="${p1}"/>',
    "a file": '<xacro:include filename="part${int(b)}.xacro"/><x v="${a}"/>',
    "an optional file": '<xacro:include filename="part.xacro" optional="true"/><x v="${a}"/>',
    "a block": '<xacro:property name="s"><z v="${a}"/></xacro:property><x><xacro:insert_block name="s"/></x>',
    "control characters": "<xacro:property name=\"p\" value=\"${'\\x01' + '0' + '\\x02'}\"/><x v=\"${len(p)}\"/>",
    "a register": '<xacro:macro name="m" params="__register_0__"><x v="${__register_0__ + a}"/></xacro:macro><xacro:m __register_0__="2.5"/>',
}  # fmt: skip
GIVEN = (
    '<xacro:arg name="a" default="1"/><xacro:arg name="b" default="1"/>'
    '<xacro:property name="a" value="$(arg a)"/><xacro:property name="b" value="$(arg b)"/>'
)
NUMBERS = [(2.5, 1.0), (2.5, 1.0), (2.5, 2.5), (-1.5, 1.0), (0.0, 0.0), (1e300, 1e20), (3, 2)]


@pytest.mark.parametrize("body", BODIES.values(), ids=BODIES)
def test_whatever_a_number_does_the_text_is_that_of_xacro(tmp_path: Path, body: str) -> None:
    path = write(tmp_path, GIVEN + body)
    compare(path, [{"a": a, "b": b} for a, b in NUMBERS])


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


@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(TERMS, min_size=1, max_size=3), st.lists(st.sampled_from(NUMBERS), min_size=4, max_size=6))
def test_any_arithmetic_is_that_of_xacro(tmp_path: Path, terms: list[str], numbers: list[tuple[float, float]]) -> None:
    chain = "".join(f'<xacro:property name="p{k}" value="${{{term}}}"/>' for k, term in enumerate(terms))
    used = " ".join(f"${{p{k}}}" for k in range(len(terms)))
    path = write(tmp_path, f'{GIVEN}{chain}<x v="{used}" w="${{p0 + a}}"/>')
    compare(path, [{"a": a, "b": b} for a, b in (numbers[0], *numbers)])


def test_an_edited_file_is_read_again(tmp_path: Path) -> None:
    part = write(tmp_path, '<xacro:property name="k" value="2"/>', "part.xacro")
    path = write(tmp_path, f'{GIVEN}<xacro:include filename="part.xacro"/><x v="${{a*k}}"/>')
    for _ in range(3):
        assert '"3.0"' in expand(path, {"a": 1.5}, root=tmp_path).xml
    write(tmp_path, '<xacro:property name="k" value="4"/>', "part.xacro")
    assert '"6.0"' in expand(path, {"a": 1.5}, root=tmp_path).xml
    part.unlink()
    with pytest.raises(PinarmError, match="there is no file"):
        expand(path, {"a": 1.5}, root=tmp_path)


def test_a_link_that_comes_to_lead_out_is_refused(tmp_path: Path) -> None:
    root, outside = tmp_path / "root", tmp_path / "outside.xacro"
    root.mkdir()
    part = write(root, "<inside/>", "part.xacro")
    outside.write_text(part.read_text())
    path = write(root, f'{GIVEN}<xacro:include filename="part.xacro"/><x v="${{a}}"/>')
    for _ in range(3):
        expand(path, {"a": 1.5}, root=root)
    part.unlink()
    part.symlink_to(outside)
    with pytest.raises(PinarmError, match="leads out of the root"):
        expand(path, {"a": 1.5}, root=root)


def test_a_text_cannot_bring_marks(tmp_path: Path) -> None:
    path = write(tmp_path, f'{GIVEN}<x v="$(arg a)"/>')
    with pytest.raises(PinarmError, match="short text"):
        expand(path, {"a": "\x010\x02"}, root=tmp_path)


def filled(xml: str, columns: dict[str, list[object]], row: int) -> str:
    """Return a text with the numbers of one row in the place of its words."""
    for word, column in columns.items():
        xml = xml.replace(word, str(column[row]))
    return xml


@pytest.mark.parametrize("body", [
    '<xacro:arg name="a" default="1"/><xacro:arg name="b" default="2"/><link name="l" mass="$(arg a) ${2*a_}"/>',
    '<xacro:arg name="a" default="1"/><xacro:arg name="b" default="2"/><link name="$(arg b)" at="${sin(a_) - 3} 0 ${-a_}"/>',
    '<xacro:arg name="a" default="1"/><xacro:arg name="b" default="$(arg a)"/><link name="l" at="${a_ if a_ &lt; 2 else 1/a_}"/>',
])  # fmt: skip
def test_columns_have_the_text_of_every_row(tmp_path: Path, body: str) -> None:
    declared, _, used = body.partition("<link")
    path = write(tmp_path, f'{declared}<xacro:property name="a_" value="$(arg a)"/><link{used}')
    values = [1.5, 0.25, 3.0, 1e-7]
    columns = expand_columns(path, {"a": values[0]}, {"a": values}, root=tmp_path)
    assert columns is not None
    assert sum(columns.holds) >= 3
    for row, (value, holds) in enumerate(zip(values, columns.holds, strict=True)):
        alone = expand(path, {"a": value}, root=tmp_path)
        same = filled(columns.xml, dict(columns.columns), row) == alone.xml
        assert same or not holds
        for name, text in alone.arguments.items():
            own = columns.arguments[name]
            assert not holds or (own if isinstance(own, str) else str(own[row])) == text


@pytest.mark.parametrize(
    "formula",
    ["a_ + 2*a_ - a_/3", "(a_ - 1.5)/(a_*a_) + 7", "1/a_ + a_//2 - a_**3", "a_*9007199254740993 + 9007199254740993/a_",
     "a_*1e308*10", "-a_ + a_*a_ - 0*a_"],
)  # fmt: skip
def test_columns_are_bit_by_bit_what_each_row_alone_is(tmp_path: Path, formula: str) -> None:
    given = '<xacro:arg name="a" default="1"/><xacro:property name="a_" value="$(arg a)"/>'
    path = write(tmp_path, f'{given}<link name="l" at="${{{formula}}}"/>')
    values = [0.1, 0.3, 1.7, 1e-9, 123.456, -2.5]
    columns = expand_columns(path, {"a": values[0]}, {"a": values}, root=tmp_path)
    assert columns is not None
    assert sum(columns.holds) >= 5
    for row, value in enumerate(values):
        if columns.holds[row]:
            assert filled(columns.xml, dict(columns.columns), row) == expand(path, {"a": value}, root=tmp_path).xml


def test_a_division_by_zero_in_a_column_is_an_error(tmp_path: Path) -> None:
    given = '<xacro:arg name="a" default="1"/><xacro:property name="a_" value="$(arg a)"/>'
    path = write(tmp_path, f'{given}<link name="l" at="${{1/a_}}"/>')
    with pytest.raises(PinarmError, match="division"):
        expand_columns(path, {"a": 1.5}, {"a": [1.5, 0.0]}, root=tmp_path)
