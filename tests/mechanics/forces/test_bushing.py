"""Bushings: the energy contract at finite rotations, closed forms of small and large motions, refusals."""

import json
import math
import re
from contextlib import nullcontext

import numpy as np
import pinocchio as pin
import pytest

import pinarm
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import DynamicsError, InputError, IntegrationError
from pinarm.mechanics.forces.bushing import REACH, Bushing, DampingRates, LinearBushing, SpringRates
from pinarm.mechanics.forces.points import PointSpring, Wrench
from pinarm.mechanics.laws import Harmonic
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.equilibria import Equilibria
from pinarm.problems.forward import Forward
from pinarm.problems.inverse import Inverse
from pinarm.problems.time_grid import TimeGrid

from .test_force_element import wrenches_of

FULL = np.random.default_rng(7).normal(size=(2, 6, 6))
STIFFNESS, DAMPING = (half @ half.T * scale for half, scale in zip(FULL, (5.0, 0.3), strict=True))


def place(*path):
    return nullcontext()


def turned(rng, angle):
    """A rotation by an angle about a random axis."""
    axis = rng.normal(size=3)
    return pin.exp3(angle * axis / np.linalg.norm(axis))


@pytest.fixture(scope="module")
def two_bodies():
    """Two bodies that move freely, each with a frame off its origin."""
    model, rng = pin.Model(), np.random.default_rng(3)
    for name in ("a", "b"):
        joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), name)
        model.addFrame(pin.Frame(name, joint, pin.SE3(turned(rng, 1.0), rng.normal(size=3)), pin.FrameType.BODY))
    return model, tuple(model.getFrameId(name) for name in ("a", "b"))


def between(two_bodies, *, swapped=False, stiffness=STIFFNESS, damping=DAMPING):
    model, frames = two_bodies
    return LinearBushing(model, frames[::-1] if swapped else frames, stiffness, damping, model.createData())


def posed(two_bodies, seed, angle):
    """A configuration in which the frames are an angle apart, and a velocity, both otherwise random."""
    model, (first, second) = two_bodies
    rng = np.random.default_rng(seed)
    start = pin.SE3(turned(rng, rng.uniform(0.0, 3.0)), rng.normal(size=3))
    end = start * pin.SE3(turned(rng, angle), rng.normal(size=3))
    bodies = (start * model.frames[first].placement.inverse(), end * model.frames[second].placement.inverse())
    return np.concatenate([pin.SE3ToXYZQUAT(body) for body in bodies]), rng.normal(size=12)


def load(element, q, v):
    tau = np.zeros_like(v)
    element.add_load(0.0, q, v, tau)
    return tau


class TestContract:
    @pytest.mark.parametrize("angle", [2.9])
    def test_every_direction_obeys_it_not_only_the_velocity(self, two_bodies, differentiate, angle):
        model, _ = two_bodies
        element = between(two_bodies, damping=np.zeros((6, 6)))
        q, _ = posed(two_bodies, 11, angle)
        tau = load(element, q, np.zeros(12))
        for k, step in enumerate(np.eye(12)):
            energy = lambda t, step=step: element.potential_energy(pin.integrate(model, q, t * step))  # noqa: E731
            # energies near 300 J, differenced over 2 mrad
            assert tau[k] == pytest.approx(-differentiate(energy, 0.0, h=0.002), abs=1e-8)

    def test_small_deflections_are_those_of_the_matrix(self, two_bodies, differentiate):
        """The wrench on frame 2, in its own axes, is -K x: K by differences of it."""
        model, (first, second) = two_bodies
        element = between(two_bodies, damping=np.zeros((6, 6)))
        start = pin.SE3(turned(np.random.default_rng(0), 1.0), np.array([0.2, -0.4, 0.9]))
        bodies = (start * model.frames[frame].placement.inverse() for frame in (first, second))
        q, data = np.concatenate([pin.SE3ToXYZQUAT(body) for body in bodies]), model.createData()

        def pull(h, direction):
            step = model.frames[second].placement.act(pin.Motion(direction)).vector
            moved = pin.integrate(model, q, np.concatenate([np.zeros(6), h * step]))
            pin.framesForwardKinematics(model, data, moved)
            wrench = wrenches_of(element, model, 0.0, moved, np.zeros(12))[model.frames[second].parentJoint]
            return data.oMf[second].actInv(pin.Force(wrench)).vector

        found = np.array([differentiate(lambda h, x=x: pull(h, x), 0.0) for x in np.eye(6)])
        assert -found == pytest.approx(STIFFNESS, abs=1e-9 * STIFFNESS.max())


