"""Models that attack: each ends in a ``PinarmError`` within its steps, runs nothing and tells nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import pytest

from pinarm.errors import PinarmError
from pinarm.input.xacro import evaluation
from pinarm.input.xacro.expander import expand
from pinarm.input.xml_text import MAX_BYTES, MAX_DEPTH, MAX_ELEMENTS, MAX_LINKS, MAX_TEXT

SECRET = "canary-in-a-coal-mine"

HEAD = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">\n'
SUBCLASSES = (
    "[c for c in ().__class__.__base__.__subclasses__() if c.__name__ == 'Popen'][0]('touch {canary}', shell=1)"
)

PYTHON = {
    "subclasses": "${" + SUBCLASSES + "}",
    "class": "${().__class__}",
    "format": "${'{0.__class__}'.format(1)}",
    "f-string": "${f'{canary}'}",
    "open": "${open('{canary}', 'w').write('x')}",
    "import": "${__import__('os').system('touch {canary}')}",
    "globals": "${xacro.load_yaml.__globals__['os'].system('touch {canary}')}",
    "load_yaml": "${load_yaml('{secret}')}",
    "xacro.load_yaml": "${xacro.load_yaml('{secret}')}",
    "type": "${python.type(1)}",
    "vars": "${python.vars(math)}",
    "map of a list": "${[[1]]['a']}",
    "split by nothing": "${'a'.split('')}",
    "method of a text": "${'a'.join(['b'])}",
    "key of a map": "${dict(a=1)['__class__']}",
    "unpacked": "${dict(**{'a': 1})}",
    "list times number": "${[1]*10**9}",
    "comprehension": "${[i for i in range(10**9)]}",
    "power": "${9**9**9}",
    "shift": "${1 &lt;&lt; 10**10}",
    "text times number": "${'a'*10**9}",
    "factorial": "${factorial(10**9)}",
    "round": "${round(5, -10**10) + 1/0}",
    "digits": "${" + "9" * 4500 + "}",
    "parentheses": "${" + "(" * 1900 + "}",
    "long": "${" + "1+" * 4000 + "1}",
    "pow": "${pow(10, 400)}",
    "namespace": "${__class__}",
    "table": "${symbols}",
}
SUBSTITUTIONS = {
    "env": "$(env SECRET)",
    "cwd": "$(cwd)",
    "anon": "$(anon x)",
    "eval": "$(eval open('{canary}', 'w'))",
    "arg unknown": "$(arg unknown)",
    "nested": "${$(env SECRET)}",
    "built": "$(${'env'} SECRET)",
    "open bracket": "$(arg ",
}
INCLUDES = {
    "absolute": "{outside}/secret.xacro",
    "upwards": "../secret.xacro",
    "link": "link.xacro",
    "wildcard": "../*.xacro",
    "file": "file://{outside}/secret.xacro",
    "http": "http://127.0.0.1:9/secret.xacro",
    "package": "package://../secret.xacro",
    "device": "/dev/zero",
    "folder": ".",
    "itself": "model.urdf.xacro",
    "pipe": "pipe.xacro",
    "too long": "x" * 5000,
    "loop of links": "loop.xacro",
}
DOUBLING = "".join(f'<xacro:property name="p{n + 1}" value="${{p{n}}}${{p{n}}}"/>' for n in range(20))
CHAIN = "".join(f'<xacro:property name="c{n}" value="${{c{n + 1}}}"/>' for n in range(2000))
MACRO = '<xacro:macro name="{name}" params="{params}">{body}</xacro:macro>'


def macro(name: str, body: str, params: str = "") -> str:
    return MACRO.format(name=name, body=body, params=params)


TWICE = "<xacro:insert_block name='b'/>" * 2

BODIES = {
    "property, then eval": "<xacro:property name='p' value='open(\"{canary}\",\"w\").write(\"x\")'/>"
    "<x v='$(eval ${p})'/>",
    "property, then expression": "<xacro:property name=\"p\" value=\"${open('{canary}','w')}\"/><x v=\"${p}\"/>",
    "expression in an argument": '<xacro:arg name="a" default="${open(1)}"/>',
    "expression in a condition": '<xacro:if value="${open(1)}"/>',
    "expression in a call": '<xacro:call macro="${open(1)}"/>',
    "expression in a namespace": '<xacro:include filename="good.xacro" ns="${open(1)}"/>',
    "namespace as a value": '<xacro:include filename="good.xacro" ns="n"/><x v="${n}"/>',
    "parent of a namespace": '<xacro:include filename="good.xacro" ns="n"/><x v="${n.parent}"/>',
    "doubling properties": '<xacro:property name="p0" value="aaaa"/>' + DOUBLING + '<x v="${p20}"/>',
    "doubling sums": "<xacro:property name='a' value='" + "a" * 9000 + "'/><x v='${a + a}'/>",
    "doubling lists": '<xacro:property name="l0" value="${[1, 1]}"/>'
    + "".join(f'<xacro:property name="l{n + 1}" value="${{[l{n}, l{n}]}}"/>' for n in range(40)) + '<x v="${l40}"/>',
    "a table beside the root": "<x v=\"${xacro.load_yaml('../secret.yaml')['key']}\"/>",
    "a table by a link": "<x v=\"${xacro.load_yaml('folder/secret.yaml')['key']}\"/>",
    "a table that is no YAML": "<x v=\"${xacro.load_yaml('good.xacro')}\"/>",
    "a table with a tag": "<x v=\"${xacro.load_yaml('tagged.yaml')}\"/>",
    "chained properties": CHAIN + '<x v="${c0}"/>',
    "property of itself": '<xacro:property name="p" value="${p}"/><x v="${p}"/>',
    "recursive macro": macro("m", "<xacro:m/>") + "<xacro:m/>",
    "recursive block": macro("m", f"<xacro:m>{TWICE}</xacro:m>", "*b") + "<xacro:m><x/></xacro:m>",
    "doubling recursion": macro("m", "<xacro:m n='${n+1}'/>" * 2, "n") + "<xacro:m n='0'/>",
    "doubling block": "".join(macro(f"m{n}", f"<xacro:m{n + 1}><a>{TWICE}</a></xacro:m{n+1}>", "*b") for n in range(30))
    + macro("m30", "<xacro:insert_block name='b'/>", "*b") + "<xacro:m0><x/></xacro:m0>",
    "siblings that are moved": macro("m", "<a/>" * 20_000) + "<xacro:m/>" * 1000,
    "many siblings": "<xacro:if value='1'><a/></xacro:if>" * 12_000,  # more than the steps of the tests
    "quotes in parameters": macro("m", "<x/>", "a:=" + "x" * 5000 + "&quot;") + "<xacro:n/>",
    "many parameters": macro("m", "<x/>", "a " * (MAX_TEXT // 2)) * 40 + "<xacro:n/>",
    "many expressions": "<x>" + "${1}" * 400_000 + "</x>",
    "long text again and again": "<xacro:property name='a' value='" + "a" * 9999 + "'/>"
    + macro("m", "<x v='${a}'/>" * 1000) + "<xacro:m/>" * 1000,
    "long attributes copied": macro("m", ("<x v='" + "a" * 9000 + "'/>") * 20) + "<xacro:m/>" * 1000,
    "element of a forged name": "<xacro:element xacro:name=\"x/></robot><!DOCTYPE a><robot\"/>",
    "depth from macros": "".join(macro(f"d{n}", "<a>" * 40 + f"<xacro:d{n + 1}/>" + "</a>" * 40) for n in range(9))
    + macro("d9", "<x/>") + "<xacro:d0/>",
    "property name": '<xacro:property name="' + "(" * 5000 + '" value="1"/>',
    "dollar": "<x v='$${${'/>",
}  # fmt: skip

FILES: dict[str, Callable[[], str | bytes]] = {
    "doctype": lambda: "<!DOCTYPE robot><robot/>",
    "external entity": lambda: '<!DOCTYPE r [<!ENTITY e SYSTEM "file:///etc/passwd">]><robot>&e;</robot>',
    "billion laughs": lambda: (
        '<!DOCTYPE r [<!ENTITY a0 "ha">'
        + "".join(f'<!ENTITY a{n + 1} "{f"&a{n};" * 10}">' for n in range(9))
        + "]><robot>&a9;</robot>"
    ),
    "100,000 nested elements": lambda: "<robot>" + "<a>" * 100_000 + "</a>" * 100_000 + "</robot>",
    "10,000 links": lambda: (
        "<robot>" + "".join(f"<link name='l{n}'/><joint name='j{n}'/>" for n in range(10_000)) + "</robot>"
    ),
    "many elements": lambda: "<robot>" + "<a/>" * 150_000 + "</robot>",
    "long attribute": lambda: f"<robot name='{'a' * 1_000_000}'/>",
    "many attributes": lambda: "<robot " + " ".join(f"a{n}='{n:0200}'" for n in range(9000)) + "><a b='1'>",
    "huge": lambda: "<robot>" + " " * MAX_BYTES + "</robot>",
    "null bytes": lambda: "<robot name='a\0b'/>",
    "empty": lambda: "",
    "not UTF-8": lambda: b"<robot name='\xff\xfe'/>",
    "UTF-16": lambda: "<robot name='r'/>".encode("utf-16"),
    "twice an attribute": lambda: "<robot a='1' a='2'/>",
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A root, with a secret beside it and ways that lead there."""
    import os

    root = tmp_path / "root"
    root.mkdir()
    (tmp_path / "secret.xacro").write_text(f'<robot><x v="{SECRET}"/></robot>')
    (tmp_path / "secret.yaml").write_text(f"key: {SECRET}")
    (root / "link.xacro").symlink_to(tmp_path / "secret.xacro")
    (root / "folder").symlink_to(tmp_path)
    (root / "loop.xacro").symlink_to(root / "loop.xacro")
    (root / "good.xacro").write_text(HEAD + '<xacro:property name="a" value="1"/></robot>')
    (root / "tagged.yaml").write_text("a: !!python/object/apply:os.system ['true']")
    os.mkfifo(root / "pipe.xacro")
    monkeypatch.setenv("SECRET", SECRET)
    return root


