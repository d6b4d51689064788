"""Documents: what YAML means here, what is refused, and that every mistake has its place."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pinarm.errors import InputError, Key, Location, within
from pinarm.input.yaml.document import MAX_BYTES, Document, varied
from pinarm.input.yaml.schema import InputStruct, Time


def parse(text: str) -> Any:
    return Document.parse(text).data


def refused(text: str) -> InputError:
    with pytest.raises(InputError) as caught:
        Document.parse(text, source="f.yaml")
    return caught.value


def at(error: InputError) -> tuple[int, int]:
    assert isinstance(error.location, Location)
    return error.location.line, error.location.column


# ------------------------------------------------------------------------------------------------------- values


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 1e-3), (".5", 0.5), ("-1.", -1.0), ("-.INF", -math.inf), ("-7", -7), ("0x1F", 31), ("0o17", 15),
        ("012", 12), ("true", True), ("False", False), ("null", None), ("~", None), ("", None), ("yes", "yes"),
        ("off", "off"), ("1:30", "1:30"), ("2001-12-14", "2001-12-14"), ("'1e-3'", "1e-3"), ('"true"', "true"),
        ("1.2.3", "1.2.3"), ("<<", "<<"), ("0b11", "0b11"),
    ],
)  # fmt: skip
def test_scalars_are_those_of_yaml_1_2(text: str, value: Any) -> None:
    read = parse(f"a: {text}\n")["a"]
    assert read == value
    assert type(read) is type(value)


# ------------------------------------------------------------------------------------------------------- places

TEXT = """\
# a comment
title: arm
problem:
  time: {end: 3 s, samples: 5}
outputs:
  - alpha
  - {quantity: beta}
