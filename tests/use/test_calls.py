"""Whatever the command line does is one library call of the same name."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinarm
from pinarm.cli.main import _parser
from pinarm.errors import InputError


def commands() -> set[str]:
    [choices] = [action for action in _parser([])._actions if isinstance(action, argparse._SubParsersAction)]
    return set(choices.choices)


def test_every_command_is_a_call() -> None:
    known = "new run check validate explain lab quantities sweep tradeoff replay report schema examples selftest"
    assert commands() == set(known.split())
    assert commands() <= set(pinarm.__all__)
    with pytest.raises(InputError, match="no schema of 'result'"):
        pinarm.schema("result")  # type: ignore[arg-type]


def test_run_takes_a_file_or_a_scenario_and_replaces_values(scenario: Callable[..., Any], folder: Path) -> None:
    loaded = scenario("statics")
    for given in (loaded, folder / "statics.yaml", str(folder / "statics.yaml")):
        assert np.array_equal(pinarm.run(given)["M"].values, loaded.run()["M"].values)
        assert len(pinarm.run(given, ["problem.over.pivot.samples=3"])) == 3
    assert len(loaded.run()) == 8  # which is as it was
    with pytest.raises(InputError, match="samplse"):
        pinarm.run(loaded, ["problem.over.pivot.samplse=3"])


def test_check_and_validate_take_folders(scenario: Callable[..., Any], folder: Path) -> None:
    key = "expect:\n  - {quantity: M, at: max, value: 20 N*m, rtol: 0.03, source: 2 kg at 1 m}\n"
    for kind in ("statics", "equilibria"):
        scenario(kind, key if kind == "statics" else "")
    (folder / "own").mkdir()
    for kind in ("statics", "equilibria"):
        text = (folder / f"{kind}.yaml").read_text().replace("pendulum.yaml", "../pendulum.yaml")
        (folder / "own" / f"{kind}.yaml").write_text(text)
    assert [one.name for one in pinarm.validate(folder / "own")] == ["equilibria", "statics"]
    assert [(one.scenario, one.verdict) for one in pinarm.check(folder / "own")] == [("statics", "agrees")]
    (folder / "own" / "statics.yaml").write_text("pinarm: 1\n")
    with pytest.raises(InputError, match="mechanism"):
        pinarm.validate(folder / "own")
    (folder / "nothing").mkdir()
    with pytest.raises(InputError, match="no scenarios"):
        pinarm.check(folder / "nothing")


ARM = Path(__file__).parents[2] / "models" / "gen411_arm" / "mechanism.yaml"
ALONG = {
    "statics": "over: {A_height: {from: 0.6 m, to: 0.7 m, samples: 3}}, hold: {O: 0}, drives: [A_height, O]",
    "state": "hold: {O: 0, A_height: 0.6 m}, drives: [A_height, O]",
    "equilibria": "starts: [{B: 30 deg}], hold: {A_height: 0.6 m}",
    "inverse": "time: {end: 1 s}, motion: {O: {law: constant, value: 0}, A_height: {law: constant, value: 0.6 m}}, "
    "drives: [A_height, O]",
    "forward": "time: {end: 0.1 s}, motion: {A_height: {law: constant, value: 0.6 m}}, start: {B: 30 deg}",
}
"""Problems in which something acts along a task coordinate."""


@pytest.mark.parametrize("kind", ALONG)
def test_validate_knows_the_efforts_that_a_run_tells(folder: Path, kind: str) -> None:
    problem, outputs = f"problem: {{kind: {kind}, {ALONG[kind]}}}\n", "outputs: [coordinate.A_height.effort]\n"
    (folder / "along.yaml").write_text(f"pinarm: 1\nmechanism: {ARM}\n{problem}{outputs}")
    with pinarm.file_root(ARM.parents[2]):
        assert len(pinarm.validate(folder / "along.yaml")) == 1
        effort = pinarm.run(folder / "along.yaml")["coordinate.A_height.effort"]
    assert str(effort.unit) == "N"
    assert np.isfinite(effort.values).all()


def test_a_scenario_may_be_plain_data():
    """Paths in it are relative to the working folder, and mistakes have their path."""
    root = Path(pinarm.__file__).parents[1]
    arm = (root / "models/gen411_arm/mechanism.yaml").as_posix()
    data = {
        "pinarm": 1, "mechanism": arm, "outputs": ["C_B"],
        "problem": {"kind": "statics", "hold": {"O": 0.0}, "over": {"phi": {"from": "-60 deg", "to": "60 deg"}}},
    }  # fmt: skip
    with pinarm.file_root(root):
        result = pinarm.run(data, {"arguments.m_A": "0.2 kg"})
        file = pinarm.run(root / "scenarios/gen411_arm_static.yaml", {"arguments.m_A": "0.2 kg"})
        assert result["C_B"].max() == pytest.approx(float(file["C_B"].max()), rel=1e-14)
        with pytest.raises(InputError, match="unknown key 'hld'") as error:
            pinarm.validate({**data, "problem": {**data["problem"], "hld": {}}})
    assert str(error.value.location) == "scenario: problem.hld"
