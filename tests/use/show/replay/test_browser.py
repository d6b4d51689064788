"""The page in a real browser: silent, alone, right to 1e-6, and worth looking at."""

import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from _pytest.mark import ParameterSet

from pinarm.use.facade import Result
from pinarm.use.show.replay.chromium import Page, browser

EXACT = 1e-6
"""Metres and radians. The page computes in doubles, so that 1e-12 is usual."""

RESULTS = ("panda_quintic", "gyroscope_free", "andrews_squeezing", "gen411_arm_equilibria")


def quick(names: Iterable[str], *fast: str) -> list[ParameterSet]:
    """Return names as parameters, slow ones but for some: a browser without graphics card takes seconds each."""
    return [pytest.param(name, marks=() if name in fast else pytest.mark.slow) for name in names]


def placements(result: Result, row: int) -> np.ndarray:
    """Placements of all joints in the world at one row by Pinocchio, shape (njoints, 4, 4)."""
    model = result.trajectory.mechanism.model
    data = model.createData()
    pin.forwardKinematics(model, data, result.trajectory.q[row])
    return np.array([place.homogeneous for place in data.oMi])


def seen(page: Page, value: float) -> np.ndarray:
    """The same in the page."""
    page.evaluate(f"replay.show({value!r})")
    return np.array(page.evaluate("replay.placements()")).reshape(-1, 4, 4).transpose(0, 2, 1)


def complaints(page: Page) -> list[dict[str, Any]]:
    """Console messages, exceptions and log entries, but for the driver's remark that a screenshot makes it wait."""
    kinds = ("Runtime.consoleAPICalled", "Runtime.exceptionThrown", "Log.entryAdded")
    found = [event for event in page.events if event["method"] in kinds]
    return [event for event in found if "GPU stall due to ReadPixels" not in str(event)]


@pytest.mark.parametrize("name", quick(RESULTS, "andrews_squeezing"))
def test_bodies_are_where_pinocchio_has_them(solved: Callable[..., Any], shown: Callable[..., Any], name: str) -> None:
    result = solved(name)
    page, t = shown(result, arrows=["all"], traces=["com"]), result.trajectory.grid.t
    for row in np.unique(np.linspace(0, len(t) - 1, 5).astype(int)):
        right = [k for k in range(len(t)) if t[k] == t[row]][-1]  # at a jump the page shows the later side
        assert seen(page, float(t[row])) == pytest.approx(placements(result, right), abs=EXACT)
    assert complaints(page) == []
    requests = [event["params"]["request"]["url"] for event in page.events
                if event["method"] == "Network.requestWillBeSent"]  # fmt: skip
    assert [url.split(":")[0] for url in requests] == ["file"]


@pytest.mark.slow
def test_between_two_rows_joints_turn_evenly(solved: Callable[..., Any], shown: Callable[..., Any]) -> None:
    """Half way every joint has turned by half, and no rod has changed its length."""
    result = solved("manipulator_motion")
    run, model = result.trajectory, result.trajectory.mechanism.model
    data, row = model.createData(), len(result) // 3
    pin.forwardKinematics(model, data, (run.q[row] + run.q[row + 1]) / 2)
    middle = float(run.grid.t[row] + run.grid.t[row + 1]) / 2
    wanted = np.array([place.homogeneous for place in data.oMi])
    assert seen(shown(result), middle) == pytest.approx(wanted, abs=EXACT)


