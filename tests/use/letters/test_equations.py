"""Equations in letters: published formulas, runs of the engine, linear motions, and what is refused."""

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import sympy
import yaml

import pinarm
from pinarm.use.letters import equations as equations_module
from pinarm.use.letters import projection
from pinarm.use.letters.bodies import letter
from pinarm.use.letters.projection import lettered_coordinates

ROOT = Path(pinarm.__file__).parents[1]


def scenario(name):
    return ROOT / "scenarios" / f"{name}.yaml"


@cache
def written(name):
    return pinarm.equations(scenario(name))


def right_of(equations, left):
    """Return the formula that a symbol is equal to."""
    some = (*equations.motion, *equations.momenta)
    return next(equation.right for equation in some if str(equation.left) == left)


def alike(formula, text):
    """Return whether a formula has the values of a published one at random values of its symbols."""
    names = {str(symbol): symbol for symbol in formula.free_symbols}
    wanted = sympy.sympify(text, locals={**names, "I": letter("I"), "C": letter("C")})
    symbols = sorted(formula.free_symbols | wanted.free_symbols, key=str)
    values = np.random.default_rng(1).uniform(0.5, 1.5, len(symbols))
    ours, theirs = (sympy.lambdify(symbols, some)(*values) for some in (formula, wanted))
    return ours == pytest.approx(theirs, rel=1e-11)


PUBLISHED = [
    ("exoskeleton_leg_knee", "Cr", "-m4*L*cos(theta10)*(hdd + g)"),
    ("gen411_arm_static", "C_B", "g*l2*cos(phi)*(m_A + m_BA/2)"),
    ("gyroscope_free", "p_psi", "A*psd*sin(theta)**2 + C*(phd + psd*cos(theta))*cos(theta)"),
    ("gyroscope_free", "p_phi", "C*(phd + psd*cos(theta))"),
    (
        "handling_arm_c1",
        "C1",
        "(I + m*L**2/4 + m*L**2 + m*L**2/2*cos(phi))*thdd + (I + m*L**2/2*cos(phi) + m*L**2/4)*(thdd + phdd)"
        " - m*L**2/2*phd*sin(phi)*(2*thd + phd)",
    ),
    ("handling_arm_c1", "C2", "(I + m*L**2/4)*(thdd + phdd) + m*L**2/2*(thdd*cos(phi) + thd**2*sin(phi))"),
]


@pytest.mark.parametrize(("name", "symbol", "formula"), PUBLISHED)
def test_published_formulas_come_out(name, symbol, formula):
    equations = written(name)
    assert equations.difference < 1e-12
    assert alike(right_of(equations, symbol), formula)


def test_the_gimbals_turn_by_the_published_equation():
    equations = written("gyroscope_free")
    (nutation,) = (equation.right for equation in equations.motion if equation.of == "theta")
    assert alike(nutation, "A*thdd - A*psd**2*sin(theta)*cos(theta) + C*psd*(phd + psd*cos(theta))*sin(theta)")


def test_parameters_multiply_simplified_functions_of_angles():
    momentum = str(right_of(written("gyroscope_free"), "p_psi"))
    assert momentum == "C*phd*cos(theta) + psd*(A*sin(theta)**2 + C*cos(theta)**2)"


def residuals(name):
    """Return the largest residual of each equation along a run, relative to its largest term there."""
    result = pinarm.run(scenario(name))
    equations = written(name)
    mechanism, motion = result.scenario.mechanism, getattr(result.scenario.problem, "motion", None) or {}
    values = {letter(symbol): number for symbol, number in mechanism.arguments.items()}
    values |= {letter("g"): mechanism.gravity}
    for c in lettered_coordinates(mechanism, motion).chosen:
        kind = "joint" if c.name in mechanism.joints else "coordinate"
        for symbol, rate in zip((c.value, c.rate, c.second), ("position", "velocity", "acceleration"), strict=True):
            values[symbol] = result[f"{kind}.{c.name}.{rate}"].values
    for symbol in equations.symbols:
        axis, _, loop = symbol.partition("_")
        if any(loop == constraint.name for constraint in mechanism.constraints):
            values[letter(symbol)] = result[f"loop.{loop}.force.{axis.lower()}"].values
    for joint in mechanism.joints:
        values[letter(f"tau_{joint}")] = result[f"joint.{joint}.effort"].values
    values |= {letter(name): result[name].values for name in mechanism.symbols if letter(name) not in values}
    for spring, force in mechanism.description.forces.items():
        values[letter(f"k_{spring}")] = force.stiffness
    if "gas_x" in equations.symbols:
        values[letter("gas_x")] = result["power.gas"].values / result["xd"].values
    worst = {}
    for equation in (*equations.closure, *equations.motion):
        terms = [*sympy.Add.make_args(sympy.expand(equation.right)), -equation.left]
        numbers = [np.asarray(sympy.lambdify([*values], term)(*values.values()), float) for term in terms if term != 0]
        size = max(np.abs(term).max() for term in numbers)
        worst[equation.of] = max(worst.get(equation.of, 0.0), np.abs(sum(numbers)).max() / size)
    return worst


@pytest.mark.parametrize(
    "name",
    [
        "crank_rocker_free",
        "slider_crank_gas",
        pytest.param("four_bar_shaking_balanced", marks=pytest.mark.slow),
        pytest.param("olive_vibrator_shaking", marks=pytest.mark.slow),
    ],
)
def test_the_rows_of_a_run_fulfil_them(name):
    """Loop forces too, whose signs and axes are those of the quantities ``loop.NAME.force``."""
    worst = residuals(name)
    assert max(worst.values()) < 1e-7