SIX = [*({"name": axis, "kind": "prismatic", "axis": axes, "mass": 0.0, "inertia": (0.0, 0.0, 0.0)}
         for axis, axes in (("x", "1 0 0"), ("y", "0 1 0"), ("z", "0 0 1"))),
       *({"name": name, "axis": axes, "mass": 0.0, "inertia": (0.0, 0.0, 0.0)}
         for name, axes in (("roll", "1 0 0"), ("pitch", "0 1 0")))]  # fmt: skip
MASS, INERTIA = 2.5, (0.3, 0.5, 0.7)
BODY = [*SIX, {"name": "yaw", "mass": MASS, "inertia": INERTIA}]
MOUNT = SpringRates(translation=(900.0, 400.0, 1600.0), rotation=(30.0, 80.0, 20.0))


def held(stiffness=MOUNT, **given):
    return {"mount": Bushing(between=("base", "yaw_link"), stiffness=stiffness, **given)}


@pytest.fixture
def body(mechanism, chain):
    """A body with six degrees of freedom, each a joint, without weight."""
    return mechanism(chain(*BODY), gravity="none")


def run(mechanism, end, samples=101, accuracy=None, **content):
    problem = Forward(time=TimeGrid(end=end, samples=samples), **content)
    return problem.solve(mechanism, accuracy or Accuracy(tolerance=1e-12), place).rows


class TestSmallMotions:
    squares = sorted([900.0 / MASS, 400.0 / MASS, 1600.0 / MASS, 30.0 / 0.3, 80.0 / 0.5, 20.0 / 0.7])

    def test_frequencies_of_a_body_at_rest(self, body):
        """k / m along each axis, and k / I about it."""
        rest = Equilibria(starts=[{}, {"x": 0.2, "yaw": 0.3, "roll": -0.3}], loads=held())
        found = rest.solve(body, Accuracy(), place).rows
        assert len(found) == 1
        squares = [found.columns[f"equilibrium.frequency2_{k}"].values[0] for k in range(1, 7)]
        assert squares == pytest.approx(self.squares, rel=1e-11)

    def test_the_tip_of_a_cantilever(self, body):
        """F L^3 / 3 E I and F L^2 / 2 E I, from the end stiffness of an Euler-Bernoulli beam along x."""
        length, rigidity, force = 0.8, 6.0, 1e-4
        beam = SpringRates(
            translation=(1e4, 12 * rigidity / length**3, 12 * rigidity / length**3),
            rotation=(50.0, 4 * rigidity / length, 4 * rigidity / length),
            coupling={"y_rz": -6 * rigidity / length**2, "z_ry": 6 * rigidity / length**2},
        )
        for axis, turn, sign in ((1, "yaw", 1.0), (2, "pitch", -1.0)):
            push = Wrench(point="yaw_link", force=force * np.eye(3)[axis])
            bent = Equilibria(starts=[{}], loads={**held(beam), "push": push}).solve(body, Accuracy(), place).rows
            deflection, slope = bent.q[0, axis], bent.q[0, body.joints[turn].q]
            # at a slope of 5e-6 rad what is not linear is of that order
            assert deflection == pytest.approx(force * length**3 / (3 * rigidity), rel=2e-5)
            assert slope == pytest.approx(sign * force * length**2 / (2 * rigidity), rel=2e-5)


