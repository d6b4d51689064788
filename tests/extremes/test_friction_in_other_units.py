"""Scenes with friction in other units of mass, length and time: closed forms without dimension, at sizes 1e12 apart."""

import numpy as np
import pytest

import pinarm

SCALES = [(1.0, 1.0, 1e6), (1e-12, 1e-6, 1e-3)]
"""Units of mass, length and time in SI: parts of watches and of micro-machines, and motions of days."""

LIMIT = '<limit lower="-1e30" upper="1e30" effort="1e60" velocity="1e60"/>'


def body(mass, inertia):
    moments = " ".join(f'{name}="{inertia!r}"' for name in ("ixx", "iyy", "izz"))
    return f'<inertial><mass value="{mass!r}"/><inertia {moments} ixy="0" ixz="0" iyz="0"/></inertial>'


@pytest.fixture
def mechanism(tmp_path):
    def made(links, length, time, **values):
        (tmp_path / "m.urdf").write_text(f'<robot name="m"><link name="base"/>{links}</robot>')
        gravity = {"magnitude": f"{9.81 * length / time**2!r} m/s^2"}
        return pinarm.Mechanism.load(tmp_path / "m.urdf", values={"gravity": gravity, **values})

    return made


def forward(mechanism, output, end, **keys):
    problem = {"kind": "forward", "time": {"end": f"{end!r} s", "samples": 5}, **keys}
    return {"pinarm": 1, "mechanism": mechanism, "outputs": [output], "problem": problem}


@pytest.mark.parametrize(("m", "l", "t"), SCALES)
def test_a_torque_that_grows_breaks_an_unloaded_gear_loose_at_once(mechanism, m, l, t):
    """``x = N eta t^3 / (6 (I + eta J))`` under a motor's torque that grows by 1 in 1."""
    inertia, effort = m * l**2, m * l**2 / t**2
    links = f"""<link name="rotor">{body(m, 0.02 * inertia)}</link>
<joint name="x" type="continuous"><parent link="base"/><child link="rotor"/><axis xyz="0 1 0"/></joint>"""
    rotor = {"rotor_inertia": f"{1e-4 * inertia!r} kg*m^2", "motor": {"kind": "ideal"}}
    drives = {"servo": {"joint": "x", "ratio": 10.0, "efficiency": 0.7, **rotor}}
    scene = forward(mechanism(links, l, t, drives=drives), "x", t)
    result = pinarm.run(scene, control={"servo": lambda now, state: effort * now / t})
    exact = 10.0 * 0.7 * (result["t"].values / t) ** 3 / 6.0 / (0.02 + 0.7 * 1e-2)
    assert np.abs(result["x"].values - exact).max() < 1e-10


@pytest.mark.parametrize(("m", "l", "t"), SCALES)
def test_a_block_on_a_belt_sticks_and_slips(mechanism, m, l, t):
    """It sticks until the spring pulls with 0.4 m g, then swings about 0.25 m g / k until it is as fast as the belt."""
    links = f"""<link name="band">{body(m, m * l**2)}</link><link name="block">{body(2.0 * m, m * l**2)}</link>
<link name="wall"/><joint name="post" type="fixed"><parent link="base"/><child link="wall"/>
<origin xyz="{-l!r} 0 0"/></joint><joint name="belt" type="prismatic"><parent link="base"/><child link="band"/>
<axis xyz="1 0 0"/>{LIMIT}</joint><joint name="slip" type="prismatic"><parent link="band"/><child link="block"/>
<axis xyz="1 0 0"/>{LIMIT}</joint>"""
    spring = {"kind": "point_spring", "between": ["wall", "block"], "stiffness": f"{50.0 * m / t**2!r} N/m"}
    values = {
        "forces": {"spring": {**spring, "free_length": f"{l!r} m"}},
        "friction": {"slip": {"mu": 0.25, "static_mu": 0.4}},
    }
    motion = {"belt": {"law": "constant_speed", "speed": f"{0.1 * l / t!r} m/s"}}
    result = pinarm.run(forward(mechanism(links, l, t, **values), "slip", 2.8 * t, motion=motion))
    omega, swing = 5.0, 0.15 * 2.0 * 9.81 / 50.0
    slipping = 2.0 / omega * (np.pi - np.arctan(omega * swing / 0.1))
    ends = [one.solution.end / t for one in result.outcome.motion.motion.segments]
    begins = 0.4 * 2.0 * 9.81 / 50.0 / 0.1
    # the tolerance of the integration is 1e-8
    assert ends == pytest.approx([begins, begins + slipping, 2.8], rel=1e-7)
    assert result.figures["friction"] < 1e-9
