"""A linkage beside one 1000 times as large, or on the same crank, has the motion and the forces that it has alone."""

from math import sqrt

import numpy as np
import pytest

import pinarm
from pinarm.engine.checks.balance import power_balance
from pinarm.records import replace

DENSITY = 1000.0
"""Mass of a linkage over the cube of its size [kg/m^3]: forces of one of 1 mm are 1e-9 of those of one of 1 m."""

PARTS = ("O", "A", "C")
"""Joints of a four-bar: crank and ground, crank and coupler, rocker and ground. It is cut at B."""


def four_bar(k: int, size: float, x: float) -> tuple[dict, dict]:
    """Return points and links: crank 0.1, coupler 0.35, rocker 0.25, ground 0.4, times the size [m], drawn at x [m]."""
    drawn = {"O": (0.0, 0.0), "A": (0.1, 0.0), "B": (0.35, 0.1 * sqrt(6.0)), "C": (0.4, 0.0)}
    points = {f"{name}{k}": [f"{x + size * a!r} m", f"{size * b!r} m"] for name, (a, b) in drawn.items()}
    bars = {"crank": ("OA", 0.1), "coupler": ("AB", 0.35), "rocker": ("BC", 0.25)}
    links = {f"{name}{k}": {"points": [f"{end}{k}" for end in ends], "mass": f"{DENSITY * share * size**3!r} kg"}
             for name, (ends, share) in bars.items()}  # fmt: skip
    return points, links


def run(points: dict, links: dict, outputs: list[str], problem: dict) -> pinarm.Result:
    """Return the result of a problem on a plane mechanism."""
    ground = [name for name in points if name[0] in "OC"]
    planar = {"points": points, "ground": ground, "links": links}
    mechanism = {"pinarm": 1, "planar": planar, "gravity": {"direction": "-y", "magnitude": "9.81 m/s^2"}}
    return pinarm.run({"pinarm": 1, "title": "Sizes", "mechanism": mechanism, "problem": problem, "outputs": outputs})


def turning(size: float, *cranks: str) -> dict:
    """Return the problem of cranks at constant speed."""
    law = {"law": "constant_speed", "speed": "6 rad/s"}
    return {"kind": "inverse", "time": {"end": "1 s", "samples": 21}, "motion": dict.fromkeys(cranks, law)}


def swinging(size: float, *cranks: str) -> dict:
    """Return the free motion from a speed of the cranks, as long as a linkage of this size [m] takes to fall."""
    return {"kind": "forward", "time": {"end": f"{0.5 * sqrt(size)!r} s", "samples": 11},
            "initial": {"velocity": dict.fromkeys(cranks, "6 rad/s")}}  # fmt: skip


def outputs(k: int, parts: tuple[str, ...], *efforts: str) -> list[str]:
    asked = ("position", "acceleration", "force.x", "force.y")
    return [f"joint.{part}{k}.{one}" for part in parts for one in asked] + [f"joint.{one}.effort" for one in efforts]


def require_alike(found: pinarm.Result, alone: pinarm.Result, names: list[str], within: float) -> None:
    """Compare each quantity, relative to the largest value of its kind."""
    for kind in ("position", "acceleration", "force", "effort"):
        own = [name for name in names if kind in name]
        largest = max((np.abs(alone[name].values).max() for name in own), default=0.0)
        for name in own:
            assert found[name].values == pytest.approx(alone[name].values, abs=within * largest), name


@pytest.mark.parametrize(
    ("small", "large", "problem"), [(0.1, 100.0, turning), (1e-3, 1.0, turning), (0.1, 100.0, swinging)]
)
def test_beside_it(small: float, large: float, problem) -> None:
    """By laws to the rounding of places, 1e-14 m at 100 m beside bars of 0.1 mm; free motions to what is left of the
    tolerance of 1e-9 after some hundred steps."""
    (others, heavy), (points, links) = four_bar(1, large, 0.0), four_bar(2, small, large)
    names = outputs(2, PARTS, *(["O2"] if problem is turning else []))
    together = run(others | points, heavy | links, names, problem(small, "O1", "O2"))
    within = 1e-10 if problem is turning else 1e-6
    require_alike(together, run(points, links, names, problem(small, "O2")), names, within)


@pytest.mark.parametrize("small", [0.1])
def test_on_the_same_crank(small: float) -> None:
    """One drive turns both: their rows share a joint, at which forces of the small one are 1e-3 of the others."""
    (points, links), (others, heavy) = four_bar(1, small, 0.0), four_bar(2, 1.0, 0.0)
    del others["O2"], heavy["crank2"]
    crank = {"points": ["O1", "A1", "A2"], "mass": "100 kg", "centre": "O1", "inertia": "1 kg*m^2"}
    names = outputs(1, ("A", "C"))
    together = run(points | others, links | heavy | {"crank1": crank}, names, turning(small, "O1"))
    require_alike(together, run(points, links, names, turning(small, "O1")), names, 1e-10)


@pytest.mark.parametrize("small", [0.1, 1e-3])
@pytest.mark.parametrize("wrong", ["lam", "tau"])
def test_a_wrong_force_in_the_small_one_shows(small: float, wrong: str) -> None:
    """Equilibrium is relative to the terms of each joint: an error of 1e-5 is seen however small these are."""
    (others, heavy), (points, links) = four_bar(1, 1.0, 0.0), four_bar(2, small, 1.0)
    right = run(others | points, heavy | links, ["joint.O2.effort"], turning(small, "O1", "O2")).trajectory
    assert power_balance(right)["equilibrium"] < 2e-14 / small  # places are rounded at 1 m
    values = np.array(getattr(right, wrong))
    # forces grow with the cube of the size, moments with its fourth power: the small ones are below half of that
    values[:, np.abs(values).max(axis=0) < np.sqrt(small) ** 3 * np.abs(values).max()] *= 1.0 + 1e-5
    changed = replace(right, **{wrong: values})
    assert power_balance(changed)["equilibrium"] > 1e-7
