"""Cams in machines, against closed forms, against linkages with the same motion, and against a reduced equation."""

import json

import numpy as np
import pytest
from motions import driven, freely

from pinarm.engine.checks.residuals import excesses
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError, UnitError
from pinarm.mechanics.laws import ConstantSpeed, Harmonic
from pinarm.use.mechanism import Mechanism

M, J, G, E, RB = 0.5, 0.003, 9.81, 0.011, 0.03
"""Masses of follower and shaft, gravity, eccentricity, and radius of the base circle."""

ECCENTRIC = {"law": "harmonic", "amplitude": f"{E} m", "pulsation": "1 rad/rad", "mean": f"{E} m", "phase": "-90 deg"}
"""``s = E (1 - cos theta)``: an eccentric disc under a flat face."""

FOLLOWER = {"points": {"O": ["0 m", "0 m"], "T": ["0 m", f"{RB} m"], "U": ["0 m", "0.12 m"]}, "ground": ["O"]}


@pytest.fixture
def machine(tmp_path):
    """Return a function that builds a mechanism of a drawing."""

    def build(planar, **description) -> Mechanism:
        (tmp_path / "cam.yaml").write_text(json.dumps({"pinarm": 1, "planar": planar, **description}))
        return Mechanism.load(tmp_path / "cam.yaml")

    return build


@pytest.fixture
def cam(machine):
    """Return a function that builds a cam with a follower that slides upwards; T is on it, at the base circle."""

    def build(profile=ECCENTRIC, *, at=("0 m", f"{RB} m"), friction=None, forces=None, **more):
        points = {**FOLLOWER["points"], "T": list(at), "U": [at[0], "0.12 m"]}
        links = {"shaft": {"points": ["O"], "mass": "1 kg", "inertia": f"{J} kg*m^2"},
                 "follower": {"points": ["T", "U"], "mass": f"{M} kg"}}  # fmt: skip
        sliders = {"lift": {"link": "follower", "along": ["T", "U"]}}
        coupling = {"kind": "cam", "joints": ["O", "lift"], "profile": profile, "period": "360 deg", **more}
        extra = {"friction": friction} if friction else {}
        return machine({"points": points, "ground": ["O"], "links": links, "sliders": sliders},
                       couplings={"cam": coupling}, forces=forces or {}, **extra)  # fmt: skip

    return build


def asked(run, *names):
    quantities = Quantities(run)
    return [quantities[name].values for name in names]


class TestEccentricDisc:
    """A disc of radius RB + E, eccentric by E, under a flat face."""

    def test_torque_contact_and_bearing_by_hand(self, cam):
        speed = 40.0
        run = driven(cam(face="T"), {"O": ConstantSpeed(speed=speed)}, end=0.2, samples=41)
        theta = run.q[:, 0]
        force = M * (G + E * np.cos(theta) * speed**2)
        torque, normal, phi, rho, beside = asked(
            run, "joint.O.effort", "coupling.cam.normal", "coupling.cam.pressure_angle",
            "coupling.cam.curvature_radius", "coupling.cam.eccentricity",
        )  # fmt: skip
        assert normal == pytest.approx(force, rel=1e-13)
        assert torque == pytest.approx(force * E * np.sin(theta), abs=1e-13)
        assert phi == pytest.approx(0.0, abs=1e-14)
        assert rho == pytest.approx(np.full(len(theta), RB + E), rel=1e-12)  # rb + s + s'': that of the disc
        assert beside == pytest.approx(E * np.sin(theta), abs=1e-15)
        fx, fy = asked(run, "joint.O.force.x", "joint.O.force.y")
        assert fx == pytest.approx(0.0, abs=1e-12)
        assert fy == pytest.approx(force + 1.0 * G, rel=1e-12)

    def test_without_contact_the_reactions_are_refused(self, cam):
        run = driven(cam(), {"O": ConstantSpeed(speed=3.0)})
        torque, _ = asked(run, "joint.O.effort", "coupling.cam.effort")
        assert np.abs(torque).max() > 0.01
        for name in ("joint.O.force.x", "coupling.cam.normal"):
            with pytest.raises(InputError, match="cam"):
                asked(run, name)


RISE = {"law": "succession", "segments": [
    {"duration": "100 deg", "motion": {"law": "cycloidal", "from": "0 m", "to": "12 mm", "duration": "100 deg"}},
    {"duration": "80 deg", "motion": {"law": "constant", "value": "12 mm"}},
    {"duration": "100 deg", "motion": {"law": "polynomial", "from": "12 mm", "to": "0 m", "duration": "100 deg"}},
    {"duration": "80 deg", "motion": {"law": "constant", "value": "0 m"}},
]}  # fmt: skip
PULLED = {"spring": {"kind": "joint_spring", "joint": "lift", "stiffness": "4 N/mm", "rest": "-20 mm"}}


