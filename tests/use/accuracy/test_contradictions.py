"""Measures of one run that contradict each other: no bound of the error is told then, and no target is reached.

The slide of 2 kg on a spring of 200 N/m moves as x = A cos(10 t).
"""

import json

import numpy as np
import pytest

import pinarm
from pinarm.cli.main import main
from pinarm.errors import IntegrationError
from pinarm.problems import forward
from pinarm.use.accuracy import error_estimate
from pinarm.use.accuracy.error_estimate import with_setting
from pinarm.use.study.tradeoff import reference_solution, settings, tradeoff

from .test_error_estimate import SLIDE, SPRING, on_slide

BELOW, NEVER, NOTHING = "-0.9999 m", "-3 m", ""
COARSE = {"method": "rk4", "step": "0.05 s"}
"""A half turn of Runge-Kutta 4 with steps of half a radian loses 7e-4 of the amplitude."""


def swing(accuracy=None, reaches=BELOW, then="stop", **keys):
    """Half a turn from 1 m: an event at -0.9999 m takes place at acos(-0.9999)/10 = 0.3127 s."""
    events = {"low": {"when": "x", "reaches": reaches, "then": then}} if reaches else {}
    problem = {"time": {"end": "10 s", "samples": 41}, "initial": {"position": {"x": "1 m"}}, "loads": {"s": SPRING},
               "events": events}  # fmt: skip
    return on_slide(problem, **({"accuracy": accuracy} if accuracy else {}), **keys)


@pytest.fixture
def swing_file(tmp_path):
    """Write a swing as a scenario beside the file of its mechanism."""

    def written(*given, **keys):
        content = swing(*given, **keys)
        (tmp_path / "slide.yaml").write_text(json.dumps(content["mechanism"]))
        (tmp_path / "swing.yaml").write_text(json.dumps({**content, "mechanism": "slide.yaml"}))
        return tmp_path / "swing.yaml"

    return written


@pytest.fixture
def parted(monkeypatch):
    """Solutions to compare with pass the event, as they would by an error that is larger than they know."""

    def other(scenario, setting, max_steps, **seed):
        return with_setting(scenario.varied({"problem.events.low.reaches": BELOW}), setting, max_steps)

    monkeypatch.setattr(error_estimate, "with_setting", other)


@pytest.fixture
def losing(monkeypatch):
    """Half of the energy is not accounted for, however fine the steps are."""
    monkeypatch.setattr(forward, "energy_balance", lambda *accounts: {"energy": 0.5})


STOP = np.arccos(-0.9999) / 10.0


@pytest.mark.usefixtures("parted")
def test_a_run_beside_one_that_stops_early_has_no_bound():
    """Rows until 0.31 s agree to 1e-8; those until 10 s are of a motion that is over."""
    result = pinarm.load(swing(reaches=NEVER)).verified()
    assert result.trajectory.grid.t[-1] == 10.0
    assert result.errors["x"] == np.inf
    assert "'low' takes place 0 and 1 times" in result.no_bound
    assert "they end at t = 10 s and 0.31" in result.no_bound


def test_an_event_on_a_row_leaves_the_bound(tmp_path):
    """At constant speed 0.5 m are passed at 0.5 s, which is a row: of two solutions one may stop before it."""
    problem = {"time": {"end": "1 s", "samples": 11}, "initial": {"velocity": {"x": "1 m/s"}},
               "loads": {"drag": {"kind": "joint_spring", "joint": "x", "damping": "1e-9 N*s/m"}},
               "events": {"half": {"when": "x", "reaches": "0.5 m", "then": "stop"}}}  # fmt: skip
    result = pinarm.load(on_slide(problem)).verified()
    assert result.no_bound == ""
    assert abs(result.trajectory.grid.t[-1] - 0.5) < 1e-8
    assert result.error < 1e-8


def test_a_target_is_reached_by_a_setting_that_sees_the_event():
    """Coarser settings agree with one another, as none of them sees it: they are not taken."""
    result = pinarm.run(swing({"method": "rk4", "target": 0.05}))
    assert not result.missed
    assert result.trajectory.grid.t[-1] == pytest.approx(STOP, rel=0.05)


