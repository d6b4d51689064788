"""Sections, graphs and files of a linear analysis, compared with a carriage on a spring and a damper."""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.errors import InputError
from pinarm.use.facade import Result
from pinarm.use.result.vibrations import responses
from pinarm.use.show.picture_files import pictures
from pinarm.use.show.text import report

CARRIAGE = """<robot name="carriage"><link name="rail"/><link name="body"><inertial><mass value="2"/>
<inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="slide" type="prismatic"><parent link="rail"/><child link="body"/><axis xyz="1 0 0"/>
<limit lower="-9" upper="9" effort="1e6" velocity="1e3"/></joint></robot>"""
MASS, STIFFNESS, DAMPING = 2.0, 300.0, 4.0
NATURAL = np.sqrt(STIFFNESS / MASS)
RATIO = DAMPING / (2.0 * MASS * NATURAL)


@pytest.fixture
def carriage(tmp_path: Path) -> Callable[..., Result]:
    (tmp_path / "carriage.urdf").write_text(CARRIAGE)

    def run(damping: float = DAMPING, outputs: tuple[str, ...] = ("slide",), **more: object) -> Result:
        spring = {"kind": "joint_spring", "joint": "slide", "stiffness": "300 N/m", "damping": f"{damping} N*s/m"}
        mechanism = {"pinarm": 1, "robot": str(tmp_path / "carriage.urdf"), "gravity": "none"}
        with pinarm.file_root(tmp_path):
            return pinarm.run({
                "pinarm": 1, "mechanism": mechanism,
                "problem": {"kind": "linear", "outputs": list(outputs), "loads": {"mount": spring},
                            "frequencies": {"from": "0.1 Hz", "to": "50 Hz", "samples": 30}},
                "outputs": ["mode.1.frequency"], **more,
            })  # fmt: skip

    return run


def test_a_bode_plot_has_amplitude_and_phase_and_marks_the_resonance(carriage: Callable[..., Result]) -> None:
    """``x/F = 1/(k - m w^2 + i c w)``."""
    axes = carriage().plot("bode").axes
    frequencies, amplitude = axes[0].lines[0].get_data()
    w = 2.0 * np.pi * np.asarray(frequencies)
    expected = 1.0 / (STIFFNESS - MASS * w**2 + 1j * DAMPING * w)
    assert np.asarray(amplitude) == pytest.approx(np.abs(expected), rel=1e-5)
    assert np.asarray(axes[1].lines[0].get_ydata()) == pytest.approx(np.degrees(np.angle(expected)), abs=1e-4)
    damped = NATURAL * np.sqrt(1.0 - RATIO**2) / (2.0 * np.pi)
    assert axes[0].collections[0].get_segments()[0][0, 0] == pytest.approx(damped)
    assert (axes[0].get_xscale(), axes[0].get_yscale(), axes[1].get_yscale()) == ("log", "log", "linear")
    assert axes[0].get_ylabel() == "|slide / slide| [m/N]"


def test_the_peak_of_a_resonance_is_a_number(carriage: Callable[..., Result]) -> None:
    """``1/(2 zeta sqrt(1 - zeta^2) k)`` at ``w_n sqrt(1 - 2 zeta^2)``; without damping there is no end."""
    result = carriage()
    largest, _ = result.number("frequency_response.slide.slide.largest")
    assert largest == pytest.approx(1.0 / (2.0 * RATIO * np.sqrt(1.0 - RATIO**2) * STIFFNESS), rel=1e-12)
    frequency, _ = result.number("frequency_response.slide.slide.frequency")
    assert frequency == pytest.approx(NATURAL * np.sqrt(1.0 - 2.0 * RATIO**2) / (2.0 * np.pi), rel=1e-7)
    assert carriage(0.0).number("frequency_response.slide.slide.largest")[0] == np.inf


def test_a_search_moves_a_peak(carriage: Callable[..., Result]) -> None:
    """The damping whose peak is 1/(40 N/m), and the mass whose peak is at 1 Hz, by the formulas above."""
    largest = "frequency_response.slide.slide.largest"
    damping = {"for": {"problem.loads.mount.damping": "4 N*s/m"}, "so_that": {largest: "0.025 m/N"}}
    ratio = carriage(find=damping)["mode.1.damping"].values[0]
    assert 2.0 * ratio * np.sqrt(1.0 - ratio**2) * STIFFNESS == pytest.approx(40.0, rel=1e-6)
    least = {"for": {"problem.loads.mount.damping": ["1 N*s/m", "9 N*s/m"]}, "minimise": largest}
    assert carriage(find=least)["mode.1.damping"].values[0] == pytest.approx(RATIO * 9.0 / DAMPING, rel=1e-6)


