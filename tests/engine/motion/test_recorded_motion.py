"""Directions in recorded motions: friction and losses of gears where joints rest and turn back, by closed forms."""

import json

import numpy as np
import pytest

import pinarm

LINK = """<robot name="one"><link name="base"/><link name="load"><inertial><origin xyz="{arm} 0 0"/><mass value="1"/>
<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="x" type="continuous"><parent link="base"/><child link="load"/><axis xyz="0 -1 0"/>{more}</joint></robot>"""


def mechanism(tmp_path, arm=0.0, more="", **keys):
    (tmp_path / "one.urdf").write_text(LINK.format(arm=arm, more=more))
    path = tmp_path / "mechanism.yaml"
    path.write_text(json.dumps({"pinarm": 1, "robot": "one.urdf", **keys}))
    return pinarm.Mechanism.load(path)


def recorded(mechanism, output, t, q, *rates):
    """Run rows with given v and a, or with those of a spline."""
    rates = [x[:, None] for x in rates]
    return mechanism.result(t, q[:, None], *rates, derivatives="given" if rates else "spline", outputs=[output])


def rest_to_rest(t, begin, duration, way):
    """The polynomial of degree 5 between two rests: q, v, a."""
    x = np.clip((t - begin) / duration, 0.0, 1.0)
    q, v, a = 10 * x**3 - 15 * x**4 + 6 * x**5, 30 * (x * (1 - x)) ** 2, 60 * x * (1 - x) * (1 - 2 * x)
    return way * q, way * v / duration, way * a / duration**2


@pytest.fixture
def flywheel(tmp_path):
    """0.02 kg m^2 with 0.7 N m of friction, without gravity."""
    return mechanism(tmp_path, more='<dynamics friction="0.7" damping="0.1"/>', gravity="none")


@pytest.fixture
def lifting(tmp_path):
    """1 kg at 0.2 m behind a gear 10 : 1 that passes on a half, with a rotor of 1e-5 kg m^2."""
    drive = {"joint": "x", "ratio": 10.0, "efficiency": 0.5, "rotor_inertia": "1e-5 kg*m^2"}
    return mechanism(tmp_path, arm=0.2, drives={"s": drive})


def motor_torque(q, a, direction):
    """Torque of the motor of ``lifting``, by hand: losses are its own where it drives."""
    load = 0.06 * a + 9.81 * 0.2 * np.cos(q)
    return np.where(load * direction < 0.0, 0.5, 2.0) * load / 10 + 1e-4 * a


@pytest.mark.parametrize("digits", [16, 4])
@pytest.mark.parametrize(("rows", "shift"), [(101, 0.0), (182, 300.15)])
def test_a_spline_at_rest_has_the_band_of_friction_and_no_friction_of_its_error(flywheel, rows, shift, digits):
    t = np.linspace(0.0, 2.0, rows)
    q, v, a = rest_to_rest(t, 0.6, 0.8, 0.8)
    result = recorded(flywheel, "joint.x.effort", t, np.round(q + shift, digits))
    rest, moving = (t < 0.55) | (t > 1.45), (t > 0.65) & (t < 1.35)
    effort, lower, upper = (result[f"joint.x.effort{part}"].values for part in ("", ".lower", ".upper"))
    assert effort[rest] == pytest.approx(0.0, abs=1e-3)
    assert lower[rest] == pytest.approx(-0.7, abs=1e-3)
    assert upper[rest] == pytest.approx(0.7, abs=1e-3)
    assert effort[moving] == pytest.approx((0.02 * a + 0.1 * v + 0.7)[moving], abs=0.2)
    assert any("friction holds any value" in note for note in result.notes())


@pytest.mark.parametrize("given", [True, False])
def test_a_motion_from_rest_to_rest_has_the_friction_of_the_motion_at_its_ends(flywheel, given):
    t = np.linspace(0.0, 1.0, 101)
    q, v, a = rest_to_rest(t, 0.0, 1.0, 0.8)
    result = recorded(flywheel, "joint.x.effort", t, q, *((v, a) if given else ()))
    assert result["joint.x.effort"].values == pytest.approx(0.02 * a + 0.1 * v + 0.7, abs=1e-9)
    assert any("in 2 of 101 rows a joint is at rest for an instant" in note for note in result.notes())


@pytest.mark.parametrize("pulsation", [2 * np.pi, 3.0])
@pytest.mark.parametrize("rows", [81])
@pytest.mark.parametrize("given", [True, False])
def test_where_a_joint_turns_back_the_motion_that_follows_tells_the_losses(lifting, given, rows, pulsation):
    """At the last row the motion that has ended does."""
    t = np.linspace(0.0, 4 * np.pi / pulsation, rows)
    q = 0.4 * np.cos(pulsation * t)
    v, a = -0.4 * pulsation * np.sin(pulsation * t), -(pulsation**2) * q
    result = recorded(lifting, "drive.s.torque", t, q, *((v, a) if given else ()))
    direction = np.where(np.abs(v) > 1e-9, np.sign(v), np.sign(a))
    direction[-1] = 1.0
    assert result["drive.s.torque"].values == pytest.approx(motor_torque(q, a, direction), abs=2e-3)


def test_a_row_before_a_jump_has_the_side_of_the_motion_that_has_ended(flywheel):
    """Stops without a jerk, and goes on the other way from the next row, which has the same instant."""
    t = np.linspace(0.0, 1.0, 51)
    q, v, a = (np.concatenate([x, y]) for x, y in zip(
        rest_to_rest(t, 0.0, 1.0, 0.8), rest_to_rest(t, 0.0, 1.0, -0.8), strict=True))  # fmt: skip
    q[51:] += 0.8
    effort = recorded(flywheel, "joint.x.effort", np.concatenate([t, 1.0 + t]), q, v, a)["joint.x.effort"].values
    assert effort == pytest.approx(0.02 * a + 0.1 * v + np.repeat([0.7, -0.7], 51), abs=1e-12)
