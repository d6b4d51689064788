"""Efficiencies of teeth come out of their friction, as the gear loss factor and moments by hand have it."""

import numpy as np
import pytest

import pinarm

ALPHA = np.radians(20.0)
BODY = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
LIMITS = '<limit lower="-1e4" upper="1e4" effort="1e6" velocity="1e3"/>'


def joint(name, at="0 0 0", axis="0 0 1", kind="continuous", parent="base"):
    """Return a joint and its link."""
    return f"""<link name="{name}_link">{BODY}</link><joint name="{name}" type="{kind}"><parent link="{parent}"/>
<child link="{name}_link"/><origin xyz="{at}"/><axis xyz="{axis}"/>{LIMITS}</joint>"""


def addendum_ratios(*teeth, alpha=ALPHA, addendum=1.0):
    """Return the parts of the contact ratio of numbers of teeth, by the angles of the involute at the tips.

    A negative number is that of inner teeth; an infinite one a rack.
    """
    ratios = []
    for z in teeth:
        if np.isinf(z):
            ratios.append(addendum / np.sin(alpha) / (np.pi * np.cos(alpha)))
            continue
        tip = np.arccos(z * np.cos(alpha) / (z + 2.0 * addendum))
        ratios.append(z / (2.0 * np.pi) * (np.tan(tip) - np.tan(alpha)))
    return ratios


def mean_slip(*teeth, **section):
    """Return G in transverse modules: ``p / 2 (1 - e1 - e2 + e1^2 + e2^2)``."""
    e1, e2 = addendum_ratios(*teeth, **section)
    pitch = np.pi * np.cos(section.get("alpha", ALPHA))
    return pitch / 2.0 * (1.0 - e1 - e2 + e1**2 + e2**2)


def driven(write, urdf, coupling, mu, teeth, output="out", load="50 N*m"):
    """Return the result of driving ``turn`` against a load."""
    mechanism = f"""gravity: none
couplings: {{teeth: {coupling}}}
forces: {{load: {{kind: joint_effort, joint: {output}, effort: {{law: constant, value: {load}}}}}}}
friction: {{teeth: {{mu: {mu}, teeth: {teeth}}}}}
"""
    problem = "{kind: inverse, time: {end: 1 s, samples: 2}, motion: {turn: {law: constant_speed, speed: 3 rad/s}}}"
    outputs = "-power.load/joint.turn.power, -power.friction/joint.turn.power, joint.turn.force.y"
    result = pinarm.run(write(urdf, mechanism, problem, outputs))
    assert result.figures["friction"] < 1e-12
    assert result.figures["bodies"] < 1e-12
    efficiency, loss = (result[name].values[0] for name in outputs.split(", ")[:2])
    assert efficiency + loss == pytest.approx(1.0, abs=1e-13)
    return efficiency


SPURS = joint("turn") + joint("out", "0.12 0 0")


@pytest.mark.parametrize(("mu", "beta"), [(0.05, 0.0), (0.1, 20.0)])
def test_the_efficiency_of_spur_and_helical_teeth(write, mu, beta):
    """Teeth 18 and 42: ``1 - mu H_V`` to first order in mu; exactly, with G of the mean slip, as below.

    The moments of the flanks are ``N (rb1 cos beta_b + mu G)`` on the pinion that drives, and
    ``N (rb2 cos beta_b - mu G)`` on the wheel.
    """
    coupling = f"""{{kind: gear, joints: [turn, out], ratio: {-18 / 42!r}, pressure_angle: 20 deg,
  helix_angle: {beta} deg}}"""
    beta = np.radians(beta)
    section = {"alpha": np.arctan(np.tan(ALPHA) / np.cos(beta)), "addendum": np.cos(beta)}
    base = np.arcsin(np.sin(beta) * np.cos(ALPHA))
    levers = np.cos(section["alpha"]) * np.array([18, 42]) / 2.0 * np.cos(base)  # in transverse modules
    mean = mean_slip(18, 42, **section)
    efficiency = driven(write, SPURS, coupling, mu, 18)
    assert efficiency == pytest.approx((1.0 - mu * mean / levers[1]) / (1.0 + mu * mean / levers[0]), rel=1e-12)
    e1, e2 = addendum_ratios(18, 42, **section)
    lost = np.pi * (1 / 18 + 1 / 42) / np.cos(base) * (1.0 - e1 - e2 + e1**2 + e2**2)  # H_V of ISO/TR 14179-2
    assert efficiency == pytest.approx(1.0 - mu * lost, abs=2.0 * (mu * lost) ** 2)