@pytest.mark.slow
def test_a_free_body_and_a_slide_are_placed_too(shown: Callable[..., Any], tmp_path: Path) -> None:
    import pinarm

    (tmp_path / ".pinarm-root").touch()
    link = ('<link name="{0}"><inertial><mass value="1"/><inertia ixx=".1" iyy=".2" izz=".15" ixy="0" ixz="0" iyz="0"/>'
            "</inertial></link>")  # fmt: skip
    (tmp_path / "free.urdf").write_text(
        '<robot name="free"><link name="world"/>' + link.format("body") + link.format("block")
        + '<joint name="free" type="floating"><parent link="world"/><child link="body"/><origin xyz="1 2 3" '
        'rpy="0.1 0.2 0.3"/></joint><joint name="s" type="prismatic"><parent link="body"/><child link="block"/>'
        '<origin xyz="0.1 0 0" rpy="0 0.5 0"/><axis xyz="1 1 0"/><limit lower="-9" upper="9" effort="1" velocity="1"/>'
        "</joint></robot>"
    )  # fmt: skip
    (tmp_path / "free.yaml").write_text(
        "pinarm: 1\nmechanism: free.urdf\nproblem: {kind: forward, time: {end: 0.5 s, samples: 21}, "
        "initial: {velocity: {s: 2 m/s}}}\noutputs: [s]\n"
    )
    result = pinarm.load(tmp_path / "free.yaml").run()
    page = shown(result, traces=["com", "block"])
    for row in (0, 7, 20):
        assert seen(page, float(result.trajectory.grid.t[row])) == pytest.approx(placements(result, row), abs=EXACT)
    assert complaints(page) == []


def press(page: Page, key: str, **more: Any) -> None:
    page.call("Input.dispatchKeyEvent", type="keyDown", key=key, **more)
    page.call("Input.dispatchKeyEvent", type="keyUp", key=key)


@pytest.mark.slow
def test_keys_move_it(solved: Callable[..., Any], shown: Callable[..., Any]) -> None:
    result = solved("exoskeleton_leg_knee")
    t, page = np.unique(result.trajectory.grid.t), shown(result)

    def value() -> float:
        return float(page.evaluate("replay.player.value"))

    press(page, "ArrowRight")
    assert value() == t[1]
    press(page, "ArrowRight", modifiers=8)  # with shift
    assert value() == t[11]
    press(page, "ArrowLeft")
    assert value() == t[10]
    press(page, "End")
    assert value() == t[-1]
    press(page, "Home")
    assert value() == t[0]
    page.evaluate("document.getElementById('loop').checked = false")
    press(page, "ArrowUp")
    assert page.evaluate("document.getElementById('speed').value") == "2"
    press(page, " ")
    time.sleep(0.4)
    press(page, " ")
    there = value()
    assert 0.2 < there < t[-1]  # at twice the speed of the clock, less a slow first picture
    time.sleep(0.1)
    assert value() == there


def test_plots_follow_and_lead(solved: Callable[..., Any], shown: Callable[..., Any]) -> None:
    """The cursor stands at the value and says the quantity there; a press on the plot goes there."""
    result = solved("gen411_arm_static")
    page, t = shown(result, plots=["C_B"]), result.trajectory.grid.t
    page.evaluate(f"replay.show({float(t[60])!r})")
    assert (
        page.evaluate("document.querySelector('figcaption output').textContent")
        == f"{result['C_B'].values[60]:.4g} N·m"
    )
    assert page.evaluate("document.getElementById('now').textContent") == "φ = −30.0°"
    box = page.evaluate(
        "(() => { const c = document.querySelector('figure .grid').getBoundingClientRect();"
        "const l = document.querySelector('figure .cursor').getBoundingClientRect();"
        "return [c.left, c.right, c.top, l.left]; })()"
    )
    assert (box[3] - box[0]) / (box[1] - box[0]) == pytest.approx(60 / 240, abs=0.01)
    middle = (box[0] + box[1]) / 2
    page.call(
        "Input.dispatchMouseEvent", type="mousePressed", x=middle, y=box[2], button="left", buttons=1, clickCount=1
    )
    page.call("Input.dispatchMouseEvent", type="mouseReleased", x=middle, y=box[2], button="left", clickCount=1)
    assert page.evaluate("replay.player.value") == pytest.approx(0.0, abs=0.01)


