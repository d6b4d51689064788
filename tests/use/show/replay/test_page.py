"""The page as a file: small, soon written, the same bytes each time, with nothing in it that leads out of it."""

import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pinarm.errors import InputError
from pinarm.use.show.replay.page import replay_page
from pinarm.use.store.restore import restore


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("gen411_arm_vertical", {"arrows": ["all"], "traces": ["A", "com"]}),
        ("exoskeleton_leg_knee", {"arrows": ["forces"]}),
        ("manipulator_pressure", {"arrows": ["all"], "plots": []}),
        ("gen411_arm_equilibria", {}),
        pytest.param("panda_quintic", {"traces": ["panda_hand"]}, marks=pytest.mark.slow),
    ],
)
def test_a_result_and_its_folder_give_the_same_bytes(
    solved: Callable[..., Any], tmp_path: Path, name: str, options: dict[str, Any]
) -> None:
    result = solved(name)
    first = result.replay(**options).html
    assert first == result.replay(**options).html
    assert first == restore(result.save(tmp_path / "out", plots=False)).replay(**options).html


def test_size_and_time(solved: Callable[..., Any]) -> None:
    """What the task allows: 1.2 MB and 0.5 s for an arm, 4 MB and 2 s for a Panda; the time with a factor for CI."""
    for name, size, seconds in (("gen411_arm_vertical", 1.2e6, 0.5), ("panda_quintic", 4e6, 2.0)):
        result = solved(name)
        begin = time.perf_counter()
        page = result.replay()
        assert time.perf_counter() - begin < 3 * seconds
        assert len(page.html.encode()) < size


def test_nothing_leads_out_of_the_page(solved: Callable[..., Any]) -> None:
    html = solved("panda_quintic").replay().html
    assert not re.search(r"""(src|href|url|import|fetch)\s*[=(]\s*["']?\s*(https?:|//)""", html)
    assert "default-src 'none'" in html
    assert html.count("<script") == html.count("</script>") == 4


def test_many_rows_are_thinned_but_jumps_and_extremes_stay(
    scenario: Callable[..., Any], read: Callable[..., Any]
) -> None:
    result = scenario("inverse", "", ("samples: 9", "samples: 20001")).run()
    page = read(result.replay(plots=["M"]).html)
    rows, values = page.array(page.scene["rows"]), page.array(page.scene["plots"][0]["values"])
    assert len(rows) < 2500
    assert set(result.trajectory.grid.t[np.array(result.trajectory.grid.rows[:-1])]) <= set(rows)
    assert (values.min(), values.max()) == (result["M"].values.min(), result["M"].values.max())
    swing = scenario("forward", "", ("samples: 23", "samples: 20001")).run()
    page_of_swing = read(swing.replay(plots=["alpha"]).html)
    shown = page_of_swing.array(page_of_swing.scene["plots"][0]["values"])
    assert np.radians([shown.min(), shown.max()]) == pytest.approx(
        [swing["alpha"].values.min(), swing["alpha"].values.max()], abs=1e-15
    )
    assert page.scene["notes"] == [f"{len(rows)} of {len(result)} rows"]


def test_arrows_are_the_forces(solved: Callable[..., Any], read: Callable[..., Any]) -> None:
    """Weight of each body at its centre of mass, torque of each drive, reaction of each joint, to single precision."""
    result = solved("gen411_arm_vertical")
    page = read(result.replay(arrows=["all"], plots=[]).html)
    arrows = {kind: [a for a in page.scene["arrows"] if a["of"] == kind] for kind in ("forces", "torques", "reactions")}
    [weight] = arrows["forces"]  # the first rod has no mass
    assert weight["vector"] == pytest.approx([0.0, -1.6 * 9.81, 0.0], rel=1e-12)
    assert weight["point"] == pytest.approx([(1.0 * 0.125 + 0.1 * 0.25) / 1.6, 0.0, 0.0], abs=1e-12)
    [torque] = [a for a in arrows["torques"] if a["node"] == 2]
    assert page.array(torque["values"]) == pytest.approx(result["C_B"].values, rel=1e-6)
    assert torque["axis"] == [0.0, 0.0, 1.0]
    [reaction] = [a for a in arrows["reactions"] if a["node"] == 2]
    wanted = np.stack([result[f"joint.B.force.{axis}"].values for axis in "xyz"], axis=1)
    assert page.array(reaction["vectors"]).reshape(-1, 3) == pytest.approx(wanted, rel=1e-6, abs=1e-5)
    assert reaction["largest"] == pytest.approx(np.linalg.norm(wanted, axis=1).max(), rel=0.2)  # of both joints


def test_reactions_that_rigid_bodies_do_not_determine_are_not_drawn(
    solved: Callable[..., Any], read: Callable[..., Any]
) -> None:
    """Bricard's loop of six hinges is overconstrained: its self-stress reaches every joint."""
    page = read(solved("bricard_falling").replay(arrows=["reactions"]).html)
    assert page.scene["arrows"] == []


def test_of_planar_loops_the_forces_in_the_plane_are_drawn(
    solved: Callable[..., Any], read: Callable[..., Any]
) -> None:
    """Across the plane a loop of revolute joints can be stressed freely; in it the forces are what is asked by name."""
    result = solved("crank_rocker_turning")
    page = read(result.replay(arrows=["reactions"], plots=[]).html)
    model, across = result.trajectory.mechanism.model, []
    for arrow in page.scene["arrows"]:
        vectors = page.array(arrow["vectors"]).reshape(-1, 3)
        across.append(np.abs(vectors[:, 2]).max())
        if np.any(arrow["point"]):
            continue
        for k, axis in enumerate("xy"):
            wanted = result[f"joint.{model.names[arrow['node']]}.force.{axis}"].values
            assert vectors[:, k] == pytest.approx(wanted, rel=1e-6, abs=1e-5 * arrow["largest"])
    assert len(across) == 4
    assert max(across) < 1e-9
    assert any("that rigid bodies determine" in entry["text"] for entry in page.scene["legend"])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"traces": ["nowhere"]}, "no link 'nowhere'"),
        ({"arrows": ["wind"]}, "no arrows of 'wind'"),
        ({"plots": ["C_X"]}, "no quantity 'C_X'"),
    ],
)
def test_what_is_unknown_is_refused(solved: Callable[..., Any], options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        replay_page(solved("gen411_arm_static"), **options)


def test_kinematics_have_no_forces(solved: Callable[..., Any]) -> None:
    with pytest.raises(InputError, match="asks for no forces"):
        solved("magic_arms_kinematics").replay(arrows=["reactions"])
