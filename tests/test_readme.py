"""Every marked block of the pages with code is what it says; links of all pages lead somewhere."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from pinarm import load
from pinarm.use.show.terminal import report
from pinarm.use.study.answers.check import check

ROOT = Path(__file__).parents[1]
BLOCK = re.compile(r"<!-- (?P<name>\w+) -->\n```\w+\n(?P<text>.*?)```", re.DOTALL)
CODE_PAGES = ("README.md", "docs/many_cases.md", "docs/pinocchio.md", "docs/control.md")
MARKED = "\n".join((ROOT / page).read_text(encoding="utf-8") for page in CODE_PAGES)
BLOCKS = {match["name"]: match["text"] for match in BLOCK.finditer(MARKED)}
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]


@pytest.fixture
def project(tmp_path):
    """A folder that looks like the project, in which blocks may write."""
    (tmp_path / "pyproject.toml").touch()
    for name in ("models", "scenarios"):
        (tmp_path / name).symlink_to(ROOT / name)
    return tmp_path


@pytest.fixture
def scenario(tmp_path):
    (tmp_path / "pyproject.toml").touch()
    (tmp_path / "models").mkdir()
    folder = tmp_path / "models" / "gen411_arm"
    folder.mkdir()
    for file in (ROOT / "models" / "gen411_arm").iterdir():
        (folder / file.name).write_bytes(file.read_bytes())
    (tmp_path / "scenarios").mkdir()
    path = tmp_path / "scenarios" / "readme.yaml"
    path.write_text(BLOCKS["scenario"], encoding="utf-8")
    return load(path)


def test_every_marked_block_is_known():
    assert set(BLOCKS) == {"run", "test", "installed", "scenario", "output", "python", "sweep", "swept", "batch",
                           "matrices", "recorded", "model", "meshcat", "function"}  # fmt: skip


def test_commands_name_what_there_is():
    """The first block installs and solves; the second installs for tests and runs this suite."""
    assert len(BLOCKS["run"].strip().splitlines()) == len(BLOCKS["test"].strip().splitlines()) == 1
    (solved,) = re.findall(r"pinarm run (\S+)", BLOCKS["run"])
    assert (ROOT / solved).is_file()
    assert "pytest -n auto -m 'not slow'" in BLOCKS["test"]


def test_the_scenario_meets_its_answer_key(scenario):
    findings = check(scenario)
    assert len(findings) == 2
    assert all(finding.verdict == "agrees" for finding in findings)


def test_the_output_is_what_is_printed(scenario):
    def without_residuals(text):  # which are rounding, and differ between machines
        return re.sub(r"\d\.\de[-+]\d\d", "residual", text)

    printed = report(scenario.run())
    assert without_residuals(printed) == without_residuals(BLOCKS["output"].rstrip("\n"))
    assert all(float(residual) < 1e-12 for residual in re.findall(r"\d\.\de[-+]\d\d", printed))


def test_the_python_block_runs(project):
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}
    done = subprocess.run(
        [sys.executable, "-c", BLOCKS["python"]], cwd=project, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("Cr [N*m] -321.5")
    assert (project / "torques.png").stat().st_size > 10_000


@pytest.mark.parametrize("block", ["matrices", "recorded", "model", "meshcat"])
def test_the_blocks_for_pinocchios_users_run(project, block):
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", BLOCKS[block]], cwd=project, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


def test_the_control_function_gives_what_it_says():
    done = subprocess.run([sys.executable, "-c", BLOCKS["function"]], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == BLOCKS["function"].strip().rpartition("# ")[2]


def test_the_batch_runs(project):
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", BLOCKS["batch"]], cwd=project, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[0:3:2] == ["0", "True"]


def test_the_sweep_prints_what_it_says(project):
    command = shlex.split(BLOCKS["sweep"])[1:]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, *command], cwd=project, env=environment, capture_output=True, text=True)
    residual = re.compile(r"\d\.\de[-+]\d\d")  # which differs between machines
    assert done.returncode == 0, done.stderr
    assert residual.sub("", done.stdout) == residual.sub("", BLOCKS["swept"])
    assert {path.name for path in (project / "results" / "arm").iterdir()} >= {"cases.csv", "cases.npz", "plots"}


def test_the_command_for_an_installed_wheel_runs(tmp_path):
    """Here with the package of the checkout; ``.ci/wheel`` runs it with the wheel."""
    command = BLOCKS["installed"].replace("python ", f"{shlex.quote(sys.executable)} ")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, shell=True, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "pinarm-examples/results/gen411_arm_static/trajectory.csv").is_file()


def test_the_table_has_every_command_and_its_call():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    told = re.findall(r"^\| `(\w+)(?:[^|]|\\\|)*\| `pinarm\.(\w+)\(", text, re.MULTILINE)
    assert [command for command, _ in told] == [call for _, call in told]
    done = subprocess.run([sys.executable, "-m", "pinarm", "-h"], cwd=ROOT, capture_output=True, text=True, check=True)
    assert {command for command, _ in told} == set(re.findall(r"^    (\w+)(?: |$)", done.stdout, re.MULTILINE))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_files(page: Path):
    links = re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8"))
    assert [link for link in links if "://" not in link and not (page.parent / link).exists()] == []
