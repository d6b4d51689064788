"""Expansion: honest files come out as xacro gives them, and mistakes are told with their place."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import pytest

from pinarm.errors import InputError, ModelError, PinarmError
from pinarm.input.roots import contained_file, example_robot_data, file_root, packages_around
from pinarm.input.xacro.expander import Expansion, expand
from pinarm.input.xml_text import tree_of

HEAD = '<?xml version="1.0"?>\n<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">\n'


def write(folder: Path, body: str, name: str = "model.urdf.xacro") -> Path:
    path = folder / name
    path.write_text(f"{HEAD}{body}\n</robot>\n")
    return path


def expanded(folder: Path, body: str, **arguments: float | str) -> Expansion:
    return expand(write(folder, body), arguments, root=folder)


def value(folder: Path, expression: str) -> str:
    xml = expanded(folder, f'<x v="{expression}"/>').xml
    return str(ElementTree.fromstring(xml).find("x").get("v"))  # type: ignore[union-attr]


def content(xml: str) -> object:
    """Return the elements of a text with their attributes and texts, whatever stands between them."""

    def of(element: ElementTree.Element) -> object:
        texts = [(text or "").strip() for text in (element.text, *(child.tail for child in element))]
        attributes = sorted(item for item in element.attrib.items() if not item[0].startswith("xmlns"))
        return element.tag, attributes, "".join(texts), [of(child) for child in element]

    return of(tree_of(xml))


def plainly(path: Path, **arguments: str) -> str:
    """Expand with xacro itself."""
    import xacro

    with contextlib.redirect_stderr(io.StringIO()):
        xacro.init_stacks(str(path))
        document = xacro.parse(None, str(path))
        xacro.process_doc(document, mappings=arguments)
    return str(document.toprettyxml(indent="  "))


HONEST = """
  <!-- a comment that stays -->
  <xacro:arg name="length" default="0.5"/>
  <xacro:arg name="side" default="left"/>
  <xacro:arg name="mass" default="${2*3}"/>
  <xacro:property name="L" value="$(arg length)"/>
  <xacro:property name="pi" value="3.1415926535897931"/>
  <xacro:property name="half" value="${L/2}"/>
  <xacro:property name="colour" value="0.1 0.2 0.3 1"/>
  <xacro:property name="count" value="3"/>
  <xacro:property name="flag" value="true"/>
  <xacro:property name="box"><origin xyz="0 0 ${half}"/><geometry><box size="1 1 ${L}"/></geometry></xacro:property>
  <xacro:macro name="cylinder_inertia" params="m r h">
    <inertia ixx="${m*(3*r*r + h*h)/12}" ixy="0" ixz="0" iyy="${m*(3*r**2 + h**2)/12}" iyz="0" izz="${m*r*r/2}"/>
  </xacro:macro>
  <xacro:macro name="link" params="name m:=1.5 r:='0.1 + 0' suffix:=^|_x **shape *more">
    <link name="${name}${suffix}">
      <inertial><mass value="${m}"/><xacro:cylinder_inertia m="${m}" r="0.1" h="${L}"/></inertial>
      <visual><xacro:insert_block name="shape"/></visual>
      <xacro:insert_block name="more"/>
    </link>
  </xacro:macro>
  <xacro:if value="${'$(arg side)' == 'left' and flag}"><xacro:property name="sign" value="1"/></xacro:if>
  <xacro:unless value="${'$(arg side)' == 'left'}"><xacro:property name="sign" value="-1"/></xacro:unless>
  <xacro:link name="a" m="$(arg mass)"><shape><xacro:insert_block name="box"/></shape><q b="${L}"/></xacro:link>
  <xacro:link name="b" suffix="_${count}"><shape/><q b="&lt;&amp;&quot;"/></xacro:link>
  <xacro:if value="${count > 2}"><kept a="${sin(pi/6)} ${math.cos(0)} ${atan2(1, sign)}"/></xacro:if>
  <xacro:if value="${count // 2 == 0}"><dropped/></xacro:if>
  <xacro:call macro="cylinder_inertia" m="1" r="${0.5 if L > 1 else 0.25}" h="2"/>
  <xacro:include filename="part.xacro"/>
  <xacro:include filename="${'named'}.xacro" ns="other"/>
  <xacro:include filename="none.xacro" optional="true"/>
  <xacro:element xacro:name="n_${count}"><xacro:attribute name="k" value="k${count**2}"/></xacro:element>
  <out v="${other.width} ${width} $${escaped} $$(too) cost $5" t="${max(1, 2)} ${round(2.6)} ${not flag} ${-sign}"/>
  <text> a &lt; b, ${L} </text><text>${'a' + 'b'}</text>