@pytest.mark.parametrize(
    "contact", [{"roller": "T", "roller_radius": "8 mm"}, {"face": "T"}, {"roller": "T"}],
    ids=["roller", "face", "edge"],
)  # fmt: skip
class TestPower:
    def test_the_shaft_gives_what_the_follower_takes(self, cam, contact):
        machine = cam(RISE, at=("4 mm", "35 mm"), forces=PULLED, **contact)
        run = driven(machine, {"O": Harmonic(amplitude=3.0, pulsation=7.0)}, samples=77)
        torque, spin, speed, rate, angular = asked(
            run, "joint.O.effort", "joint.O.velocity", "joint.lift.velocity", "joint.lift.acceleration",
            "joint.O.acceleration",
        )  # fmt: skip
        lift = run.q[:, 1]
        taken = (M * (rate + G) + 4000.0 * (lift + 0.02)) * speed + J * angular * spin
        assert torque * spin == pytest.approx(taken, abs=1e-11)


def test_a_free_motion_keeps_its_energy_and_is_that_of_the_reduced_equation(cam):
    """``(J + m f'^2) theta'' + m f' f'' theta'^2 + f' (m g + k (f + d)) = 0``, by SciPy's DOP853."""
    from scipy.integrate import solve_ivp

    machine = cam(RISE, at=("4 mm", "35 mm"), forces=PULLED, roller="T", roller_radius="8 mm")
    outcome = freely(machine, end=0.05, samples=5, velocity={"O": 50.0}, tolerance=1e-10)
    relation, k = machine.constraints[0], 4000.0

    def rate(t, y):
        f, df, ddf = (x[0] for x in relation.profile(np.array([y[0]])))
        a = -(M * df * ddf * y[1] ** 2 + df * (M * G + k * (f + 0.02))) / (J + M * df**2)
        return [y[1], a]

    known = solve_ivp(rate, (0.0, 0.05), [0.0, 50.0], method="DOP853", rtol=1e-12, atol=1e-13, max_step=5e-4,
                      t_eval=np.linspace(0.0, 0.05, 5))  # fmt: skip
    own = np.isin(outcome.rows.grid.t, known.t)
    theta = np.interp(known.t, outcome.rows.grid.t, outcome.rows.q[:, 0])
    assert own.sum() >= 5
    assert theta == pytest.approx(known.y[0], abs=2e-7)
    assert outcome.measures()["energy"] < 1e-8


class TestJumpsOfTheAcceleration:
    HARMONIC = {"law": "succession", "segments": [
        {"duration": "180 deg", "motion": {"law": "harmonic", "amplitude": "10 mm", "pulsation": "1 rad/rad",
                                           "mean": "10 mm", "phase": "-90 deg"}},
        {"duration": "90 deg", "motion": {"law": "constant", "value": "20 mm"}},
        {"duration": "90 deg", "motion": {"law": "cycloidal", "from": "20 mm", "to": "0 m", "duration": "90 deg"}},
    ]}  # fmt: skip

    def test_both_sides_of_a_jump_have_their_row(self, cam):
        """A harmonic rise ends with ``-A w^2``, and the dwell begins with 0; the extremes of the table are exact."""
        speed = 10.0
        run = driven(cam(self.HARMONIC, roller="T"), {"O": ConstantSpeed(speed=speed)}, end=0.45, samples=7)
        rate = run.a[:, 1]
        assert rate.min() == pytest.approx(-0.01 * speed**2, rel=1e-6)
        beside = np.flatnonzero(np.abs(run.grid.t - np.pi / speed) < 1e-6)
        assert rate[beside] == pytest.approx([-1.0, 0.0], abs=1e-6)

    def test_turned_backwards_the_other_side_counts(self, cam):
        law = {"O": ConstantSpeed(speed=-np.pi, start=2.0 * np.pi)}
        run = driven(cam(self.HARMONIC, roller="T"), law, end=2.0, samples=3)
        assert run.a[run.grid.t == 1.0, 1] == pytest.approx([-0.01 * np.pi**2], rel=1e-9)


