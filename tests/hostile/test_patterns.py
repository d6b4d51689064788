"""No regular expression of the package takes more than linear time, whatever the text."""

import importlib
import pkgutil
import re
from collections.abc import Iterator
from itertools import product

import pytest

import pinarm

LENGTH = 30_000  # linear patterns take milliseconds for all texts, quadratic ones minutes
BOUNDED = {
    "pinarm.input.units._FACTOR": 100,  # units are at most that long
    "pinarm.input.xacro.expander._MACRO_PARAMETER": 10_000,  # an attribute
}
LETTERS = ["a", "1", " ", ".", "e", "-", "'", '"', "<mesh ", "filename=", "$", "${", "[", "(", "_", "²", "٣", "d"]


def patterns() -> Iterator[tuple[str, "re.Pattern[str]"]]:
    for module in pkgutil.walk_packages(pinarm.__path__, "pinarm."):
        if not module.name.endswith("__main__"):
            for name, value in vars(importlib.import_module(module.name)).items():
                if isinstance(value, re.Pattern):
                    yield f"{module.name}.{name}", value


PATTERNS = dict(patterns())


@pytest.mark.parametrize("name", PATTERNS)
def test_a_pattern_is_linear(name: str, no_hang: None) -> None:
    pattern, length = PATTERNS[name], BOUNDED.get(name, LENGTH)
    for first, again, last in product(["", "1", "<mesh filename='", "start", "normal(1,"], LETTERS, ["\n]\0", ""]):
        given = first + again * (length // len(again)) + last
        text = given.encode() if isinstance(pattern.pattern, bytes) else given
        pattern.fullmatch(text)
        pattern.match(text)
