"""Several frictions that hold one motion: what each holds is told as a band, by hand and by statics."""

import numpy as np
import pytest

import pinarm
from pinarm.engine.friction import complementarity
from pinarm.errors import InputError
from pinarm.use.study.restore import restore

LOAD, GUIDE = 15.0 * 9.81, 60.0
"""Weight of the door, and the most that its guide holds [N]."""

HOIST = """\
pinarm: 1
planar:
  points: {W: [-1 m, 0], D: [-1 m, 1 m], G: [0, 0], U: [0, 3 m]}
  ground: [W, D, U]
  links:
    worm: {points: [W], mass: 0.5 kg, centre: W, inertia: 1e-4 kg*m^2}
    drum: {points: [D], mass: 6 kg, centre: D, inertia: 0.02 kg*m^2}
    door: {points: [G], mass: 15 kg, centre: G, inertia: 1 kg*m^2}
  sliders: {lift: {link: door, along: [G, U]}}
couplings:
  gear: {kind: gear, joints: [W, D], ratio: 0.05}
  cable: {kind: rack, joints: [D, lift], radius: 60 mm}
"""
REST = """\
pinarm: 1
mechanism: mechanism.yaml
problem:
  kind: forward
  time: {end: 1 s, samples: 3}
  initial: {position: {lift: 1 m}}
outputs: [coupling.cable.effort, joint.lift.friction]
"""
HELD = """\
pinarm: 1
mechanism: mechanism.yaml
problem: {kind: statics, hold: {lift: 1 m}, drives: [lift]}
outputs: [joint.lift.effort.lower, joint.lift.effort.upper]
"""


@pytest.fixture
def hoist(tmp_path):
    """Write a door on a rope and a worm gear with friction of the gear, and of the guide where it is asked for."""

    def written(gear, guide=True, scenario=REST):
        friction = f"friction:\n  gear: {gear}\n" + (f"  lift: {{constant: {GUIDE} N}}\n" if guide else "")
        (tmp_path / "mechanism.yaml").write_text(HOIST + friction)
        (tmp_path / "scenario.yaml").write_text(scenario)
        return tmp_path / "scenario.yaml"

    return written


LOCKS = "{mu: 0.12, radius: 20 mm, lead_angle: 4.5 deg}"
SLIPS = "{mu: 0.06, constant: 4 N, radius: 20 mm, lead_angle: 4.5 deg}"


def test_the_guide_of_a_door_on_a_gear_that_locks_holds_anything_within_its_limit(hoist):
    """The rope carries the weight less what the guide holds."""
    result = pinarm.run(hoist(LOCKS))
    for name, low, high in (("joint.lift.friction", -GUIDE, GUIDE),
                            ("coupling.cable.effort", LOAD - GUIDE, LOAD + GUIDE)):  # fmt: skip
        assert result[f"{name}.least"].values == pytest.approx(np.full(3, low), rel=1e-10)
        assert result[f"{name}.greatest"].values == pytest.approx(np.full(3, high), rel=1e-10)
        assert low <= result[name].values[0] <= high
        told = result.headline(result[name])
        assert (told["min"], told["max"]) == pytest.approx((low, high), rel=1e-10)
    assert result["coupling.cable.effort"].doubt.startswith("not determined in 3 of 3 rows")


def test_numbers_that_depend_on_it_are_refused_and_their_bands_told(hoist):
    result = pinarm.run(hoist(LOCKS))
    for place in ("start", "end", "max", "rms"):
        with pytest.raises(InputError, match=r"not determined in 3 of 3 rows.* anything from 87\.15 to 207\.15 N"):
            result.number(f"coupling.cable.effort @ {place}")
    assert result.number("coupling.cable.effort.greatest @ max")[0] == pytest.approx(LOAD + GUIDE, rel=1e-10)
    assert result.number("joint.lift.position @ max")[0] == pytest.approx(1.0, rel=1e-14)
    # what both hold together is determined
    sums = "joint.lift.friction + coupling.cable.effort @ max"
    assert result.number(sums)[0] == pytest.approx(LOAD, rel=1e-12)


def test_a_gear_that_does_not_lock_needs_the_guide_as_statics_says(hoist):
    """In statics a drive in place of the guide's friction holds the door from ``lower`` to ``upper``."""
    statics = pinarm.run(hoist(SLIPS, guide=False, scenario=HELD))
    lower, upper = (float(statics[f"joint.lift.effort.{side}"].values[0]) for side in ("lower", "upper"))
    assert 0.0 < lower < GUIDE < upper
    result = pinarm.run(hoist(SLIPS))
    assert result["joint.lift.friction.least"].values == pytest.approx(np.full(3, lower), rel=1e-9)
    assert result["joint.lift.friction.greatest"].values == pytest.approx(np.full(3, GUIDE), rel=1e-10)


def test_a_brake_on_the_drum_leaves_the_rope_to_the_guide(hoist, tmp_path):
    """Three joints share the weight, and the gear raises its own load."""
    path = hoist(LOCKS)
    mechanism = tmp_path / "mechanism.yaml"
    mechanism.write_text(mechanism.read_text() + "  D: {constant: 1 N*m}\n")
    result = pinarm.run(path)
    ends = (result[f"coupling.cable.effort.{end}"].values for end in ("least", "greatest"))
    assert list(map(float, map(np.mean, ends))) == pytest.approx([LOAD - GUIDE, LOAD + GUIDE], rel=1e-10)


