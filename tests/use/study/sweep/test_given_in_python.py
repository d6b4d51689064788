"""A sweep goes on from cases of the same mechanism and the same controllers only, though no file says what they are."""

import importlib
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinarm
from pinarm.use.study.sweep.journal import identity

MODEL = Path(__file__).parents[4] / "models" / "gen411_arm" / "mechanism.yaml"
DATA = {
    "pinarm": 1, "outputs": ["theta"],
    "problem": {"kind": "forward", "time": {"end": "1 s", "samples": 11}, "initial": {"position": {"O": "-60 deg"}}},
}  # fmt: skip


def scenario(mass: str = "0.2 kg") -> pinarm.Scenario:
    return pinarm.load({**DATA, "mechanism": pinarm.Mechanism.load(MODEL, {"m_A": mass})})


@pytest.fixture
def controllers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], Any]]:
    """Write a module of controllers and one beside it, and import them anew."""
    folder = tmp_path / "controllers"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)

    def written(gain: str) -> Any:
        (folder / "gains_of_test.py").write_text(f"GAIN = {gain}\n")
        (folder / "controllers_of_test.py").write_text(
            "from gains_of_test import GAIN\n\ndef pull(t, state, by=1.0):\n    return by * GAIN\n"
        )
        for name in ("gains_of_test", "controllers_of_test"):
            sys.modules.pop(name, None)
        importlib.invalidate_caches()
        return importlib.import_module("controllers_of_test")

    yield written
    for name in ("gains_of_test", "controllers_of_test"):
        sys.modules.pop(name, None)


def least(given: pinarm.Scenario, folder: Path | None) -> Any:
    return pinarm.sweep(given, {"problem.time.end": "0.5:1:2 s"}, workers=1, folder=folder)["min theta"].values


def test_a_sweep_of_another_mechanism_does_not_go_on_from_the_first(tmp_path: Path) -> None:
    light = least(scenario(), tmp_path / "out")
    heavy = least(scenario("2 kg"), tmp_path / "out")
    assert np.array_equal(heavy, least(scenario("2 kg"), None))
    assert np.abs(heavy - light).max() > 1e-3


def test_nor_does_a_sweep_of_another_controller(tmp_path: Path, controllers: Callable[[str], Any]) -> None:
    """Be it another number that it holds, or another in a module beside its own."""
    pull, found = controllers("0.5").pull, []
    for function in (pull, partial(pull, by=3.0)):
        controlled = scenario().controlled({"O": function})
        found.append(least(controlled, tmp_path / "out"))
        assert np.array_equal(found[-1], least(controlled, None))
    stronger = scenario().controlled({"O": controllers("3.0").pull})
    found.append(least(stronger, tmp_path / "out"))
    assert np.array_equal(found[-1], least(stronger, None))
    assert len({values.tobytes() for values in found}) == 3


def test_what_is_the_same_has_the_same_identity(controllers: Callable[[str], Any]) -> None:
    pull = controllers("0.5").pull
    one, again = (scenario().controlled({"O": partial(pull, by=2.0)}) for _ in range(2))
    assert identity(one.source) == identity(again.source)
    other = scenario().controlled({"O": partial(pull, by=2.5)})
    assert identity(other.source) != identity(one.source)
    fileless = scenario().controlled({"O": lambda t, state: 1.0})
    assert identity(fileless.source) != identity(fileless.source), "a function without a file is never the same again"


@pytest.mark.slow
def test_a_mechanism_has_the_same_identity_in_every_process() -> None:
    """Whatever order sets have there."""
    said = (
        "import pinarm; from pinarm.use.study.sweep.journal import _of_mechanism; "
        f"print(_of_mechanism(pinarm.Mechanism.load({str(MODEL.parents[1] / 'andrews' / 'mechanism.yaml')!r})))"
    )
    calls = [
        subprocess.run(
            [sys.executable, "-c", said], env={**os.environ, "PYTHONHASHSEED": seed}, capture_output=True, check=True
        )
        for seed in ("1", "2")
    ]
    assert calls[0].stdout == calls[1].stdout != b""
