"""Every quantity of several mechanisms as an output: C and D against real differences of ``Mechanism.at``."""

import numpy as np
import pinocchio as pin
import pytest
from urdf_links import link, robot, tip

from pinarm.errors import InputError

BODY = {"mass": 2.0, "com": "0.1 0.05 -0.4", "inertia": (0.03, 0.04, 0.02)}
TREE = {
    "forces": {
        "mount": {"kind": "joint_spring", "joint": "a", "stiffness": "7 N*m/rad", "damping": "0.4 N*m*s/rad"},
        "bush": {
            "kind": "bushing",
            "between": ["base", "end"],
            "stiffness": {"translation": ["90 N/m", "70 N/m", "0 N/m"], "rotation": ["0 N*m/rad"] * 2 + ["3 N*m/rad"]},
            "damping": {"translation": ["2 N*s/m", "0 N*s/m", "0 N*s/m"]},
        },
        "strut": {
            "kind": "point_spring",
            "between": ["base", "b_link"],
            "stiffness": "80 N/m",
            "damping": "3 N*s/m",
            "free_length": "0.2 m",
        },
        "push": {"kind": "wrench", "point": "end", "force": ["1 N", "2 N", "-3 N"], "axes": "end"},
        "turn": {
            "kind": "coordinate_spring",
            "coordinate": "tilt",
            "stiffness": "5 N*m/rad",
            "damping": "0.3 N*m*s/rad",
        },
        "reach": {"kind": "coordinate_effort", "coordinate": "way", "effort": {"law": "constant", "value": "4 N"}},
    },
    "coordinates": {
        "tilt": {"kind": "rotation", "body": "end", "about": "x"},
        "way": {"kind": "distance", "between": ["base", "end"]},
        "both": {"kind": "sum", "of": {"a": 1, "b": 2}},
    },
    "drives": {"motor": {"joint": "a", "ratio": 20, "rotor_inertia": "1e-4 kg*m^2"}},
    "friction": {"b": {"mu": 0.1, "radius": "2 cm", "span": "0.1 m", "constant": "0.1 N*m"}},
}
LOOP = {
    "loops": {"pin": {"kind": "pin", "between": ["b_end", "c_end"], "axis": "y"}},
    "couplings": {"mesh": {"kind": "gear", "joints": ["c", "wheel"], "ratio": -2.0, "pressure_angle": "20 deg"}},
    "forces": {
        "pin_spring": {
            "kind": "coordinate_spring",
            "coordinate": "pin.angle",
            "stiffness": "5 N*m/rad",
            "damping": "0.2 N*m*s/rad",
        }
    },
    "friction": {"pin": {"mu": 0.2, "radius": "30 mm"}},
}


def tree(mechanism):
    ball = link("c", "b_link", "0 0 1", at="0.2 0 0.1", **BODY).replace('type="continuous"', 'type="spherical"')
    xml = robot(
        link("a", "base", "0 1 0.2", **BODY),
        link("b", "a_link", "1 0.3 0", at="0.1 0.05 -0.5", **BODY),
        ball,
        tip("end", "c_link", "0.1 0.2 -0.3"),
    )
    made = mechanism(xml, **TREE)
    q = pin.integrate(made.model, pin.neutral(made.model), np.array([0.3, -0.7, 0.4, 0.2, -0.5]))
    return made, q, np.array([1.1, -0.6, 0.8, -0.3, 0.5])


def loop(mechanism):
    bars = link("a", "base", "0 1 0", **BODY) + link("b", "a_link", "0 1 0", at="0 0 -0.5", **BODY)
    xml = robot(
        bars,
        link("c", "base", "0 1 0", at="0.4 0 0", **BODY),
        tip("b_end", "b_link", "0.3 0 0.1"),
        tip("c_end", "c_link", "0 0 -0.45"),
        link("wheel", "base", "0 1 0", at="0.5 0 0.2", **BODY),
    )
    made = mechanism(xml, start={"a": "0.2 rad"}, **LOOP)
    q = closed(made, made.configurations({"a": 0.2, "b": 0.0, "c": 0.0, "wheel": 0.0}))
    return made, q, allowed(made, q, 0, 1.3)


def closed(made, q):
    for _ in range(30):
        state = made.closure.state(q)
        q = pin.integrate(made.model, q, -np.linalg.lstsq(made.closure.rows(state), made.closure.gap(state))[0])
    return q


def allowed(made, q, index, rate):
    """Return the velocity of a mechanism of one freedom at which a joint has a rate."""
    if not made.closure.size:
        return None
    free = np.linalg.svd(made.closure.rows(made.closure.state(q)))[2][-1]
    return free / free[index] * rate


