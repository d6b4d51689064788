"""Forces of couplings do the power of their multiplier in every motion, and balance on the bodies."""

import typing

import numpy as np
import pinocchio as pin
import pytest

from pinarm.mechanics.couplings.kinds import CouplingDefinition
from pinarm.mechanics.friction.definition import Friction
from pinarm.mechanics.geometry.link_placements import LinkPlacements

TEETH = {"pressure_angle": "20 deg", "helix_angle": "15 deg"}
WAVE = {"law": "harmonic", "amplitude": "9 mm", "pulsation": "1 rad/rad", "mean": "20 mm"}
SWING = {"law": "harmonic", "amplitude": "5 deg", "pulsation": "1 rad/rad"}
SAMPLES = {
    "outer teeth": {"kind": "gear", "joints": ["sun", "wheel"], "ratio": -2.0, **TEETH},
    "inner teeth, a pinion first": {"kind": "gear", "joints": ["sun", "wheel"], "ratio": 0.4, **TEETH},
    "inner teeth, a ring first": {"kind": "gear", "joints": ["wheel", "sun"], "ratio": 3.0, **TEETH, "plane": "middle"},
    "axes of opposite senses": {"kind": "gear", "joints": ["ring", "wheel"], "ratio": 2.0, **TEETH},
    "in planes apart": {"kind": "gear", "joints": ["back", "sun"], "ratio": 0.7, **TEETH, "plane": "back_link"},
    "a sun and a planet": {"kind": "gear", "joints": ["sun", "planet"], "ratio": -3.0, "carrier": "arm", **TEETH},
    "a planet and a ring": {"kind": "gear", "joints": ["planet", "ring"], "ratio": -0.25, "carrier": "arm", **TEETH},
    "a ring at rest": {"kind": "gear", "joints": ["arm", "planet"], "ratio": -4.0, **TEETH},
    "a ring at rest, second": {"kind": "gear", "joints": ["planet", "arm"], "ratio": -0.25, **TEETH},
    "planets unseen": {"kind": "gear", "joints": ["sun", "ring"], "ratio": 0.4, "carrier": "arm", "planets": 3},
    "planets in a ring at rest": {"kind": "gear", "joints": ["sun", "arm"], "ratio": 0.3, "planets": 2},
    "bevel teeth": {"kind": "gear", "joints": ["cone", "sun"], "ratio": -0.5, "pressure_angle": "20 deg",
                    "plane": "face"},
    "a rack": {"kind": "rack", "joints": ["sun", "bar"], "radius": "40 mm", **TEETH},
    "a rack on the other side": {"kind": "rack", "joints": ["ring", "bar"], "radius": "-40 mm", **TEETH},
    "a screw": {"kind": "screw", "joints": ["sun", "nut"], "lead": "12 mm"},
    "a screw of opposite senses": {"kind": "screw", "joints": ["ring", "nut"], "lead": "12 mm"},
    "a screw on its nut": {"kind": "screw", "joints": ["sun", "runner"], "lead": "-7 mm"},
    "a spindle on its slide": {"kind": "screw", "joints": ["spindle", "nut"], "lead": "9 mm"},
    "a belt": {"kind": "belt", "joints": ["sun", "wheel"], "radii": ["90 mm", "30 mm"], "pretension": "20 N"},
    "a crossed belt": {"kind": "belt", "joints": ["wheel", "sun"], "radii": ["30 mm", "50 mm"], "pretension": "9 N",
                       "course": "crossed"},
    "a chain": {"kind": "belt", "joints": ["ring", "wheel"], "radii": ["30 mm", "50 mm"], "pretension": "0 N"},
    "a cam with a roller that slides": {"kind": "cam", "joints": ["sun", "bar"], "roller": "tip",
                                        "roller_radius": "7 mm", "profile": WAVE},
    "a cam with a flat face, of the other sense": {"kind": "cam", "joints": ["ring", "bar"], "face": "tip",
                                                   "profile": WAVE},
    "a cam with a lever": {"kind": "cam", "joints": ["sun", "back"], "roller": "nose", "roller_radius": "5 mm",
                           "profile": SWING},
    "a belt to a planet": {"kind": "belt", "joints": ["arm", "planet"], "radii": ["60 mm", "20 mm"],
                           "pretension": "20 N"},
}  # fmt: skip


@pytest.mark.house
def test_every_kind_that_tells_its_forces_is_sampled():
    silent = {"sum"}  # says nothing of the parts between the joints
    kinds = {one.__struct_config__.tag for one in typing.get_args(CouplingDefinition)}
    assert kinds - silent == {sample["kind"] for sample in SAMPLES.values()}


