"""The command: exit codes, what is printed and where, progress on terminals only."""

import json
from pathlib import Path

import numpy as np
import pytest

from pinarm.cli.main import main
from pinarm.use.progress import case_progress

MASSES = "arguments.m=1:3:3 kg"


@pytest.fixture(autouse=True)
def here(path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(path.parent)
    return path.parent


def test_a_sweep_prints_statistics_and_writes_a_folder(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sweep", "held.yaml", "--over", MASSES, "--result", "M @ end", "--set", "arguments.l=0.5 m"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    head, _, values, *rest = out.splitlines()
    assert head == "A pendulum, held"
    assert values.split() == ["M", "@", "end", "N*m", "5", "0", "10", "5", "15", "2"]
    assert rest[-2:] == ["cases: 3", "written to results/held-sweep"]
    table = Path("results/held-sweep/cases.csv").read_text().splitlines()
    assert table[0].startswith("case,arguments.m [kg],M @ end [N*m],equilibrium,power,")


def test_a_case_that_fails_is_told_and_the_exit_code_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sweep", "held.yaml", "--over", "arguments.m=-2:2:5 kg", "--no-plots"]) == 3
    out = capsys.readouterr().out
    assert "cases: 5, 2 failed\nfailed: " in out
    assert "the mass is negative (-2 kg) (2: 0, 1)\n" in out


def test_json_is_for_machines(capsys: pytest.CaptureFixture[str]) -> None:
    command = ["sweep", "held.yaml", "--over", "arguments.m=normal(2, 0.1)", "--sample", "20", "--lhs", "--json"]
    assert main([*command, "--seed", "3", "-j", "1", "--no-plots"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["cases"] == 20
    assert found["results"]["max M"]["mean"] == pytest.approx(20, rel=0.01)  # a tenth of the deviation, stratified
    with np.load("results/held-sweep/cases.npz") as arrays:
        assert arrays["arguments.m"].mean() == pytest.approx(2, rel=0.01)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--over", "arguments.m"], "'arguments.m' has no name or no value"),
        (["--over", MASSES, "--result", "N"], "error: --result N: there is no quantity 'N'"),
        (["--over", MASSES, "-j", "0"], "0 workers solve nothing"),
        (["--cases", "none.csv"], "there is no file none.csv"),
        ([], "try: --over problem.time.end='1, 2, 3 s', or --cases FILE.csv"),
    ],
)
def test_a_mistake_in_the_sweep_itself_exits_with_2(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sweep", "held.yaml", *arguments]) == 2
    out, err = capsys.readouterr()
    assert message in err
    assert "Traceback" not in err
    assert out == ""


def test_cases_come_from_a_file_too(here: Path) -> None:
    (here / "cases.csv").write_text("arguments.m [kg],arguments.l [mm]\n1,500\n2,2000\n")
    command = ["sweep", "held.yaml", "--cases", "cases.csv", "--over", "problem.over.pivot.to=30, 90"]
    assert main([*command, "--result", "M @ end", "-o", "out"]) == 0
    with np.load("out/cases.npz") as arrays:
        np.testing.assert_allclose(arrays["M @ end"], [2.5, 5, 20, 40], rtol=1e-13)
        assert arrays["arguments.l"].tolist() == [500, 500, 2000, 2000]


def test_processes_keep_to_the_root_that_was_given(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    inner = here / "inner"
    inner.mkdir()
    (inner / ".pinarm-root").touch()
    (inner / "held.yaml").write_text((here / "held.yaml").read_text().replace("pendulum.yaml", "../pendulum.yaml"))
    command = ["sweep", "inner/held.yaml", "--over", MASSES, "--no-plots", "-o", "out"]
    assert main(command) == 2
    assert "leads out of the root folder" in capsys.readouterr().err
    assert main([*command, "--root", str(here)]) == 0


def test_progress_tells_what_is_done_and_failed() -> None:
    lines = list[str]()
    progress = case_progress(lines.append)
    progress(3, 1, 10)
    progress(4, 1, 10)
    progress(10, 2, 10)
    assert [line.rpartition(",")[0] for line in lines] == ["3/10 cases, 1 failed", "10/10 cases, 2 failed"]