def shafts(mechanism):
    """A motor behind a gear with losses, a belt and a rack."""
    turned = {name: link(name, "base", "0 0 1", at=at, **BODY) for name, at in (("in", "0 0 0"), ("out", "0.3 0 0"))}
    xml = robot(*turned.values(), link("bar", "base", "0 1 0", at="0.4 0 0", kind="prismatic", **BODY))
    made = mechanism(
        xml,
        couplings={
            "belt": {"kind": "belt", "joints": ["in", "out"], "radii": ["50 mm", "100 mm"], "pretension": "30 N"},
            "rack": {"kind": "rack", "joints": ["out", "bar"], "radius": "0.1 m"},
        },
        drives={"motor": {"joint": "bar", "ratio": 20, "efficiency": 0.7, "rotor_inertia": "1e-4 kg*m^2"}},
    )
    q = closed(made, np.array([0.3, 0.2, 0.1])[: made.model.nq])
    return made, q, allowed(made, q, 0, -1.3)


@pytest.mark.parametrize("kind", [tree, loop, shafts])
def test_every_quantity_has_the_slopes_of_its_values(kind, mechanism, differentiate):
    made, q, v = kind(mechanism)
    tau = 0.5 * np.sin(np.arange(1.0, made.model.nv + 1.0))
    linear = made.linearise(q, v, tau)
    motion, found, refused = linear.motion, {}, []
    for name in made.at(q, v, tau=tau).names():
        try:
            found[name] = linear.slopes([name])[0]
        except InputError as error:
            refused += [name] if "has no derivatives" in str(error) else []
    assert len(found) > 60
    moving = [name for name in refused if "_j." not in name]  # fixed joints are looked at in numbers alone
    assert moving in ([], ["power.friction"])  # of slips of loop joints, which Pinocchio evaluates
    size, independent = len(motion.a), motion.independent

    def at(x, column):
        if column >= size:
            return made.at(q, v, tau=tau + x * np.eye(made.model.nv)[column - size])
        moved = closed(made, pin.integrate(made.model, q, x * motion.position[:, column]))
        if not made.closure.size:
            return made.at(moved, v + x * motion.velocity[:, column], tau=tau)
        rate = v[independent[0]] + x * motion.velocity[independent[0], column]
        return made.at(moved, allowed(made, moved, independent[0], rate), tau=tau)

    for column in range(size + made.model.nv):

        def values(x, column=column):
            here = at(x, column)
            return np.array([here[name].values for name in found])

        slopes = np.array([slope[column] for slope in found.values()])
        wanted = differentiate(values, 0.0, h=2e-3)
        wrong = np.abs(slopes - wanted) > 1e-6 * (1.0 + np.abs(wanted))  # rounding of values of 100 over the step
        assert not wrong.any(), [
            (name, a, b) for name, a, b, bad in zip(found, slopes, wanted, wrong, strict=True) if bad
        ]


@pytest.mark.parametrize("name", ["point.end.velocity.norm", "joint.b.moment.norm"])
def test_the_size_of_what_is_0_has_a_kink(name, mechanism):
    """Of a pendulum that hangs at rest: its derivative would be that to one side."""
    hung = {"mass": 2.0, "com": "0 0 -0.4"}
    arms = link("a", "base", "0 1 0", **hung), link("b", "a_link", "0 1 0", at="0 0 -0.4", **hung)
    at = mechanism(robot(*arms, tip("end", "b_link", "0 0 -0.4"))).linearise(np.zeros(2))
    with pytest.raises(InputError, match=f"'{name}' has a kink here"):
        at.slopes([name])
    assert at.slopes(["point.end.velocity.x", "joint.b.force.norm"])[0, 2] == pytest.approx(-0.8)


def test_the_tight_strand_of_an_unloaded_belt_has_a_kink(mechanism):
    """Which strand is tight changes with the sign of the torque."""
    shafts = robot(*(link(name, "base", "0 0 1", at=at, **BODY) for name, at in (("in", "0 0 0"), ("out", "0.3 0 0"))))
    belt = {"kind": "belt", "joints": ["in", "out"], "radii": ["50 mm", "100 mm"], "pretension": "30 N"}
    made = mechanism(shafts, gravity="none", couplings={"C": belt})
    with pytest.raises(InputError, match=r"'coupling\.C\.tight' has a kink here"):
        made.linearise(np.zeros(2)).slopes(["coupling.C.tight"])
    loaded = made.linearise(np.zeros(2), tau=np.array([1.0, -2.0]))
    assert loaded.slopes(["coupling.C.tight"])[0, 2] == pytest.approx(-loaded.slopes(["coupling.C.slack"])[0, 2])