class TestLargeMotions:
    @pytest.mark.parametrize("amplitude", [2.9])
    def test_torsion_about_one_axis_is_linear(self, mechanism, chain, amplitude):
        """U = k phi^2 / 2 exactly: phi = a cos(sqrt(k / I) t), up to half a turn."""
        wheel = mechanism(chain({"name": "turn", "mass": 1.0, "inertia": (0.2, 0.3, 0.4)}))
        rod = Bushing(between=("base", "turn_link"), stiffness=SpringRates(rotation=(5.0, 7.0, 10.0)))
        swing = run(wheel, 3.0, initial={"position": {"turn": amplitude}}, loads={"rod": rod})
        assert swing.q[:, 0] == pytest.approx(amplitude * np.cos(5.0 * swing.grid.t), abs=1e-10)

    def soft(self, ends):
        coupled = SpringRates(translation=(30.0, 50.0, 20.0), rotation=(6.0, 9.0, 4.0),
                              coupling={"y_rz": -8.0, "z_ry": 5.0, "x_rx": 3.0})  # fmt: skip
        return Bushing(between=ends, stiffness=coupled)

    def test_two_bodies_in_space_keep_energy_and_momentum(self, mechanism):
        """Joined by the bushing alone: both roots float, and nothing acts on the two together."""
        inertial = ('<inertial><mass value="{}"/><inertia ixx="0.2" iyy="0.3" izz="0.4" ixy="0" ixz="0" iyz="0"/>'
                    "</inertial>")  # fmt: skip
        parts = "".join(
            f'<link name="{name}">{inertial.format(mass)}</link><joint name="to_{name}" type="floating">'
            f'<parent link="base"/><child link="{name}"/></joint>' for name, mass in (("a", 1.0), ("b", 2.0))
        )  # fmt: skip
        pair = mechanism(f'<robot name="pair"><link name="base"/>{parts}</robot>', gravity="none")
        start = {
            "position": {"to_b.x": 0.5, "to_b.roll": 1.0, "to_b.yaw": 1.2},
            "velocity": {"to_a.angular_velocity.x": 1.5, "to_b.y": 0.7, "to_b.angular_velocity.z": -2.0},
        }
        flight = Quantities(run(pair, 3.0, initial=start, loads={"mount": self.soft(("a", "b"))}))
        assert flight["force.mount.rotation.norm"].values.max() > 1.0
        assert np.ptp(flight["energy.kinetic"].values) > 1.0
        momenta = (f"momentum.all.{part}.{axis}" for part in ("linear", "angular") for axis in "xyz")
        for name in ("energy.total", *momenta):
            assert flight[name].values == pytest.approx(flight[name].values[0], rel=1e-9, abs=1e-10), name


TURN = {"name": "turn", "inertia": (0.2, 0.3, 0.4)}
WEAK = Bushing(between=("base", "turn_link"), stiffness=SpringRates(rotation=(0.0, 0.0, 1.0)))