def attack(folder: Path, text: str | bytes, name: str = "model.urdf.xacro") -> None:
    """Expand a file and look whether it did any harm."""
    canary, path = folder.parent / "canary", folder / name
    if isinstance(text, str):
        named = {"canary": canary, "secret": folder.parent / "secret.yaml", "outside": folder.parent}
        for key, value in named.items():
            text = text.replace(f"{{{key}}}", str(value))
        text = text.encode("utf-8", "surrogatepass")
    path.write_bytes(text)
    with pytest.raises(PinarmError) as caught:
        expand(path, {}, root=folder)
    assert not canary.exists()
    assert SECRET not in str(caught.value)
    assert "environ" not in str(caught.value)


def by_name(attacks: Iterable[str]) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("name", attacks)


@by_name(PYTHON)
def test_expressions(folder: Path, name: str) -> None:
    attack(folder, f'{HEAD}<xacro:property name="nine" value="9"/><x v="{PYTHON[name]}"/></robot>')


@by_name(SUBSTITUTIONS)
def test_substitutions(folder: Path, name: str) -> None:
    attack(folder, f'{HEAD}<x v="{SUBSTITUTIONS[name]}"/></robot>')


@by_name(INCLUDES)
def test_includes(folder: Path, name: str) -> None:
    attack(folder, f'{HEAD}<xacro:include filename="{INCLUDES[name]}"/></robot>')