empty:
"""


@pytest.mark.parametrize(
    ("path", "line", "column", "width"),
    [
        (("title",), 2, 8, 3), ((Key("title"),), 2, 1, 5), (("problem", "time", "end"), 4, 15, 3),
        (("problem", "time", Key("end")), 4, 10, 3), (("outputs", 0), 6, 5, 5), (("outputs", 1), 7, 5, 1),
        (("outputs", 1, Key("quantity")), 7, 6, 8), (("empty",), 8, 1, 5),
    ],
)  # fmt: skip
def test_every_key_and_item_has_its_place(path: tuple[str | int, ...], line: int, column: int, width: int) -> None:
    place = Document.parse(TEXT, source="f.yaml").locate(path)
    assert (place.source, place.line, place.column, place.width) == ("f.yaml", line, column, width)
    assert place.text == TEXT.splitlines()[line - 1]


def test_an_error_from_within_gets_the_place_and_keeps_a_better_one() -> None:
    document = Document.parse(TEXT, source="f.yaml")
    with pytest.raises(InputError) as caught, document.locating("problem", "time", "end"):
        raise InputError("too late")
    assert str(caught.value).splitlines() == [
        "f.yaml:4:15: too late",
        "    4 |   time: {end: 3 s, samples: 5}",
        "      |               ^^^",
    ]
    with pytest.raises(InputError) as caught, document.locating("problem"), within("time"), within(Key("samples")):
        raise InputError("too many")
    assert at(caught.value) == (4, 20)
    with pytest.raises(InputError) as caught, document.locating("problem"), document.locating("title"):
        raise InputError("no")
    assert at(caught.value) == (2, 8)


def test_places_survive_a_byte_order_mark_and_windows_line_ends(tmp_path: Path) -> None:
    file = tmp_path / "f.yaml"
    file.write_bytes(b"\xef\xbb\xbf" + TEXT.replace("\n", "\r\n").encode())
    place = Document.read(file).locate(("problem", "time", "end"))
    assert (place.line, place.column, place.text) == (4, 15, "  time: {end: 3 s, samples: 5}")


# ------------------------------------------------------------------------------------------------------ refusals


@pytest.mark.parametrize(
    ("text", "says", "place"),
    [
        ("a: 1\nb: 2\na: 3\n", "the key 'a' stands twice (first in line 1)", (3, 1)),
        ("x: {a: 1, 'a': 2}\n", "the key 'a' stands twice", (1, 11)),
        ("a: &b 1\n", "anchors, aliases and tags", (1, 4)),
        ("a: [*b]\n", "undefined alias", (1, 5)),
        ("a: &b [1]\nc: *b\n", "anchors, aliases and tags", (1, 4)),
        ("a: !!python/object/apply:os.system [x]\n", "tags are not read", (1, 4)),
        ("? [1]\n: 2\n", "cannot be a key", (1, 3)),
        ("a:\n\tb: 1\n", "not YAML", (2, 1)),
        ("a: b: c\n", "not YAML: mapping values are not allowed", (1, 5)),
        ("a: [1, 2\n", "not YAML", (2, 1)),
        ("a: " + "1" * 401 + "\n", "too many digits", (1, 4)),
        ("a: " + "[" * 60 + "]" * 60, "nested too deeply", (1, 53)),
        ("a: " + "{b: " * 60 + "}" * 60, "nested too deeply", (1, 200)),
        ("a: 1\n---\na: 2\n", "", (2, 1)),
    ],
)  # fmt: skip
def test_what_is_refused_and_where(text: str, says: str, place: tuple[int, int]) -> None:
    error = refused(text)
    assert says in error.message
    assert at(error) == place


# --------------------------------------------------------------------------------------------------------- files


def test_a_missing_file_gets_a_suggestion(tmp_path: Path) -> None:
    (tmp_path / "scenario.yaml").touch()
    with pytest.raises(InputError, match="there is no file") as caught:
        Document.read(tmp_path / "scenari.yaml")
    assert caught.value.hint == str(tmp_path / "scenario.yaml")
    with pytest.raises(InputError, match="there is no file"):
        Document.read(tmp_path / "no" / "such" / "folder.yaml")


def test_files_that_are_too_large_or_not_utf_8(tmp_path: Path) -> None:
    file = tmp_path / "f.yaml"
    file.write_bytes(b"a: " + b"x" * (MAX_BYTES - 3))
    assert len(Document.read(file).data["a"]) == MAX_BYTES - 3
    file.write_bytes(b"a: " + b"x" * (MAX_BYTES - 2))
    with pytest.raises(InputError, match="too large"):
        Document.read(file)
    for raw in ("a: é\n".encode("latin-1"), "a: b\n".encode("utf-16")):
        file.write_bytes(raw)
        with pytest.raises(InputError, match="not UTF-8"):
            Document.read(file)


# ----------------------------------------------------------------------------------------------------- overrides

BASE = "title: arm\nproblem: {time: {end: 3 s}}\nexpect:\n  - {value: 1}\n  - {value: 2}\n"


@pytest.mark.parametrize(
    ("assignment", "path", "value"),
    [
        ("title=leg", ["title"], "leg"), (" title =leg", ["title"], "leg"), ("problem.time.end=4 s",
         ["problem", "time", "end"], "4 s"),
        ("problem.time.samples=5", ["problem", "time", "samples"], 5), ("expect.0.value=1e-3",
         ["expect", 0, "value"], 1e-3),
        ("expect.-1.value=9", ["expect", 1, "value"], 9), ("expect.1={a: [1, 2]}", ["expect", 1], {"a": [1, 2]}),
        ("accuracy.tolerance=1e-9", ["accuracy", "tolerance"], 1e-9), ("title=a=b", ["title"], "a=b"), ("title=",
         ["title"], None),
        ("title='3 s'", ["title"], "3 s"),
    ],
)  # fmt: skip
def test_an_override_replaces_one_value(assignment: str, path: list[str | int], value: Any) -> None:
    document = Document.parse(BASE, source="f.yaml")
    changed = varied(document, [assignment])
    node = changed.data
    for key in path:
        node = node[key]
    assert node == value
    assert changed.locate(tuple(path)).source == f"--set {assignment}"
    assert document.data == parse(BASE), "the document itself must stay as it was"


@pytest.mark.parametrize(
    ("assignment", "says"),
    [
        ("title", "not an assignment"), (" =3", "not an assignment"),
        ("title.a=3", "through a plain value"), ("expect.x=3", "not an index"),
        ("expect.-3=1", "not an index"), ("expect.²=3", "not an index"),
        ("expect.=3", "is no path of keys"),
        ("title=[1", "not YAML"), ("title=!!int 3", "tags"), ("title=a\n---\nb", ""),
    ],
)  # fmt: skip
def test_overrides_that_lead_nowhere(assignment: str, says: str) -> None:
    with pytest.raises(InputError) as caught:
        varied(Document.parse(BASE), [assignment])
    assert says in caught.value.message
    assert caught.value.location is not None
    assert caught.value.location.source == f"--set {assignment}"


# ---------------------------------------------------------------------------------------------------- validation


class Inner(InputStruct):
    """A part."""

    end: Time
    samples: int = 3


class Whole(InputStruct):
    """A document."""

    time: Inner
    title: str = ""
    parts: list[Inner] = []
    named: dict[str, Inner] = {}


@pytest.mark.parametrize(
    ("text", "says", "place", "hint"),
    [
        ("tilte: a\ntime: {end: 1 s}\n", "unknown key 'tilte'", (1, 1), "title"),
        ("time: {end: 1 s, sample: 3}\n", "unknown key 'sample'", (1, 18), "samples"),
        ("time: {end: 1 s}\nparts: [{end: 1 s}, {samples: 2}]\n", "the key 'end' is missing", (2, 21), ""),
        ("time: {end: 1 s}\nnamed: {a: {end: 1 s, sampels: 2}}\n", "unknown key 'sampels'", (2, 23), "samples"),
        ("title: a\n", "the key 'time' is missing", (1, 1), ""),
        ("time: {end: 1 s, samples: many}\n", "this is text", (1, 27), ""),
        ("title: 3\ntime: {end: 1 s}\n", "this is a whole number", (1, 8), "'3'"),
        ("time: {end: 1}\n", "'1' has no unit", (1, 13), "1 s"),
        ("time: {end: 1 m}\n", "'m' is not a unit", (1, 13), ""),
        ("time: {end: .nan}\n", "is not a finite number", (1, 13), ""),
        ("time: []\n", "this is a list", (1, 1), ""),
        ("title:\ntime: {end: 1 s}\n", "this is nothing", (1, 1), ""),
    ],
)  # fmt: skip
def test_a_mistake_is_explained_where_it_stands(text: str, says: str, place: tuple[int, int], hint: str) -> None:
    with pytest.raises(InputError) as caught:
        Document.parse(text, source="f.yaml").validate(Whole)
    assert says in caught.value.message
    assert at(caught.value) == place
    assert caught.value.hint == hint


def test_data_built_in_python_are_read_as_files_are():
    document = Document.of_data({"a": (1, np.float64(2.5)), "b": {"c": np.arange(2)}, "d": Path("x")}, "here")
    assert document.data == {"a": [1, 2.5], "b": {"c": [0, 1]}, "d": "x"}
    with pytest.raises(InputError, match="a value of type set is nothing that a file can hold") as error:
        Document.of_data({"b": {"c": [{1}]}}, "here")
    assert str(error.value.location).startswith("here: b.c")
