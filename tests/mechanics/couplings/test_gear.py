"""Forces of teeth and of planets against textbooks, base circles, and Newton's and Euler's equations of wheels."""

import numpy as np
import pytest
from catalogue import disc
from motions import anywhere, driven, free

from pinarm.engine.checks.balance import power_balance
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError
from pinarm.mechanics.forces.along_coordinate import JointEffort
from pinarm.mechanics.laws import Constant, Harmonic
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.inverse import Statics

ALPHA = np.deg2rad(20.0)


def gear(one, two, ratio, **more):
    return {"kind": "gear", "joints": [one, two], "ratio": ratio, "pressure_angle": "20 deg", **more}


def robot(*parts):
    return f'<robot name="gears"><link name="base"/>{"".join(parts)}</robot>'


def loaded(mechanism, held, moments):
    """What is asked of a mechanism at rest under moments at joints."""
    loads = {name: JointEffort(joint=name, effort=Constant(value=moment)) for name, moment in moments.items()}
    run = Statics(hold=held, drives=list(held), loads=loads).solve(mechanism, Accuracy(), anywhere).rows
    assert max(power_balance(run).values()) < 1e-14
    return Quantities(run)


def vector(found, name):
    return np.array([found[f"{name}.{axis}"].values[-1] for axis in "xyz"])


class TestSpurWheels:
    """20 N m on a wheel of 0.1 m: 200 N at the teeth, 200 tan 20 deg = 72.794 N apart, 212.836 N on the bearing."""

    @pytest.mark.parametrize("sign", [-1.0])
    def test_the_bearing_carries_the_force_of_the_teeth(self, mechanism, sign):
        wheels = robot(disc("one", 0.3), disc("two", 0.05, "0.15 0 0"))
        pair = mechanism(wheels, gravity="none", couplings={"mesh": gear("one", "two", -2.0)})
        found = loaded(pair, {"one": 0.3}, {"two": -10.0 * sign})
        assert found["joint.one.effort"].values == pytest.approx(-20.0 * sign, rel=1e-14)
        assert found["coupling.mesh.effort"].values == pytest.approx(10.0 * sign, rel=1e-14)
        assert found["coupling.mesh.tangential"].values == pytest.approx(200.0 * sign, rel=1e-14)
        assert found["coupling.mesh.radial"].values == pytest.approx(72.79404685, rel=1e-9)
        for joint, side in (("one", 1.0), ("two", -1.0)):  # bearings hold against being pressed apart
            force = [side * 72.79404685, -side * 200.0 * sign, 0.0]
            assert vector(found, f"joint.{joint}.force") == pytest.approx(force, rel=1e-9, abs=1e-12)
            assert found[f"joint.{joint}.force.norm"].values == pytest.approx(200.0 / np.cos(ALPHA), rel=1e-12)
        assert found["joint.one.moment.z"].values == pytest.approx(-20.0 * sign, rel=1e-14)


def eccentric(name, at, mass, off, moment):
    """A wheel whose centre of mass is off its axis, along x."""
    return f"""<link name="{name}_link"><inertial><origin xyz="{off} 0 0"/><mass value="{mass}"/>
      <inertia ixx="{moment}" iyy="{moment}" izz="{moment}" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="{name}" type="continuous"><parent link="base"/><child link="{name}_link"/><origin xyz="{at} 0 0"/>
      <axis xyz="0 0 1"/></joint>"""


def line_of_action(distance, r1, r2, internal, positive):
    """Where the force on wheel 2 acts, and its direction: the tangent of the base circles ``r cos alpha``.

    Of the two tangents that one on which teeth, which only push, turn wheel 2 the way that is asked.
    """
    b1, b2 = r1 * np.cos(ALPHA), r2 * np.cos(ALPHA)
    cosine = (b1 - b2) / distance if internal else (b1 + b2) / distance
    for side in (1.0, -1.0):
        normal = np.array([cosine, side * np.sqrt(1.0 - cosine**2)])
        one, two = b1 * normal, np.array([distance, 0.0]) + (b2 if internal else -b2) * normal
        pushed = (one - two if internal else two - one) / np.linalg.norm(two - one)
        arm = two - [distance, 0.0]
        if (arm[0] * pushed[1] - arm[1] * pushed[0] > 0) == positive:
            return two, pushed
    raise AssertionError


