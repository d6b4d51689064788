"""Cables, rigid and elastic, over pulleys, taut and slack; rods and their tension."""

import json

import numpy as np
import pytest
from motions import anywhere, driven, freely

from pinarm.engine.checks.residuals import excesses
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError
from pinarm.mechanics.laws import ConstantAcceleration
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.events import EndStop
from pinarm.problems.inverse import Statics
from pinarm.use.mechanism import Mechanism

G = 9.81


@pytest.fixture
def machine(tmp_path):
    """Return a function that builds a mechanism of a drawing."""

    def build(points, ground, links, sliders, **description) -> Mechanism:
        drawn = {name: [f"{x} m", f"{y} m"] for name, (x, y) in points.items()}
        planar = {"points": drawn, "ground": ground, "links": links, "sliders": sliders}
        (tmp_path / "cable.yaml").write_text(json.dumps({"pinarm": 1, "planar": planar, **description}))
        return Mechanism.load(tmp_path / "cable.yaml")

    return build


def asked(run, *names):
    quantities = Quantities(run)
    return [quantities[name].values for name in names]


def weights(machine, first, second, cable, key="loops", size=1.0):
    """Two weights that slide up and down, tied by a cable over two pulleys P and Q; with lengths of another size."""
    points = {"A": (-1, -1), "A2": (-1, -1.2), "B": (1, -2), "B2": (1, -2.2), "P": (-1, 0), "Q": (1, 0)}
    points = {name: (size * x, size * y) for name, (x, y) in points.items()}
    links = {"a": {"points": ["A", "A2"], "mass": f"{first} kg"}, "b": {"points": ["B", "B2"], "mass": f"{second} kg"}}
    sliders = {"a": {"link": "a", "along": ["A2", "A"]}, "b": {"link": "b", "along": ["B2", "B"]}}
    sliders = {f"y{name}": slide for name, slide in sliders.items()}
    return machine(points, ["P", "Q"], links, sliders, **{key: {"rope": cable}})


ROPE = {"kind": "cable", "through": ["A", "P", "Q", "B"], "length": "5 m"}


class TestAtwoodsMachine:
    def test_acceleration_and_tension(self, machine):
        outcome = freely(weights(machine, 3.0, 2.0, ROPE), end=0.5)
        run = outcome.rows
        one, other, tension, length = asked(run, "joint.ya.acceleration", "joint.yb.acceleration",
                                            "loop.rope.tension", "loop.rope.length")  # fmt: skip
        assert one == pytest.approx(-G / 5.0, rel=1e-12)
        assert other == pytest.approx(G / 5.0, rel=1e-12)
        assert tension == pytest.approx(2.0 * 3.0 * 2.0 * G / 5.0, rel=1e-12)
        assert length == pytest.approx(5.0, rel=1e-13)
        assert outcome.measures()["energy"] < 1e-12

    def test_a_path_without_length_gives_a_cable_none(self, machine):
        points = {"O": (0, 0), "A": (0, 0), "B": (0, 1)}
        slide = {"y": {"link": "a", "along": ["A", "B"]}}
        with pytest.raises(InputError, match="the path of the cable has no length") as caught:
            machine(points, ["O"], {"a": {"points": ["A", "B"], "mass": "1 kg"}}, slide,
                    loops={"rope": {"kind": "cable", "through": ["O", "A"]}})  # fmt: skip
        assert caught.value.hint == "length: 2 m"

    def test_where_it_would_have_to_push_this_is_told(self, machine):
        """One weight is lifted with 2 g: the other one does not fall so fast by itself."""
        machine_ = weights(machine, 3.0, 2.0, ROPE)
        run = driven(machine_, {"ya": ConstantAcceleration(acceleration=2.0 * G)}, end=0.2)
        (found,) = excesses(run)
        assert found.value == pytest.approx(2.0 * (G - 2.0 * G), rel=1e-12)
        assert "cable rope would have to push with 19.62 N: it goes slack" in found.words(run)


class TestBlockAndTackle:
    def test_a_movable_pulley_halves_the_force(self, machine):
        """The cable goes down to the load and up again: ``2 S = m g`` at rest."""
        points = {"A": (0, -1), "A2": (0, -1.2), "P": (-0.0, 0), "Q": (0.5, 0), "B": (0.5, -1), "B2": (0.5, -1.2)}
        links = {"load": {"points": ["A", "A2"], "mass": "8 kg"}, "hand": {"points": ["B", "B2"], "mass": "1 kg"}}
        sliders = {"y": {"link": "load", "along": ["A2", "A"]}, "h": {"link": "hand", "along": ["B2", "B"]}}
        cable = {"kind": "cable", "through": ["P", "A", "Q", "B"], "length": f"{1.0 + np.hypot(1.0, 0.5) + 1.0} m"}
        it = machine(points, ["P", "Q"], links, sliders, loops={"rope": cable})
        run = Statics(hold={"y": 0.0}, drives=["h"]).solve(it, Accuracy(), anywhere).rows
        tension, effort = asked(run, "loop.rope.tension", "joint.h.effort")
        known = 8.0 * G / (1.0 + 1.0 / np.hypot(1.0, 0.5))
        assert tension == pytest.approx([known], rel=1e-12)
        assert effort == pytest.approx([1.0 * G - known], rel=1e-12)