def test_small_motions_have_the_frequencies_of_the_linear_analysis():
    arm = pinarm.load(scenario("gen411_arm_swing")).mechanism
    down = {"O": "-90 deg", "phi": "-90 deg"}
    equations = pinarm.equations(scenario("gen411_arm_swing"), small=down)
    chosen = lettered_coordinates(arm).chosen
    right = [equation.right.subs({letter(n): v for n, v in arm.arguments.items()} | {letter("g"): arm.gravity})
             for equation in equations.motion]  # fmt: skip
    mass, stiffness = (
        np.array([[float(formula.diff(symbol)) for symbol in symbols] for formula in right])
        for symbols in ([c.second for c in chosen], [c.value for c in chosen])
    )
    ours = np.sort(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real)
    q = arm.configurations({"O": -np.pi / 2, "B": 0.0})
    assert ours == pytest.approx(
        np.sort(np.unique(np.round(-(arm.linearise(q).modes.eigenvalues ** 2).real, 9))), rel=1e-7
    )


def test_a_joint_of_a_loop_without_a_drive_has_no_effort():
    """In statics of a four-bar one joint carries a drive, though the scenario names none."""
    text = "{kind: statics, over: {upright_0: {from: 10 deg, to: 60 deg, samples: 3}}}"
    bars = pinarm.load(
        scenario("four_bar_equal_rods"), {"problem": yaml.safe_load(text), "outputs": ["theta"], "expect": []}
    )
    efforts = {equation.of: str(equation.left) for equation in pinarm.equations(bars).motion}
    assert sorted(efforts.values()) == ["0", "0", "tau_upright_0"]


def test_reports_have_the_equations_in_mathml():
    """Each velocity and acceleration has its dots over the letter of the position, and signs are those of the text."""
    page = pinarm.report(pinarm.run(scenario("handling_arm_c1")), equations=True, lang="fr").html
    (line,) = re.findall(r'<p class="equation">theta.*?</p>', page)
    text = str(right_of(written("handling_arm_c1"), "C1"))
    assert line.count("\u02d9</mtext>") == len(re.findall(r"\b(?:thd|phd)\b", text))
    assert line.count("\u00a8</mtext>") == len(re.findall(r"\b(?:thdd|phdd)\b", text))
    assert line.count("<mo>\u2212</mo>") == len(re.findall(r"(?:^| )-", text))
    assert "Équations littérales" in page
    assert "accélération thdd" in page


def test_a_load_over_a_coordinate_has_a_letter():
    moment = {"law": "piecewise_linear", "points": [["0 deg", "1 N*m"], ["180 deg", "5 N*m"]]}
    diagram = {"kind": "joint_effort", "joint": "B", "over": "O", "effort": moment, "while": {"B": "increasing"}}
    swing = pinarm.load(scenario("gen411_arm_swing"), {"problem.loads": {"gas": diagram}})
    assert "gas" in pinarm.equations(swing).symbols


def test_joints_of_a_model_are_damped(chain, mechanism, tmp_path):
    """A rod about an axis of its own: ``(0.1 + 2 * 0.3^2) Add + 0.7 Ad``."""
    rod = {"name": "A", "mass": 2.0, "com": "0.3 0 0", "damping": 0.7}
    mechanism(chain(rod), gravity="none")
    problem = "{kind: forward, time: {end: 1 s, samples: 2}}"
    (tmp_path / "scenario.yaml").write_text(f"pinarm: 1\nmechanism: mechanism.yaml\nproblem: {problem}\noutputs: [A]\n")
    (motion,) = pinarm.equations(tmp_path / "scenario.yaml").motion
    assert alike(motion.right - motion.left, "0.28*Add + 0.7*Ad")


def test_wrong_equations_are_not_printed(monkeypatch):
    """A term that is left out is found by the comparison with the numeric equations."""
    monkeypatch.setattr(projection.Letters, "_gravity", sympy.zeros(3, 1))
    with pytest.raises(pinarm.PinarmError, match="differ from the numeric ones"):
        pinarm.equations(scenario("gen411_arm_swing"))


def test_a_shortened_form_that_differs_is_not_printed(monkeypatch):
    monkeypatch.setattr(equations_module, "compact", lambda formula, seconds, rates: formula + seconds[0])
    with pytest.raises(pinarm.PinarmError, match="shortened equation differs"):
        pinarm.equations(scenario("gen411_arm_swing"))


@pytest.mark.parametrize(
    ("path", "small", "message"),
    [
        ("panda", None, "joints are too long"),
        (scenario("rotor_horizontal"), None, "'B' is not written in letters"),
        (scenario("manipulator_operator"), None, "the drive along 'P_height' is not written"),
        (scenario("magic_arms_kinematics"), None, "no body has a mass here"),
        (scenario("gen411_arm_swing"), {"psi": 0.0}, "there is no coordinate 'psi'"),
        (scenario("gen411_arm_swing"), {"phi": "2 m"}, "is no value of 'phi'"),
    ],
)
def test_what_is_not_written_says_so(path, small, message):
    with pytest.raises(pinarm.PinarmError, match=message):
        pinarm.equations(path, small=small)