@pytest.mark.slow
def test_without_webgl_the_page_says_so_and_plots_go_on(
    solved: Callable[..., Any], tmp_path: Path, _browser: Page
) -> None:
    path, names = tmp_path / "replay.html", ["C_B", "F_By"]
    solved("gen411_arm_static").replay(path, plots=names)
    with browser("--disable-3d-apis") as page:
        page.open(path, "#t=0")
        assert "no 3D graphics: WebGL is missing" in page.evaluate("document.getElementById('view').innerText")
        assert page.evaluate("document.querySelectorAll('figure path').length") == len(names)
        assert complaints(page) == []


@pytest.mark.slow
def test_it_works_in_a_notebook_cell(solved: Callable[..., Any], shown: Callable[..., Any]) -> None:
    cell = solved("gen411_arm_static").replay()._repr_html_()
    frame = "document.querySelector('iframe').contentWindow"
    page = shown(
        f"<!doctype html><body>{cell}<script>document.querySelector('iframe').onload = async () => {{"
        f"while (!{frame}.replay) await new Promise((done) => setTimeout(done, 20));"
        "document.documentElement.dataset.ready = 'yes'; }</script>"
    )
    assert page.evaluate(f"{frame}.replay.placements().length") == 3
    assert complaints(page) == []


def test_names_from_files_are_text(scenario: Callable[..., Any], folder: Path, shown: Callable[..., Any]) -> None:
    evil = "</script><script>document.title='caught'</script><!--<script <img src=x onerror=alert()>{{scene}}"
    (folder / "pendulum.urdf").write_text((folder / "pendulum.urdf").read_text().replace(
        '"tip"', '"&lt;/script&gt;&lt;img src=x onerror=document.title=1&gt;"'))  # fmt: skip
    result = scenario("statics", f'symbols: {{"{evil}": 2*alpha}}\n', ("[M,", f'["{evil}", M,'),
                      ("A pendulum, held", evil)).run()  # fmt: skip
    page = shown(result, traces=["</script><img src=x onerror=document.title=1>"])
    assert page.evaluate("document.title") == evil
    assert page.evaluate("document.querySelector('figcaption span').textContent").startswith(evil)
    assert page.evaluate("document.images.length") == 0
    assert complaints(page) == []


@pytest.mark.slow
def test_the_key_n_names_points_where_they_are(solved: Callable[..., Any], shown: Callable[..., Any]) -> None:
    """Beside its point by the camera of the page, at several instants; hidden at first, hidden again by the key."""
    result = solved("slider_crank_gas")
    page = shown(result)
    layer = "getComputedStyle(document.getElementById('names')).display"
    assert page.evaluate(layer) == "none"
    press(page, "n")
    assert page.evaluate(layer) == "block"
    texts = page.evaluate("Array.from(document.querySelectorAll('#names span'), (span) => span.textContent)")
    assert set(texts) == {"O, θ", "A", "G3", "B3, B, x", "crank", "rod", "piston"}
    model, q = result.trajectory.mechanism.model, result.trajectory.q
    for row in (10, 100, 333):
        data = model.createData()
        pin.framesForwardKinematics(model, data, q[row])
        wanted = data.oMf[model.getFrameId("A", pin.FrameType.BODY)].translation.tolist()
        page.evaluate(f"replay.show({float(result.trajectory.grid.t[row])!r})")
        x, y = page.evaluate(
            f"(() => {{ const p = new replay.view.THREE.Vector3(...{wanted})"
            ".applyMatrix4(replay.view.world.matrixWorld).project(replay.view.viewer.camera);"
            "const box = document.getElementById('names').getBoundingClientRect();"
            "return [box.left + (p.x + 1) / 2 * box.width, box.top + (1 - p.y) / 2 * box.height]; })()"
        )
        left, top, bottom = page.evaluate(
            "(() => { const box = Array.from(document.querySelectorAll('#names span'))"
            ".find((span) => span.textContent === 'A').getBoundingClientRect();"
            "return [box.left, box.top, box.bottom]; })()"
        )
        assert x < left < x + 20  # pixels
        assert abs((top + bottom) / 2 - y) < 40
    press(page, "n")
    assert page.evaluate(layer) == "none"
    assert complaints(page) == []
