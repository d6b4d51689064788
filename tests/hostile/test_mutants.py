"""A small sample of the mutants of every kind of file, or as many as the variable ``MUTANTS`` says."""

import os
import signal
from pathlib import Path

import pytest
from mutants import kinds, prepare, tried

NAMES = ("scenario", "others", "forward", "mechanism", "urdf", "xacro", "mjcf", "sdf", "stl", "obj", "dae", "find",
         "table", "cases", "summary", "resolved", "arrays", "journal", "options")  # fmt: skip
SAMPLE = range(int(os.environ.get("MUTANTS", "8")))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("mutants")
    prepare(made)
    return made


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # np.load leaves broken files open
@pytest.mark.parametrize("name", NAMES)
def test_a_mutant_ends_in_an_answer_or_in_words(
    folder: Path, name: str, no_hang: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    known = kinds(folder)
    assert set(known) == set(NAMES)
    ended = {}
    for number in SAMPLE:
        signal.alarm(60)  # seconds for each
        ended[number] = tried(name, known[name], number, folder)
    assert {number: said for number, said in ended.items() if said not in ("answered", "refused")} == {}
