"""States in arrays of any leading axes are those of the flat call, and of each state alone."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinarm
from pinarm.errors import InputError
from pinarm.use.mechanism import Mechanism

MODELS = Path(pinarm.__file__).parents[1] / "models"
ANY = np.random.default_rng(3)


def arm():
    q, v, a = ANY.normal(size=(3, 12, 2))
    return Mechanism.load(MODELS / "gen411_arm" / "mechanism.yaml"), q, v, a, ()


def four_bar():
    """All rods turn alike, so that any angle closes the loop."""
    mechanism = Mechanism.load(MODELS / "four_bar" / "mechanism.yaml")
    shares = {"upright_0": 1.0, "coupler_0": -1.0, "upright_1": 1.0}
    angle, speed, gain = ANY.uniform(-1.2, 1.2, (3, 12))
    q, v, a = (mechanism.rates({name: k * x for name, k in shares.items()}) for x in (angle, speed, gain))
    return mechanism, q, v, a, ("upright_0",)


def flying():
    mechanism = Mechanism.load("panda", values={"base": "floating"})
    names = ("root.x", "root.angular_velocity.y", *(f"panda_joint{k}" for k in range(1, 8)))
    v, a = (mechanism.rates(dict(zip(names, x, strict=True))) for x in ANY.normal(size=(2, len(names), 12)))
    q = np.array([pin.integrate(mechanism.model, pin.neutral(mechanism.model), row) for row in 0.7 * v])
    return mechanism, q, v, a, ()


@pytest.fixture(params=[arm, four_bar, flying], ids=lambda one: one.__name__)
def case(request):
    return request.param()


def test_efforts_accelerations_and_quantities_keep_the_leading_axes(case):
    mechanism, *states, drives = case
    q, v, a = (x.reshape(3, 4, -1) for x in states)
    flat, nv = mechanism.inverse(*states, drives=drives), mechanism.model.nv
    tau = mechanism.inverse(q, v, a, drives=drives)
    assert tau.shape == (3, 4, nv)
    assert tau.reshape(12, nv) == pytest.approx(flat, rel=1e-13, abs=1e-13)
    assert mechanism.forward(q, v, tau) == pytest.approx(a, abs=1e-10)  # of the flying arm, whose M has condition 1e4
    still = mechanism.forward(*states[:2]).reshape(3, 4, nv)
    assert mechanism.forward(q, v) == pytest.approx(still, rel=1e-13, abs=1e-13)
    found, rows = mechanism.at(q, v, a, drives=drives), mechanism.at(*states, drives=drives)
    first, *_, last = mechanism.joints
    for name in ("energy.kinetic", "momentum.all.angular.z", f"joint.{first}.force.x", f"2*joint.{last}.velocity"):
        assert found[name].values == pytest.approx(rows[name].values.reshape(3, 4), rel=1e-12, abs=1e-12)


def test_a_state_that_is_no_number_is_told_by_its_place(case):
    mechanism, q, v, a, drives = case
    unknown = q.reshape(3, 4, -1).copy()
    unknown[1, 2, -1] = np.nan
    v, a = (x.reshape(3, 4, -1) for x in (v, a))
    place = rf"q\[{unknown.shape[-1] - 1}\] of state \(1, 2\) is nan"
    for call in (lambda: mechanism.forward(unknown, v), lambda: mechanism.inverse(unknown, v, a, drives=drives)):
        with pytest.raises(InputError, match=place):
            call()
    v = v * 1e200  # squares overflow, numbers do not
    with pytest.raises(InputError, match=r"a\[0\] of state \(0, 0\) is -?inf"):
        mechanism.inverse(q.reshape(unknown.shape), v, np.full_like(v, np.inf), drives=drives)


def test_the_state_that_tears_a_loop_is_told_by_its_place():
    mechanism, *states, drives = four_bar()
    q, v, a = (x.reshape(3, 4, -1) for x in states)
    q[2, 1, 0] += 1e-5
    with pytest.raises(InputError, match=r"^state \(2, 1\): the positions tear"):
        mechanism.forward(q, v)
    with pytest.raises(InputError, match=r"(?s)^the state: the positions tear.*mechanism\.close"):
        mechanism.inverse(q[2, 1], v[2, 1], a[2, 1], drives=drives)