@pytest.mark.parametrize("name", SAMPLES)
def test_wrenches_have_the_power_of_the_multiplier_in_every_motion(name, gearbox):
    box = gearbox(it=SAMPLES[name])
    (coupling,) = box.constraints
    model, rng = box.model, np.random.default_rng(3)
    q, lam = rng.uniform(-2, 2, (5, model.nq)), np.array([[40.0], [-7.0], [0.0], [0.3], [-200.0]])
    wrenches = coupling.wrenches(LinkPlacements.at(model, q), lam)
    data, largest = model.createData(), 0.0
    for i in range(5):
        pin.computeJointJacobians(model, data, q[i])
        power = np.zeros(model.nv)
        for body, wrench in wrenches.items():
            jacobian = pin.getJointJacobian(model, data, body, pin.WORLD).reshape(6, -1)
            power += wrench[i] @ jacobian
            largest = max(largest, np.abs(wrench[i]).max())
        assert power == pytest.approx(lam[i, 0] * coupling.rows_at(q)[i], abs=1e-12 * largest)
    assert np.abs(sum(wrenches.values())).max() < 1e-12 * largest


@pytest.mark.parametrize("name", [name for name, one in SAMPLES.items() if "planets" not in one])
def test_what_acts_on_the_second_member_acts_where_it_is_said(name, gearbox):
    box = gearbox(it=SAMPLES[name])
    (coupling,) = box.constraints
    links, lam = LinkPlacements.at(box.model, np.full((1, box.model.nq), 0.7)), np.array([[5.0]])
    (point,), (wrench,) = coupling.known.transmitted(links, lam[:, 0])
    at_origin = next(iter(coupling.wrenches(links, lam).values()))[0]  # that of the second member comes first
    assert wrench[:3] == pytest.approx(at_origin[:3], abs=1e-13)
    assert wrench[3:] + np.cross(point, wrench[:3]) == pytest.approx(at_origin[3:], abs=1e-11)
    if coupling.kind in ("gear", "rack", "cam"):  # a force alone
        assert wrench[3:] == pytest.approx(np.zeros(3), abs=1e-10)


TEETH_OF_FIRST = {
    "outer teeth": 40, "inner teeth, a pinion first": 24, "inner teeth, a ring first": 90,
    "axes of opposite senses": 60, "in planes apart": 21, "a sun and a planet": 90, "a planet and a ring": 30,
    "a ring at rest": 120, "a ring at rest, second": 30, "bevel teeth": 20, "a rack": 20,
    "a rack on the other side": 20,
}  # fmt: skip


@pytest.mark.parametrize("name", TEETH_OF_FIRST)
def test_friction_of_teeth_is_against_the_rolling_of_the_members(name, gearbox):
    """Its slip is that of the two bodies, by their angular velocities; its wrenches do ``f u`` in every motion.

    The angular velocities along the pitch line, ``w1 - w2``, are those of Pinocchio, whatever the joints between.
    """
    assert {one for one, sample in SAMPLES.items() if "pressure_angle" in sample} == set(TEETH_OF_FIRST)
    box = gearbox(it=SAMPLES[name])
    (coupling,), model = box.constraints, box.model
    (contact,) = Friction(mu=0.1, teeth=TEETH_OF_FIRST[name]).bind("it", model, {}, box.constraints)
    known, couple = coupling.transmission, -contact.slip.acting.wrench[3:]
    distance = np.linalg.norm(couple)
    data, rng = model.createData(), np.random.default_rng(5)
    q, v, f = rng.uniform(-2, 2, model.nq), rng.uniform(-2, 2, model.nv), np.array([7.0])
    pin.forwardKinematics(model, data, q, v)
    line = data.oMi[known.carrier].rotation @ couple / distance
    spins = [pin.getVelocity(model, data, body, pin.WORLD).angular for body in (known.first, known.second)]
    slip = contact.slip.weights @ v
    assert slip == pytest.approx(distance * line @ (spins[0] - spins[1]), rel=1e-12)
    power = sum(
        wrench[0] @ pin.getVelocity(model, data, body, pin.WORLD).vector
        for body, wrench in contact.slip.wrenches(LinkPlacements.at(model, q[None]), f).items()
    )
    assert power == pytest.approx(7.0 * slip, rel=1e-11)
    force = known.in_carrier(q[None], np.array([-3.0]))[known.second][0, :3]
    assert contact.bearing.load(np.array([-3.0, 0, 0, 0, 0, 0])) == pytest.approx(np.linalg.norm(force), rel=1e-13)
