"""Sheets for a lab: answers, the mistakes that they look like, and the notebook."""

import re
from pathlib import Path

import pytest

import pinarm

SCENARIOS = Path(pinarm.__file__).parents[1] / "scenarios"


@pytest.fixture(scope="module")
def arm():
    return pinarm.Sheet(SCENARIOS / "gen411_arm_static.yaml")


@pytest.fixture(scope="module")
def knee():
    return pinarm.Sheet(SCENARIOS / "exoskeleton_leg_knee.yaml")


def test_questions_do_not_tell_the_answers(arm):
    assert arm.questions[:2] == [
        "C_B: a formula, or a number if it is constant [N*m]",
        "C_B, max of the run: a number with its unit, or a formula [N*m]",
    ]


NUMBERS = [
    ("1.4715 N*m", "Right"),
    ("1.47e3 N*mm", "Right"),
    ("-1.47 N*m", "sign"),
    ("2.943 N*m", "factor of 2"),
    ("84.31 N*m", "degrees stand where radians"),
    ("0.15 N*m", "mass stands where its weight"),
    ("1.226 N*m", "m_A is forgotten"),
    ("1.3 N*m", r"Not right\.$"),
    ("1.47 N", "cannot be compared"),
    ("1.4715N*m", "Right"),
    ("1.4715", "'1.4715' has no unit"),
    ("...", "no answer yet"),
]


@pytest.mark.parametrize(("answer", "words"), NUMBERS)
def test_a_number_is_right_or_looks_like_a_mistake(arm, answer, words):
    """By hand: 9.81*0.25*(0.1 + 1/2) = 1.4715 N*m; without the load 1.22625."""
    assert re.search(words, arm.check(2, answer))


FORMULAS = [
    ("g*l2*cos(phi)*(m_A + m_BA/2)", "Right."),
    ("g*(0.25 m)*cos(phi)*(m_A + m_BA/2)", "for others"),
    ("g*l2*cos(phi)*m_BA/2", "m_A is forgotten"),
    ("l2*cos(phi)*(m_A + m_BA/2)", "mass stands where its weight"),
    ("l2*cos(phi)*m_A", "cannot be compared"),
    ("C_B", "what the program computes"),
    ("g*l2*cos(", "cannot be compared"),
]


@pytest.mark.parametrize(("answer", "words"), FORMULAS)
def test_a_formula_is_right_for_all_numbers_or_looks_like_a_mistake(arm, answer, words):
    assert words in arm.check(1, answer)


def test_terms_that_are_left_out_are_told_apart(knee):
    assert "weights are forgotten" in knee.check(2, "-m4*L*cos(theta10)*hdd")
    assert "weights alone" in knee.check(2, "-m4*L*cos(theta10)*g")


@pytest.mark.parametrize(
    ("weight", "inertia", "words"),
    [
        ("m_A + m_BA/2", "m_A + m_BA/3", "Right"),
        ("m_A + m_BA/2", "m_A + m_BA/12", "a wrong factor in these terms: accelerations"),
        ("m_A + m_BA/2", "-m_A - m_BA/3", "a wrong sign in these terms: accelerations"),
        ("m_A + m_BA", "m_A + m_BA/3", "a wrong factor in these terms: the weights"),
        ("m_A + m_BA", "m_A + m_BA/12", r"Not right\.$"),
    ],
)
def test_a_wrong_factor_or_sign_of_some_terms_is_told(weight, inertia, words):
    """``C_B = g l2 cos phi (m_A + m_BA/2) + l2^2 (m_A + m_BA/3) alpha``."""
    sheet = pinarm.Sheet(SCENARIOS / "gen411_arm_dynamic.yaml")
    answer = f"g*l2*cos(phi)*({weight}) + l2**2*({inertia})*coordinate.phi.acceleration"
    assert re.search(words, sheet.check(1, answer))


def test_a_moment_about_another_point_is_told(knee):
    """About the ankle the load has no moment, about the hip it has m4*(g + hdd)*l4."""
    assert "at the joint hip" in knee.check(2, "m4*(g + hdd)*l4")


def test_a_slider_at_a_length_that_does_not_reach_says_so(knee, capsys):
    pytest.importorskip("ipywidgets")
    sliders = {slider.description: slider.value for slider in knee.explore("Cr").children[:-1]}
    knee.explore("Cr").f(**{**sliders, "L": 0.5 * sliders["L"]})
    assert "out of reach" in capsys.readouterr().out


@pytest.mark.slow
def test_the_notebook_runs_and_holds_no_key(tmp_path):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    file = pinarm.lab(SCENARIOS / "gen411_arm_static.yaml", tmp_path / "sheet.ipynb")
    assert "1.4715" not in file.read_text() and "m_BA/2" not in file.read_text()
    notebook = nbformat.reads(file.read_text(), 4)
    nbformat.validate(notebook)
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    assert any("FloatSlider" in str(output) for output in outputs)


@pytest.mark.parametrize(("parameters", "shown"), [("", False), ("parameters: {m: 1 kg}\n", True)])
def test_numbers_of_a_drawing_have_sliders_where_they_are_parameters(tmp_path, parameters, shown):
    (tmp_path / "mechanism.yaml").write_text(
        f"pinarm: 1\n{parameters}planar:\n  points: {{O: [0, 0], A: [250 mm, 0]}}\n  ground: [O]\n"
        f"  links: {{rod: {{points: [O, A], mass: {'m' if parameters else '1 kg'}}}}}\n"
    )
    (tmp_path / "scenario.yaml").write_text(
        "pinarm: 1\nmechanism: mechanism.yaml\noutputs: [joint.O.effort]\n"
        "problem: {kind: statics, over: {O: {from: 0 deg, to: 60 deg, samples: 3}}}\n"
        "expect: [{quantity: joint.O.effort, at: max, value: 1.22625 N*m, source: m g l/2}]\n"
    )
    assert ("explore" in pinarm.lab(tmp_path / "scenario.yaml", tmp_path / "sheet.ipynb").read_text()) == shown


def test_a_scenario_without_a_key_makes_no_sheet(tmp_path):
    (tmp_path / "plain.yaml").write_text(
        "pinarm: 1\ntitle: Plain\nmechanism: panda\nproblem: {kind: forward, time: {end: 1 s, samples: 3}}\n"
        "outputs: [joint.panda_joint1.position]\n"
    )
    with pytest.raises(pinarm.PinarmError, match="has no answer key"):
        pinarm.lab(tmp_path / "plain.yaml")