def test_the_band_of_spur_teeth_at_rest(write):
    mu, levers = 0.1, np.cos(ALPHA) * np.array([9.0, 21.0])
    mean = mean_slip(18, 42)
    mechanism = f"""gravity: none
couplings: {{teeth: {{kind: gear, joints: [turn, out], ratio: {-18 / 42!r}, pressure_angle: 20 deg}}}}
forces: {{load: {{kind: joint_effort, joint: out, effort: {{law: constant, value: 50 N*m}}}}}}
friction: {{teeth: {{mu: {mu}, teeth: 18}}}}
"""
    statics = "{kind: statics, hold: {turn: 0 rad}, drives: [turn]}"
    held = pinarm.run(write(SPURS, mechanism, statics, "joint.turn.effort.lower, joint.turn.effort.upper"))
    sides = sorted(abs(held[f"joint.turn.effort.{side}"].values[0]) for side in ("lower", "upper"))
    wanted = [50.0 * (levers[0] - s * mu * mean) / (levers[1] + s * mu * mean) for s in (1.0, -1.0)]
    assert sides == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize("load", [300.0, -300.0])
def test_the_efficiency_of_a_rack(write, load):
    """A pinion of 20 teeth drives, or is driven: the pinion alone turns, ``N (rb1 +- mu G)`` against ``N cos alpha``.

    The load is with the motion where it is positive: the rack then drives, and the friction takes from what arrives.
    """
    mu, lever, mean = 0.08, 10.0 * np.cos(ALPHA), mean_slip(20, np.inf)
    urdf = joint("turn") + joint("out", "0 -0.04 0", "1 0 0", "prismatic")
    coupling = "{kind: rack, joints: [turn, out], radius: 40 mm, pressure_angle: 20 deg}"
    efficiency = driven(write, urdf, coupling, mu, 20, load=f"{load} N")
    part = 1.0 / (1.0 + mu * mean / lever) if load < 0 else 1.0 / (1.0 - mu * mean / lever)
    assert efficiency == pytest.approx(part, rel=1e-12)
    e1, e2 = addendum_ratios(20, np.inf)
    lost = np.pi / 20 * (1.0 - e1 - e2 + e1**2 + e2**2)
    assert efficiency == pytest.approx(1.0 + np.sign(load) * mu * lost, abs=2.0 * (mu * lost) ** 2)


def test_the_efficiency_of_bevel_wheels_is_that_of_their_virtual_spur_wheels(write):
    """Teeth 20 and 40 at 90 deg, a mean radius of 40 mm: cones of ``tan delta1 = 1/2``, virtual teeth z / cos delta.

    By the virtual wheels' moments: ``N cos alpha r (1 +- mu G / rbv)`` on each, with r from its axis.
    """
    mu, cones = 0.07, np.array([np.arctan(0.5), np.arctan(2.0)])
    virtual = np.array([20.0, 40.0]) / np.cos(cones)
    urdf = (
        joint("turn")
        + joint("out", axis="1 0 0")
        + """<link name="face"/><joint name="mark" type="fixed">
<parent link="base"/><child link="face"/><origin xyz="0.04 0 0.08"/></joint>"""
    )
    coupling = "{kind: gear, joints: [turn, out], ratio: -0.5, pressure_angle: 20 deg, plane: face}"
    efficiency = driven(write, urdf, coupling, mu, 20)
    mean, levers = mean_slip(*virtual), np.cos(ALPHA) * virtual / 2.0
    assert efficiency == pytest.approx((1.0 - mu * mean / levers[1]) / (1.0 + mu * mean / levers[0]), rel=1e-12)
    e1, e2 = addendum_ratios(*virtual)
    lost = np.pi * (1.0 / virtual).sum() * (1.0 - e1 - e2 + e1**2 + e2**2)
    assert efficiency == pytest.approx(1.0 - mu * lost, abs=2.0 * (mu * lost) ** 2)


