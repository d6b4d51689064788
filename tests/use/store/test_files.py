import os

import pytest
import yaml
from ruamel.yaml import YAML

from pinarm.errors import InputError
from pinarm.input.yaml.document import Builder
from pinarm.use.store.files import yaml_text

TEXTS = [
    "a", "", " ", "x ", " x", "- a", "-", "--", "---", "...", ".", "-y", "-60 deg", "9.81 m/s^2", "g*(m_A + m_BA/2)",
    "1e5", "1e-5", "-.5e3", "+.5", ".5", ".5 m", "1.", "5 ", "1,5", "0x1F", "0o17", "0b11", "1_000", ".inf", "-.INF",
    ".nan", "true", "No", "null", "~", "y", "on", "12:30", "2026-11-21", "a: b", "a:", "a #b", "#a", "[x]", "{x}", "*a",
    "&a", "!a", "@a", "`a", "%a", "? a", "|", ">", "'", '"', 'a"b', "a\\b", "a,b", "=1", "<<", "../x y.yaml", "C:/x",
    "line\nbreak", "a\r\nb", "tab\t", "\x7f", "\x85", "\u2028", "\ufeffa", "\ue000", "\u0663", "\u00b2", "\U0001f600",
]  # fmt: skip


@pytest.mark.parametrize("read", [
    lambda written: YAML(typ="safe", pure=True).load(written), yaml.safe_load,
    lambda written: Builder(written, "written").build(),
], ids=["YAML 1.2", "YAML 1.1", "ours"])  # fmt: skip
def test_text_is_written_so_that_every_reader_of_yaml_takes_it_for_the_same_text(read):
    for text in TEXTS:
        data = {"alone": text, "map": {text: text}, "list": [text, [text], {"a": text, "b": [text]}]}
        assert read(yaml_text(data)) == data, text


def test_numbers_and_what_is_empty_are_read_as_they_were():
    inner = {"numbers": [1, -0.0, 0.1, 1e-9, 1e22, float("inf"), -float("inf")], "words": [True, False, None]}
    data = {"deep": [[1, [2, []]], {}, {"a": {}, "b": [], "c": {"d": [inner]}}], "last": 3}
    assert Builder(yaml_text(data), "written").build() == data
    assert YAML(typ="safe", pure=True).load(yaml_text(data)) == data


def test_a_name_that_is_no_unicode_is_refused_in_words():
    with pytest.raises(InputError, match="is no text that a file of results can hold"):
        yaml_text({"mechanism": os.fsdecode(b"../\xff\xfe/arm.yaml")})