class TestHalfATurn:
    @pytest.mark.parametrize("accuracy", [
        {"tolerance": 1e-10}, {"method": "stiff", "tolerance": 1e-8}, {"method": "rk4", "step": 0.002},
    ], ids=lambda accuracy: accuracy.get("method", "dop853"))  # fmt: skip
    def test_a_motion_that_goes_there_ends_in_words(self, mechanism, chain, accuracy):
        wheel = mechanism(chain(TURN))
        says = r"force 'rod': its frames base and turn_link are turned by 1[67]"
        with pytest.raises(IntegrationError, match=says) as caught:
            run(wheel, 4.0, initial={"velocity": {"turn": 6.0}}, loads={"rod": WEAK}, accuracy=Accuracy(**accuracy))
        kept = caught.value.partial.rows
        # w = sqrt(k / I): the angle is 6 / w sin(w t) up to there
        w = math.sqrt(1.0 / 0.4)
        assert kept.q[-1, 0] == pytest.approx(6.0 / w * math.sin(w * kept.grid.t[-1]), abs=1e-5)
        assert 2.7 < kept.q[-1, 0] <= REACH

    @pytest.mark.parametrize("kind", ["statics", "inverse"])
    @pytest.mark.parametrize(("end", "samples"), [(120, 3), (200, 5), (-500, 6)])
    def test_what_passes_half_a_turn_between_rows_is_refused(self, tmp_path, chain, kind, end, samples):
        """A torque of k phi at every row, or the place where it would leap: 160 deg are no 200 deg turned back."""
        (tmp_path / "wheel.urdf").write_text(chain(TURN))
        rod = {"kind": "bushing", "between": ["base", "turn_link"], "stiffness": {"rotation": [0.0, 0.0, "1 N*m/rad"]}}
        way = {"statics": {"over": {"turn": {"from": "0 deg", "to": f"{end} deg", "samples": samples}}},
               "inverse": {"time": {"end": "1 s", "samples": samples},
                           "motion": {"turn": {"law": "constant_speed", "speed": f"{end} deg/s"}}}}[kind]  # fmt: skip
        (tmp_path / "s.yaml").write_text(json.dumps({
            "pinarm": 1, "mechanism": "wheel.urdf", "problem": {"kind": kind, "loads": {"rod": rod}, **way},
            "outputs": ["turn", "joint.turn.effort"]}))  # fmt: skip
        if abs(end) < 170.0:
            result = pinarm.run(tmp_path / "s.yaml")
            assert result["joint.turn.effort"].values == pytest.approx(np.radians(np.linspace(0, end, samples)))
            return
        with pytest.raises(DynamicsError, match=r"'rod' .* half a turn apart, and a bushing acts up to 170") as caught:
            pinarm.run(tmp_path / "s.yaml")
        part = abs(end) / (samples - 1) / 8
        whole = np.radians(abs(end)) if kind == "statics" else 1.0
        assert abs(caught.value.data["t"]) == pytest.approx(whole * 180.0 / abs(end), abs=whole * part / abs(end))


ARM = [{"name": "shoulder", "axis": "0 1 0", "com": "0.2 0 0"}, {"name": "elbow", "axis": "0 0 1", "at": "0.5 0 0"}]


class TestQuantities:
    def swung(self, arm):
        loads = {
            "pad": Bushing(between=("shoulder_link", "elbow_link"), stiffness=MOUNT,
                           damping=DampingRates(rotation=(1.0, 1.0, 2.0))),
            "m.1": Bushing(between=("base", "elbow_link"), stiffness=MOUNT),
            "line": PointSpring(between=("base", "elbow_link"), stiffness=30.0, damping=2.0, free_length=0.4),
        }  # fmt: skip
        motion = {"shoulder": Harmonic(amplitude=0.9, pulsation=2.0), "elbow": Harmonic(amplitude=1.1, pulsation=3.0)}
        return (
            Inverse(time=TimeGrid(end=1.0, samples=21), motion=motion, loads=loads).solve(arm, Accuracy(), place).rows
        )

    @pytest.fixture
    def moved(self, mechanism, chain):
        return self.swung(mechanism(chain(*ARM)))

    def test_reactions_balance_every_body(self, mechanism, chain):
        found = Quantities(self.swung(mechanism(chain(ARM[0], {**ARM[1], "axis": "0.6 0 0.8"}))))
        assert np.ptp(found["joint.shoulder.force.x"].values) > 10.0
        assert found.figures()["bodies"] < 1e-14
        # what the wrenches leave about the axes of the joints is what the loads leave to the drives
        elbow = "0.6*joint.elbow.moment.along.shoulder_link.x + 0.8*joint.elbow.moment.along.shoulder_link.z"
        for name, moment in (("shoulder", "joint.shoulder.moment.y"), ("elbow", elbow)):
            effort = found[f"joint.{name}.effort"].values
            assert found[moment].values == pytest.approx(effort, abs=1e-12)
            assert np.ptp(effort) > 1.0

    def test_deflection_and_wrench_by_name(self, moved):
        found, q, v = Quantities(moved), moved.q, moved.v
        names = found.names()
        values = {
            name: found[f"force.pad.{name}"].values
            for name in ("rotation.along.shoulder_link.z", "rotation.norm", "moment.along.elbow_link.z", "force.norm")
        }
        assert values["rotation.along.shoulder_link.z"] == pytest.approx(q[:, 1], abs=1e-14)
        assert values["rotation.norm"] == pytest.approx(np.abs(q[:, 1]), abs=1e-14)
        # the origins are 0.5 m apart along x of the first link, so along the halfway axes the pull has two components
        x, y = 0.5 * np.cos(q[:, 1] / 2), -0.5 * np.sin(q[:, 1] / 2)
        pull = np.hypot(900.0 * x, 400.0 * y)
        assert values["force.norm"] == pytest.approx(pull, rel=1e-13)
        torque = -20.0 * q[:, 1] - 2.0 * v[:, 1] + 0.5 * (x * 400.0 * y - y * 900.0 * x)
        assert values["moment.along.elbow_link.z"] == pytest.approx(torque, abs=1e-11)
        assert found["force.m.1.displacement.x"].values == pytest.approx(0.5 * np.cos(q[:, 0]), abs=1e-14)
        assert {"force.pad.force.x", "force.m.1.displacement.norm", "force.line.tension"} <= set(names)
        units = {"force.pad.rotation.x": "rad", "force.pad.moment.x": "N*m", "force.line.length": "m"}
        assert {name: str(found[name].unit) for name in units} == units