@pytest.mark.slow
def test_a_stop_that_is_grazed_is_hit_at_any_target():
    """1e-6 m before the amplitude: x = cos(10 (t - 2 k t1)), with the blows at the odd multiples of t1.

    A motion that misses them errs by 4e-2 after 10 s.
    """
    stop = {"x": {"lower": "-0.999999 m", "restitution": 1}}
    problem = {"time": {"end": "10 s", "samples": 21}, "initial": {"position": {"x": "1 m"}}, "loads": {"s": SPRING},
               "end_stops": stop}  # fmt: skip
    result = pinarm.run(on_slide(problem, accuracy={"target": 0.01}))
    t, blow = result.trajectory.grid.t, np.arccos(-0.999999) / 10.0
    true = np.abs(result["x"].values - np.cos(10.0 * (t - 2.0 * blow * np.round(t / (2.0 * blow))))).max()
    assert true <= result.error
    assert result.missed or true <= 0.01


@pytest.mark.usefixtures("losing")
def test_two_solutions_with_the_same_residual_have_no_bound(swing_file, tmp_path, capsys):
    """Both may be wrong in the same way: what the residual should be is 0, and their difference does not show it."""
    run = ["run", str(swing_file(reaches=NOTHING)), "-o", str(tmp_path / "out"), "--no-plots",
           "--set", "problem.time.end=1 s"]  # fmt: skip
    assert main([*run, "--set", "accuracy={target: 1e-2, method: dopri5}"]) == 1
    printed = capsys.readouterr().out
    assert "target 0.01: MISSED" in printed
    assert "the same residual, 'energy' 0.5 and 0.5" in printed
    assert main([*run, "--verify"]) == 3
    assert "global error: no bound" in capsys.readouterr().out
    assert main(run) == 0
    assert "note: energy: a residual of 0.5" in capsys.readouterr().out


def test_no_bound_is_below_energy_that_is_lost():
    """Beside 1 km an oscillation is small: its coarse solution errs by 1e-6 of the output, and loses 1 % of energy."""
    result = pinarm.load(swing(COARSE, NOTHING, outputs=["x + 1000 m"])).verified()
    assert result.figures["energy"] > 1e-3
    assert result.figures["energy"] <= result.error < np.inf


@pytest.mark.parametrize("accuracy", [COARSE, {"method": "dopri5", "tolerance": 1e-3}])
def test_a_bound_beside_lost_energy_holds(accuracy):
    """A coarse motion has the error that it has: its lost energy contradicts nothing."""
    result = pinarm.load(swing(accuracy, NOTHING)).verified()
    true = np.abs(result["x"].values - np.cos(10.0 * result.trajectory.grid.t)).max()
    assert true <= result.error < 10.0 * true + 0.1
    assert not any("residual" in note for note in result.notes())


@pytest.mark.usefixtures("parted")
def test_every_place_tells_why_there_is_no_bound(swing_file, tmp_path, capsys):
    out = tmp_path / "out"
    file = swing_file(reaches=NEVER, numbers=["x @ end"], limits={"keep": {"x @ end": "< 2 m"}})
    assert main(["run", str(file), "--verify", "-o", str(out), "--no-plots"]) == 3
    why = "two solutions take different courses: 'low' takes place 0 and 1 times"
    assert why in capsys.readouterr().out
    assert json.loads((out / "summary.json").read_text())["accuracy"]["no bound"].startswith(why)
    restored = pinarm.restore(out)
    assert restored.no_bound.startswith(why)
    assert [row[-1] for row in restored.section("limits").tables[0].rows] == ["within its error"]
    assert main(["report", str(out), "-o", str(tmp_path / "report.html")]) == 0
    assert "different courses" in (tmp_path / "report.html").read_text()


@pytest.mark.slow
def test_a_trade_off_tells_settings_with_other_events():
    """1e-6 m before the amplitude: coarse solutions miss some of the 16 passages of 10 s, and are no small error."""
    asked = swing(reaches="-0.999999 m", then="record")
    trade = tradeoff(pinarm.load(asked))
    other = [point for point in trade.points if point.evaluations and point.error == np.inf]
    assert other
    assert "other events" in {row[1] for row in settings(trade, trade.reference)}
    fine = trade.recommended()[1e-6]
    assert fine is None or fine.error < 1e-6


