"""Branches of modes through a sweep, against two oscillators whose frequencies cross."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.input.units import DIMENSIONLESS
from pinarm.use.study.sweep.axes import Axis, Cases, Column
from pinarm.use.study.sweep.branches import RAW, ModeValues
from pinarm.use.study.sweep.table import Sweep

BODY = """<link name="{0}"><inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
</inertial></link><joint name="{0}_slide" type="prismatic"><parent link="rail"/><child link="{0}"/><axis xyz="1 0 0"/>
<limit lower="-9" upper="9" effort="1e6" velocity="1e3"/></joint>"""
STIFFNESSES = np.array([50.0, 150.0, 250.0, 350.0, 450.0])


@pytest.fixture
def swept(tmp_path: Path) -> Callable[..., Sweep]:
    """Return a sweep over the spring of the first of two bodies of 2 kg; that of the second has 200 N/m."""
    bodies = BODY.format("a") + BODY.format("b")
    (tmp_path / "two.urdf").write_text(f'<robot name="two"><link name="rail"/>{bodies}</robot>')
    loads = {name: {"kind": "joint_spring", "joint": f"{name}_slide", "stiffness": "200 N/m", "damping": "4 N*s/m"}
             for name in "ab"}  # fmt: skip
    scenario = {
        "pinarm": 1, "mechanism": {"pinarm": 1, "robot": str(tmp_path / "two.urdf"), "gravity": "none"},
        "problem": {"kind": "linear", "loads": loads}, "outputs": ["mode.1.frequency"], "title": "Two oscillators",
    }  # fmt: skip

    def run(values: str = "50:450:5 N/m", results: Sequence[str] = ("modes",), **more: int) -> Sweep:
        with pinarm.file_root(tmp_path):
            path = "problem.loads.a.stiffness"
            return pinarm.sweep(scenario, {path: values}, results=results, workers=1, **more)

    return run


def test_branches_that_cross_go_on(swept: Callable[..., Sweep]) -> None:
    """By rank, the first frequency would stay below that of the second oscillator."""
    sweep = swept()
    assert sweep["mode.1.frequency"].values == pytest.approx(np.sqrt(STIFFNESSES / 2.0) / (2.0 * np.pi), rel=1e-9)
    assert sweep["mode.2.frequency"].values == pytest.approx([np.sqrt(100.0) / (2.0 * np.pi)] * 5, rel=1e-9)
    assert sweep["mode.2.damping"].values == pytest.approx([4.0 / (2.0 * 2.0 * 10.0)] * 5, rel=1e-9)
    assert sweep.notes == []
    assert [series.name for series in sweep.results()] == [
        f"mode.{k}.{name}" for k in (1, 2) for name in ("frequency", "damped_frequency", "damping", "growth")
    ]


def test_all_branches_are_in_one_picture(swept: Callable[..., Sweep], tmp_path: Path) -> None:
    sweep = swept("450, 50, 150, 350, 250 N/m")
    axis = sweep.plot("mode.1.damped_frequency").axes[0]
    assert [line.get_label() for line in axis.lines] == ["mode 1", "mode 2"]
    damped = np.sqrt(STIFFNESSES / 2.0 - 1.0) / (2.0 * np.pi)
    assert any(line.get_ydata() == pytest.approx(damped) for line in axis.lines)  # in the order of the values
    locus = sweep.plot("root_locus").axes[0]
    assert locus.lines[0].get_xdata() == pytest.approx([-1.0] * 5)
    names = sorted(path.name for path in (sweep.save(tmp_path / "out") / "plots").iterdir())
    assert names == ["01_mode.1.frequency.svg", "02_mode.1.damped_frequency.svg", "03_mode.1.damping.svg",
                     "04_mode.1.growth.svg", "05_root_locus.svg"]  # fmt: skip


def test_only_what_is_asked_is_a_column_and_cases_by_chance_have_ranks(swept: Callable[..., Sweep]) -> None:
    sweep = swept("uniform(50, 450) N/m", ["mode.1.frequency"], samples=3)
    assert [series.name for series in sweep.results()] == ["mode.1.frequency"]
    assert sweep["mode.1.frequency"].values.max() <= np.sqrt(100.0) / (2.0 * np.pi) + 1e-9
    assert sweep.notes == ["modes are numbered by frequency in each case: cases in no order have no branches"]
    with pytest.raises(InputError, match=r"mode\.9\.frequency"):
        swept(results=["mode.9.frequency"])


def columns(values: np.ndarray, shapes: np.ndarray) -> list[Series]:
    """Return the columns of modes: eigenvalues, shape (cases, modes), and shapes, (cases, modes, velocities)."""
    parts = np.stack([shapes.real, shapes.imag], axis=-1).reshape(*values.shape, -1)
    table = np.concatenate(
        [values.real[..., None], values.imag[..., None], 0.0 * values.real[..., None], parts], axis=2
    )
    return [Series(f"{RAW}{k}", DIMENSIONLESS, column) for k, column in enumerate(table.reshape(len(values), -1).T)]


def test_a_grid_with_an_unknown_case_and_with_a_leap_of_shapes() -> None:
    axes = tuple(Axis((Column(name, values),)) for name, values in (("x", [1.0, 2.0]), ("y", [1.0, 2.0, 3.0])))
    cases, modes = Cases(axes), ModeValues(2, 2, ("mode.1.damped_frequency",))
    values = np.array([[1j, 4j], [2j, 4j], [4j, 5j]] * 2)
    shapes = np.array([np.eye(2), np.eye(2), np.eye(2)[::-1]] * 2, complex)
    values[1], shapes[1] = complex(np.nan, np.nan), complex(np.nan, np.nan)
    [series], notes = modes.followed(cases, columns(values, shapes))
    assert series.values * 2.0 * np.pi == pytest.approx([1.0, np.nan, 5.0, 1.0, 2.0, 5.0], nan_ok=True)
    assert notes == []
    shapes[5] = [[1.0, 1.2], [1.0, -1.2]]
    _, notes = modes.followed(cases, columns(values, shapes))
    assert len(notes) == 1
    assert "from case 4 to 5; more cases there tell" in notes[0]
