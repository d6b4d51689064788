"""Arrows are the forces, torques and reactions of the result; what joins two points reaches from one to the other."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinarm
from pinarm.errors import InputError


def test_arrows_are_the_forces(solved: Callable[..., Any], read: Callable[..., Any]) -> None:
    """Weight of each body at its centre of mass, torque of each drive, reaction of each joint, to single precision."""
    result = solved("gen411_arm_vertical")
    page = read(result.replay(arrows=["all"], plots=[]).html)
    arrows = {kind: [a for a in page.scene["arrows"] if a["of"] == kind] for kind in ("forces", "torques", "reactions")}
    [weight] = arrows["forces"]  # the first rod has no mass
    assert page.array(weight["vectors"])[:3] == pytest.approx([0.0, -1.6 * 9.81, 0.0], rel=1e-6)
    assert weight["point"] == pytest.approx([(1.0 * 0.125 + 0.1 * 0.25) / 1.6, 0.0, 0.0], abs=1e-12)
    [torque] = [a for a in arrows["torques"] if a["node"] == 2]
    wanted = np.outer(result["C_B"].values, [0.0, 0.0, 1.0])
    assert page.array(torque["vectors"]).reshape(-1, 3) == pytest.approx(wanted, rel=1e-6, abs=1e-6)
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


def test_kinematics_have_no_forces(solved: Callable[..., Any]) -> None:
    with pytest.raises(InputError, match="asks for no forces"):
        solved("magic_arms_kinematics").replay(arrows=["reactions"])


def test_springs_and_cylinders_join_their_points(picture: Callable[..., Any], chain: Callable[..., str]) -> None:
    xml = chain({"name": "a", "axis": "0 1 0"}, {"name": "b", "axis": "0 1 0", "at": "0 0 3", "com": "0 0 1"})
    scene, _ = picture(xml, forces="{s: {kind: point_spring, between: [base, b_link], stiffness: 1 N/m}, "
                                   "c: {kind: point_spring, between: [base, b_link], force: -5 N}}")  # fmt: skip
    assert [(pair["kind"], pair["a"]["node"], pair["b"]["node"]) for pair in scene["pairs"]] == [
        ("spring", 0, 2), ("cylinder", 0, 2),
    ]  # fmt: skip
    assert scene["pairs"][0]["longest"] == pytest.approx(3.0)


def test_a_cable_that_does_not_stretch_pulls_at_all_its_points(
    solved: Callable[..., Any], read: Callable[..., Any]
) -> None:
    """Atwood's machine: ``S = 2 m1 m2 g / (m1 + m2)`` at both weights, along both parts at pulleys; then slack."""
    result = solved("counterweighted_door_falling")
    page = read(result.replay(arrows=["reactions"], plots=[]).html)
    cable = [arrow for arrow in page.scene["arrows"] if arrow["of"] == "reactions"][-4:]
    tension, t = 2.0 * 40.0 * 35.0 / 75.0 * 9.81, result["t"].values
    falling = t < 1.23  # until sqrt(2 0.5 m / 0.654 m/s^2)
    up, right = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])
    for arrow, pull in zip(cable, [up, right - up, -right - up, up], strict=True):
        vectors = page.array(arrow["vectors"]).reshape(-1, 3)
        assert vectors[falling] == pytest.approx(np.tile(tension * pull, (falling.sum(), 1)), rel=1e-6, abs=1e-5)
        assert np.abs(vectors[np.abs(t - 1.3) < 0.05]).max() < 1e-9
    assert [arrow["node"] == 0 for arrow in cable] == [False, True, True, False]


def test_a_slot_has_an_outline_around_the_way_of_its_pin(tmp_path: Path, read: Callable[..., Any]) -> None:
    """O turns A by 40 degrees; the pin B of the rod of 0.5 m stays at x = 0.3 m: half an outline at each end."""
    (tmp_path / ".pinarm-root").touch()
    (tmp_path / "m.yaml").write_text(
        "pinarm: 1\nplanar:\n  points: {O: [0, 0], A: [0, 0.4 m], B: [0.3 m, 0], Y: [0.3 m, 1 m]}\n  ground: [O, Y]\n"
        "  links: {crank: {points: [O, A]}, rod: {points: [A, B], mass: 1 kg}}\n"
        "  slots: {s: {link: rod, point: B, along: [B, Y]}}\n"
    )
    (tmp_path / "s.yaml").write_text(
        "pinarm: 1\nmechanism: m.yaml\nproblem:\n  kind: kinematics\n  time: {end: 1 s, samples: 21}\n"
        "  motion: {O: {law: constant_speed, speed: -40 deg/s}}\noutputs: [O]\n"
    )
    scene = read(pinarm.run(tmp_path / "s.yaml").replay().html).scene
    [slot], [pair] = scene["slots"], scene["pairs"]
    x, y, _ = np.transpose(slot["points"])
    turned = np.deg2rad(np.linspace(0.0, -40.0, 21))
    arm = 0.4 * np.stack([-np.sin(turned), np.cos(turned)])
    pin = arm[1] - np.sqrt(0.25 - (0.3 - arm[0]) ** 2)
    half = (x.max() - x.min()) / 2
    assert slot["node"] == 0 != pair["b"]["node"]
    assert (x.max() + x.min()) / 2 == pytest.approx(0.3, abs=1e-9)
    assert [y.min(), y.max()] == pytest.approx([pin.min() - 3 * half, pin.max() + 3 * half], abs=1e-9)