def test_what_takes_part_in_a_mode_is_told(carriage: Callable[..., Result]) -> None:
    section = carriage().section("modes")
    assert [table.name for table in section.tables] == ["modes", "springs", "masses", "dampers"]
    assert section.remarks == [
        "mode 1: most stiffness from mount (100 %), most mass in body (100 %), most damping from mount (100 %)"
    ]


def test_eigenvalues_and_the_circle_of_a_resonance_are_drawn(carriage: Callable[..., Result]) -> None:
    result = carriage(0.04)
    x, y = result.plot("eigenvalues").axes[0].lines[0].get_data()
    assert x == pytest.approx([-0.01, -0.01])
    assert sorted(y) == pytest.approx([-NATURAL, NATURAL])
    x, y = (np.asarray(values) for values in result.plot("nyquist").axes[0].lines[0].get_data())
    steps = np.hypot(np.diff(x), np.diff(y))
    assert steps.max() < 0.1 * np.ptp(y)


def test_the_table_of_modes_marks_unstable_ones(carriage: Callable[..., Result]) -> None:
    upright = pinarm.run("scenarios/gen411_arm_modes.yaml", {"problem.about.equilibrium": {"O": "80 deg"}})
    assert [row[-1] for row in upright.section("modes").tables[0].rows].count("unstable") == 2
    assert [row[-1] for row in carriage(100.0).section("modes").tables[0].rows] == ["no oscillation"] * 2
    lines = report(upright).splitlines()
    assert any("time constant [s]" in line for line in lines)
    assert sum(line.endswith(" unstable") for line in lines) == 2


def test_several_outputs_have_graphs_of_their_own(carriage: Callable[..., Result]) -> None:
    result = carriage(outputs=("slide", "joint.slide.velocity"))
    names = [name for name, _ in pictures(result)]
    assert "frequency_response_bode_joint_slide_velocity" in names
    assert "slide" not in names
    with pytest.raises(InputError, match="bode_slide, bode_joint_slide_velocity"):
        result.plot("bode")


def test_a_folder_holds_the_matrices_with_names_and_units(carriage: Callable[..., Result], tmp_path: Path) -> None:
    result = carriage()
    folder = result.save(tmp_path / "saved", plots=False)
    with np.load(folder / "tables.npz") as stored:
        assert stored["A"] == pytest.approx(np.array([[0.0, 1.0], [-STIFFNESS / MASS, -DAMPING / MASS]]))
        assert stored["B.columns"].tolist() == ["slide"]
    assert (folder / "A.csv").read_text().startswith(",slide [1/m],slide' [s/m]\nslide [m/s],0.0,1.0\n")
    assert (folder / "response.csv").read_text().startswith(",Re slide / slide")
    again = pinarm.restore(folder)
    assert again.section("frequency_response").graphs[0].marks == result.section("frequency_response").graphs[0].marks
    assert [axis.get_xscale() for axis in again.plot("bode").axes] == ["log", "log"]


def test_python_control_gets_the_matrices_with_their_names(carriage: Callable[..., Result]) -> None:
    control = pytest.importorskip("control")
    result = carriage()
    plant = result.to_control()
    assert (plant.state_labels, plant.input_labels, plant.output_labels) == (["slide", "slide'"], ["slide"], ["slide"])
    dotted = carriage(outputs=("joint.slide.velocity",)).to_control()
    assert dotted.output_labels == ["joint_slide_velocity"]
    known = responses(result.arrays)[0]
    assert plant(2j * np.pi * known.frequencies) == pytest.approx(known.values, rel=1e-5)
    assert control.damp(plant, doprint=False)[1] == pytest.approx([RATIO, RATIO])


def test_without_matrices_or_python_control_it_says_so(
    carriage: Callable[..., Result], monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match="no matrices A, B, C, D"):
        pinarm.run("scenarios/gen411_arm_static.yaml").to_control()
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(InputError, match=r"pip install 'pinarm\[control\]'"):
        carriage().to_control()
