"""Every scenario that is shipped runs, and meets its answer key."""

from pathlib import Path

import msgspec
import pytest

import pinarm
from pinarm.input.yaml.document import Document
from pinarm.use.scenario.scenario import ScenarioFile

FOLDER = Path(pinarm.__file__).parents[1] / "scenarios"
FILES = sorted(FOLDER.glob("*.yaml"))


def test_there_are_scenarios() -> None:
    assert FILES


CASES = [pytest.param(file, marks=pytest.mark.slow if "forty" in file.stem else ()) for file in FILES]


@pytest.mark.parametrize("file", CASES, ids=lambda file: file.stem)
def test_it_runs_and_meets_its_answer_key(file: Path) -> None:
    findings = pinarm.check(pinarm.load(file))
    assert findings
    assert [f"{f.expectation.quantity} at {f.expectation.at}: {f.reason}" for f in findings if not f.ok] == []


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_what_runs_is_accepted_without_solving(file: Path) -> None:
    """``test_it_runs_and_meets_its_answer_key`` solves it; ``validate`` and ``sweep`` judge it near its start."""
    assert pinarm.validate(file)


MODELS = [
    pytest.param(file, marks=pytest.mark.slow if "forty" in file.parent.name else ())
    for file in sorted((FOLDER.parent / "models").glob("*/mechanism.yaml"))
]


@pytest.mark.parametrize("file", MODELS, ids=lambda file: file.parent.name)
def test_its_mechanism_is_explained_where_it_is_closed(file: Path) -> None:
    found = pinarm.explain(file)
    assert found.mobility.mobility > 0
    assert found.mobility.regularity > 1e-3


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_something_independent_decides(file: Path) -> None:
    """A published figure alone proves little: there must be a value or formula from elsewhere."""
    expect = pinarm.load(file).content.expect
    assert any(entry.value is not None or entry.formula is not None for entry in expect)
    assert all(entry.source.strip() for entry in expect)


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_its_keys_are_those_of_the_json_schema(file: Path) -> None:
    fields, data = msgspec.structs.fields(ScenarioFile), Document.read(file).data
    assert set(data) <= {field.encode_name for field in fields}
    assert {field.encode_name for field in fields if field.required} <= set(data)