"""


@pytest.fixture
def honest(tmp_path: Path) -> Path:
    write(tmp_path, '<xacro:property name="width" value="${L*4}"/><w v="${width}"/>', "part.xacro")
    write(tmp_path, '<xacro:property name="width" value="7"/><xacro:macro name="m"><n/></xacro:macro>', "named.xacro")
    return write(tmp_path, HONEST)


@pytest.mark.parametrize("given", [{"length": "1.25", "side": "right"}])
def test_an_honest_file_is_what_xacro_makes_of_it(honest: Path, given: dict[str, str]) -> None:
    result = expand(honest, given, root=honest.parent)
    assert content(result.xml) == content(plainly(honest, **given))
    assert result.arguments == {"length": "0.5", "side": "left", "mass": "6"} | given


def robots() -> Iterator[Path]:
    with contextlib.suppress(ModelError):
        yield from sorted(example_robot_data().rglob("*.urdf"))
        yield from sorted(example_robot_data().rglob("*.xacro"))


@pytest.mark.slow
def test_example_robots_are_what_xacro_makes_of_them() -> None:
    compared = 0
    for path in robots():
        text = path.read_bytes().decode("utf-8-sig")
        if path.name == "quadrotor_base.xacro":
            continue  # it includes a file that the package does not have
        found = expand(path, {}, root=path.parent).xml
        if found != text:
            assert content(found) == content(plainly(path)), path
            compared += 1
    assert compared > 0 or not list(robots())


DECLARED = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">{}</robot>'


def test_urdf_that_xacro_has_written_stays_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "a.urdf"
    path.write_text(DECLARED.format('\n  <!-- xacro:leg -->\n  <link name="a"/>\n'))
    assert expand(path, {}, root=tmp_path) == Expansion(path.read_text(), {})


@pytest.mark.parametrize(
    ("expression", "wanted"),
    [
        ("${6/3} ${7//2} ${2**10} ${2**-1} ${7 % 4}", "2.0 3 1024 0.5 3"),
        ("${1 == 1.0} ${0 &lt; 1 &lt; 2} ${not 1}", "True True False"),
        ("${0 or 'x'} ${1/0 if 0 else 'lazy'} ${0 and 1/0}", "x lazy 0"),
        ("${radians(180) == pi} ${math.sqrt(4)} ${hypot(3, 4)}", "True 2.0 5.0"),
        ("${str(1) + 'a'} ${int('12') + len('abc')} ${float(1)}", "1a 15 1.0"),
        ("${'mesh.1.stl' + ' a.in.b'}", "mesh.1.stl a.in.b"),  # words of names in quotes stay
        ("$$${x} $$ {", None),
    ],
)
def test_expressions(tmp_path: Path, expression: str, wanted: str | None) -> None:
    if wanted is None:
        with pytest.raises(PinarmError):
            value(tmp_path, expression)
    else:
        assert value(tmp_path, expression) == wanted


TABLE = """
hip: {low: !degrees 90, high: 2.5, name: right}
knee: &knee {low: -1, mass: 0.5, mass: 0.75}
ankle: *knee
parts: [1.5, [2, 3], {x: 4}]
"""
TABLES = """
  <xacro:arg name="file" default="limits.yaml"/>
  <xacro:property name="t" value="${xacro.load_yaml('$(arg file)')}"/>
  <xacro:macro name="joint" params="name limits:=${t}"><j name="${name}" low="${limits[name]['low']}"/></xacro:macro>
  <xacro:joint name="hip"/><xacro:joint name="ankle"/>
  <x a="${t.hip.high} ${t['parts'][1][0]} ${t['parts'][2].x} ${t.knee.mass}" b="${'hip' in t} ${'toe' not in t}"/>
  <xacro:property name="d" value="${dict(a=1, b='two')}"/><xacro:property name="xyz" value="0.1 0.2 0.3"/>
  <y a="${d['b']} ${[1, 2, 3][-1]} ${xyz.split(' ')[1]} ${len(xyz.split())} ${2.0 if 'y' in 'xyz' else 0}"/>
