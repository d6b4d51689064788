"""The assembly with which runs begin, against closed forms, wherever their first row is."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.errors import AssemblyError, InputError

CRANK, ROD = 0.04, 0.14
FAR = [170, -150, 400]
WALKER = Path(__file__).parent / "walker.urdf"


def metres(*place):
    return [f"{x:.15g} m" for x in place]


def drawing(points, links, ground, **more):
    planar = {"points": {name: metres(*place) for name, place in points.items()}, "ground": ground}
    planar["links"] = {name: {"points": list(ends), "mass": "1 kg"} for name, ends in links.items()}
    return {"pinarm": 1, "planar": planar | more, "gravity": "none"}


def slider_crank(suffix="", crank=CRANK, rod=ROD, below=0.0):
    """Points, links and slider, drawn at the outer dead centre."""
    O, A, B = (name + suffix for name in "OAB")
    points = {O: (0.0, below), A: (crank, below), B: (crank + rod, below)}
    links = {f"crank{suffix}": [O, A], f"rod{suffix}": [A, B], f"piston{suffix}": [B]}
    return points, links, {f"x{suffix}": {"link": f"piston{suffix}", "along": [O, B]}}


def one(**sizes):
    points, links, sliders = slider_crank(**sizes)
    return drawing(points, links, ["O"], sliders=sliders)


def piston(angle, crank=CRANK, rod=ROD):
    """Return the way of the piston from the outer dead centre."""
    return crank * np.cos(angle) + np.sqrt(rod**2 - (crank * np.sin(angle)) ** 2) - crank - rod


def run(mechanism, problem, outputs=("O", "x")):
    return pinarm.run({"pinarm": 1, "mechanism": mechanism, "problem": problem, "outputs": list(outputs)})


def turning(angle, kind="kinematics", **more):
    law = {"law": "constant_speed", "speed": "300 rpm", "from": f"{angle} deg"}
    return {"kind": kind, "time": {"end": "0.1 s", "samples": 5}, "motion": {"O": law}, **more}


def written(folder, scenario, mechanism):
    """Return the file of a scenario, beside that of its mechanism."""
    (folder / "mechanism.yaml").write_text(json.dumps(mechanism))
    (folder / "scenario.yaml").write_text(json.dumps({"pinarm": 1, "mechanism": "mechanism.yaml", **scenario}))
    return folder / "scenario.yaml"


def assembly_notes(result):
    return [note for note in result.outcome.notes if note.startswith("assembly")]


class TestFarFromTheDrawing:
    @pytest.mark.parametrize("angle", FAR)
    @pytest.mark.parametrize("kind", ["kinematics", "inverse", "over", "hold", "forward", "led"])
    def test_a_slider_crank_is_the_one_that_is_drawn(self, kind, angle):
        """Mirrored, the piston would be beyond the crank: at 180 deg at -0.36 m in place of -0.08 m."""
        start = f"{angle} deg"
        problem = {
            "kinematics": turning(angle), "inverse": turning(angle, "inverse", drives=["O"]),
            "over": {"kind": "statics", "over": {"O": {"from": start, "to": f"{angle + 40} deg", "samples": 3}}},
            "hold": {"kind": "state", "hold": {"O": start}, "velocity": {"O": "1 rad/s"}},
            "forward": {"kind": "forward", "time": {"end": "1 ms", "samples": 3}, "initial": {
                "position": {"O": start}, "velocity": {"O": "9 rad/s"}}},
            "led": {"kind": "statics", "over": {"angle": {"from": start, "to": f"{angle + 40} deg", "samples": 3}}},
        }[kind]  # fmt: skip
        mechanism = {**one(), "coordinates": {"angle": {"kind": "sum", "of": ["O"]}}}
        found = run(mechanism, problem)
        assert found["O"].values[0] == pytest.approx(math.radians(angle))
        assert found["x"].values == pytest.approx(piston(found["O"].values), abs=1e-12)
        assert not assembly_notes(found)

    @pytest.mark.parametrize("seed", range(6))
    def test_a_four_bar_keeps_to_the_side_on_which_it_is_drawn(self, seed):
        """Where the crank can turn all the way; else both assemblies are named, and none is taken."""
        generator = np.random.default_rng(seed)
        A, B, C, angle = *generator.uniform(-1.0, 1.0, (3, 2)) * [[0.5], [1.5], [1.5]], generator.uniform(-3.5, 3.5)
        links = {"crank": "OA", "rod": "AB", "rocker": "BC"}
        mechanism = drawing({"O": (0.0, 0.0), "A": A, "B": B, "C": C}, links, ["O", "C"])
        side = np.sign((C - A)[0] * (B - A)[1] - (C - A)[1] * (B - A)[0])
        way = [
            _meeting(_turned(A, angle * s), C, math.dist(A, B), math.dist(B, C), side) for s in np.linspace(0, 1, 999)
        ]
        problem = {"kind": "kinematics", "time": {"end": "1 s", "samples": 2},
                   "motion": {"O": {"law": "constant", "value": f"{angle} rad"}}}  # fmt: skip
        places = [f"point.B.position.{axis}" for axis in "xyz"]
        if any(place is None for place in way):
            with pytest.raises((AssemblyError, InputError), match=r"out of reach|singular"):
                run(mechanism, problem, places)
            return
        found = run(mechanism, problem, places)
        reached = sorted(found[name].values[0] for name in places)
        assert reached == pytest.approx(sorted([*way[-1], 0.0]), abs=1e-10)

    def test_a_sweep_begins_as_its_runs_do(self, tmp_path):
        """The first rows are up to one turn from the drawing; lengths vary as well."""
        scenario = written(tmp_path, {"problem": turning(0), "outputs": ["x"]}, one())
        angles, lengths = [0, 5, 90, 180, 190, -150], [0.14, 0.15]
        over = {"problem.motion.O.from": [f"{angle} deg" for angle in angles],
                "changes.planar.points.B.0": [f"{CRANK + rod} m" for rod in lengths]}  # fmt: skip
        swept = pinarm.sweep(scenario, over, results=["x @ start"], workers=1)["x @ start"].values
        wanted = [piston(math.radians(angle), rod=rod) for angle in angles for rod in lengths]
        assert swept == pytest.approx(wanted, abs=1e-12)


def _turned(place, angle):
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]) @ place


def _meeting(A, C, rod, rocker, side):
    """Return the point at given distances from A and C, to one side of the line between them; None if there is none."""
    apart = np.subtract(C, A)
    length = float(np.hypot(*apart))
    along = (length**2 + rod**2 - rocker**2) / (2.0 * length)
    if rod**2 < along**2:
        return None
    return A + (along * apart + side * math.sqrt(rod**2 - along**2) * np.array([-apart[1], apart[0]])) / length


PRESSED = {"kind": "kinematics", "time": {"end": "1 s", "samples": 2},
           "motion": {"x": {"law": "constant", "value": "-30 mm"}}}  # fmt: skip


class TestOtherStarts:
    def crank(self, x=-0.03):
        """Return the angle of the crank by the law of cosines."""
        reach = CRANK + ROD + x
        return math.acos((CRANK**2 + reach**2 - ROD**2) / (2.0 * CRANK * reach))

    def test_a_start_in_a_singular_position_is_refused_and_another_one_chooses(self):
        """At the dead centre that is drawn the piston tells nothing of the side to which the crank turns."""
        with pytest.raises(AssemblyError, match=r"singular position, where several assemblies meet"):
            run(one(), PRESSED)
        for side in (1.0, -1.0):
            found = run(one(), {**PRESSED, "start": {"O": f"{side * 50} deg", "A": f"{side * -60} deg"}})
            assert found["O"].values == pytest.approx(side * self.crank(), abs=1e-12)
            assert not assembly_notes(found)

    def test_parts_are_closed_one_by_one(self):
        """Beside a press at its dead centre another slider-crank turns, whose assembly is not in question."""
        first, second = slider_crank(), slider_crank("2", below=1.0)
        points, links, sliders = (a | b for a, b in zip(first, second, strict=True))
        both = drawing(points, links, ["O", "O2"], sliders=sliders)
        motion = {**PRESSED["motion"], "O2": {"law": "constant", "value": "170 deg"}}
        with pytest.raises(AssemblyError, match="several assemblies"):
            run(both, {**PRESSED, "motion": motion})
        start = {"O": "50 deg", "A": "-60 deg"}
        found = run(both, {**PRESSED, "motion": motion, "start": start}, ["O", "x2"])
        assert found["O"].values == pytest.approx(self.crank(), abs=1e-12)
        assert found["x2"].values == pytest.approx(piston(math.radians(170.0)), abs=1e-12)

    def test_limits_choose_where_zero_lies_beyond_them(self, tmp_path):
        """Of two bends of the elbow one is within its limits; the stretched arm of the file is not."""
        (tmp_path / "arm.urdf").write_text(ARM)
        x, y = 0.5, 0.3
        bend = -math.acos((x**2 + y**2 - 0.5**2 - 0.4**2) / (2.0 * 0.5 * 0.4))
        along = {name: {"kind": "point", "point": "tip", "along": name} for name in "xy"}
        mechanism = {"pinarm": 1, "robot": "arm.urdf", "coordinates": along}
        problem = {"kind": "state", "hold": {"x": f"{x} m", "y": f"{y} m"}, "drives": ["shoulder", "elbow"]}
        found = pinarm.run(written(tmp_path, {"problem": problem, "outputs": ["elbow"]}, mechanism))
        assert found["elbow"].values == pytest.approx(bend, abs=1e-12)
        [note] = assembly_notes(found)
        assert "the start has elbow beyond the limits" in note
        assert "start: chooses another" in note

    def test_limits_choose_the_leg_of_a_walker(self, tmp_path):
        """Its effort is the slope of the potential energy, by differences of fourth order, in the only position within.

        Newton's method converges slowly on the way there: more than 60 steps.
        """
        (tmp_path / "walker.urdf").write_text(WALKER.read_text())
        mechanism = {"pinarm": 1, "robot": "walker.urdf"}
        problem = {"kind": "statics", "hold": {"crank": "0 deg"}, "drives": ["crank"]}
        file = written(tmp_path, {"problem": problem, "outputs": ["joint.crank.effort", "ef", "ki", "jk"]}, mechanism)
        found = pinarm.run(file)
        assert found["joint.crank.effort"].values == pytest.approx(-1.3480407790, rel=1e-8)
        assert [found[name].to("deg").values[0] for name in ("ef", "ki", "jk")] == pytest.approx(
            [-82.09, -26.67, -87.80], abs=0.005
        )
        explanations = pinarm.explain(file), pinarm.explain(tmp_path / "mechanism.yaml")
        model = explanations[0].mechanism.model
        for explained in explanations:
            assert (explained.q >= model.lowerPositionLimit).all()
            assert (explained.q <= model.upperPositionLimit).all()


ARM = """<robot name="arm"><link name="base"/>
<link name="upper"><inertial><origin xyz="0.2 0 0"/><mass value="1"/>
  <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
<link name="fore"><inertial><origin xyz="0.2 0 0"/><mass value="1"/>
  <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
<link name="tip"/>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.5 0 0"/>
  <axis xyz="0 0 1"/><limit lower="-3" upper="-0.1" effort="100" velocity="100"/></joint>
<joint name="end" type="fixed"><parent link="fore"/><child link="tip"/><origin xyz="0.4 0 0"/></joint></robot>"""
