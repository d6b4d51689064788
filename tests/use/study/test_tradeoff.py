"""Errors of settings and of simplified models against motions that are known in closed form."""

import json

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

from pinarm.cli.main import main
from pinarm.errors import InputError
from pinarm.use.study.tradeoff import TriedSetting, recommended_setting, solve_variants, tradeoff

SMALL = """\
variants:
  small_angle:
    gravity: none
    problem.loads: {weight: {kind: joint_spring, joint: pivot, stiffness: 20 N*m/rad}}
  weightless: {gravity: none}
"""
"""For the pendulum of 20 N m at the horizontal; its pulsation for small angles is the root of 8 rad/s."""


def pendulum(t, start, pulsation):
    """The exact swing from rest, by Jacobi's elliptic functions."""
    k = np.sin(start / 2)
    sn, _, _, _ = ellipj(ellipk(k**2) - pulsation * t, k**2)
    return 2 * np.arcsin(k * sn)


def oscillator(scenario):
    load = "  loads: {spring: {kind: joint_spring, joint: pivot, stiffness: 10 N*m/rad}}\n"
    return scenario("forward", "gravity: none\n", ("outputs: [alpha, energy.total]", f"{load}outputs: [alpha]"))


@pytest.mark.slow
def test_errors_of_settings_are_those_against_the_closed_form(scenario):
    """A rod on a spring moves as A cos(2 t). Between the rows errors are seen in 100 places: their largest, to 15 %."""
    asked = oscillator(scenario)
    trade = tradeoff(asked)
    assert trade.reference.bound < 1e-12
    t = trade.reference.result["t"].values
    close = {"start": f"{float(t[0])!r} s", "end": f"{float(t[-1])!r} s", "samples": 4001}
    for point in trade.points:
        key, _, value = point.setting.partition(", ")[2].partition(" ")
        accuracy = {"method": point.method, key: float(value) if key == "tolerance" else value}
        found = asked.varied({"accuracy": accuracy, "problem.time": close}).solve()
        exact = np.pi / 6 * np.cos(2 * found["t"].values)
        true = np.abs(found["alpha"].values - exact).max() / np.abs(exact).max()
        assert point.errors["alpha"] == pytest.approx(true, rel=0.15, abs=3e-13)
    errors = {method: [p.error for p in trade.points if p.method == method] for method in ("dop853", "rk4")}
    assert errors["dop853"][0] > 1e-4
    assert errors["dop853"][-1] < 1e-10
    orders = np.log2(np.array(errors["rk4"][:-1]) / errors["rk4"][1:])
    assert orders[-3:] == pytest.approx(4.0, abs=0.2)


def tried_settings(**errors_and_costs):
    """Settings of methods, the coarsest first, from their errors and evaluations."""
    return [TriedSetting(method, f"{method}{k}", {"x": error, "y": 0.0}, cost, 1.0)
            for method, settings in errors_and_costs.items() for k, (error, cost) in enumerate(settings)]  # fmt: skip


def test_a_setting_that_is_good_by_luck_is_not_recommended():
    """A finer one errs more: errors that cancel in this motion do not in the next. What failed says so itself."""
    lucky = [(1e-4, 10), (9.8e-3, 20), (1e-4, 30), (1e-5, 40)]
    assert recommended_setting(tried_settings(m=lucky), 1e-13, 1e-3).setting == "m2"
    assert recommended_setting(tried_settings(m=lucky, n=[(2e-4, 25)]), 1e-13, 1e-3).setting == "n0"
    assert recommended_setting(tried_settings(m=[*lucky, (np.inf, 0)]), 1e-13, 1e-3).setting == "m2"
    assert recommended_setting(tried_settings(m=[*lucky, (2e-3, 50)]), 1e-13, 1e-3) is None


def test_the_cheapest_setting_that_is_good_enough_by_a_margin_is_recommended():
    """Not the most accurate, and none whose error the reference cannot tell from the wanted one."""
    tried = tried_settings(m=[(1e-2, 10), (3e-7, 80), (1e-7, 90), (1e-12, 500)])
    assert recommended_setting(tried, 1e-13, 1e-6).setting == "m1"
    assert recommended_setting(tried, 5e-7, 1e-6).setting == "m2"
    assert recommended_setting(tried, 1e-13, 1e-13) is None
    assert recommended_setting(tried_settings(m=[(0.9e-3, 10), (0.3e-3, 20)]), 1e-13, 1e-3).setting == "m1"


def test_the_error_of_a_simplified_model_is_that_of_the_closed_forms(scenario):
    """A pendulum released at 30 degrees against its law for small angles, and against no law at all."""
    exact, small, weightless = solve_variants(scenario("forward", SMALL))
    t, start = exact.result["t"].values, np.pi / 6
    swing = pendulum(t, start, np.sqrt(8.0))
    assert np.abs(exact.result["alpha"].values - swing).max() < 1e-7
    apart = np.abs(start * np.cos(np.sqrt(8.0) * t) - swing)
    assert small.errors["alpha"] == pytest.approx(apart.max(), rel=1e-5)
    assert small.relative["alpha"] == pytest.approx(apart.max() / np.abs(swing).max(), rel=1e-5)
    assert small.where["alpha"] == t[apart.argmax()]
    assert weightless.errors["alpha"] == pytest.approx(np.abs(swing - start).max(), rel=1e-5)


@pytest.mark.slow
def test_a_trade_off_is_a_folder_of_tables_and_plots(scenario, tmp_path, capsys):
    path, out = scenario("forward", SMALL).document.path, tmp_path / "out"
    assert main(["tradeoff", str(path), "-o", str(out), "--set", "problem.time.end=1 s"]) == 0
    said = json.loads((out / "tradeoff.json").read_text())
    assert set(said["recommended"]) == {"0.001", "1e-06", "1e-09"}
    assert set(said["variants"]) == {"exact", "small_angle", "weightless"}
    assert all((out / name).stat().st_size > 10_000 for name in ("settings.svg", "variants_alpha.svg"))
    printed = capsys.readouterr().out
    assert all(word in printed for word in ("for 1e-06: dop853", "small_angle", "known to"))


def test_what_nothing_can_be_traded_for_is_refused(scenario):
    with pytest.raises(InputError, match="nothing to trade"):
        tradeoff(scenario("inverse"))


def test_a_mistake_in_a_variant_is_found_where_it_stands(scenario):
    asked = scenario("forward", "variants:\n  short: {problem.time.edn: 1 s}\n")
    line = asked.document.path.read_text().splitlines().index("  short: {problem.time.edn: 1 s}") + 1
    with pytest.raises(InputError, match="edn") as caught:
        asked.validate()
    assert f"forward.yaml:{line}:" in str(caught.value)


def test_a_variant_that_cannot_be_solved_says_why_and_the_others_are_told(scenario):
    more = SMALL + "  hasty: {accuracy.max_steps: 3}\n"
    *_, weightless, hasty = solve_variants(scenario("forward", more))
    assert weightless.errors
    assert "3 steps" in hasty.failure