def test_two_solutions_that_pass_the_same_load_have_no_bound():
    """At 20 m/s steps of 0.05 s and their halves go past a kick of 0.05 J that is 2 cm long: they agree to rounding."""

    def ramp(start, end, length="0.01 m"):
        return {"duration": length, "motion": {"law": "polynomial", "from": start, "to": end, "duration": length}}

    def rest(length):
        return {"duration": length, "motion": {"law": "constant", "value": "0 N"}}

    parts = [rest("5.03 m"), ramp("0 N", "5 N"), ramp("5 N", "0 N"), rest("100 m")]
    effort = {"law": "succession", "segments": parts}
    kick = {"kind": "joint_effort", "joint": "x", "over": "x", "effort": effort}
    problem = {"time": {"end": "1 s", "samples": 3}, "initial": {"velocity": {"x": "20 m/s"}}, "loads": {"kick": kick}}
    result = pinarm.load(on_slide(problem, outputs=["v_x"], symbols={"v_x": "joint.x.velocity"},
                                  accuracy={"method": "rk4", "step": "0.05 s"})).verified()  # fmt: skip
    assert result["v_x"].values[-1] < np.sqrt(400.0 + 0.05) - 1e-4
    assert result.error == np.inf
    assert "past whole pieces of a load" in result.no_bound


BACK = {"time": {"end": "10 s", "samples": 21}, "initial": {"position": {"x": "1 m"}}, "loads": {"s": SPRING},
        "events": {"back": {"when": "x", "reaches": "1 m", "then": "stop"}}}  # fmt: skip
"""The motion turns at the value of the event, after pi/5 s: any rounding decides whether it takes place."""


@pytest.mark.parametrize("accuracy", [{}, {"method": "dopri5"}])
def test_an_event_where_the_motion_turns_leaves_no_bound(accuracy):
    result = pinarm.load(on_slide(BACK, accuracy=accuracy)).verified()
    assert result.errors["x"] == np.inf
    assert "'back' takes place at t = 0.6283" in result.no_bound
    assert not any("not decided" in note for note in result.notes()), "it is said once"


def test_no_target_is_reached_where_a_decision_is_open():
    limits = {"keep": {"x @ end": "< 2 m"}}
    result = pinarm.run(on_slide(BACK, accuracy={"target": 0.01, "method": "dop853"}, limits=limits))
    assert [row[-1] for row in result.section("limits").tables[0].rows] == ["within its error"]
    assert result.missed
    assert "not decided" in result.shortfall
    with pytest.raises(IntegrationError, match="no reference to measure errors against: not decided"):
        reference_solution(pinarm.load(on_slide(BACK)))


def test_a_decision_whose_margin_is_known_leaves_the_bound():
    """1e-3 m beyond the amplitude, and below it: two solutions agree on the margin to far less."""
    for reached, end in ((1.0 - 1e-3, np.pi / 5.0), (1.0 + 1e-3, 10.0)):
        events = {"back": {"when": "x", "reaches": f"{reached!r} m", "direction": "rising", "then": "stop"}}
        result = pinarm.load(on_slide({**BACK, "events": events})).verified()
        assert result.no_bound == ""
        assert result.trajectory.grid.t[-1] == pytest.approx(end, rel=0.1)
        assert result.error < 1e-6


def test_friction_at_its_threshold_leaves_no_bound():
    """A block of 2 kg comes to rest 1e-9 m beyond where friction holds it: coarse steps do not know the margin."""
    mechanism = {"pinarm": 1, "gravity": "none", "planar": SLIDE,
                 "friction": {"x": {"constant": "2 N", "static_constant": "32 N"}}}  # fmt: skip
    problem = {"kind": "forward", "time": {"end": "2.5 s", "samples": 21},
               "initial": {"position": {"x": "0.300000001 m"}}, "loads": {"s": SPRING}}  # fmt: skip
    asked = {"pinarm": 1, "mechanism": mechanism, "problem": problem, "outputs": ["x"]}
    result = pinarm.load({**asked, "accuracy": {"method": "rk4", "step": "0.02 s"}}).verified()
    assert result.error == np.inf
    assert "whether friction at rest holds" in result.no_bound


def test_margins_of_different_occasions_are_not_compared():
    """The least certain of many blows is another one in a finer solution: its margin is another one, and no error."""
    stop = {"x": {"lower": "-0.5 m", "restitution": 0.8}}
    problem = {"time": {"end": "5 s", "samples": 101}, "initial": {"position": {"x": "1 m"}}, "loads": {"s": SPRING},
               "end_stops": stop}  # fmt: skip
    result = pinarm.load(on_slide(problem, accuracy={"tolerance": 1e-4})).verified()
    assert result.no_bound == ""
    assert result.error < 1e-2