def test_ends_that_are_not_known_are_infinite(hoist, tmp_path, monkeypatch):
    """As of many joints that hold one motion."""
    monkeypatch.setattr(complementarity, "MOST", 1)
    result = pinarm.run(hoist(LOCKS))
    for read in (result, restore(result.save(tmp_path / "saved", plots=True))):
        assert (read["coupling.cable.effort.least"].values == -np.inf).all()
        assert (read["coupling.cable.effort.greatest"].values == np.inf).all()
        assert read["joint.lift.position.greatest"].values == pytest.approx(np.ones(3), rel=1e-14)
    with pytest.raises(InputError, match="anything from -inf to inf N"):
        result.number("coupling.cable.effort @ max")


def test_what_one_friction_holds_is_determined(hoist):
    result = pinarm.run(hoist(LOCKS, guide=False, scenario=REST.replace(", joint.lift.friction", "")))
    assert not result.trajectory.others
    assert result.number("coupling.cable.effort @ max")[0] == pytest.approx(LOAD, rel=1e-12)


BODY = '<inertial><mass value="{}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
SLIDE = (
    '<joint name="{0}_slide" type="prismatic"><parent link="base"/><child link="{0}"/><origin xyz="{1}"/>'
    '<axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="1" velocity="1"/></joint>'
)
EYE = (
    '<link name="{0}"/><joint name="{0}_fixed" type="fixed"><parent link="base"/><child link="{0}"/>'
    '<origin xyz="{1}"/></joint>'
)
COUNTERWEIGHT = (
    f'<link name="door">{BODY.format(15)}</link><link name="weight">{BODY.format(10)}</link>'
    + SLIDE.format("door", "0 0 0") + SLIDE.format("weight", "1 0 1")
    + EYE.format("a", "0 0 3") + EYE.format("b", "1 0 3")
)  # fmt: skip
CABLE = (
    "loops: {{rope: {{kind: cable, through: [door, a, b, weight], length: 6 m}}}}\n"
    "friction: {{door_slide: {{constant: {} N}}, weight_slide: {{constant: {} N}}}}\n"
)


@pytest.mark.parametrize(
    ("door", "weight", "least", "greatest"),
    [
        (200.0, 5.0, 98.1 - 5.0, 98.1 + 5.0),  # what holds the counterweight
        (60.0, 90.0, 147.15 - 60.0, 98.1 + 90.0),  # below what the door's guide holds, above again the counterweight's
        (200.0, 120.0, 0.0, 98.1 + 120.0),  # a cable does not push
    ],
)
def test_a_cable_with_a_counterweight(write, door, weight, least, greatest):
    problem = "{kind: forward, time: {end: 1 s, samples: 2}}"
    result = pinarm.run(write(COUNTERWEIGHT, CABLE.format(door, weight), problem, "loop.rope.tension"))
    assert result["loop.rope.tension.least"].values == pytest.approx(np.full(2, least), rel=1e-9, abs=1e-9)
    assert result["loop.rope.tension.greatest"].values == pytest.approx(np.full(2, greatest), rel=1e-9)


def told_in(text, names):
    """Return the columns of a CSV table by the names of its heading, without units."""
    heading, *rows = text.splitlines()
    columns = np.array([row.split(",") for row in rows], float).T
    known = dict(zip([name.partition(" [")[0] for name in heading.split(",")], columns, strict=True))
    return [known[name] for name in names]


def test_tables_and_summaries_never_have_one_share_alone(hoist, tmp_path):
    """In the table the ends stand beside the value; a summary has no value at the start and at the end."""
    result = pinarm.run(hoist(LOCKS))
    entry = result.summary()["outputs"]["coupling.cable.effort"]
    assert np.isnan([entry["start"], entry["end"]]).all()
    assert entry["doubt"].startswith("not determined in 3 of 3 rows")
    folder = result.save(tmp_path / "saved", plots=True)
    names = [f"coupling.cable.effort.{end}" for end in ("least", "greatest")]
    least, greatest = told_in((folder / "trajectory.csv").read_text(), names)
    assert (least, greatest) == (pytest.approx(LOAD - GUIDE, rel=1e-10), pytest.approx(LOAD + GUIDE, rel=1e-10))
    assert list(result.to_dataframe().columns)[2:4] == [f"{name} [N]" for name in names]
    assert "least and greatest" in (folder / "plots" / "outputs_1.svg").read_text()
    assert result.replay(arrows=["reactions"]).html.count("coupling.cable.effort.least") > 0


def test_sweeps_take_the_ends_and_searches_refuse(hoist):
    swept = pinarm.sweep(hoist(LOCKS), {"problem.time.end": "0.5, 1 s"}, results=["coupling.cable.effort"], workers=1)
    assert swept["min coupling.cable.effort"].values == pytest.approx(np.full(2, LOAD - GUIDE), rel=1e-10)
    assert swept["max coupling.cable.effort"].values == pytest.approx(np.full(2, LOAD + GUIDE), rel=1e-10)
    find = "find:\n  for: {problem.initial.position.lift: 1 m}\n  so_that: {coupling.cable.effort: 100 N}\n"
    with pytest.raises(InputError, match="not determined in 3 of 3 rows"):
        pinarm.run(hoist(LOCKS, scenario=REST + find))
