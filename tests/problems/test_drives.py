"""Drives that share a load: a four-bar with two motors, a slider-crank with motor and cylinder, an arm with three."""

from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.errors import DrivesError, InputError, PinarmError

ROOT = Path(pinarm.__file__).parents[1]
FOUR_BAR = {
    "pinarm": 1,
    "mechanism": str(ROOT / "models" / "crank_rocker" / "mechanism.yaml"),
    "problem": {
        "kind": "inverse",
        "time": {"end": "0.6 s", "samples": 61},
        "motion": {"theta2": {"law": "constant_speed", "speed": "100 rpm"}},
        "drives": ["theta2", "theta4"],
        "start": {"theta2": "0 rad", "A": "40 deg", "theta4": "80 deg"},
    },
    "outputs": ["T"],
}
TWO, FOUR = "joint.theta2.effort", "joint.theta4.effort"


def four_bar(**problem):
    """Solve it with other keys of the problem, those that are ``...`` left out."""
    given = {**FOUR_BAR["problem"], **problem}
    return pinarm.run({**FOUR_BAR, "problem": {key: value for key, value in given.items() if value is not ...}})


def values(run, *names):
    return [run[name].values for name in names]


@pytest.fixture(scope="module")
def alone():
    """What one motor at the crank gives, Q, and r = d theta4 / d theta2, by velocities."""
    run = four_bar(drives=["theta2"])
    q, two, four = values(run, TWO, "joint.theta2.velocity", "joint.theta4.velocity")
    return q, four / two


def test_least_squares(alone):
    """The least ``T2^2 + T4^2`` for ``T2 + r T4 = Q``."""
    q, r = alone
    assert np.ptp(r) > 0.5
    two, four = values(four_bar(share="least_squares"), TWO, FOUR)
    assert two == pytest.approx(q / (1 + r**2), rel=1e-10, abs=1e-10)
    assert four == pytest.approx(r * q / (1 + r**2), rel=1e-10, abs=1e-10)


def test_weights(alone):
    """The least ``(3 T2)^2 + (0.5 T4)^2``."""
    q, r = alone
    share = {"weights": {"theta4": "0.5 1/N/m", "theta2": "3 1/N/m"}}
    two, four = values(four_bar(share=share), TWO, FOUR)
    part = 1 / 3**2 + r**2 / 0.5**2
    assert two == pytest.approx(q / 3**2 / part, rel=1e-10, abs=1e-10)
    assert four == pytest.approx(q * r / 0.5**2 / part, rel=1e-10, abs=1e-10)


def test_a_motor_at_its_limit_leaves_the_rest_to_the_other(alone):
    q, r = alone
    run = four_bar(share={"limits": {"theta4": "1 N*m"}})
    two, four = values(run, TWO, FOUR)
    wanted = np.clip(r * q / (1 + r**2), -1.0, 1.0)
    assert 0 < (np.abs(four) == 1.0).sum() < len(four)
    assert four == pytest.approx(wanted, rel=1e-10, abs=1e-10)
    assert two == pytest.approx(q - r * wanted, rel=1e-10, abs=1e-10)


REACTIONS = [f"{of}.force.{axis}" for of in ("joint.theta2", "joint.A", "joint.theta4", "loop.B") for axis in "xy"]


def test_reactions_are_those_of_the_chosen_efforts(alone):
    """At every twentieth instant the rocker's motor as a load, the crank's as the only drive."""
    run = four_bar(share="least_squares")
    changed = values(four_bar(drives=["theta2"]), *REACTIONS)
    assert max(np.abs(a - b).max() for a, b in zip(values(run, *REACTIONS), changed, strict=True)) > 1.0
    for row in range(0, 61, 20):
        effort, two, *expected = (float(series[row]) for series in values(run, FOUR, TWO, *REACTIONS))
        load = {
            "kind": "joint_effort",
            "joint": "theta4",
            "effort": {"law": "constant", "value": f"{effort!r} N*m"},
        }
        same = four_bar(drives=["theta2"], loads={"motor": load})
        assert [series[row] for series in values(same, TWO, *REACTIONS)] == pytest.approx([two, *expected], abs=1e-11)


def test_rows_beyond_all_limits_are_refused_with_their_instant():
    with pytest.raises(DrivesError, match=r"at t = 0\.\d+ s the drives theta2, theta4 cannot carry the load") as caught:
        four_bar(share={"limits": {"theta2": "2 N*m", "theta4": "1 N*m"}})
    assert "theta2 -2 to 2 N*m, theta4 -1 to 1 N*m" in str(caught.value)
    assert caught.value.exit_code == 2


class TestAsManyDrivesAsFreedoms:
    def test_limits_are_kept(self):
        with pytest.raises(DrivesError, match="cannot carry the load within their limits"):
            four_bar(drives=["theta2"], share={"limits": {"theta2": "1 N*m"}})


