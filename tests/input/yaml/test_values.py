"""Other values for a file: a mapping and texts say the same, and what cannot be meant is refused."""

import re
from collections.abc import Mapping
from typing import Any

import pytest

from pinarm.errors import InputError, UnitError
from pinarm.input.yaml.document import Document, require_apart, varied

FILE = "title: arm\nproblem: {time: {end: 3 s}, speed: 3000 rpm}\nlist: [1 kg, 2 mm]\n"


def made(values: Any, declared: Mapping[str, str] | None = None) -> Any:
    return varied(Document.parse(FILE), values, lambda path: (declared or {}).get(path, "")).data


@pytest.mark.parametrize(
    ("mapping", "texts"),
    [
        ({"problem.time.end": "4 s"}, ["problem.time.end=4 s"]), ({"title": "leg"}, ["title=leg"]),
        ({"problem.time.end": 4.5}, ["problem.time.end=4.5"]), ({"list.0": 3}, ["list.0=3"]),
        ({"problem.time": {"end": "4 s", "samples": 5}}, ["problem.time={end: 4 s, samples: 5}"]),
        ({"new.key": [1, "a", True]}, ["new.key=[1, a, true]"]), ({"title": None}, ["title="]),
        ({"title": "a", "problem.speed": "1 rad/s"}, ["title=a", "problem.speed=1 rad/s"]),
    ],
)  # fmt: skip
def test_a_mapping_and_texts_say_the_same(mapping: Mapping[str, object], texts: Any) -> None:
    assert made(mapping) == made(texts) != Document.parse(FILE).data


class TestBareNumbers:
    def test_are_in_si_where_the_file_is(self) -> None:
        assert made({"problem.time.end": 4})["problem"]["time"]["end"] == "4 s"
        assert made({"arguments.m": 0.25}, {"arguments.m": "kg"})["arguments"]["m"] == "0.25 kg"

    @pytest.mark.parametrize(("path", "hint"), [("problem.speed", "'100.5 rpm'"), ("list.1", "'100.5 mm'")])
    def test_are_refused_where_it_has_another_unit(self, path: str, hint: str) -> None:
        """100.5 might be meant in rpm, or in rad/s."""
        for values in ({path: 100.5}, [f"{path}=100.5"]):
            with pytest.raises(UnitError, match="has no unit") as caught:
                made(values)
            assert caught.value.hint == hint
            assert path in str(caught.value)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ("title=a", "other values are given as 'title=a'"), (3, "other values are given as '3'"),
        ({"": 1}, "is no path"), ({3: 1}, "the key 3 is no path"),
        ({"title": object()}, "a value of type object is nothing"),
        ({"title": {"a": {1, 2}}}, "of type set is nothing"), ({"title.a": 3}, "leads through a plain value"),
        ({"list.2": 3}, "is not an index"), (["title"], "is not an assignment"), ({"list.²": 3}, "is not an index"),
    ],
)  # fmt: skip
def test_what_is_no_value(values: Any, says: str) -> None:
    with pytest.raises(InputError) as caught:
        made(values)
    assert says in caught.value.message


def test_what_is_varied_is_not_set_too() -> None:
    data = Document.parse(FILE).data
    for values in (["problem.time.end=4 s"], {"problem.time.end": "4 s"}):
        for over in ("problem.time.end", "problem.time", 'problem."time".end'):
            with pytest.raises(InputError, match=f"'{re.escape(over)}' is varied, and"):
                require_apart(data, values, ["problem.speed", over])
    with pytest.raises(InputError, match="are one path, and varied twice"):
        require_apart(data, (), ["problem.time.end", "title", 'problem."time".end'])
    require_apart(data, ["problem.time={end: 4 s}", "problem.speed=3 rpm"], ["problem.time.end", "title", "list.0"])
