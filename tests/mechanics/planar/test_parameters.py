"""Parameters of mechanism files: the same drawing in numbers, closed forms, saved results, mistakes."""

import json
import math

import numpy as np
import pytest

import pinarm
from pinarm.errors import InputError
from pinarm.use.mechanism import Mechanism

FILE = """pinarm: 1
title: Five-bar
parameters: {l1: 200 mm, l2: 300 mm, d: 250 mm, alpha: 120 deg, rho: 2 kg/m, c: 5 N*m, half: 0.5*d}
planar:
  points:
    A: [0, 0]
    E: [d, 0]
    B: [l1*cos(alpha), l1*sin(alpha)]
    D: [d - l1*cos(alpha), l1*sin(alpha)]
    P: [half, l1*sin(alpha) + sqrt(l2**2 - (half - l1*cos(alpha))**2)]
  ground: [A, E]
  links:
    left: {points: [A, B], mass: rho*l1}
    right: {points: [E, D], mass: rho*l1}
    forearm: {points: [B, P], mass: rho*l2}
    other: {points: [D, P], mass: rho*l2}
points: {tool: {link: forearm, at: [0, l2/3, half]}}
forces: {spring: {kind: joint_spring, joint: A, stiffness: 2*c}}
"""
SCENARIO = """pinarm: 1
mechanism: mechanism.yaml
problem:
  kind: kinematics
  time: {end: 1 s, samples: 3}
  motion: {A: {law: constant, value: 0 rad}, E: {law: constant, value: 0 rad}}
outputs: [point.P.position.y, half, 2*l1]
"""
SENSITIVITY = """\
sensitivity: {of: [point.P.position.y @ max], to: {l1: 0.1 mm, alpha: 0.1 deg, changes.planar.points.A.0: 0.1 mm}}
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "mechanism.yaml").write_text(FILE)
    (tmp_path / "scenario.yaml").write_text(SCENARIO)
    return tmp_path


def in_numbers(l1=0.2, l2=0.3, d=0.25, alpha=2.0 * math.pi / 3.0, c=5.0, half=None):
    """Return the file as a user would write it without parameters."""
    half, x, y = 0.5 * d if half is None else half, l1 * math.cos(alpha), l1 * math.sin(alpha)
    places = {"A": (0.0, 0.0), "E": (d, 0.0), "B": (x, y), "D": (d - x, y)}
    places["P"] = half, y + math.sqrt(l2**2 - (half - x) ** 2)
    links = {"left": ("AB", l1), "right": ("ED", l1), "forearm": ("BP", l2), "other": ("DP", l2)}
    return {
        "pinarm": 1,
        "planar": {
            "points": {name: [f"{x!r} m", f"{y!r} m"] for name, (x, y) in places.items()}, "ground": ["A", "E"],
            "links": {name: {"points": [*ends], "mass": f"{2.0 * size!r} kg"} for name, (ends, size) in links.items()},
        },
        "points": {"tool": {"link": "forearm", "at": [0, f"{l2 / 3!r} m", f"{half!r} m"]}},
        "forces": {"spring": {"kind": "joint_spring", "joint": "A", "stiffness": f"{2.0 * c!r} N*m/rad"}},
    }  # fmt: skip


@pytest.mark.parametrize(("given", "values"), [
    ({}, {}), ({"l1": "210 mm", "alpha": 2.0}, {"l1": 0.21, "alpha": 2.0}), ({"half": "120 mm"}, {"half": 0.12}),
    ({"d": 0.24, "c": "6 N*m"}, {"d": 0.24, "c": 6.0}),
])  # fmt: skip
def test_a_file_with_parameters_is_the_file_in_numbers(folder, given, values):
    (folder / "numbers.yaml").write_text(json.dumps(in_numbers(**values)))
    found, expected = Mechanism.load(folder / "mechanism.yaml", given), Mechanism.load(folder / "numbers.yaml")
    q = np.random.default_rng(0).normal(size=4)
    assert found.mass_matrix(q) == pytest.approx(expected.mass_matrix(q), abs=1e-14)
    for name in ("P", "P_other", "tool"):
        assert found.frame(name, q) == pytest.approx(expected.frame(name, q), abs=1e-14)
    q = expected.close({"A": 0.1, "E": -0.1})
    torques = [one.inverse(q, np.zeros(4), np.zeros(4), drives=["A", "E"]) for one in (found, expected)]
    assert torques[0] == pytest.approx(torques[1], abs=1e-12)


def test_sweeps_and_sensitivities_vary_a_parameter(folder):
    """Height of the tip: ``y + sqrt(l2^2 - (d/2 - x)^2)``, differentiated by hand."""
    l1, l2, half, (x, y) = 0.2, 0.3, 0.125, (0.2 * math.cos(2 * math.pi / 3), 0.2 * math.sin(2 * math.pi / 3))
    root = math.sqrt(l2**2 - (half - x) ** 2)
    over = {"arguments.l1": "190:210:3"}
    swept = pinarm.sweep(folder / "scenario.yaml", over, results="point.P.position.y @ max", workers=1)
    lengths = np.array([0.19, 0.2, 0.21])
    expected = lengths * y / l1 + np.sqrt(l2**2 - (half - lengths * x / l1) ** 2)
    assert swept["point.P.position.y @ max"].values == pytest.approx(expected, abs=1e-12)
    (folder / "scenario.yaml").write_text(SCENARIO + SENSITIVITY)
    result = pinarm.run(folder / "scenario.yaml")
    slopes = {"l1": y / l1 + (half - x) / root * x / l1, "alpha": x + (half - x) / root * -y}
    slopes["changes.planar.points.A.0"] = 0.0  # the crank keeps its angle: it is longer, and turned back in the drawing
    numbers = result.sections["sensitivity"].numbers
    for name, slope in slopes.items():
        assert numbers[f"point_P_position_y_max.by.{name}"].values == pytest.approx(slope, abs=1e-8), name


def test_a_saved_result_knows_its_parameters(folder):
    result = pinarm.run(folder / "scenario.yaml", {"arguments.d": "240 mm"})
    saved = result.save(folder / "saved", plots=False)
    assert pinarm.restore(saved)["half + 2*l1"].values == pytest.approx(0.52, abs=1e-15)
    with pinarm.file_root(folder):
        again = pinarm.run(saved / "scenario.yaml")
    assert again["point.P.position.y"].values == pytest.approx(result["point.P.position.y"].values, abs=0.0)
    assert again["half"].values == pytest.approx(0.12, abs=1e-15)


@pytest.mark.parametrize(("old", "new", "said"), [
    ("E: [d, 0]", "E: [dd, 0]", r":7:9: unknown name 'dd'(.|\n)*expected: one of alpha, c, d"),
    ("E: [d, 0]", "E: [2*rho, 0]", "'kg/m' is not a unit"),
    ("E: [d, 0]", "E: [3 mmm, 0]", r"unknown unit 'mmm'(.|\n)*try: mm"),
    ("l1: 200 mm", "l1: 2*d", ":3:18: unknown name 'd'"),
    ("l1: 200 mm", "pi: 200 mm", r":3:14: 'pi' cannot be in a formula"),
    ("forces:", "symbols: {l1: 2 m}\nforces:", r":3:14: 'l1' is a symbol"),
])  # fmt: skip
def test_mistakes_are_told_with_their_place(folder, old, new, said):
    (folder / "mechanism.yaml").write_text(FILE.replace(old, new))
    with pytest.raises(InputError, match=said):
        Mechanism.load(folder / "mechanism.yaml")


@pytest.mark.parametrize(("given", "said"), [
    ({"l1": "3 kg"}, "the argument l1: 'kg' is not a unit"), ({"l3": 1.0}, "no argument 'l3'(.|\n)*one of alpha, c, d"),
])  # fmt: skip
def test_values_that_do_not_fit_are_refused(folder, given, said):
    with pytest.raises(InputError, match=said):
        Mechanism.load(folder / "mechanism.yaml", given)
