"""Drawings against the same mechanisms as URDF files: the same torques and reactions; and against closed forms."""

from pathlib import Path
from typing import Any

import numpy as np

import pinarm

MODELS = Path(pinarm.__file__).parents[1] / "models"

SAME = 1e-12
"""Relative difference of two routes: rounding, larger by the condition of the loops."""

FOUR_BAR = f"""\
pinarm: 1
planar:
  points:
    O2: [0, 0]
    A: [100 mm, 0]
    B: [350 mm, {0.06**0.5!r} m]
    O4: [400 mm, 0]
    G3: [225 mm, {0.06**0.5 / 2!r} m]
  ground: [O2, O4]
  links:
    crank: {{points: [O2, A], mass: 1 kg}}
    coupler: {{points: [A, B], mass: 3.5 kg, centre: G3, inertia: {3.5 * 0.35**2 / 12!r} kg*m^2}}
    rocker: {{points: [B, O4], mass: 2.5 kg}}
"""
"""The crank-rocker at theta2 = 0: B is 0.35 m from A and 0.25 m from O4; its bars are uniform rods."""

TURNING = {
    "kind": "inverse", "time": {"end": "0.6 s", "samples": 61},
    "motion": {"O2": {"law": "constant_speed", "speed": "100 rpm"}}, "drives": ["O2"],
}  # fmt: skip

SLIDER_CRANK = """\
pinarm: 1
gravity: none
planar:
  points: {O: [0, 0], A: [45 mm, 0], G: [90 mm, 0], B: [190 mm, 0]}
  ground: [O]
  links:
    crank: {points: [O, A], mass: 1 kg, centre: O, inertia: 0.012 kg*m^2}
    rod: {points: [A, B], mass: 0.65 kg, centre: G, inertia: 0.0019 kg*m^2}
    piston: {points: [B], mass: 0.55 kg}
  sliders:
    x: {link: piston, along: [O, B]}
"""


def solved(folder: Path, mechanism: str, problem: dict[str, Any], outputs: list[str]) -> pinarm.Result:
    import yaml

    (folder / "mechanism.yaml").write_text(mechanism)
    scenario = {"pinarm": 1, "mechanism": "mechanism.yaml", "problem": problem, "outputs": outputs}
    (folder / "scenario.yaml").write_text(yaml.safe_dump(scenario))
    return pinarm.run(folder / "scenario.yaml")


def compared(drawn: pinarm.Result, model: pinarm.Result, names: dict[str, str]) -> None:
    for here, there in names.items():
        other = model[there].values
        scale = np.abs(other).max()
        assert scale > 0.0
        np.testing.assert_allclose(drawn[here].values, other, rtol=0, atol=SAME * scale, err_msg=here)


def test_a_four_bar_is_that_of_the_urdf_file(tmp_path: Path) -> None:
    names = {
        "joint.O2.effort": "T", "joint.O2.force.x": "joint.theta2.force.x", "joint.O2.force.y": "joint.theta2.force.y",
        "joint.A.force.x": "joint.A.force.x", "joint.A.force.y": "joint.A.force.y", "loop.B.force.x": "loop.B.force.x",
        "loop.B.force.y": "loop.B.force.y", "joint.O4.force.x": "joint.theta4.force.x", "point.G3.velocity.x":
        "point.G3.velocity.x", "joint.O4.velocity": "omega4",
    }  # fmt: skip
    drawn = solved(tmp_path, FOUR_BAR, TURNING, ["O2"])
    model = pinarm.run(MODELS.parent / "scenarios" / "crank_rocker_turning.yaml", {"problem.time.samples": 61})
    compared(drawn, model, names)


def test_whichever_pin_closes_the_loop_it_does_what_the_others_do(tmp_path: Path) -> None:
    """With O4 drawn first, A closes the loop in place of B: other equations for one dry machine with a spring at B."""
    dry = "".join(f"  {pin}: {{mu: 0.1, radius: 12 mm}}\n" for pin in ("O2", "A", "B", "O4"))
    last = "    O4: [400 mm, 0]\n"
    first = FOUR_BAR.replace(last, "").replace("  points:\n", f"  points:\n{last}", 1)
    problem = {**TURNING, "time": {"end": "0.6 s", "samples": 7}}
    results = []
    for closes, text, angle in (("B", FOUR_BAR, "B.angle"), ("A", first, "B")):
        spring = f"forces: {{S: {{kind: coordinate_spring, coordinate: {angle}, stiffness: 40 N*m/rad}}}}\n"
        (tmp_path / closes).mkdir()
        results.append(solved(tmp_path / closes, f"{text}friction:\n{dry}{spring}", problem, ["O2", angle]))
        assert {*results[-1].scenario.mechanism.closure.slices} == {closes}
    names = {"joint.O2.effort": "joint.O2.effort", "joint.A.friction": "loop.A.friction", "joint.O2.friction":
             "joint.O2.friction", "joint.O4.friction": "joint.O4.friction"}  # fmt: skip
    compared(*results, names)
    for here, there in (("B.angle", "B"), ("loop.B.friction", "joint.B.friction")):
        np.testing.assert_allclose(
            np.abs(results[0][here].values), np.abs(results[1][there].values), rtol=0, atol=1e-12
        )


def test_a_slider_crank_is_that_of_the_urdf_file(tmp_path: Path) -> None:
    motion = {"law": "constant_speed", "speed": "3000 rpm"}
    turning = {**TURNING, "time": {"end": "20 ms", "samples": 41}, "motion": {"O": motion}, "drives": ["O"]}
    drawn = solved(tmp_path, SLIDER_CRANK, turning, ["x"])
    model = pinarm.run(
        MODELS.parent / "scenarios" / "slider_crank_gas.yaml",
        {"problem.time": {"end": "20 ms", "samples": 41}, "problem.loads": {}, "outputs": ["C"], "expect": []},
    )
    names = {"joint.O.effort": "C", "joint.x.force.y": "N", "x": "x - r - L", "joint.x.acceleration": "xdd"}
    names |= {"loop.B.force.x": "loop.B.force.x", "joint.A.force.y": "joint.A.force.y"}
    compared(drawn, model, names)


TRAMMEL = """\
pinarm: 1
planar:
  points: {C: [0, 0], P: [3 m, 0], Q: [0, 4 m], X: [1 m, 0], Y: [0, 1 m]}
  ground: [C]
  links:
    foot: {points: [P]}
    rod: {points: [P, Q], mass: 2 kg}
  sliders: {x: {link: foot, along: [C, X]}}
  slots: {y: {link: rod, point: Q, along: [C, Y]}}
"""


def test_a_ladder_in_a_slot_is_held_by_its_closed_form(tmp_path: Path) -> None:
    """Of the elliptic trammel: the foot is pushed with F = m g x / (2 y), the wall carries the same."""
    problem = {"kind": "statics", "over": {"x": {"from": "0 m", "to": "1 m", "samples": 11}}, "drives": ["x"]}
    drawn = solved(tmp_path, TRAMMEL, problem, ["x"])
    x = drawn["x"].values + 3.0
    force = 2 * 9.81 * x / (2 * np.sqrt(25 - x**2))
    np.testing.assert_allclose(drawn["joint.x.effort"].values, -force, rtol=1e-11)  # the loop's condition
    np.testing.assert_allclose(drawn["loop.y.force.x"].values, force, rtol=1e-11)
    np.testing.assert_allclose(drawn["point.Q.position.x"].values, 0.0, atol=1e-14)
