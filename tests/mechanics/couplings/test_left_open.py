"""Reactions that depend on parts of a coupling of which nothing is said are refused; all others are told."""

from itertools import product

import numpy as np
import pytest
from catalogue import disc
from motions import driven, free

from pinarm.engine.constraints.self_stresses import mobility_of
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError
from pinarm.mechanics.couplings.coupling import Coupling, left_open
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.laws import Harmonic
from pinarm.use.mechanism import Mechanism

GEARS = {
    "gear": {"kind": "gear", "joints": ["sun", "wheel"], "ratio": -2.0},
    "rack": {"kind": "rack", "joints": ["sun", "bar"], "radius": "40 mm"},
    "screw across": {"kind": "screw", "joints": ["sun", "bar"], "lead": "40 mm"},
    "screw apart": {"kind": "screw", "joints": ["planet", "nut"], "lead": "40 mm"},
    "belt": {"kind": "belt", "joints": ["sun", "wheel"], "radii": ["9 mm", "9 mm"]},
    "sum": {"kind": "sum", "weights": {"sun": 2.0, "wheel": -1.0}},
}
OPEN = {
    "gear": {"sun": 6, "wheel": 6}, "rack": {"sun": 6, "bar": 6}, "screw across": {"sun": 6, "bar": 6},
    "screw apart": {"planet": 6, "arm": 5, "nut": 6}, "belt": {"sun": 6, "wheel": 6}, "sum": {"sun": 6, "wheel": 6},
}  # fmt: skip
REACTIONS = [f"{kind}.{axis}" for kind in ("force", "moment") for axis in "xyz"]


def opened(box):
    couplings = [one for one in box.constraints if isinstance(one, Coupling)]
    return {box.model.names[joint]: one for joint, one in left_open(box.model, couplings).items()}


@pytest.mark.parametrize("name", GEARS)
def test_joints_between_the_members_are_open(name, gearbox):
    assert {joint: len(one.wrenches) for joint, one in opened(gearbox(it=GEARS[name])).items()} == OPEN[name]


XML = f"""<robot name="arm"><link name="base"/>{disc("shoulder", 0.3)}
  {disc("one", 0.2, "0.5 0 0").replace('<parent link="base"/>', '<parent link="shoulder_link"/>')}
  {disc("rest", 0.1, "0.2 0.1 0").replace('<parent link="base"/>', '<parent link="shoulder_link"/>')}
  {disc("two", 0.1, "0.2 0.1 0").replace('<parent link="base"/>', '<parent link="rest_link"/>')}
  {disc("tool", 0.1, "0.1 0 0.1", "1 0 0").replace('<parent link="base"/>', '<parent link="two_link"/>')}</robot>"""
MOTION = {name: Harmonic(amplitude=0.5, pulsation=2.0) for name in ("shoulder", "one", "rest", "tool")}


@pytest.fixture
def found(mechanism):
    arm = mechanism(XML, couplings={"chain": {"kind": "gear", "joints": ["one", "two"], "ratio": 2.0}})
    return Quantities(driven(arm, MOTION, drives=list(MOTION)))


def test_what_is_open_is_refused_with_the_reason_and_efforts_are_told(found):
    own = found["joint.rest.effort"].values
    assert found["joint.rest.moment.z"].values == pytest.approx(own, rel=1e-12)
    for joint, part in product(["one", "rest", "two"], REACTIONS):
        if (joint, part) != ("rest", "moment.z"):
            with pytest.raises(InputError, match=r"'chain' \(gear\): it has no pressure_angle") as refused:
                found[f"joint.{joint}.{part}"]
            assert "pressure_angle" in refused.value.hint
    with pytest.raises(InputError, match=r"is not known: it has no pressure_angle\n  expected: coupling.chain.effort"):
        found["coupling.chain.tangential"]
    assert np.abs(found["coupling.chain.effort"].values).max() > 0.0


def test_joints_before_and_beyond_it_keep_their_reactions(found, mechanism):
    """They are those of the same motion with a drive in place of the coupling."""
    open_chain = mechanism(XML)
    two = {"two": Harmonic(amplitude=1.0, pulsation=2.0)}
    free_of_it = Quantities(driven(open_chain, {**MOTION, **two}))
    for joint in ("shoulder", "tool"):
        for part in REACTIONS:
            expected = free_of_it[f"joint.{joint}.{part}"].values
            assert found[f"joint.{joint}.{part}"].values == pytest.approx(expected, rel=1e-11, abs=1e-11)


def test_fingers_that_mimic_each_other_leave_the_arm_determined():
    panda = Mechanism.load("panda")
    fingers = [f"panda_finger_joint{k}" for k in (1, 2)]
    assert sorted(opened(panda)) == fingers
    found = Quantities(free(panda, 0.01, 2))
    assert np.isfinite(found["joint.panda_joint7.force.x"].values).all()
    with pytest.raises(InputError, match="'mimic' in the model says nothing of the parts between them"):
        found[f"joint.{fingers[0]}.force.x"]


@pytest.mark.parametrize("kind", [
    {"kind": "gear", "ratio": -2.0, "pressure_angle": "20 deg"},
    {"kind": "belt", "radii": ["5 cm", "5 cm"], "pretension": "10 N"},
], ids=["gear", "belt"])  # fmt: skip
def test_two_couplings_side_by_side_leave_open_what_they_push_both_ways(mechanism, kind):
    """Teeth push wheels apart, and strands pull them together, whichever way they drive; together they drive as one."""
    wheels = disc("one", 0.3) + disc("two", 0.05, "0.3 0 0")
    both = {name: {**kind, "joints": ["one", "two"]} for name in ("a", "b")}
    pair = mechanism(f'<robot name="p"><link name="base"/>{wheels}</robot>', couplings=both)
    run = driven(pair, {"one": Harmonic(amplitude=0.3, pulsation=2.0)})
    links, lam = LinkPlacements.at(pair.model, run.q[:1]), run.lam[:1]
    other = lam + np.pad([[50.0, -50.0]], [(0, 0), (0, lam.shape[1] - 2)])  # another share, the same motion
    shares = [pair.closure.wrenches(links, each[:, :2])[0, 1] for each in (lam, other)]
    assert abs(shares[1][0] - shares[0][0]) > 100.0
    found, least = Quantities(run), Quantities(run, undetermined="minimum_norm")
    for name in ("joint.one.force.x", "joint.two.force.radial"):
        with pytest.raises(InputError, match="hyperstatic of degree 1"):
            found[name]
        assert least[name].doubt
    assert found["joint.one.force.z"].values == pytest.approx(9.81, rel=1e-12)
    assert mobility_of(pair, run.q[0]).undetermined["one"][0] == "force x"
