"""Profiles over a coordinate that rest but for a short piece, as loads, followers and cams, against closed forms."""

import json
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

import pinarm

SIZES = '<limit lower="-1e4" upper="1e4" effort="1e6" velocity="1e3"/>'
BODY = '<inertial><mass value="2"/><inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>'
JOINT = ('<link name="{0}_link">' + BODY + '</link><joint name="{0}" type="{1}"><parent link="{2}"/>'
         f'<child link="{{0}}_link"/><axis xyz="1 0 0"/>{SIZES}</joint>')  # fmt: skip
WHEELS = JOINT.format("wheel", "continuous", "base") + JOINT.format("other", "continuous", "base")
OTHERS = {"none": {}, "held": {"other": {"law": "constant", "value": "0.3 rad"}},
          "turning": {"other": {"law": "constant_speed", "speed": "2 rad/s"}}}  # fmt: skip
"""Motions of a wheel that has nothing to do with it; where it is held, it is not solved for."""


def short(place, width, height):
    """Return a spline that rests but for one of its points, and these."""
    beside = [(place + side * width * k, 0.0) for side in (-1.0, 1.0) for k in range(1, 25)]
    points = sorted([(-1.0, 0.0), *beside, (place, height), (30.0, 0.0)])
    return CubicSpline(*np.array(points).T, bc_type="natural"), points


def law(points, unit):
    return {"law": "spline", "points": [[f"{x!r} rad", f"{y!r} {unit}"] for x, y in points]}


def solved(write, bodies, problem, outputs, mechanism="gravity: none\n"):
    return pinarm.run(write(bodies, mechanism, json.dumps({"kind": "forward", **problem}), outputs))


@pytest.mark.parametrize("other", [OTHERS["held"], OTHERS["turning"]])
def test_a_blow_over_an_angle_takes_its_work(write, other):
    """A wheel of 0.02 kg m^2 at 20 rad/s passes a brake that acts over 0.004 rad: ``I v^2 / 2`` falls by its work."""
    blow, points = short(12.05, 0.002, -800.0)
    loads = {"brake": {"kind": "joint_effort", "joint": "wheel", "over": "wheel", "effort": law(points, "N*m")}}
    problem = {"time": {"end": "1 s", "samples": 3}, "initial": {"velocity": {"wheel": "20 rad/s"}},
               "loads": loads, "motion": other}  # fmt: skip
    result = solved(write, WHEELS, problem, "wheel, joint.wheel.velocity")
    work = float(blow.integrate(0.0, 15.0))
    assert work < -1.0
    assert result["joint.wheel.velocity"].values[-1] == pytest.approx(np.sqrt(400.0 + 2.0 * work / 0.02), rel=1e-5)


@pytest.mark.parametrize("method", ["dop853", "stiff"])
def test_what_swings_past_a_short_blow_and_back_within_a_step_is_hit_every_time(write, method):
    """Eight swings past 9.5 of 10 mrad: ``v = int F(0.01 sin w t) dt / I``, F rises and falls as a cycloid."""
    rests = {"duration": "9.5 mrad", "motion": {"law": "constant", "value": "0 N*m"}}
    blow = [{"duration": "0.1 mrad", "motion": {"law": "cycloidal", "from": low, "to": high, "duration": "0.1 mrad"}}
            for low, high in (("0 N*m", "1 N*m"), ("1 N*m", "0 N*m"))]  # fmt: skip
    loads = {"blow": {"kind": "joint_effort", "joint": "wheel", "over": "other",
                      "effort": {"law": "succession", "segments": [rests, *blow]}}}  # fmt: skip
    swing = {"law": "harmonic", "amplitude": "0.01 rad", "pulsation": f"{160.0 * np.pi!r} rad/s"}
    problem = {"time": {"end": "0.1 s", "samples": 2}, "loads": loads, "motion": {"other": swing}}
    path = write(WHEELS, "gravity: none\n", json.dumps({"kind": "forward", **problem}), "joint.wheel.velocity")
    result = pinarm.run(path, {"accuracy.method": method})

    def effort(phase):
        u = max(0.0, 1.0 - abs(0.01 * np.sin(phase) - 9.6e-3) / 1e-4)
        return u - np.sin(2.0 * np.pi * u) / (2.0 * np.pi)

    ends = np.arcsin([0.95, 0.96, 0.97])
    mean = 2.0 * sum(quad(effort, low, high, epsabs=1e-14)[0] for low, high in pairwise(ends)) / (2.0 * np.pi)
    assert result["joint.wheel.velocity"].values[-1] == pytest.approx(0.1 * mean / 0.02, rel=6e-6)  # 300 steps of 1e-9


def test_a_short_lift_of_a_cam_delays_its_shaft(write):
    """The energy ``(I + m f'^2) w^2 / 2`` stays, so that ``t = int sqrt(1 + m f'^2 / I) / w0``."""
    lift, points = short(7.7, 0.001, 0.0003)
    bodies = JOINT.format("shaft", "continuous", "base") + JOINT.format("lift", "prismatic", "base")
    cam = {"C": {"kind": "cam", "joints": ["shaft", "lift"], "profile": law(points, "m")}}
    problem = {"time": {"end": "1 s", "samples": 3}, "initial": {"velocity": {"shaft": "10 rad/s"}}}
    result = solved(write, bodies, problem, "shaft", f"gravity: none\ncouplings: {json.dumps(cam)}\n")
    knots = [x for x, _ in points if 0.0 < x < 9.0]

    def time(angle):
        pieces = pairwise([0.0, *knots, angle])
        return sum(quad(lambda x: 0.1 * np.sqrt(1.0 + 100.0 * lift(x, 1) ** 2), *piece, epsabs=1e-13)[0]
                   for piece in pieces)  # fmt: skip

    exact = brentq(lambda angle: time(angle) - 1.0, 9.0, 10.0, xtol=1e-12)
    assert exact < 9.996
    assert result["shaft"].values[-1] == pytest.approx(exact, abs=1e-6)


