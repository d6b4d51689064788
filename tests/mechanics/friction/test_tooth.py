"""Friction of teeth: against the forces of the flanks at every instant of a mesh, and in a gear that runs."""

import numpy as np
import pytest

from pinarm.errors import InputError
from pinarm.mechanics.couplings.transmissions import PitchSurfaces
from pinarm.mechanics.friction.coupling_friction import ToothMesh

ALPHA = np.radians(20.0)
MODULE = 0.004


def mesh(z1, z2, beta=0.0):
    """Return the mesh of wheels with the normal module, inner teeth negative, or of a wheel and a rack."""
    r1, r2 = 0.5 * MODULE * z1 / np.cos(beta), 0.5 * MODULE * z2 / np.cos(beta)
    curvatures = 1.0 / r1, 1.0 / r2
    return ToothMesh.of(abs(z1), PitchSurfaces(np.zeros(3), {}, (abs(r1), abs(r2)), curvatures, ALPHA, beta))


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


@pytest.mark.parametrize(("z1", "z2"), [(20, 20), (42, 18), (24, -72)])
def test_the_mean_slip_is_that_of_the_flanks_in_contact(z1, z2):
    assert mesh(z1, z2).mean_distance == pytest.approx(mean_distance(z1, z2), rel=1e-4)


def test_a_rack_is_the_limit_of_a_large_wheel():
    """The tips of a rack lie on a straight line at the distance m: the contact begins at ``m / sin alpha``."""
    rack, large = mesh(20, np.inf), mesh(20, 2_000_000)
    assert rack.contact_ratios[1] * rack.base_pitch == pytest.approx(MODULE / np.sin(ALPHA), rel=1e-14)
    # what is left of the curvature is z1 / z2 = 1e-5 of terms of the order 1
    assert rack.mean_distance == pytest.approx(large.mean_distance, rel=1e-4)
    assert rack.mean_distance != large.mean_distance
    rack.check()
    mesh(18, np.inf).check()
    with pytest.raises(InputError, match="wheels with 17 and a rack interfere"):
        mesh(17, np.inf).check()  # 2 / sin^2 alpha = 17.1


def test_helical_teeth_lose_more_by_the_helix_angle_on_the_base_cylinder():
    """``H_V = pi (u + 1) / (z1 u cos beta_b) (1 - e + e1^2 + e2^2)``, ISO/TR 14179-2, with the transverse section.

    The transverse contact ratio of 20 and 60 teeth, alpha = 20 deg, beta = 15 deg, by the sections of the tip circles;
    ``sin beta_b = sin beta cos alpha``.
    """
    beta, z1, z2 = np.radians(15.0), 20, 60
    transverse, base = np.arctan(np.tan(ALPHA) / np.cos(beta)), np.arcsin(np.sin(beta) * np.cos(ALPHA))
    expected, of_tips = mesh(z1, z2, beta), []
    for z in (z1, z2):
        tip = np.arccos(z * np.cos(transverse) / (z + 2.0 * np.cos(beta)))
        of_tips.append(z / (2.0 * np.pi) * (np.tan(tip) - np.tan(transverse)))
    e1, e2 = of_tips
    assert expected.contact_ratios == pytest.approx((e1, e2), rel=1e-13)
    bases = np.cos(transverse) * 0.5 * MODULE / np.cos(beta) * np.array([z1, z2])
    factor = np.pi * (1 / z1 + 1 / z2) / np.cos(base) * (1.0 - e1 - e2 + e1**2 + e2**2)
    assert expected.mean_distance * (1.0 / bases).sum() / np.cos(base) == pytest.approx(factor, rel=1e-12)
    # without a helix it is a spur wheel; the rest is of the order of beta^2
    assert mesh(z1, z2, 1e-5).mean_distance == pytest.approx(mesh(z1, z2).mean_distance, rel=1e-9)
    assert mesh(z1, z2, beta).mean_distance < 0.99 * mesh(z1, z2).mean_distance


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
        teeth = {key: value for key, value in teeth.items() if value is not None}
        return mechanism(text, gravity="none", couplings={"teeth": teeth}, friction=friction)

    return build


@pytest.mark.parametrize("sense", [-1.0])
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


def test_teeth_that_are_not_known_and_sizes_that_teeth_do_not_have_are_refused(gear):
    with pytest.raises(InputError, match="the teeth of the gear 'teeth' are not known"):
        gear(pressure_angle=None)
    with pytest.raises(InputError, match="would mesh with one of"):
        gear(friction={"teeth": {"mu": 0.06, "teeth": 19}})
    with pytest.raises(InputError, match="friction of teeth has no preload"):
        gear(friction={"teeth": {"mu": 0.06, "teeth": 18, "preload": "3 N"}})
