"""The folder that files may refer to: found, or given by the user."""

from pathlib import Path

import pytest

import pinarm
from pinarm.cli.main import main
from pinarm.errors import InputError
from pinarm.input.roots import root_of

URDF = """<robot name="r"><link name="base"/><link name="rod"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="pivot" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/></joint></robot>"""
SCENARIO = """pinarm: 1
mechanism: ../models/rod.urdf
problem: {kind: inverse, time: {end: 1 s, samples: 3}, motion: {pivot: {law: table, file: ../tables/t.csv}}}
outputs: [pivot]
"""


@pytest.fixture
def apart(tmp_path: Path) -> Path:
    """A scenario whose model and table lie in folders beside its own, with nothing that marks a root above them."""
    for folder in ("scenarios", "models", "tables"):
        (tmp_path / folder).mkdir()
    (tmp_path / "models" / "rod.urdf").write_text(URDF)
    (tmp_path / "tables" / "t.csv").write_text("t [s],pivot [rad]\n0,0\n1,1\n")
    (tmp_path / "scenarios" / "s.yaml").write_text(SCENARIO)
    return tmp_path


def test_a_given_root_widens_what_files_may_refer_to(apart: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario = str(apart / "scenarios" / "s.yaml")
    assert main(["validate", scenario]) == 2
    told = capsys.readouterr().err
    assert "leads out of the root folder" in told
    assert "--root DIR" in told
    assert main(["validate", scenario, "--root", str(apart)]) == 0
    assert root_of(apart / "scenarios" / "s.yaml") == (apart / "scenarios").resolve(), "it holds for the command only"


def test_a_given_root_narrows_it_too(apart: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (apart / ".pinarm-root").touch()
    scenario = str(apart / "scenarios" / "s.yaml")
    assert main(["validate", scenario]) == 0
    for inner in ("scenarios", "models", "tables"):
        assert main(["validate", scenario, "--root", str(apart / inner)]) == 2
        assert "leads out of the root folder" in capsys.readouterr().err


def test_the_working_folder_is_the_root_of_files_under_it(apart: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = apart / "scenarios" / "s.yaml"
    monkeypatch.chdir(apart)
    assert main(["validate", "scenarios/s.yaml"]) == 0
    assert main(["new", "models/rod.urdf", "-o", "sub"]) == 0
    assert main(["validate", "sub/scenario.yaml"]) == 0
    for folder in (apart / "models", Path("/")):
        monkeypatch.chdir(folder)
        assert root_of(scenario) == (apart / "scenarios").resolve(), "not of files elsewhere, nor the top of all"
    monkeypatch.setenv("HOME", str(apart))
    monkeypatch.chdir(apart)
    assert root_of(scenario) == (apart / "scenarios").resolve(), "nor the home of a user"


def test_packages_and_words_reach_the_model(apart: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (apart / "part.xacro").write_text(f'<robot><xacro:property name="l" value="{0.5}"/></robot>')
    named = URDF.replace('"pivot"', '"$(arg side)pivot"').replace(
        "<link", '<xacro:arg name="side" default=""/><xacro:include filename="$(find p)/part.xacro"/><link', 1
    )
    (apart / "models" / "rod.xacro").write_text(named)
    scenario = {
        "pinarm": 1, "mechanism": "models/rod.xacro", "arguments": {"side": "right_"},
        "problem": {"kind": "statics", "hold": {"right_pivot": "0 rad"}}, "outputs": ["joint.right_pivot.effort"],
    }  # fmt: skip
    monkeypatch.chdir(apart / "models")
    with pytest.raises(InputError, match="unknown package 'p'"):
        pinarm.run({**scenario, "mechanism": "rod.xacro"})
    with pinarm.file_root(apart, {"p": apart}):
        result = pinarm.run({**scenario, "mechanism": "rod.xacro"})
    (apart / "mechanism.yaml").write_text("pinarm: 1\nrobot: models/rod.xacro\npackages: {p: .}\n")
    monkeypatch.chdir(apart)
    for folder in ("/etc", "..", "models/../.."):
        (apart / "out.yaml").write_text(f"pinarm: 1\nrobot: models/rod.xacro\npackages: {{p: {folder}}}\n")
        with pytest.raises(InputError, match="leads out of the root folder"):
            pinarm.run({**scenario, "mechanism": "out.yaml"})
    (again := pinarm.run({**scenario, "mechanism": "mechanism.yaml"})).save(apart / "out", plots=False)
    assert again["joint.right_pivot.effort"].values.tolist() == result["joint.right_pivot.effort"].values.tolist()
    assert "side: right_" in (apart / "out" / "scenario.yaml").read_text()
    assert "packages" not in (apart / "out" / "mechanism.yaml").read_text()
    assert main(["validate", "out/scenario.yaml"]) == 0
    assert main(["validate", "out/scenario.yaml", "--package", "p"]) == 2


def test_a_root_that_is_no_folder_is_refused(apart: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputError, match="there is no folder"), pinarm.file_root(apart / "model"):
        pass
    assert main(["validate", str(apart / "scenarios" / "s.yaml"), "--root", str(apart / "model")]) == 2
    assert "models" in capsys.readouterr().err