def ball(machine, mass=2.0, cable=None, **more):
    """A ball in the plane on a string of 1 m; x and y are 0 below the point O at which it hangs."""
    points = {"O": (0, 0), "X": (0, -1), "X2": (1, -1), "B": (0, -1), "B2": (0, 0.5)}
    links = {"carriage": {"points": ["X", "X2"], "mass": "0 kg", "inertia": "0 kg*m^2"},
             "ball": {"points": ["B", "B2"], "mass": f"{mass} kg", "inertia": "1 kg*m^2"}}  # fmt: skip
    sliders = {"x": {"link": "carriage", "along": ["X", "X2"]},
               "y": {"link": "ball", "along": ["B", "B2"], "on": "carriage"}}  # fmt: skip
    string = {"kind": "cable", "through": ["O", "B"], "length": "1 m"}
    return machine(points, ["O"], links, sliders, **{"loops": {"string": cable or string}, **more})


class TestPendulumThatGoesSlack:
    """From the lowest point with ``2 g l < v0^2 < 5 g l`` the string is slack from ``cos a = (2 g l - v0^2)/(3 g l)``.

    a is the angle from the vertical downwards; then the ball is thrown, until its distance is l again.
    """

    V0 = 6.0

    def test_slack_thrown_and_taut_again(self, machine):
        outcome = freely(ball(machine), end=1.5, samples=301, position={"x": 0.0, "y": 0.0}, velocity={"x": self.V0})
        opened, taut = outcome.events
        cosine = (2.0 * G - self.V0**2) / (3.0 * G)
        sine = np.sqrt(1.0 - cosine**2)
        speed = np.sqrt(self.V0**2 - 2.0 * G * (1.0 - cosine))
        assert opened.name == "string opens"
        assert opened.q == pytest.approx([sine, 1.0 - cosine], abs=1e-9)
        assert opened.v == pytest.approx([speed * cosine, speed * sine], abs=1e-8)
        # thrown from (sin a, -cos a): |r|^2 = 1 gives g^2 t^2 / 4 - g v_y t + v^2 - g y = 0 beside t = 0
        quadratic = [G**2 / 4.0, -G * speed * sine, speed**2 + G * cosine]
        flight = min(t.real for t in np.roots(quadratic) if abs(t.imag) < 1e-9 and t.real > 1e-3)
        assert taut.name == "string"
        assert taut.t - opened.t == pytest.approx(flight, rel=1e-7)
        place = np.array([taut.q[0], taut.q[1] - 1.0])
        assert np.hypot(*place) == pytest.approx(1.0, abs=1e-12)
        thrown = np.array([speed * cosine, speed * sine - G * flight])
        along = place @ thrown
        assert along > 1.0  # it is drawn taut with some speed
        assert taut.v == pytest.approx(thrown - along * place, abs=1e-7)
        (tension,) = asked(outcome.rows, "loop.string.tension")
        t = outcome.rows.grid.t
        assert (tension[(t > opened.t + 1e-6) & (t < taut.t - 1e-6)] == 0.0).all()
        assert tension.min() > -1e-9
        assert outcome.measures()["energy"] < 1e-9
        assert any("cable 'string': it goes slack, first at t = 0.48446" in note for note in outcome.notes)
        assert any("cable 'string': 1 impact" in note for note in outcome.notes)

    def test_slow_enough_it_swings_and_fast_enough_it_goes_round(self, machine):
        for v0 in (np.sqrt(2.0 * G) - 0.01, np.sqrt(5.0 * G) + 0.01):
            start = {"position": {"x": 0.0, "y": 0.0}, "velocity": {"x": v0}}
            outcome = freely(ball(machine), end=1.0, tolerance=1e-8, **start)
            assert not outcome.events


class TestTwoCables:
    """A weight of 1 kg on a slide, thrown upwards, between a cable from above and one from below."""

    def drawn(self, machine, other, length):
        points = {"A": (0, 0), "B": (0, 0.1), "U": (0, 1), "V": (0, other)}
        ropes = {"up": (["U", "A"], 1.2), "other": (["V", "A"], length)}
        loops = {name: {"kind": "cable", "through": through, "length": f"{size} m"}
                 for name, (through, size) in ropes.items()}  # fmt: skip
        links, slide = {"w": {"points": ["A", "B"], "mass": "1 kg"}}, {"y": {"link": "w", "along": ["A", "B"]}}
        return machine(points, ["U", "V"], links, slide, loops=loops)

    def test_those_that_are_never_taut_together_have_their_tensions(self, machine):
        run = freely(self.drawn(machine, -1, 1.2), end=1.0, samples=11, position={"y": 0.0}, velocity={"y": 3.0}).rows
        above, below = asked(run, "loop.up.tension", "loop.other.tension")
        assert above[-1] == pytest.approx(G, rel=1e-12)
        assert not below.any()
        assert not above[run.grid.t < 0.36].any()


