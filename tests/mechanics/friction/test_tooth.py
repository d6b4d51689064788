"""Friction of spur teeth: against the forces of the flanks at every instant of a mesh, and in a gear that runs."""

import numpy as np
import pytest

from pinarm.errors import InputError
from pinarm.mechanics.friction.tooth import SpurMesh

ALPHA = np.radians(20.0)
MODULE = 0.004


def mesh(z1, z2):
    return SpurMesh(z1, (0.5 * MODULE * z1, 0.5 * MODULE * z2), ALPHA)


def mean_distance(z1, z2):
    """Return the mean of ``|g|`` over a mesh, by the flanks in contact at 200,000 instants, which share the force.

    Along the line of action from where the tip circle of wheel 2 meets it to where that of wheel 1 does.
    """
    r1, r2 = 0.5 * MODULE * z1, 0.5 * MODULE * z2
    pitch = np.pi * MODULE * np.cos(ALPHA)
    foot1, foot2 = r1 * np.sin(ALPHA), -r2 * np.sin(ALPHA)  # of the base circles, from the pitch point
    end = -foot1 + np.sqrt((r1 + MODULE) ** 2 - (r1 * np.cos(ALPHA)) ** 2)
    begin = -foot2 + np.sign(z2) * -np.sqrt((r2 + MODULE) ** 2 - (r2 * np.cos(ALPHA)) ** 2)
    g = begin + (np.arange(200_000)[:, None] + 0.5) / 200_000 * pitch + pitch * np.arange(3)
    touching = g <= end
    return ((np.abs(g) * touching).sum(axis=1) / touching.sum(axis=1)).mean()


@pytest.mark.parametrize(("z1", "z2"), [(20, 20), (18, 42), (42, 18), (24, -72), (40, -60), (35, 90)])
def test_the_mean_slip_is_that_of_the_flanks_in_contact(z1, z2):
    assert mesh(z1, z2).mean_distance == pytest.approx(mean_distance(z1, z2), rel=1e-4)


def test_the_loss_is_that_of_the_formula():
    """Ohlendorf's ``H_V = pi (u + 1) / (z1 u) (1 - e + e1^2 + e2^2)``, u = z2/z1, e of 20 and 20 teeth 1.557.

    So ISO/TR 14179-2 has it, and programs of gear losses by others compute it.
    """
    found = mesh(20, 20)
    assert sum(found.contact_ratios) == pytest.approx(1.557, abs=5e-4)
    e1, e2 = found.contact_ratios
    expected = np.pi * (1 / 20 + 1 / 20) * (1 - e1 - e2 + e1**2 + e2**2)
    base = 0.5 * MODULE * 20 * np.cos(ALPHA)
    assert found.mean_distance * (1.0 / base + 1.0 / base) == pytest.approx(expected, rel=1e-12)


def test_teeth_that_do_not_fit_are_refused():
    with pytest.raises(InputError, match=r"would mesh with one of 41\.4"):
        SpurMesh(23, (0.01, 0.018), ALPHA).check()
    with pytest.raises(InputError, match="interfere"):
        mesh(5, 5).check()
    mesh(18, 42).check()


WHEELS = ({"name": "one", "axis": "0 0 1"}, {"name": "two", "axis": "0 0 1"})
RATIO = -18.0 / 42.0
LOSS = {"teeth": {"mu": 0.06, "teeth": 18}}


@pytest.fixture
def gear(mechanism, chain):
    """Return a pair of wheels, 18 and 42 teeth of 4 mm, with friction; senses are those of the joints' axes."""

    def build(sense=1.0, ratio=RATIO, friction=LOSS, **more):
        first, second = chain(WHEELS[0]), chain({**WHEELS[1], "at": "0.12 0 0", "axis": f"0 0 {sense}"})
        link = second[second.index('<link name="two_link"') : second.index("</robot>")]
        text = first.replace("</robot>", f"{link}</robot>")
        teeth = {"kind": "gear", "joints": ["one", "two"], "ratio": sense * ratio, "pressure_angle": "20 deg", **more}
        return mechanism(text, gravity="none", couplings={"teeth": teeth}, friction=friction)

    return build


@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize("speed", [3.0, -3.0])
@pytest.mark.parametrize("load", [50.0, -50.0])
def test_a_gear_loses_that_part_of_its_power(gear, sense, speed, load):
    """Of the power ``lam w2`` of the teeth ``mu H_V`` is lost, driven by either wheel, either way."""
    pair = gear(sense)
    v = np.array([[speed, sense * RATIO * speed]])
    # an acceleration that asks for the load: inertias of 0.1 kg m^2
    a = np.array([[load / RATIO / 0.1, sense * load / 0.1]])
    found = pair.at(np.zeros((1, 2)), v, a, drives=["one"])
    lam, friction = (found[f"coupling.teeth.{part}"].values[0] for part in ("effort", "friction"))
    e1, e2 = mesh(18, 42).contact_ratios
    loss = 0.06 * np.pi * (1 / 18 + 1 / 42) * (1 - e1 - e2 + e1**2 + e2**2)
    assert found["power.friction"].values[0] == pytest.approx(-loss * abs(lam * v[0, 1]), rel=1e-12)
    assert abs(friction) == pytest.approx(0.06 * abs(lam) / (0.084 * np.cos(ALPHA)), rel=1e-12)
    effort = found["joint.one.effort"].values[0]
    power = effort * speed + found["power.friction"].values[0] - (0.1 * a * v).sum()
    assert power == pytest.approx(0.0, abs=1e-9)


def test_a_gear_without_teeth_or_with_slanted_ones_is_refused(gear):
    with pytest.raises(InputError, match="not a pair of spur wheels"):
        gear(helix_angle="20 deg")
    with pytest.raises(InputError, match="would mesh with one of"):
        gear(friction={"teeth": {"mu": 0.06, "teeth": 19}})
