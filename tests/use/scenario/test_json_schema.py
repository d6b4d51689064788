"""What editors show of a key: its meaning and an example."""

import json
import re
import shutil

import msgspec
import pytest
from key_examples import ROOT, chosen, given

import pinarm
from pinarm.input.yaml.document import Document
from pinarm.input.yaml.schema import InputStruct, convert, reading_from, with_types
from pinarm.use.scenario.json_schema import EXAMPLES, has_example

pytestmark = pytest.mark.house


def keys():
    """Every key of the files, with its schema."""
    for of in ("mechanism", "scenario"):
        root = pinarm.schema(of)
        for name, definition in {root["title"]: root, **root["$defs"]}.items():
            for key, own in definition.get("properties", {}).items():
                yield f"{name}.{key}", own


def test_every_key_has_a_text_and_an_example():
    assert len(dict(keys())) > 450
    assert [name for name, own in keys() if not own.get("description")] == []
    assert [name for name, own in keys() if not has_example(own)] == []


def structs(base):
    """Every struct of the files that is below another one."""
    for struct in base.__subclasses__():
        yield struct
        yield from structs(struct)


def test_what_a_text_gives_as_an_example_is_accepted(tmp_path):
    """Each is read as a file would have it, and becomes what the key holds."""
    shutil.copy(ROOT / "models/motors/motors.csv", tmp_path)
    texts, read = dict(keys()), set()
    for struct in list(structs(InputStruct)):
        for field in msgspec.structs.fields(with_types(struct, struct.deferred)):
            key = f"{struct.__name__}.{field.encode_name}"
            for example in re.findall(r"[Ss]uch as ``(.+?)``", texts.get(key, {}).get("description", "")):
                with reading_from(tmp_path):
                    msgspec.convert(Document.parse(f"key: {example}").data["key"], field.type, dec_hook=convert)
                read.add(key)
    assert len(read) > 130


def test_no_text_speaks_of_the_code():
    """Of functions and modules that a user does not call."""
    texts = {name: own["description"] for name, own in keys()}
    assert [name for name, text in texts.items() if "see ``" in text and "see ``run --verify``" not in text] == []


def test_examples_are_values_of_tested_files():
    values, shown = given(), json.loads(EXAMPLES.read_text(encoding="utf-8"))
    advice = "write them anew: python docs/key_examples.py"
    assert {name: set(keys) for name, keys in shown.items()} == {name: set(keys) for name, keys in chosen().items()}, (
        advice
    )
    for name, keys_of in shown.items():
        for key, value in keys_of.items():
            assert json.dumps(value, ensure_ascii=False) in values[name, key], f"{name}.{key}: {advice}"