def test_torque_and_force_with_weights_in_units():
    """Slider-crank: ``x = r cos theta + sqrt(L^2 - r^2 sin^2 theta)``, ``C + F dx/dtheta = Q``."""
    crank, rod, w, u = 0.045, 0.145, 1 / 5.0, 1 / 200.0
    problem = {
        "kind": "state", "over": {"theta": {"from": "10 deg", "to": "170 deg", "samples": 17}},
        "velocity": {"theta": "30 rad/s"}, "drives": ["x", "theta"], "start": {"theta": "10 deg", "x": "0.19 m"},
    }  # fmt: skip
    given = {"pinarm": 1, "mechanism": str(ROOT / "models" / "slider_crank" / "mechanism.yaml"), "outputs": ["C"]}
    share = {"weights": {"theta": "0.2 1/N/m", "x": "0.005 1/N"}}
    torque, force, theta = values(pinarm.run({**given, "problem": {**problem, "share": share}}),
                                  "C", "joint.x.effort", "theta")  # fmt: skip
    (q,) = values(pinarm.run({**given, "problem": {**problem, "drives": ["theta"]}}), "C")
    s, c = np.sin(theta), np.cos(theta)
    slope = -crank * s - crank**2 * s * c / np.sqrt(rod**2 - crank**2 * s**2)
    part = 1 / w**2 + slope**2 / u**2
    assert torque == pytest.approx(q / w**2 / part, rel=1e-9, abs=1e-10)
    assert force == pytest.approx(q * slope / u**2 / part, rel=1e-9, abs=1e-8)


ARM = [{"name": name, "axis": "0 1 0", "mass": 2.0, "com": "0.5 0 0", **at}
       for name, at in (("A", {}), ("B", {"at": "1 0 0"}))]  # fmt: skip
BOTH = {"both": {"kind": "sum", "of": ["A", "B"]}}


def held(arm, **problem):
    given = {"kind": "statics", "hold": {"A": "0.4 rad", "B": "-0.9 rad"}, **problem}
    return pinarm.run({"pinarm": 1, "mechanism": arm, "problem": given, "outputs": ["joint.A.effort"]})


EFFORTS = ("joint.A.effort", "joint.B.effort", "coordinate.both.effort")


@pytest.fixture
def arm(mechanism, chain):
    return mechanism(chain(*ARM), coordinates=BOTH, gravity={"direction": "-z", "magnitude": "9.81 m/s^2"})


def test_three_motors_hold_an_arm_of_two_joints(arm):
    """Motors at A, at B, and one that turns with both: least for ``x1 + x3 = q1`` and ``x2 + x3 = q2``.

    ``x = (2 q1 - q2, 2 q2 - q1, q1 + q2) / 3``.
    """
    q1, q2 = (series[0] for series in values(held(arm), *EFFORTS[:2]))
    run = held(arm, drives=["A", "B", "both"], share="least_squares")
    # the effort at a joint is that of its own motor and of the one that turns with it
    at_a, at_b, both = (series[0] for series in values(run, *EFFORTS))
    assert both == pytest.approx((q1 + q2) / 3, rel=1e-12)
    assert (at_a, at_b) == pytest.approx((q1, q2), rel=1e-12)


@pytest.mark.parametrize("share", ["bounded", {"limits": {"A": "9 N*m"}}])
def test_dependent_sums_of_joints_share_evenly_only(arm, share):
    """Efforts at joints would not tell those of the drives."""
    with pytest.raises(InputError, match="A, B, both, which depend on each other"):
        held(arm, drives=["A", "B", "both"], share=share)


@pytest.mark.parametrize("mass", [10.0, 160.0])
def test_limits_of_the_model_bound_them(mechanism, chain, mass):
    """A motor of 1000 N*m at A, and a winch at the height of B, ``-sin A``: least for ``x_A - cos A F = q_A``."""
    heavy = mechanism(chain(*({**body, "mass": mass} for body in ARM)),
                      coordinates={"height": {"kind": "point", "point": "B_link", "along": "z"}},
                      gravity={"direction": "-z", "magnitude": "9.81 m/s^2"})  # fmt: skip
    (q,) = (series[0] for series in values(held(heavy), EFFORTS[0]))
    weights = {"A": "1 1/N/m", "B": "1 1/N/m", "height": "1 1/N"}
    run = held(heavy, drives=["A", "B", "height"], share={"weights": weights, "limits": "model"})
    at_a, force = (series[0] for series in values(run, EFFORTS[0], "coordinate.height.effort"))
    c = np.cos(0.4)
    expected = np.clip(q / (1 + c**2), -1000.0, 1000.0)
    assert (abs(expected) == 1000.0) == (mass > 100.0)
    assert (at_a, force) == pytest.approx((expected, (expected - q) / c), rel=1e-12)


def test_friction_that_sticks_is_refused(mechanism, chain):
    arm = mechanism(chain(*ARM), coordinates=BOTH, friction={"A": {"constant": "1 N*m"}})
    with pytest.raises(InputError, match=r"the friction of joint\.A sticks"):
        held(arm, drives=["A", "B", "both"], share="least_squares")


