"""What a run gives back: series with units, tables, and errors that list what there is."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinarm
from pinarm.errors import DynamicsError, ExpressionError, InputError, UnitError
from pinarm.use.show.text import report
from pinarm.use.study.restore import restore


@pytest.mark.parametrize(
    ("name", "unit", "end"),
    [
        ("t", "s", 2.0), ("joint.pivot.acceleration", "rad/s^2", -1.0), ("M", "N*m", 20 * np.sin(1) - 2.5),
        ("pivot", "rad", 1.0),
        ("drive.motor.speed", "rad/s", 0.0), ("point.tip.position.x", "m", -np.sin(1)),
        ("point.tip.position.norm", "m", 1.0), ("energy.potential", "J", -20 * np.cos(1)),
        ("g", "m/s^2", 10.0), ("$\\foo{", "1", 2.0),
        # formulas
        ("M*joint.pivot.velocity", "W", 0.0), ("2", "1", 2.0),
        ("sin(alpha)**2 + cos(alpha)**2", "1", 1.0), ("g*t", "m/s", 20.0), ("degrees(alpha)", "1", np.degrees(1)),
    ],
)  # fmt: skip
def test_series(scenario: Callable[..., Any], name: str, unit: str, end: float) -> None:
    result = scenario("inverse").run()
    series = result[name]
    assert str(series.unit) == unit
    assert series.values.shape == (len(result),)
    assert series.values[-1] == pytest.approx(end, rel=1e-13, abs=1e-13)  # a few roundings of terms up to 20
    assert np.array_equal(np.asarray(series), series.values)


def test_a_jump_stands_twice_in_the_table(scenario: Callable[..., Any]) -> None:
    """At t = 1 s the trapezoid turns round: once with what is just before, once with what is just after."""
    result = scenario("inverse").run()
    t, a = result["t"].values, result["joint.pivot.acceleration"].values
    assert len(t) == 10
    assert a[t == 1.0].tolist() == [1.0, -1.0]


@pytest.mark.parametrize(
    ("name", "kind", "says"),
    [
        ("alpa", InputError, "alpha"), ("joint.pivot.efort", InputError, "joint.pivot.effort"),
        ("drive.moter.speed", InputError, "drive.motor.speed"), ("point.tip.position.w", InputError, "tip.position."),
        ("joint", InputError, "there is no quantity"), ("joint.", InputError, ""), ("", InputError, "empty"),
        ("alpha + M", UnitError, "do not go together"), ("sin(M)", UnitError, ""),
        ("sine(alpha)", ExpressionError, "sin"), ("alpha +", ExpressionError, "not a formula"),
        ("__import__('os')", ExpressionError, ""), ("alpha.real", InputError, ""),
        ("1/0", ExpressionError, "not finite"),
    ],
)  # fmt: skip
def test_unknown_quantities(scenario: Callable[..., Any], name: str, kind: type[Exception], says: str) -> None:
    with pytest.raises(kind) as caught:
        _ = scenario("inverse").run()[name]
    assert says in str(caught.value)


def test_symbols_of_the_scenario_are_formulas_of_symbols(scenario: Callable[..., Any]) -> None:
    result = scenario("inverse", "symbols: {twice: 2*alpha, four: 2*twice}\n").run()
    assert result["four"].values[-1] == 4.0
    with pytest.raises(InputError, match="defined by itself: a -> b -> a"):
        _ = scenario("inverse", "symbols: {a: b, b: a}\n").run()["a"]


def test_the_summary_has_the_headline_numbers(scenario: Callable[..., Any]) -> None:
    summary = scenario("inverse").run().summary()
    assert summary["outputs"]["alpha"] == {
        "unit": "rad", "min": 0.0, "at_min": 0.0, "max": 1.0, "at_max": 2.0, "start": 0.0, "end": 1.0,
    }  # fmt: skip
    assert summary["rows"] == 10
    residuals = [summary["accuracy"][name] for name in ("equilibrium", "power", "return trip")]
    assert all(0 <= value < 1e-13 for value in residuals)  # rounding, relative to the terms


def test_the_digest_is_that_of_what_decides_the_numbers(scenario: Callable[..., Any]) -> None:
    plain = scenario("inverse").run().digest()
    assert scenario("inverse", "title: x\n").run().digest() == plain
    assert scenario("inverse", "gravity: none\n").run().digest() != plain
    assert scenario("inverse", "", ("1 rad/s^2", "2 rad/s^2")).run().digest() != plain


def test_the_digest_tells_mechanisms_apart(scenario: Callable[..., Any], folder: Any) -> None:
    """Gravity, springs and drives are in the mechanism file, not in the model's text."""
    plain = scenario("inverse").run().digest()
    file = folder / "pendulum.yaml"
    file.write_text(file.read_text().replace("10 m/s^2", "11 m/s^2"))
    assert scenario("inverse").run().digest() != plain