"""


def test_lists_maps_and_tables_are_what_xacro_makes_of_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "limits.yaml").write_text(TABLE)
    path = write(tmp_path, TABLES)
    monkeypatch.chdir(tmp_path)
    assert content(expand(path, {}, root=tmp_path).xml) == content(plainly(path))


@pytest.mark.parametrize(
    ("expression", "told"),
    [
        ("t['hip']['lo']", r"the map has no 'lo'[\s\S]*one of high, low, name[\s\S]*try: low"),
        ("t.hip.lo", "the map has no 'lo'"), ("t['parts'][7]", "'7' is no key or index"), ("t + 1", "does not go with"),
        ("xacro.load_yaml('gone.yaml')", r"there is no file \S*gone.yaml"), ("t == t", "are not compared"),
    ],
)  # fmt: skip
def test_mistakes_in_tables_are_told(tmp_path: Path, expression: str, told: str) -> None:
    (tmp_path / "limits.yaml").write_text(TABLE)
    given = "<xacro:property name='t' value=\"${xacro.load_yaml('limits.yaml')}\"/>"
    with pytest.raises(PinarmError, match=told):
        expanded(tmp_path, f'{given}<x v="${{{expression}}}"/>')


def test_a_package_may_be_named_and_the_one_around_a_file_is_known(tmp_path: Path) -> None:
    inner, other = tmp_path / "mine" / "urdf", tmp_path / "other"
    for folder in (inner, other):
        folder.mkdir(parents=True)
    (tmp_path / "mine" / "package.xml").write_text("<package><name>mine</name></package>")
    write(other, '<y v="2"/>', "part.xacro")
    path = write(inner, '<x f="file://$(find other)/a.stl"/><xacro:include filename="$(find other)/part.xacro"/>')
    assert packages_around(path, tmp_path) == {"mine": tmp_path / "mine"}
    with pytest.raises(PinarmError, match="unknown package 'other'"):
        expand(path, {}, root=tmp_path / "mine")
    with file_root(None, {"other": other}):
        assert '<y v="2"' in expand(path, {}, root=tmp_path / "mine").xml
        for out in ("$(find other)/../x.xacro", "$(find none)/x.xacro"):
            with pytest.raises(PinarmError, match=r"leads out of the root|unknown package"):
                expanded(inner, f'<xacro:include filename="{out}"/>')


def test_tags_that_an_expanded_file_still_has_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "a.urdf"
    path.write_text(DECLARED.format('<link name="a"/><xacro:sensor at="a"><origin/></xacro:sensor>'))
    result = expand(path, {}, root=tmp_path)
    assert content(result.xml) == content('<robot name="r"><link name="a"/></robot>')
    assert result.warnings == ("<xacro:sensor> is left out: the file has no such macro",)


def test_arguments_are_exact_and_must_be_declared(tmp_path: Path) -> None:
    body = '<xacro:arg name="mass" default="1"/><x v="$(arg mass)"/>'
    assert 'v="0.1"' in expanded(tmp_path, body, mass=0.1).xml
    assert expanded(tmp_path, body, mass=3).arguments == {"mass": "3"}
    assert expanded(tmp_path, body, mass="heavy").arguments == {"mass": "heavy"}
    with pytest.raises(InputError, match=r"no argument 'mas'[\s\S]*one of mass[\s\S]*try: mass"):
        expanded(tmp_path, body, mas=1)
    with pytest.raises(InputError, match="finite"):
        expanded(tmp_path, body, mass=float("nan"))
    plain = tmp_path / "plain.urdf"
    plain.write_text("<robot name='r'/>")
    with pytest.raises(InputError, match="no argument 'mass'"):
        expand(plain, {"mass": 1}, root=tmp_path)


def test_a_package_is_its_uri_and_no_file_of_it_is_read(tmp_path: Path) -> None:
    path = write(tmp_path, '<mesh filename="$(find parts)/a.stl"/><plugin>$(find parts)/config.yaml</plugin>')
    text = expand(path, {}, root=tmp_path).xml
    assert '"package://parts/a.stl"' in text
    assert ">package://parts/config.yaml<" in text
    for name in ("$(find parts)/part.xacro", "package://parts/part.xacro"):
        with pytest.raises(PinarmError, match=r":3:1: unknown package 'parts'") as caught:
            expanded(tmp_path, f'<xacro:include filename="{name}"/>')
        assert caught.value.hint == "--package parts=DIR, or packages: {parts: DIR} in the mechanism file"


@pytest.mark.parametrize(
    ("body", "told"),
    [
        ('<ok/>\n<x v="${1/0}"/>', r"model.urdf.xacro:4:7: .*division by zero.*'1/0'"),
        ('<xacro:property name="width" value="1"/>\n<x v="${widht}"/>', r":4:7: unknown name[\s\S]*try: width"),
        ('<xacro:property name="p" value="${q/0}"/>\n<xacro:property name="q" value="1"/>\n\n<x v="${p}"/>', ":3:33: "),
        ("<ok/>\n<xacro:foo/>", r":4:1: unknown macro name: xacro:foo"),
        ('<xacro:macro name="m" params="a b"/>\n<xacro:m a="1"/>', r":4:1: Undefined parameters \[b\].*in macro m"),
        ('<xacro:macro name="m">\n<x v="${1/0}"/>\n</xacro:macro>\n<ok/>\n<xacro:m/>', ":4:7: "),
        ('<xacro:include filename="gone.xacro"/>', r":3:1: there is no file \S*gone.xacro"),
        ('<xacro:include filename="part.xacro"/>', r"part.xacro:3:7: unknown name 'inner'"),
        ('<xacro:include filename="broken.xacro"/>', r"broken.xacro:4:3: this is not XML: mismatched tag"),
        ("<a>\n<b>\n</a>", r"model.urdf.xacro:5:3: this is not XML: mismatched tag"),
        ("<x v='${[a for a in x]}'/>", r"try: the model as xacro expands it: xacro model.urdf.xacro > model.urdf"),
        ("<x v='${1 +}'/>", r":3:7: this is not a formula"),
        ("<x v='$(arg none)'/>", r":3:7: unknown argument 'none'"),
        ("<xacro:insert_block name='b'/>", r':3:1: Undefined block "b"'),
        ("<xacro:property name='1a' value='1'/>", ":3:1: Property names must be valid"),
        ("<xacro:property name='a' value='${b}'/><xacro:property name='b' value='${a}'/><x v='${a}'/>", "circular"),
    ],
)
def test_mistakes_are_located(tmp_path: Path, body: str, told: str) -> None:
    write(tmp_path, '<x v="${inner}"/>', "part.xacro")
    write(tmp_path, "<x>", "broken.xacro")
    with pytest.raises(PinarmError, match=told):
        expanded(tmp_path, body)


@pytest.mark.parametrize(
    "path",
    ["/etc/passwd", "../x", "link", "folder", "none", "http://a/b", "package://q/x", "package://p/../../x",
     "file:///etc/passwd", "a\0b", "x" * 5000, "/dev/zero", "loop", "pipe"],
)  # fmt: skip
def test_paths_that_are_refused(tmp_path: Path, path: str) -> None:
    import os

    root = tmp_path / "root"
    (root / "folder").mkdir(parents=True)
    (tmp_path / "x").write_text("secret")
    (root / "link").symlink_to(tmp_path / "x")
    (root / "loop").symlink_to(root / "loop")
    os.mkfifo(root / "pipe")
    with pytest.raises(InputError):
        contained_file(path, root, {"p": root / "folder"})