@pytest.mark.parametrize(
    ("problem", "texts"),
    [
        ({}, ["more drives than degrees of freedom, 2 and 1", "share: least_squares"]),
        ({"share": {"limits": {"A": "1 N*m"}}}, ["'A' is no drive"]),
        ({"share": {"weights": {"theta2": 1}}}, ["no weight is given for theta4"]),
        ({"share": {"weights": {"theta2": 1, "theta4": "2 1/N/m"}}}, ["the weight 1 has no unit", "1 1/N/m"]),
        ({"share": {"limits": {"theta4": "1 N"}}}, ["'N' is not a unit", "N*m"]),
        ({"share": {"limits": {"theta4": ["1 N*m", "-1 N*m"]}}}, ["1 is not below -1", "[least, largest]"]),
        ({"share": "bounded"}, ["the model gives none of the drives theta2, theta4 an effort limit"]),
    ],
)
def test_mistakes_are_told(problem, texts):
    with pytest.raises(PinarmError) as caught:
        four_bar(**problem)
    assert all(text in str(caught.value) for text in texts), str(caught.value)


def test_cables_that_only_pull_keep_their_least_tension():
    """A load of 2 kg on four cables: the lower two at 5 N, the upper two carry the rest by themselves."""
    corners = {"A": [-1.0, 1.0], "B": [1.0, 1.0], "C": [1.0, -1.0], "D": [-1.0, -1.0]}
    points = {name: [f"{x} m" for x in at] for name, at in {**corners, "O": (0, 0), "P": (0, 0), "X": (1, 0),
                                                           "Y": (0, 1)}.items()}  # fmt: skip
    planar = {
        "points": points,
        "ground": ["O", "X", *corners],
        "links": {
            "cart": {"points": ["Y"]},
            "load": {"points": ["P"], "mass": "2 kg", "centre": "P", "inertia": "0 kg*m^2"},
        },
        "sliders": {
            "y": {"link": "cart", "along": ["O", "Y"]},
            "x": {"link": "load", "on": "cart", "along": ["O", "X"]},
        },
    }
    cables = {name: {"kind": "distance", "between": [name, "P"]} for name in corners}
    limits = {"A": ["-100 N", "-5 N"], "B": ["-100 N", "-5 N"], "C": [None, "-5 N"], "D": [None, "-5 N"]}
    run = pinarm.run({
        "pinarm": 1,
        "mechanism": {"pinarm": 1, "planar": planar, "coordinates": cables},
        "problem": {"kind": "statics", "hold": {"x": "0.2 m", "y": "0.1 m"}, "drives": [*corners],
                    "share": {"limits": limits}},
        "outputs": [f"coordinate.{name}.effort" for name in corners],
    })  # fmt: skip
    pull = {name: np.subtract(at, (0.2, 0.1)) / np.hypot(*np.subtract(at, (0.2, 0.1))) for name, at in corners.items()}
    weight = [0.0, 2.0 * 9.81]
    upper = np.linalg.solve(np.column_stack([pull["A"], pull["B"]]), weight - 5.0 * (pull["C"] + pull["D"]))
    found = [series[0] for series in values(run, *(f"coordinate.{name}.effort" for name in corners))]
    assert found == pytest.approx([-upper[0], -upper[1], -5.0, -5.0], rel=1e-12)


def test_torques_beside_forces_need_weights():
    given = {"pinarm": 1, "mechanism": str(ROOT / "models" / "slider_crank" / "mechanism.yaml"), "outputs": ["C"]}
    problem = {"kind": "statics", "hold": {"theta": "1 rad"}, "drives": ["theta", "x"], "share": "least_squares"}
    with pytest.raises(InputError, match="torques and forces have no common sum of squares") as caught:
        pinarm.run({**given, "problem": problem})
    assert "theta: 1 1/N/m, x: 1 1/N" in str(caught.value)


def test_too_few_drives_name_the_coordinate_that_lacks_one():
    """An arm of two links whose elbow has no drive: its weight turns the elbow while the shoulder rests."""
    points = {"O": ["0 m", "0 m"], "A": ["0.3 m", "0.1 m"], "B": ["0.6 m", "0 m"]}
    links = {"upper": {"points": ["O", "A"], "mass": "1 kg"}, "fore": {"points": ["A", "B"], "mass": "1 kg"}}
    mechanism = {"pinarm": 1, "planar": {"points": points, "links": links, "ground": ["O"]}}
    problem = {"kind": "statics", "drives": ["O"], "hold": {"O": "1 deg", "A": "1 deg"}}
    with pytest.raises(DrivesError, match="uncarried: A moves while they rest") as caught:
        pinarm.run({"pinarm": 1, "mechanism": mechanism, "problem": problem, "outputs": ["O"]})
    assert caught.value.hint == "drives: [O, A]"