class TestOscillatingFollower:
    def test_a_lever_with_a_roller_by_virtual_work(self, machine):
        points = {"O": ["0 m", "0 m"], "B": ["80 mm", "30 mm"], "R": ["5 mm", "40 mm"]}
        links = {"shaft": {"points": ["O"], "mass": "1 kg", "inertia": f"{J} kg*m^2"},
                 "lever": {"points": ["B", "R"], "mass": "0.3 kg"}}  # fmt: skip
        profile = {"law": "harmonic", "amplitude": "-8 deg", "pulsation": "1 rad/rad", "mean": "-8 deg",
                   "phase": "-90 deg"}  # fmt: skip
        lever = machine({"points": points, "ground": ["O", "B"], "links": links},
                        couplings={"cam": {"kind": "cam", "joints": ["O", "B"], "profile": profile,
                                           "roller": "R", "roller_radius": "9 mm"}})  # fmt: skip
        run = driven(lever, {"O": ConstantSpeed(speed=30.0)}, end=0.3, samples=50)
        torque, normal, phi, lam = asked(run, "joint.O.effort", "coupling.cam.normal", "coupling.cam.pressure_angle",
                                         "coupling.cam.effort")  # fmt: skip
        (theta,) = asked(run, "joint.O.position")
        assert torque == pytest.approx(-lam * np.deg2rad(8.0) * np.sin(theta), abs=1e-12)
        arm = np.hypot(0.075, 0.01)
        assert np.abs(lam) == pytest.approx(np.abs(normal) * arm * np.cos(phi), rel=1e-12)
        assert normal.max() > 0.0


class TestOneSided:
    def test_an_inverse_problem_tells_where_the_follower_leaves(self, cam):
        """Without a spring, ``g + E cos(theta) w^2 < 0`` from ``cos(theta) = -g / (E w^2)`` on."""
        speed = 40.0
        run = driven(cam(face="T", closed_by="force"), {"O": ConstantSpeed(speed=speed)}, end=0.15, samples=1501)
        (found,) = excesses(run)
        leaves = np.arccos(-G / (E * speed**2))
        assert found.at == pytest.approx(leaves / speed, abs=1.01e-4)
        assert found.value == pytest.approx(M * (G - E * speed**2), rel=1e-5)
        assert "cam cam would have to pull with" in found.words(run)
        assert "the follower lifts off" in found.words(run)
        assert not excesses(driven(cam(face="T"), {"O": ConstantSpeed(speed=speed)}, end=0.15, samples=1501))

    def test_a_forward_motion_lifts_off_flies_and_lands(self, cam):
        """Lift-off where the disc falls faster than the follower; then a throw; landing where both meet again."""
        from scipy.optimize import brentq

        speed = 40.0
        machine = cam(face="T", closed_by="force")
        law = {"O": ConstantSpeed(speed=speed)}
        outcome = freely(machine, end=0.17, samples=31, motion=law)
        opened, landed = outcome.events[:2]
        t0 = np.arccos(-G / (E * speed**2)) / speed
        assert opened.name == "cam opens"
        assert opened.t == pytest.approx(t0, abs=1e-9)

        def lift(t):
            return E * (1.0 - np.cos(speed * t))

        y0, v0 = lift(t0), E * speed * np.sin(speed * t0)

        def apart(t):
            return y0 + v0 * (t - t0) - G * (t - t0) ** 2 / 2.0 - lift(t)

        t1 = brentq(apart, t0 + 0.02, 0.2)
        assert landed.name == "cam"
        assert landed.t == pytest.approx(t1, abs=1e-8)
        assert landed.before[1] == pytest.approx(v0 - G * (t1 - t0), rel=1e-8)
        assert landed.v[1] == pytest.approx(E * speed * np.sin(speed * t1), rel=1e-8)
        flying = (outcome.rows.grid.t > t0 + 1e-6) & (outcome.rows.grid.t < t1 - 1e-6)
        (normal,) = asked(outcome.rows, "coupling.cam.normal")
        assert np.array_equal(normal[flying], np.zeros(flying.sum()))
        assert normal[~flying].min() > -1e-9
        assert any("lifts off" in note for note in outcome.notes)
        assert any("cam 'cam': 1 impact" in note for note in outcome.notes)
        assert not excesses(outcome.rows)


class TestUndercutting:
    def test_a_profile_that_no_cam_has_is_told(self, cam):
        """Under a flat face where ``rb + s + s'' < 0``; with a roller where the pitch curve bends more than it does."""
        speed = {"O": ConstantSpeed(speed=1.0)}
        run = driven(cam(RISE, at=("0 m", "12 mm"), face="T"), speed, end=2.0, samples=200)
        s, bend = run.q[:, 1], run.a[:, 1]
        (found,) = excesses(run)
        assert found.rows == (0.012 + s + bend <= 0.0).sum() > 0
        first = run.grid.t[(0.012 + s + bend <= 0.0).argmax()]
        assert f"cam cam is undercut: no cam has this profile with its flat face, first at t = {first:.6g} s" in (
            found.words(run))  # fmt: skip
        assert not excesses(driven(cam(RISE, at=("0 m", "45 mm"), face="T"), speed, end=2.0, samples=200))
        wide = driven(cam(RISE, at=("0 m", "30 mm"), roller="T", roller_radius="29 mm"), speed, end=2.0, samples=200)
        assert "undercut" in excesses(wide)[0].words(wide)


