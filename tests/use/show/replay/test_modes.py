"""Modes in the page: where they should be, loops closed at every amplitude, one period without an end."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import pinarm
from pinarm.errors import InputError
from pinarm.use.facade import Result
from pinarm.use.show.replay.chromium import Page, place
from pinarm.use.show.replay.modes import LEVELS, PHASES, mode_pictures


@pytest.fixture(scope="module")
def swing() -> Result:
    """The crank-rocker about its equilibrium, with a spring and a damper at its crank."""
    mount = {"kind": "joint_spring", "joint": "theta2", "stiffness": "20 N*m/rad", "damping": "0.3 N*m*s/rad"}
    about = {"equilibrium": {"theta2": "-1 rad", "A": "40 deg", "theta4": "80 deg"}}
    return pinarm.run("scenarios/crank_rocker_free.yaml", {
        "problem": {"kind": "linear", "about": about, "loads": {"mount": mount}}, "outputs": ["mode.1.frequency"],
        "expect": [], "symbols": {}, "find": None,
    })  # fmt: skip


def placements(model: pin.Model, q: Any) -> np.ndarray:
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    return np.array([place.homogeneous for place in data.oMi])


def seen(page: Page, phase: float, mode: int, amplitude: float) -> np.ndarray:
    for name, value in (("mode", mode - 1), ("amplitude", amplitude)):
        page.evaluate(f"(() => {{ const e = document.getElementById('{name}'); e.value = {value};"
                      "e.dispatchEvent(new Event('input')); })()")  # fmt: skip
    page.evaluate(f"replay.show({phase!r})")
    return np.array(page.evaluate("replay.placements()")).reshape(-1, 4, 4).transpose(0, 2, 1)


def test_a_tree_moves_along_its_shape(solved: Callable[..., Any], shown: Callable[..., Any]) -> None:
    """``q + a Re(x exp(i phi))``, full amplitude being 20 degrees of the joint that moves most."""
    result = solved("gen411_arm_modes")
    page, model, q = shown(result), result.trajectory.mechanism.model, result.trajectory.q[0]
    for mode in (1, 2):
        shape = result.arrays["shapes"].values[:, mode - 1]
        full = shape * np.radians(20.0) / np.abs(shape).max()
        for amplitude, k in ((1.0, 0), (0.375, 4), (0.5, 12)):
            phase = 2.0 * np.pi * k / (PHASES - 1)
            expected = placements(model, pin.integrate(model, q, amplitude * np.real(full * np.exp(1j * phase))))
            assert seen(page, phase, mode, amplitude) == pytest.approx(expected, abs=1e-6)
    text = page.evaluate("document.querySelector('#legend li').textContent")
    assert text.startswith(f"mode 2: {result['mode.2.frequency'].values[0]:.4g} Hz, damping ratio 0; full amplitude: ")


@pytest.mark.slow
def test_loops_stay_closed_at_any_amplitude(swing: Result, shown: Callable[..., Any]) -> None:
    """The pin B is where both links have it, to the square of the distance between two levels."""
    page, model = shown(swing), swing.trajectory.mechanism.model
    ends = [model.frames[model.getFrameId(name)] for name in ("B3", "B4")]
    rest = swing.trajectory.q[0]
    for phase in (0.3, 2.0, 4.4):
        for amplitude in (0.25, 0.6, 1.0):
            places = seen(page, phase, 1, amplitude)
            first, second = (places[end.parentJoint] @ [*end.placement.translation, 1.0] for end in ends)
            assert np.linalg.norm(first - second) < 1e-3
    assert np.abs(places - placements(model, rest)).max() > 0.01  # moved at all


def test_positions_are_closed_and_deviate_as_the_shape(swing: Result) -> None:
    pictures = mode_pictures(swing)
    run, closure = pictures.run, swing.trajectory.mechanism.closure
    assert len(run) == LEVELS * PHASES
    assert max(np.abs(closure.gap(closure.state(q))).max() for q in run.q) < 1e-10
    shape = swing.arrays["shapes"].values[:, 0].real
    moved = run.q[PHASES] - swing.trajectory.q[0]  # a quarter of the amplitude, at phase 0
    assert moved / np.abs(moved).max() == pytest.approx(shape / np.abs(shape).max(), abs=0.05)
    assert pictures.notes == ()


@pytest.mark.slow
def test_a_period_goes_on_without_an_end(solved: Callable[..., Any], shown: Callable[..., Any]) -> None:
    page = shown(solved("gen411_arm_modes"))
    assert page.evaluate("replay.player.seconds()") == 2.0
    page.evaluate(
        "new Promise((done) => { replay.player.seek(6); replay.player.play(); const look = () => {"
        "const now = replay.player.value; if (now < 5) done(); else setTimeout(look, 5); }; look(); })"
    )
    assert page.evaluate("replay.player.playing")
    assert not [event for event in page.events if event["method"] == "Runtime.exceptionThrown"]


def test_a_phase_is_a_place_and_paths_are_refused(solved: Callable[..., Any], tmp_path: Path) -> None:
    result = solved("gen411_arm_modes")
    replay = result.replay(tmp_path / "modes.html")
    assert place(replay.run, "phase = 90 deg") == pytest.approx(np.pi / 2.0)
    with pytest.raises(InputError, match="no paths"):
        result.replay(traces=["com"])
