"""Joints are numbered depth-first, whatever the order of a file or of a ``pin.Model``: ``crba`` is wrong otherwise."""

import numpy as np
import pinocchio as pin
import pytest

from pinarm.arrays import Array
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.errors import ModelError
from pinarm.mechanics.loading.pinocchio_model import build_model
from pinarm.mechanics.rotors import with_counters
from pinarm.use.mechanism import Mechanism

ROUNDING = 1e-12
"""Two sums of about twenty products each, of numbers near 1."""

INERTIA = '<inertial><origin xyz="0.1 0.2 -0.3"/><mass value="2"/><inertia ixx="1" iyy="1.2" izz="1.5"/></inertial>'
BRANCHES = (("a", "world"), ("b", "world"), ("a2", "a"), ("b2", "b"), ("a3", "a"), ("b3", "b2"), ("a4", "a2"))
"""Links and their parents, each generation after the one before it: the order that ``crba`` does not stand."""


def urdf() -> str:
    """Return the branches with joints whose names run against the depth."""
    links = "".join(f'<link name="{name}">{INERTIA}</link>' for name, _ in BRANCHES)
    joints = "".join(
        f'<joint name="{9 - len(name)}{name}" type="{kind}"><parent link="{parent}"/><child link="{name}"/>'
        '<origin xyz="0.3 0.1 0.5" rpy="0.1 0.2 0.3"/><axis xyz="0 1 0"/></joint>'
        for (name, parent), kind in zip(BRANCHES, (*("continuous", "prismatic", "spherical") * 2, "floating"),
                                        strict=True)
    )  # fmt: skip
    return f'<robot name="r"><link name="world"/>{links}{joints}</robot>'


def mjcf() -> str:
    """Return the branches as nested bodies, with two joints in one of them."""
    inertial = '<inertial pos="0.1 0.2 -0.3" mass="2" diaginertia="1 1.2 1.5"/>'

    def body(name: str) -> str:
        inner = "".join(body(child) for child, parent in BRANCHES if parent == name)
        joints = f'<joint name="j{name}" axis="0 1 0"/>' + '<joint name="two" axis="1 0 0"/>' * (name == "a2")
        return f'<body name="{name}" pos="0.3 0.1 0.5" euler="10 20 30">{inner}{joints}{inertial}</body>'

    return f"<mujoco><worldbody>{body('b')}{body('a')}</worldbody></mujoco>"


def sdf(*, reverse: bool) -> str:
    """Return the branches with joints from the leaves to the world, or the other way round."""
    order = BRANCHES[::-1] if reverse else BRANCHES
    links = "".join(
        f'<link name="{name}"><pose>0.3 {k} 0.5 0.1 0.2 0.3</pose><inertial><mass>2</mass><inertia><ixx>1</ixx>'
        "<iyy>1.2</iyy><izz>1.5</izz></inertia></inertial></link>"
        for k, (name, _) in enumerate(order)
    )
    joints = "".join(
        f'<joint name="j{name}" type="{"universal" if name == "a2" else "revolute"}"><parent>{parent}</parent>'
        f"<child>{name}</child><axis><xyz>0 1 0</xyz></axis><axis2><xyz>1 0 0</xyz></axis2></joint>"
        for name, parent in order
    )
    return f'<sdf version="1.9"><model name="m">{links}{joints}</model></sdf>'


def generations() -> pin.Model:
    """Return the branches numbered generation by generation, as a program may add them."""
    model, places = pin.Model(), {"world": 0}
    kinds = (pin.JointModelRY, pin.JointModelPZ, pin.JointModelSpherical, pin.JointModelRX, pin.JointModelPX)
    for (name, parent), kind in zip(BRANCHES, (*kinds, *kinds), strict=False):
        place = pin.SE3(pin.rpy.rpyToMatrix(0.1, 0.2, 0.3), np.array([0.3, 0.1, 0.5]))
        places[name] = model.addJoint(places[parent], kind(), place, f"j{name}")
        model.addJointFrame(places[name])
        model.appendBodyToJoint(places[name], pin.Inertia(2.0, np.array([0.1, 0.2, -0.3]), np.diag([1.0, 1.2, 1.5])),
                                pin.SE3.Identity())  # fmt: skip
    return model


def by_columns(model: pin.Model, q: Array) -> Array:
    """Return M column by column: the efforts that one acceleration alone takes, without gravity."""
    still, weightless = np.zeros(model.nv), pin.Model(model)
    weightless.gravity.vector[:] = 0.0
    data = weightless.createData()
    return np.array([pin.rnea(weightless, data, q, still, unit).copy() for unit in np.eye(model.nv)]).T


def require_true_masses(model: pin.Model) -> None:
    q = pin.integrate(model, pin.neutral(model), np.sin(np.arange(1.0, model.nv + 1.0)))
    found, true = Dynamics.of(model).mass_matrices(q[None])[0], by_columns(model, q)
    assert found == pytest.approx(true, abs=ROUNDING * np.abs(true).max())


@pytest.mark.parametrize("text", [urdf(), mjcf(), sdf(reverse=False), sdf(reverse=True)])
@pytest.mark.parametrize("base", [None, "floating"])
def test_every_format_is_read_depth_first(text: str, base: str | None) -> None:
    if base and "<sdf" in text:
        text = text.replace("<parent>world</parent>", "<parent>ground</parent>").replace(
            "<link", '<link name="ground"><inertial><mass>1</mass></inertial></link><link', 1)  # fmt: skip
    require_true_masses(build_model(text, base=base and "floating", defects="noted").model)


def test_turn_counters_are_added_at_the_end() -> None:
    require_true_masses(with_counters(build_model(urdf()).model, ["8a", "7b2"]))


def test_a_model_of_the_user_is_numbered_anew() -> None:
    """Accelerations are those of ``aba`` on the user's own numbering, which does not need depth-first joints."""
    model = generations()
    mechanism = Mechanism.of(model)
    require_true_masses(mechanism.model)
    q = pin.integrate(model, pin.neutral(model), np.cos(np.arange(1.0, model.nv + 1.0)))
    v = np.sin(np.arange(1.0, model.nv + 1.0))
    own = mechanism.from_pinocchio(q, v)
    a = pin.aba(model, model.createData(), q, v, np.zeros(model.nv))
    again = mechanism.to_pinocchio(own[0], mechanism.forward(*own))
    assert np.asarray(again[1]) == pytest.approx(a, abs=1e-9 * np.abs(a).max())


def test_what_pinocchio_computes_wrongly_is_refused() -> None:
    """By tenths of the largest entry: if Pinocchio ever does it rightly, nothing has to be refused."""
    model = generations()
    q = pin.integrate(model, pin.neutral(model), np.sin(np.arange(1.0, model.nv + 1.0)))
    upper = np.triu(pin.crba(model, model.createData(), q))
    true = np.triu(by_columns(model, q))
    assert np.abs(upper - true).max() > 0.1 * np.abs(true).max()
    with pytest.raises(ModelError, match="numbered 3, apart from 'ja' \\(1\\)") as caught:
        Dynamics.of(model)
    assert "Mechanism.of(model)" in caught.value.hint