@pytest.mark.parametrize("load", [50.0, -50.0])
def test_the_efficiency_of_a_planetary_gear_follows_from_that_at_rest(write, load):
    """Sun 20, planet 30, ring 80 teeth at rest: ``eta = (1 - i0 eta0^s) / (1 - i0)`` of the way from sun to carrier.

    i0 = -80/20, and eta0 is the efficiency with the carrier at rest, of the way from the sun to the ring, or that of
    the way back; s = 1 where the sun drives. (Niemann, Winter, Maschinenelemente II, section 23.)
    """
    mu, alpha = 0.06, np.radians(25.0)  # so that the parts of the contact ratios are below 1
    urdf = joint("turn") + joint("out") + joint("planet", "0.1 0 0", parent="out_link")
    mechanism = f"""gravity: none
couplings:
  inside: {{kind: gear, joints: [turn, planet], carrier: out, ratio: {-20 / 30!r}, pressure_angle: 25 deg}}
  outside: {{kind: gear, joints: [planet, out], ratio: {-30 / 80!r}, pressure_angle: 25 deg}}
forces: {{load: {{kind: joint_effort, joint: out, effort: {{law: constant, value: {load} N*m}}}}}}
friction: {{inside: {{mu: {mu}, teeth: 20}}, outside: {{mu: {mu}, teeth: 30}}}}
"""
    problem = "{kind: inverse, time: {end: 1 s, samples: 2}, motion: {turn: {law: constant_speed, speed: 3 rad/s}}}"
    outputs = "turn, out, -power.load/joint.turn.power"
    result = pinarm.run(write(urdf, mechanism, problem, outputs))
    assert result["turn"].values == pytest.approx(5.0 * result["out"].values)
    bases, s = np.cos(alpha) * np.array([10.0, 15.0, 40.0]), -np.sign(load)
    inside, outside = (s * mu * mean_slip(*pair, alpha=alpha) for pair in ((20, 30), (30, -80)))
    at_rest = (1.0 - inside / bases[1]) / (1.0 + inside / bases[0])
    at_rest *= (1.0 + outside / bases[2]) / (1.0 + outside / bases[1])
    efficiency = result["-power.load/joint.turn.power"].values
    assert efficiency == pytest.approx((1.0 + 4.0 * at_rest) / 5.0, rel=1e-12)


def test_teeth_that_stick_carry_the_wheels_round_as_one_body(write):
    """A sun and a planet on an arm that is driven: with their friction they neither roll nor creep, ``T / I`` of all.

    Each link has 1 kg and 1 kg m^2, the planet's axis is at 0.1 m.
    """
    urdf = joint("turn") + joint("out") + joint("planet", "0.1 0 0", parent="out_link")
    mechanism = f"""gravity: none
couplings:
  inside: {{kind: gear, joints: [turn, planet], carrier: out, ratio: {-20 / 30!r}, pressure_angle: 20 deg}}
forces: {{load: {{kind: joint_effort, joint: out, effort: {{law: constant, value: 5 N*m}}}}}}
friction: {{inside: {{constant: 1 MN, teeth: 20}}}}
"""
    result = pinarm.run(write(urdf, mechanism, "{kind: forward, time: {end: 2 s, samples: 5}}", "turn, out, planet"))
    turned = 0.5 * 5.0 / 3.01 * result["t"].values ** 2
    for name, value in (("turn", turned), ("out", turned), ("planet", 0.0 * turned)):
        assert result[name].values == pytest.approx(value, abs=1e-9)


def test_a_rack_sticks_below_its_friction_and_slides_above(write):
    """The pinion's friction ``constant * G`` holds the rack up to ``constant G / r`` of force on it."""
    hold = 50.0 * mean_slip(20, np.inf) * 0.004 / 0.04
    urdf = joint("turn") + joint("out", "0 -0.04 0", "1 0 0", "prismatic")
    for part, way in ((0.9, 0.0), (1.3, 0.5 * 0.3 * hold / (1.0 + 1.0 / 0.04**2))):
        mechanism = f"""gravity: none
couplings: {{teeth: {{kind: rack, joints: [turn, out], radius: 40 mm, pressure_angle: 20 deg}}}}
forces: {{load: {{kind: joint_effort, joint: out, effort: {{law: constant, value: {part * hold} N}}}}}}
friction: {{teeth: {{constant: 50 N, teeth: 20}}}}
"""
        result = pinarm.run(write(urdf, mechanism, "{kind: forward, time: {end: 1 s, samples: 3}}", "out"))
        assert result["out"].values[-1] == pytest.approx(way, rel=1e-7, abs=1e-14)