QUADRATIC = ["many siblings"]
"""Bodies that no bound stops but that of the steps."""


@by_name([name for name in BODIES if name not in QUADRATIC])
def test_bodies(folder: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(evaluation, "MAX_STEPS", 10_000)  # what the other bounds do not stop should not keep the tests
    attack(folder, f"{HEAD}{BODIES[name]}</robot>")


@by_name(FILES)
def test_files(folder: Path, name: str) -> None:
    attack(folder, FILES[name](), "model.urdf")


@by_name(
    ["doctype", "external entity", "billion laughs", "100,000 nested elements", "10,000 links", "huge", "null bytes"]
)
def test_files_that_are_included(folder: Path, name: str) -> None:
    content = FILES[name]()
    (folder / "part.xacro").write_bytes(content.encode() if isinstance(content, str) else content)
    attack(folder, HEAD + '<xacro:include filename="part.xacro"/></robot>')


DEEP = MAX_DEPTH
BOUNDS = {
    "levels of XML": "<a>" * DEEP + "</a>" * DEEP,
    "too many links": "<link/>" * (MAX_LINKS + 1),
    "too many elements": "<a/>" * MAX_ELEMENTS,
    "characters in one attribute": f'<a b="{"c" * (MAX_TEXT + 1)}"/>',
    "nested more than 100 levels deep": CHAIN + '<x v="${c0}"/>',
    "characters in one evaluated text": BODIES["doubling properties"],
    "text is too long": BODIES["doubling sums"],
    "too many characters": macro("m", f"<x v='{'a' * 9000}'/>" * 20) + "<xacro:m/>" * 30,
    "includes itself": "<xacro:include filename='model.urdf.xacro'/>",
    "Property names must be": f"<xacro:property name='{'-' * 9000}a' value='1'/>",
    "unknown name 'a.b'": "<xacro:property name='a' value='bbb'/><x v='${a.b}'/>",
}


@by_name(BOUNDS)
def test_each_bound_by_itself(folder: Path, name: str) -> None:
    path = folder / "model.urdf.xacro"
    path.write_text(f"{HEAD}{BOUNDS[name]}</robot>")
    with pytest.raises(PinarmError, match=name.replace(".", r"\.")):
        expand(path, {}, root=folder)


def test_bytes_are_counted_over_all_files(folder: Path) -> None:
    (folder / "big.xacro").write_text("<robot>" + " " * (MAX_BYTES // 3) + "</robot>")
    attack(folder, HEAD + '<xacro:include filename="big.xacro"/>' * 4 + "</robot>")


def test_the_model_itself_lies_under_the_root(folder: Path) -> None:
    for name in ("../secret.xacro", "link.xacro", "pipe.xacro", "loop.xacro", "/dev/zero", "none.xacro", "a\0b"):
        with pytest.raises(PinarmError) as caught:
            expand(folder / name, {}, root=folder)
        assert SECRET not in str(caught.value)


@pytest.mark.parametrize(
    "text", ["${open('{canary}', 'w')}", "$(env SECRET)", "$(eval 1)", "${9**9**9}", "a" * 100_000]
)
def test_arguments(folder: Path, text: str) -> None:
    path = folder / "model.xacro"
    body = '<xacro:arg name="a" default="1"/><xacro:property name="p" value="$(arg a)"/>'
    path.write_text(f'{HEAD}{body}<x v="$(arg a)" w="${{p}}" y="${{$(arg a)}}"/></robot>')
    with pytest.raises(PinarmError, match="short text" if text[0] == "a" else None):
        expand(path, {"a": text.replace("{canary}", str(folder.parent / "canary"))}, root=folder)
    assert not (folder.parent / "canary").exists()


def test_bounds_let_honest_sizes_pass(folder: Path) -> None:
    links = "".join(f"<link name='l{n}'/><joint name='j{n}'/>" for n in range(MAX_LINKS))
    (folder / "a.urdf").write_text(f"<robot>{links}{'<a>' * (MAX_DEPTH - 1)}{'</a>' * (MAX_DEPTH - 1)}</robot>")
    assert expand(folder / "a.urdf", {}, root=folder).arguments == {}


@by_name(QUADRATIC)
def test_what_no_other_bound_stops_counts_as_steps(folder: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a clock: the steps alone stop what is quadratic, on a loaded machine at the same place."""
    monkeypatch.setattr(evaluation, "MAX_STEPS", 10_000)
    (folder / "model.xacro").write_text(f"{HEAD}{BODIES[name]}</robot>")
    with pytest.raises(PinarmError, match="does not come to an end"):
        expand(folder / "model.xacro", {}, root=folder)
