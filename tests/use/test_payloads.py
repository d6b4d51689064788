"""What links carry in a run: every kind of problem knows of it, and so do the summary and the hash of the input."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinarm
from pinarm.errors import InputError

OWN = "payloads: {hook: {point: tip, mass: 1 kg}}\n"
RUN = "\npayloads: {sack: {point: tip, mass: 3000 g, inertia: [0 kg*m^2, 0.2 kg*m^2, 0.2 kg*m^2]}}\n"
PULL, TURN = (2.0 + 1.0 + 3.0) * 10.0, 0.5 + 2.0 + 1.0 + 3.0 + 0.2
"""Weights times their lever of 1 m [N*m], and moment of inertia about the pivot [kg*m^2]."""


@pytest.fixture
def with_payloads(scenario: Callable[..., Any], folder: Path) -> Callable[..., Any]:
    """``with_payloads("statics")``: the scenario of a kind whose pendulum carries a hook and a sack."""
    with open(folder / "pendulum.yaml", "a") as mechanism:
        mechanism.write(OWN)
    return lambda kind, *changes: scenario(kind, RUN, *changes).run()


def test_driving_efforts_accelerate_the_payloads(with_payloads: Callable[..., Any]) -> None:
    result = with_payloads("inverse")
    a, alpha = result["joint.pivot.acceleration"].values, result["alpha"].values
    assert result["M"].values == pytest.approx(TURN * a + PULL * np.sin(alpha), rel=1e-13, abs=1e-12)
    assert result["energy.kinetic"].values == pytest.approx(TURN * result["joint.pivot.velocity"].values ** 2 / 2)


def test_free_motion_swings_the_payloads(with_payloads: Callable[..., Any]) -> None:
    result = with_payloads(
        "forward", ("30 deg", "0.02 deg"), ("mechanism:", "accuracy: {tolerance: 1e-12}\nmechanism:")
    )
    small = 0.02 * np.pi / 180 * np.cos(np.sqrt(PULL / TURN) * result["t"].values)
    assert result["alpha"].values == pytest.approx(small, abs=1e-10)  # the pendulum's own term of third order is 2e-12


def test_holding_efforts_carry_the_payloads_that_the_summary_lists_and_the_hash_knows(
    with_payloads: Callable[..., Any], folder: Path
) -> None:
    result = with_payloads("statics")
    assert result.summary()["payloads"] == {
        "hook": {"point": "tip", "mass": {"value": 1.0, "unit": "kg"},
                 "inertia": {"value": [0.0, 0.0, 0.0], "unit": "kg*m^2"}},
        "sack": {"point": "tip", "mass": {"value": 3.0, "unit": "kg"},
                 "inertia": {"value": [0.0, 0.2, 0.2], "unit": "kg*m^2"}},
    }  # fmt: skip
    assert result["M"].values == pytest.approx(PULL * np.sin(result["alpha"].values), rel=1e-13, abs=1e-12)
    again = pinarm.load(result.save(folder / "out", plots=False) / "scenario.yaml").run()
    assert np.array_equal(again["M"].values, result["M"].values)
    lighter = pinarm.load(folder / "statics.yaml", ["payloads.sack.mass=2 kg"]).run()
    (folder / "pendulum.yaml").write_text((folder / "pendulum.yaml").read_text().replace("mass: 1 kg", "mass: 2 kg"))
    heavier = pinarm.load(folder / "statics.yaml").run()
    assert len({result.digest(), lighter.digest(), heavier.digest()}) == 3


@pytest.mark.parametrize(("key", "place", "says"), [
    ("sack: {point: tipp, mass: 1 kg}", "9:26", ["no link 'tipp'", "try: tip"]),
    ("sack: {point: base, mass: 1 kg}", "9:26", ["'base' does not move"]),
    ("hook: {point: tip, mass: 1 kg}", "9:12", ["has a payload 'hook' already"]),
    ("sack: {point: tip, mass: 1 m}", "9:37", ["'m' is not a unit"]),
    ("sack: {point: tip, mass: 1 kg, inertia: [1 kg*m^2, 1 kg*m^2, 3 kg*m^2]}", "9:12", ["more than the sum"]),
])  # fmt: skip
def test_mistakes_are_told_where_they_stand(
    with_payloads: Callable[..., Any], folder: Path, key: str, place: str, says: list[str]
) -> None:
    with_payloads("statics")
    text = (folder / "statics.yaml").read_text()
    (folder / "statics.yaml").write_text(text[: text.index("payloads:")] + f"payloads: {{{key}}}\n")
    with pytest.raises(InputError) as caught:
        _ = pinarm.load(folder / "statics.yaml").mechanism
    told = str(caught.value)
    assert f"statics.yaml:{place}:" in told
    assert [part for part in says if part not in told] == []
