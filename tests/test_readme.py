"""The README and the tables of pages are what the program has; links of all pages lead somewhere."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from code_blocks import PAGES, ROOT, blocks_of

from pinarm import load
from pinarm.use.show.text import report
from pinarm.use.study.answers.check import check

README = blocks_of(ROOT / "README.md")
MARKED = {block.marker: block.text for block in README if block.marker}


@pytest.fixture
def scenario(tmp_path):
    (tmp_path / "pyproject.toml").touch()
    shutil.copytree(ROOT / "models" / "gen411_arm", tmp_path / "models" / "gen411_arm")
    (block,) = (block for block in README if block.title)
    path = tmp_path / block.title
    path.parent.mkdir()
    path.write_text(block.text, encoding="utf-8")
    return load(path)


def test_commands_name_what_there_is():
    """The first block installs and solves; the second installs for tests and runs this suite."""
    assert len(MARKED["run"].strip().splitlines()) == len(MARKED["test"].strip().splitlines()) == 1
    (solved,) = re.findall(r"pinarm run (\S+)", MARKED["run"])
    assert (ROOT / solved).is_file()
    assert "pytest -n auto -m 'not slow'" in MARKED["test"]


def test_the_scenario_meets_its_answer_key(scenario):
    findings = check(scenario)
    assert len(findings) == 2
    assert all(finding.verdict == "agrees" for finding in findings)


def test_residuals_of_the_printed_output_are_rounding(scenario):
    """That it is printed is tested with all other blocks."""
    assert all(float(residual) < 1e-12 for residual in re.findall(r"\d\.\de[-+]\d\d", report(scenario.run())))


@pytest.mark.slow
def test_the_command_for_an_installed_wheel_runs(tmp_path):
    """Here with the package of the checkout; ``.ci/wheel`` runs it with the wheel."""
    command = MARKED["installed"].replace("python ", f"{shlex.quote(sys.executable)} ")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, shell=True, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "pinarm-examples/results/gen411_arm_static/trajectory.csv").is_file()


def test_the_table_has_every_command_and_its_call():
    text = (ROOT / "docs/commands.md").read_text(encoding="utf-8")
    told = re.findall(r"^\| `(\w+)(?:[^|]|\\\|)*\| `pinarm\.(\w+)\(", text, re.MULTILINE)
    assert [command for command, _ in told] == [call for _, call in told]
    done = subprocess.run([sys.executable, "-m", "pinarm", "-h"], cwd=ROOT, capture_output=True, text=True, check=True)
    assert {command for command, _ in told} == set(re.findall(r"^    (\w+)(?: |$)", done.stdout, re.MULTILINE))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_files(page: Path):
    links = re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8"))
    assert [link for link in links if "://" not in link and not (page.parent / link).exists()] == []