def test_an_output_that_is_not_finite_is_an_error_of_the_numerics(scenario: Callable[..., Any]) -> None:
    with pytest.raises(DynamicsError, match="is not finite at t = 0 s") as caught:
        scenario("inverse", "", ("[M, alpha]", "[M, sqrt(alpha - 0.5)]")).run()
    assert caught.value.exit_code == 3
    assert len(caught.value.partial) == 10
    assert str(caught.value.location).endswith("inverse.yaml:7:14")


def test_a_load_over_time_has_no_place_where_there_is_no_time(scenario: Callable[..., Any]) -> None:
    """In statics what runs along the rows is an angle: a law of time would be read at t = angle."""
    load = "{load: {kind: joint_effort, joint: pivot, effort: {law: harmonic, amplitude: 5 N*m, pulsation: 1 rad/s}}}"
    with pytest.raises(InputError):
        scenario("statics", "", ("outputs:", f"  loads: {load}\noutputs:")).run()


def test_what_there_is_to_doubt_is_told_and_kept(scenario: Callable[..., Any], tmp_path: Path) -> None:
    assert scenario("forward").run().notes() == []
    result = scenario("forward", "accuracy: {method: rk4, step: 1 s}\n").run()
    notes = result.notes()
    assert notes[0].startswith("step too large: at t = ")
    assert all(f"note: {note}" in report(result) for note in notes)
    assert restore(result.save(tmp_path / "out", plots=False)).notes() == notes


@pytest.mark.parametrize(("samples", "turns", "rows"), [(12, 1, 0), (23, 2, 0), (721, 1, 33)])
def test_a_cam_that_would_have_to_pull_between_rows_is_told(samples: int, turns: int, rows: int) -> None:
    """``s = E (1 - cos(w t))`` under m and a spring: ``N = m g + F0 + k E + (m w^2 - k) E cos(w t)``, least at its top.

    F0 is such that N is -1/100 of ``(m w^2 - k) E`` there: it pulls within ``acos(0.99) = 8.1 deg`` of the top.
    """
    m, k, e, w = 0.5, 200.0, 0.011, 40.0
    swing = (m * w**2 - k) * e
    preload = 0.99 * swing - m * 9.81 - k * e
    links = {"shaft": {"points": ["O"], "mass": "1 kg", "inertia": "0.003 kg*m^2"},
             "follower": {"points": ["T", "U"], "mass": f"{m} kg"}}  # fmt: skip
    profile = {"law": "harmonic", "amplitude": f"{e} m", "mean": f"{e} m", "pulsation": "1 rad/rad", "phase": "-90 deg"}
    cam = {"kind": "cam", "joints": ["O", "lift"], "period": "360 deg", "face": "T", "profile": profile}
    spring = {"kind": "joint_spring", "joint": "lift", "stiffness": f"{k} N/m", "rest": f"{-preload / k!r} m"}
    planar = {
        "points": {"O": [0, 0], "T": [0, "30 mm"], "U": [0, "120 mm"]}, "ground": ["O"], "links": links,
        "sliders": {"lift": {"link": "follower", "along": ["T", "U"]}},
    }  # fmt: skip
    machine = {"pinarm": 1, "planar": planar, "forces": {"s": spring}}

    def limits(**closed: str) -> tuple[list[Any], Any]:
        result = pinarm.run({
            "pinarm": 1, "outputs": ["lift"],
            "mechanism": {**machine, "couplings": {"C": {**cam, **closed}}},
            "problem": {"kind": "inverse", "time": {"end": f"{turns * 2.0 * np.pi / w!r} s", "samples": samples},
                        "drives": ["O"], "motion": {"O": {"law": "constant_speed", "speed": f"{w} rad/s"}}},
        })  # fmt: skip
        return [one for one in result.excesses() if one.of == "contact"], result.trajectory

    ((limit,), run) = limits(closed_by="force")
    assert limit.value == pytest.approx(-0.01 * swing, rel=1e-9)
    assert limit.rows == rows
    period = 2.0 * np.pi / w
    assert (limit.at / period) % 1.0 == pytest.approx(0.5, abs=1e-9 if not rows else np.arccos(0.99) / (2.0 * np.pi))
    assert ("between two rows, most at t = " in limit.words(run)) == (not rows)
    assert not limits()[0]
