"""A payload is the same as its mass in the model's text."""

import numpy as np
import pinocchio as pin
import pytest

from pinarm.errors import InputError
from pinarm.mechanics.loading.pinocchio_model import build_model
from pinarm.mechanics.points import Payload, with_payloads

PLACE = 'xyz="0.21 -0.13 0.34" rpy="0.4 -0.9 1.3"'
MOMENTS = (0.013, 0.021, 0.028)


def inertial(mass, moments=(0.0, 0.0, 0.0)):
    xx, yy, zz = moments
    return (f'<inertial><mass value="{mass!r}"/>'
            f'<inertia ixx="{xx!r}" iyy="{yy!r}" izz="{zz!r}" ixy="0" ixz="0" iyz="0"/></inertial>')  # fmt: skip


@pytest.fixture
def build(chain):
    """Return a function that builds a chain whose second body carries a turned link ``tool`` with that inertial."""
    xml = chain(
        {"name": "a", "axis": "0 1 0", "com": "0.1 0.2 -0.4", "inertia": (0.2, 0.3, 0.4)},
        {"name": "b", "axis": "0.6 0 0.8", "at": "0.3 0 0.2", "com": "0 0.1 0.2"},
        {"name": "c", "kind": "prismatic", "axis": "1 0 0", "at": "0 0 0.5", "mass": 0.4},
    )

    def model(tool=""):
        link = (f'<link name="tool">{tool}</link><joint name="flange" type="fixed"><parent link="b_link"/>'
                f'<child link="tool"/><origin {PLACE}/></joint></robot>')  # fmt: skip
        built = build_model(xml.replace("</robot>", link)).model
        built.gravity.linear = np.array([1.0, -2.0, -9.0])
        built.armature = np.array([0.1, 0.0, 0.2])
        return built

    return model


def efforts(model, seed=3):
    states = np.random.default_rng(seed).normal(size=(40, 3, model.nv))
    data = model.createData()
    return np.array([pin.rnea(model, data, *state) for state in states])


@pytest.mark.parametrize("moments", [(0.0, 0.0, 0.0), MOMENTS], ids=["point", "body"])
def test_efforts_are_those_of_a_model_with_the_mass_in_its_text(build, moments):
    carried = with_payloads(build(), [Payload(point="tool", mass=1.7, inertia=moments)])
    written, empty = efforts(build(inertial(1.7, moments))), efforts(build())
    assert efforts(carried) == pytest.approx(written, rel=1e-13, abs=1e-13 * np.abs(written).max())
    assert np.abs(written - empty).max() > 1.0


def test_an_unknown_link_is_refused_with_the_choices(build):
    with pytest.raises(InputError, match="no link 'tol'") as caught:
        with_payloads(build(), [Payload(point="tol", mass=1.0)])
    assert "tool" in caught.value.hint
    assert "b_link" in caught.value.expected


@pytest.mark.parametrize(("given", "message"), [
    ({"mass": -1.0}, "out of bounds"),
    ({"mass": 1.0, "inertia": (1.0, 1.0, 2.1)}, "more than the sum of the other two"),

])  # fmt: skip
def test_what_no_body_has_is_refused(given, message):
    with pytest.raises((InputError, TypeError), match=message):
        Payload(point="tool", **given)