class TestInput:
    @pytest.mark.parametrize("kind", [DampingRates])
    @pytest.mark.parametrize(("given", "named"), [
        ({"translation": (1.0, 4.0, 0.0), "coupling": {"x_y": 2.1}}, "x, y"),
        ({"translation": (1.0, 1.0, 1.0), "rotation": (0.0, 1.0, 0.0), "coupling": {"z_rx": 1e-3}}, "rx"),
        ({"translation": (1.0, 1.0, 1.0), "coupling": {"x_y": -0.6, "y_z": -0.6, "x_z": -0.6}}, "x, y, z"),

    ])  # fmt: skip
    def test_matrices_that_give_energy_away_are_refused(self, kind, given, named):
        with pytest.raises(InputError, match=f"{named} together the matrix is negative") as caught:
            kind(**given)
        assert caught.value.path == ("coupling",)

    def test_a_file_says_it_with_units_and_learns_where_it_errs(self, tmp_path, chain):
        def written(coupling):
            (tmp_path / "wheel.urdf").write_text(chain(TURN))
            (tmp_path / "mechanism.yaml").write_text(f"""\
pinarm: 1
robot: wheel.urdf
forces:
  pad:
    kind: bushing
    between: [base, turn_link]
    stiffness:
      translation: [1 kN/m, 1 kN/m, 2 N/mm]
      rotation: [4 N*m/rad, 4 N*m/rad, 1 N*m/deg]
      coupling: {coupling}
""")
            return pinarm.Mechanism.load(tmp_path / "mechanism.yaml")

        pad = written("{y_rz: -20 N/rad}").forces["pad"]
        expected = np.diag([1000.0, 1000.0, 2000.0, 4.0, 4.0, 180 / math.pi])
        expected[1, 5] = expected[5, 1] = -20.0
        assert pad.stiffness == pytest.approx(expected, rel=1e-15)
        assert not pad.damping.any()
        assert written("{y_rz: -20 N}").forces["pad"].stiffness[5, 1] == -20.0
        for coupling, says in {
            "{y_rz: -20 N/m}": r"mechanism.yaml:10:\d+: 'N/m' is not a unit",
            "{z_rz: 1 kN/rad}": r"mechanism.yaml:10:7: in z, rz together the matrix is negative",
            "{rz_y: 1 N/rad}": r"mechanism.yaml:10:18: a bushing has no entry 'rz_y'",
        }.items():
            with pytest.raises(InputError) as caught:
                written(coupling)
            assert re.search(says, str(caught.value))