class TestFriction:
    def test_a_flat_face_drags_on_the_cam(self, cam):
        """``T = F (s' + mu (rb + s))`` while the shaft turns forwards; backwards friction helps the other way."""
        mu = 0.12
        machine = cam(face="T", friction={"cam": {"mu": mu}})
        for sign in (1.0, -1.0):
            run = driven(machine, {"O": ConstantSpeed(speed=sign * 5.0, start=0.1)}, end=1.0, samples=23)
            theta = run.q[:, 0]
            s, ds, force = E * (1 - np.cos(theta)), E * np.sin(theta), M * (G + 25.0 * E * np.cos(theta))
            torque, normal, drag = asked(run, "joint.O.effort", "coupling.cam.normal", "coupling.cam.friction")
            assert normal == pytest.approx(force, rel=1e-11)
            assert np.abs(drag) == pytest.approx(mu * force, rel=1e-11)
            assert torque == pytest.approx(force * (ds + sign * mu * (RB + s)), rel=1e-10)
            across, along, bearing = asked(run, "coupling.cam.force.x", "coupling.cam.force.y", "joint.O.force.x")
            assert across == pytest.approx(-sign * mu * force, rel=1e-10)  # the face is dragged along, of the cam's top
            assert across == pytest.approx(bearing, rel=1e-10)
            assert along == pytest.approx(force, rel=1e-10)
            (about,) = asked(run, "coupling.cam.moment.z")  # of both forces, about the contact
            assert about == pytest.approx(np.zeros(23), abs=1e-14 * M * G)

    def test_a_roller_turns_on_its_pin(self, cam):
        """The power lost is ``mu N r`` times the speed of the roller, ``u / R``; u is that of rolling on the disc."""
        machine = cam(RISE, roller="T", roller_radius="10 mm", forces=PULLED,
                      friction={"cam": {"mu": 0.1, "radius": "3 mm"}})  # fmt: skip
        run = driven(machine, {"O": ConstantSpeed(speed=5.0)}, end=1.2, samples=13)
        normal, drag, torque, speed, rate = asked(
            run, "coupling.cam.normal", "coupling.cam.friction", "joint.O.effort", "joint.lift.velocity",
            "joint.lift.acceleration",
        )  # fmt: skip
        assert np.abs(drag) == pytest.approx(0.1 * 0.3 * normal, rel=1e-10)
        dwell = (run.q[:, 0] > np.deg2rad(280.0)) & (run.q[:, 0] < np.deg2rad(359.0))
        assert dwell.any()  # on the base circle of 20 mm the roller turns against the follower by 2 per turn
        assert torque[dwell] == pytest.approx(0.1 * normal[dwell] * 0.003 * 2.0, rel=1e-10)
        assert (torque * 5.0 >= (M * (rate + G) + 4000.0 * (run.q[:, 1] + 0.02)) * speed).all()

    def test_its_wrenches_do_the_power_of_its_slip_and_its_drift_is_the_rate_of_that(self, cam):
        for contact in ({"roller": "T", "roller_radius": "9 mm"}, {"face": "T"}):
            friction = {"cam": {"mu": 0.1, **({"radius": "3 mm"} if "roller" in contact else {})}}
            machine = cam(RISE, at=("3 mm", "30 mm"), friction=friction, **contact)
            slip = machine.frictions[0].slip
            run = driven(cam(RISE, at=("3 mm", "30 mm"), **contact), {"O": Harmonic(amplitude=2.0, pulsation=3.0)},
                         samples=401)  # fmt: skip
            u, rate = np.array([
                (slip.row(state) @ state.v, slip.row(state) @ a + slip.drift(state))
                for state, a in ((machine.closure.state(q, v), a) for q, v, a in zip(run.q, run.v, run.a, strict=True))
            ]).T  # fmt: skip
            smooth = slice(4, 80)  # within the rise
            numeric = np.gradient(u, run.grid.t, edge_order=2)
            assert rate[smooth] == pytest.approx(numeric[smooth], abs=1e-3 * np.abs(rate).max())


class TestBadInput:
    @pytest.mark.parametrize(("more", "message"), [
        ({"roller": "T", "face": "T"}, "a roller or a flat face"),
        ({"roller": "shaft"}, "not on the follower"),
        ({"joints": ["O", "O"]}, "coupled to itself"),
        ({"period": "300 deg"}, "does not close"),
        ({"face": "T", "normal": [0, 0, 1]}, "leaves the plane of the cam"),
    ])  # fmt: skip
    def test_what_is_wrong_is_said(self, cam, more, message):
        with pytest.raises((InputError, UnitError), match=message):
            cam(**more)