@pytest.mark.parametrize(("r1", "r2", "internal"), [(0.1, 0.05, False), (0.06, 0.15, True)])
def test_wheels_out_of_balance_obey_newton_and_euler_with_forces_along_the_line_of_action(mechanism, r1, r2, internal):
    distance, ratio = (abs(r1 - r2), r1 / r2) if internal else (r1 + r2, -r1 / r2)
    side = -1.0 if internal and r1 < r2 else 1.0  # where wheel 2 is, seen from wheel 1
    mass, off, moment = (3.0, 2.0), (0.02, 0.03), (0.04, 0.02)
    parts = [eccentric("one", 0.0, mass[0], off[0], moment[0]),
             eccentric("two", side * distance, mass[1], off[1], moment[1])]  # fmt: skip
    pair = mechanism(robot(*parts), gravity={"direction": "-y", "magnitude": "9.81 m/s^2"},
                     couplings={"mesh": gear("one", "two", ratio)})  # fmt: skip
    run = driven(pair, {"one": Harmonic(amplitude=2.0, pulsation=6.0)}, samples=7, drives=["one"])
    found = Quantities(run)
    names = ["one", "two"]
    for i in range(len(run)):
        forces, moments = [], []
        for k, name in enumerate(names):
            v = run.mechanism.joints[name].v
            q, rate, change = run.q[i, v], run.v[i, v], run.a[i, v]
            out = np.array([np.cos(q), np.sin(q)])
            across = np.array([-out[1], out[0]])
            forces.append(mass[k] * (off[k] * (change * across - rate**2 * out) + [0.0, 9.81]))
            moments.append((moment[k] + mass[k] * off[k] ** 2) * change + mass[k] * off[k] * 9.81 * out[0])
        # both wheels along x from the first; the picture is turned where wheel 2 is on the left
        point, pushed = line_of_action(distance, r1, r2, internal, moments[1] > 0)
        turned = side * np.eye(2)
        point, pushed = turned @ point, turned @ pushed
        arm = point - [side * distance, 0.0]
        size = moments[1] / (arm[0] * pushed[1] - arm[1] * pushed[0])
        assert size >= 0
        tooth = size * pushed
        motor = moments[0] + point[0] * tooth[1] - point[1] * tooth[0]
        assert found["joint.one.effort"].values[i] == pytest.approx(motor, rel=1e-11, abs=1e-11)
        assert vector_at(found, "coupling.mesh.force", i) == pytest.approx(tooth, rel=1e-11, abs=1e-10)
        assert vector_at(found, "joint.one.force", i) == pytest.approx(forces[0] + tooth, rel=1e-11, abs=1e-10)
        assert vector_at(found, "joint.two.force", i) == pytest.approx(forces[1] - tooth, rel=1e-11, abs=1e-10)
    assert found.figures()["bodies"] < 1e-14


def vector_at(found, name, row):
    return np.array([found[f"{name}.{axis}"].values[row] for axis in "xy"])


class TestHelicalWheels:
    """Shigley's problem 13-35: z = 18 and 32, 4 teeth/in, 20 deg, 30 deg, 800 lbf: 336, 462, in all 983 lbf."""

    INCH, LBF = 0.0254, 4.4482216152605

    @pytest.mark.parametrize("hand", [1.0, -1.0])
    def test_printed_components(self, mechanism, hand):
        pitch = 4.0 * np.cos(np.deg2rad(30.0)) / self.INCH  # teeth per metre of diameter
        r1, r2 = 18 / pitch / 2, 32 / pitch / 2
        wheels = robot(disc("one", 0.3), disc("two", 0.05, f"{r1 + r2:.17g} 0 0"))
        mesh = gear("one", "two", -18 / 32, helix_angle=f"{hand * 30} deg")
        found = loaded(mechanism(wheels, gravity="none", couplings={"mesh": mesh}), {"two": 0.0},
                       {"one": 800 * self.LBF * r1})  # fmt: skip
        tangential, radial, axial = (found[f"coupling.mesh.{part}"].values[0] / self.LBF
                                     for part in ("tangential", "radial", "axial"))  # fmt: skip
        assert tangential == pytest.approx(-800.0, rel=1e-12)  # the second one is turned backwards
        assert radial == pytest.approx(336.0, abs=0.5)  # printed to 1 lbf
        assert abs(axial) == pytest.approx(462.0, abs=0.5)
        assert found["joint.one.force.norm"].values[0] / self.LBF == pytest.approx(983.0, abs=0.5)
        # right-hand rule: the right-handed pinion turns forwards, about z, and drives: it is thrust along z
        assert found["joint.one.force.z"].values[0] / self.LBF == pytest.approx(-hand * 462.0, abs=0.5)
        assert axial == pytest.approx(-hand * 462.0, abs=0.5)


def test_bevel_wheels_share_the_separating_force_by_their_cones(mechanism):
    """Straight bevel wheels, 20 deg: radial ``Wt tan(phi) cos(gamma)``, axial ``Wt tan(phi) sin(gamma)`` of the pinion.

    Shigley's Mechanical Engineering Design, section 13-15; the pinion's radial force is the wheel's axial one.
    """
    gamma = np.arctan(1 / 3)
    face = '<link name="face"/><joint name="f" type="fixed"><parent link="base"/><child link="face"/>' \
        '<origin xyz="0.09 0 0.03"/></joint>'  # fmt: skip
    wheels = robot(disc("one", 0.3, axis="1 0 0"), disc("two", 0.05, axis="0 0 1"), face)
    pair = mechanism(wheels, gravity="none", couplings={"mesh": gear("one", "two", -1 / 3, plane="face")})
    found = loaded(pair, {"two": 0.0}, {"one": 3.0})  # 100 N at 30 mm
    assert abs(found["coupling.mesh.tangential"].values) == pytest.approx(100.0, rel=1e-12)
    assert found["coupling.mesh.separating"].values == pytest.approx(100.0 * np.tan(ALPHA), rel=1e-12)
    radial, axial = 100.0 * np.tan(ALPHA) * np.cos(gamma), 100.0 * np.tan(ALPHA) * np.sin(gamma)
    # the teeth press the pinion from its apex, along x, and towards its axis, against z; its bearing holds it
    assert vector(found, "joint.one.force") == pytest.approx([-axial, *vector(found, "joint.one.force")[1:2], radial],
                                                             rel=1e-12)  # fmt: skip
    assert vector(found, "joint.two.force") == pytest.approx(-vector(found, "joint.one.force"), rel=1e-12)
    assert abs(vector(found, "joint.one.force")[1]) == pytest.approx(100.0, rel=1e-12)