@pytest.mark.parametrize(
    ("other", "turns", "rows", "middle"), [("none", 29, 639, 63.9666), ("held", 400, 801, 63.9666)]
)
def test_the_largest_effort_of_a_blow_in_every_turn_is_found(write, other, turns, rows, middle):
    """A press that needs 10 N m in the middle of 2 deg of every turn, at a steady turn a second."""
    points = [(0.0, 0.0), *((middle + 0.8 * k, -10.0 * (k == 0)) for k in range(-6, 7)), (360.0, 0.0)]
    effort = {"law": "spline", "points": [[f"{x!r} deg", f"{y!r} N*m"] for x, y in points]}
    problem = {"kind": "inverse", "time": {"end": f"{turns} s", "samples": rows},
               "motion": {"wheel": {"law": "constant_speed", "speed": "360 deg/s"}, **OTHERS[other]},
               "loads": {"press": {"kind": "joint_effort", "joint": "wheel", "over": "wheel", "period": "360 deg",
                                   "effort": effort}}}  # fmt: skip
    wheels = WHEELS if OTHERS[other] else JOINT.format("wheel", "continuous", "base")
    result = pinarm.run(write(wheels, "gravity: none\n", json.dumps(problem), "joint.wheel.effort"))
    assert result.number("joint.wheel.effort @ max")[0] == pytest.approx(10.0, rel=1e-12)
    turn = CubicSpline(*np.array(points).T, bc_type="clamped")
    pieces = [quad(lambda x: turn(x) ** 2, *pair, epsabs=1e-12)[0] for pair in pairwise([x for x, _ in points])]
    assert result.number("joint.wheel.effort @ rms")[0] == pytest.approx(np.sqrt(sum(pieces) / 360.0), rel=1e-6)
    if turns != 29:  # as many percentiles are slow
        return
    angles = np.sort(np.concatenate([np.linspace(middle - 6.0, middle + 6.0, 2_000_001), [0.0, 360.0]]))
    heights, lengths = -turn(0.5 * (angles[1:] + angles[:-1])), np.diff(angles)
    order = np.argsort(-heights)
    exact = float(heights[order][np.searchsorted(np.cumsum(lengths[order]), 0.1 * 3.6)])
    value, error = result.number("joint.wheel.effort @ p99.9")
    assert abs(value - exact) <= error + 1e-4  # the samples are 6e-6 deg apart
    assert error < 1e-6


def test_the_largest_power_of_a_blow_over_an_angle_that_a_loop_moves_is_found():
    """10 N m on the rocker of a crank-rocker, over 2e-5 rad of its angle, which follows from two circles."""
    a, b, c, d = 0.1, 0.25, 0.2, 0.3

    def rocker(phi):
        crank = a * np.exp(1j * phi)
        along = d - crank
        length = np.abs(along)
        x = (b**2 - c**2 + length**2) / (2.0 * length)
        return np.angle(crank + along / length * (x + 1j * np.sqrt(b**2 - x**2)) - d)

    drawn = rocker(0.4)
    ends = a * np.exp(0.4j), d + c * np.exp(1j * drawn)
    places = {"O": 0.0, "A": ends[0], "B": ends[1], "C": d}
    links = {"crank": "OA", "coupler": "AB", "rocker": "BC"}
    planar = {
        "points": {name: [f"{np.real(z):.17g} m", f"{np.imag(z):.17g} m"] for name, z in places.items()},
        "ground": ["O", "C"], "links": {k: {"points": [*two], "mass": "1 kg"} for k, two in links.items()},
    }  # fmt: skip
    effort, points = short(float(rocker(1.37) - drawn), 1e-5, 10.0)
    blow = {"kind": "joint_effort", "joint": "C", "over": "C", "effort": law(points, "N*m")}
    result = pinarm.run({
        "pinarm": 1, "title": "Blow", "mechanism": {"pinarm": 1, "title": "Crank-rocker", "planar": planar},
        "problem": {"kind": "inverse", "time": {"end": "2 s", "samples": 41}, "drives": ["O"], "loads": {"blow": blow},
                    "motion": {"O": {"law": "constant_speed", "speed": "6 rad/s"}}},
        "outputs": ["C", "force.blow.effort"],
    })  # fmt: skip
    phi = 0.4 + np.concatenate([6.0 * np.linspace(0.0, 2.0, 400_001), 0.97 + np.linspace(-1e-4, 1e-4, 40_001)])
    speed = 6.0 * (rocker(phi + 1e-6) - rocker(phi - 1e-6)) / 2e-6
    highest = np.max(effort(rocker(phi) - drawn) * speed)
    assert result.number("force.blow.effort*joint.C.velocity @ max")[0] == pytest.approx(highest, rel=1e-6)
    assert result.number("force.blow.effort @ max")[0] == pytest.approx(10.0, rel=1e-9)