class TestElasticCable:
    def test_a_weight_on_a_bungee_swings_and_flies(self, machine):
        """Let go at the free length it goes ``2 m g / k`` deep; half a period ``pi sqrt(m / k)`` later it turns."""
        k, m = 200.0, 2.0
        bungee = {"kind": "cable", "through": ["O", "B"], "stiffness": f"{k} N/m", "free_length": "1 m"}
        it = ball(machine, mass=m, forces={"bungee": bungee}, loops={})
        outcome = freely(it, end=np.pi * np.sqrt(m / k), samples=3, position={"y": 0.0})
        assert outcome.rows.q[-1, 1] == pytest.approx(-2.0 * m * G / k, rel=1e-9)
        (tension,) = asked(outcome.rows, "force.bungee.tension")
        assert tension[-1] == pytest.approx(2.0 * m * G, rel=1e-9)
        higher = freely(it, end=0.3, samples=31, position={"y": 0.2})
        tension, length = asked(higher.rows, "force.bungee.tension", "force.bungee.length")
        assert (tension[length < 1.0] == 0.0).all()
        assert (length < 1.0).any()
        assert (length > 1.0).any()
        assert higher.measures()["energy"] < 1e-10

    def test_a_stiff_one_over_pulleys_tends_to_the_rigid_one(self, machine):
        stiff = {"kind": "cable", "through": ["A", "P", "Q", "B"], "stiffness": "1e6 N/m", "free_length": "5 m",
                 "damping": "2000 N*s/m"}  # fmt: skip
        run = freely(weights(machine, 3.0, 2.0, stiff, "forces"), end=0.2, samples=3, tolerance=1e-8).rows
        (tension,) = asked(run, "force.rope.tension")
        assert tension[-1] == pytest.approx(12.0 * G / 5.0, rel=1e-4)


class TestRod:
    def test_its_tension_is_positive_where_it_is_pulled(self, machine):
        """A weight on a rod from above pulls it; on a rod from below it presses it."""
        for place, sign in ((-1.0, 1.0), (1.0, -1.0)):
            points = {"O": (0, 0), "B": (0, place), "B2": (0, place + 0.1)}
            links = {"weight": {"points": ["B", "B2"], "mass": "5 kg"}}
            it = machine(points, ["O"], links, {"y": {"link": "weight", "along": ["B", "B2"]}},
                         loops={"rod": {"kind": "rod", "between": ["O", "B"], "length": "1 m"}})  # fmt: skip
            run = freely(it, end=0.1).rows
            (tension,) = asked(run, "loop.rod.tension")
            assert tension == pytest.approx(sign * 5.0 * G, rel=1e-12)


class TestBadInput:
    @pytest.mark.parametrize(("cable", "message"), [
        ({**ROPE, "through": ["A", "A", "P"]}, "A follows itself"),
        ({**ROPE, "through": ["A", "A2"]}, "one rigid body"),
        ({**ROPE, "length": "0 m"}, "length"),
    ])  # fmt: skip
    def test_what_is_wrong_is_said(self, machine, cable, message):
        with pytest.raises(InputError, match=message):
            weights(machine, 3.0, 2.0, cable)


@pytest.mark.parametrize("size", [1e-10, 1e6])
def test_weights_of_any_size_bounce_go_slack_and_pull_again(machine, size):
    """The heavier falls by 1/2 on a stop and bounces there, while the other flies on and falls back for 2 v / g."""
    cable = {"kind": "cable", "through": ["A", "P", "Q", "B"], "length": f"{5.0 * size!r} m"}
    pull = G * 5.0 / 75.0
    fallen = (size / pull) ** 0.5
    again = fallen * (1.0 + 2.0 * pull / G)
    stop = {"ya": EndStop(lower=-0.5 * size, restitution=0.3)}
    events = freely(weights(machine, 40.0, 35.0, cable, size=size), end=1.1 * again, end_stops=stop).events
    stops, pulls = ([one.t for one in events if one.name == name] for name in ("ya lower", "rope"))
    assert pulls == pytest.approx([again], rel=1e-9)
    pauses = 2.0 * fallen * pull / G * 0.3 ** np.arange(1, 9)
    assert stops[:9] == pytest.approx(fallen + np.append(0.0, pauses.cumsum()), rel=1e-9)