class TestPlanetary:
    """Sun, arm and ring on one axis, a planet on the arm: z = 24, 18, 60, pitch radii 48, 36 and 120 mm."""

    SUN, PLANET, RING = 24, 18, 60
    PLACE = "0.084 0 0"

    def built(self, mechanism, **more):
        planet = disc("planet", 0.004, self.PLACE).replace('<parent link="base"/>', '<parent link="arm_link"/>')
        parts = [disc("sun", 0.01), disc("arm", 0.02), disc("ring", 0.2), planet]
        couplings = {
            "inside": gear("sun", "planet", -self.SUN / self.PLANET, carrier="arm"),
            "outside": gear("planet", "ring", self.PLANET / self.RING, carrier="arm"),
        }
        return mechanism(robot(*parts), gravity="none", couplings=couplings, **more)

    def test_torques_at_rest(self, mechanism):
        """``T_sun : T_arm : T_ring = 1 : -(1 + z3/z1) : z3/z1``; the pin of the planet bears two tooth forces."""
        found = loaded(self.built(mechanism), {"arm": 0.0, "ring": 0.0}, {"sun": 12.0})
        assert found["joint.arm.effort"].values == pytest.approx(-12.0 * (1 + self.RING / self.SUN), rel=1e-13)
        assert found["joint.ring.effort"].values == pytest.approx(12.0 * self.RING / self.SUN, rel=1e-13)
        at_teeth = 12.0 / 0.048
        for mesh in ("inside", "outside"):
            assert abs(found[f"coupling.{mesh}.tangential"].values) == pytest.approx(at_teeth, rel=1e-13)
            assert found[f"coupling.{mesh}.radial"].values == pytest.approx(at_teeth * np.tan(ALPHA), rel=1e-13)
        pin = vector(found, "joint.planet.force")  # of the arm on the planet, in y: the radial forces cancel
        assert pin == pytest.approx([0.0, -2.0 * at_teeth, 0.0], abs=1e-10)
        on_sun = [at_teeth * np.tan(ALPHA), at_teeth, 0.0]
        assert vector(found, "joint.sun.force") == pytest.approx(on_sun, rel=1e-12)
        assert vector(found, "joint.arm.force") == pytest.approx([0.0, -2.0 * at_teeth, 0.0], abs=1e-10)
        assert vector(found, "joint.ring.force") == pytest.approx([-on_sun[0], on_sun[1], 0.0], rel=1e-12)

    def test_the_planet_turns_with_a_free_arm(self, mechanism):
        """The ring is held: the arm feels ``J_arm + m d^2 + J_sun (1 + z3/z1)^2 + J_planet (z3/z2 - 1)^2``."""
        loads = {"motor": JointEffort(joint="arm", effort=Constant(value=2.0))}
        box = self.built(mechanism)
        run = free(box, motion={"ring": Constant(value=0.0)}, loads=loads)
        felt = (0.02 + 0.084**2 + 0.01 * (1 + self.RING / self.SUN) ** 2
                + 0.004 * (self.RING / self.PLANET - 1.0) ** 2)  # fmt: skip
        assert run.a[:, box.joints["arm"].v] == pytest.approx(2.0 / felt, rel=1e-11)


REFUSED = {
    "coincide": (gear("sun", "ring", -0.4, carrier="arm"), "sun and ring have one axis"),


    "skew": (gear("sun", "skew", 2.0, plane="middle"), "the axes of sun and skew are skew"),

    "nowhere": (gear("sun", "planet", -2.0), "no link carries the axes of both sun and planet"),
    "spiral": (gear("cone", "sun", -0.5, plane="face", helix_angle="9 deg"), "bevel wheels are straight"),

    "sliding": (gear("nut", "bar", 0.5), "nut slides, or is carrier and wheel"),
    "both": (gear("sun", "ring", -2.0, planets=3), "one pair of wheels in mesh, or planets"),
    "in the way": (gear("bar", "wheel", 2.0), "a gear couples joints of one kind"),

}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_gear_is_refused(name, gearbox):
    coupling, message = REFUSED[name]
    with pytest.raises(InputError, match=message):
        gearbox(it=coupling)
