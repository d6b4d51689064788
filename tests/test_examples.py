"""Every example runs, in the order of its number; notebooks in a real kernel, with warnings as errors."""

import os
import re
import runpy
import subprocess
import sys
import tempfile
import textwrap
from pathlib import Path
from typing import Any

import nbformat
import pytest

import pinarm
from pinarm.errors import PinarmError
from pinarm.use.show.replay.chromium import browser, chromium

ROOT = Path(pinarm.__file__).parents[1]
EXAMPLES = sorted(path for path in (ROOT / "examples").iterdir() if path.suffix in (".py", ".ipynb"))
NOTEBOOKS = [path for path in EXAMPLES if path.suffix == ".ipynb"]


EXECUTE = """
import sys
import nbformat
from jupyter_client import AsyncKernelManager
from nbclient import NotebookClient

path, folder, target = sys.argv[1:]
notebook = nbformat.read(path, as_version=4)
notebook.cells.insert(0, nbformat.v4.new_code_cell("import warnings; warnings.simplefilter('error')"))
kernel = AsyncKernelManager(kernel_name="python3", transport="ipc", ip=target + ".socket")
where = {"metadata": {"path": folder}}
NotebookClient(notebook, km=kernel, timeout=120, resources=where, shutdown_kernel="immediate").execute()
del notebook.cells[0]
nbformat.write(notebook, target)
"""


def executed(path: Path) -> Any:
    """The notebook saved with its outputs and read again; its kernel is reached without any port."""
    with tempfile.TemporaryDirectory() as folder:  # a short path: those of sockets are limited
        target = f"{folder}/saved.ipynb"
        done = subprocess.run(
            [sys.executable, "-c", EXECUTE, str(path), str(path.parent), target],
            env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True, timeout=300, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return nbformat.read(target, as_version=4)


def test_they_are_in_order() -> None:
    assert [path.name[:2] for path in EXAMPLES] == [f"{k:02d}" for k in range(1, len(EXAMPLES) + 1)]
    assert len(EXAMPLES) == 17


SCRIPTS = [path for path in EXAMPLES if path not in NOTEBOOKS]


@pytest.mark.parametrize("path", [
    pytest.param(path, id=path.stem, marks=pytest.mark.slow if "reactions" in path.stem else ()) for path in SCRIPTS
])  # fmt: skip
def test_a_script_runs(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runpy.run_path(str(path))
    assert capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path: Path) -> None:
    """Its kernel takes seconds to start."""
    outputs = [out for cell in executed(path).cells for out in cell.get("outputs", [])]
    assert not [out for out in outputs if out.get("name") == "stderr"]
    assert [out for out in outputs if {"text/html", "image/png"} & out.get("data", {}).keys()]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_committed_without_outputs(path: Path) -> None:
    """They would be a megabyte of replay each, change with every version, and be stale in between."""
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert not any(cell.outputs or cell.execution_count for cell in code)
    assert any("assert" in cell.source for cell in code)  # something that is true of the physics


@pytest.mark.slow
def test_a_saved_notebook_shows_the_replay_offline(tmp_path: Path) -> None:
    """Executed, written, read again by a browser without network: numbers, plots, and a mechanism that moves."""
    try:
        chromium()
    except PinarmError as error:
        pytest.fail(str(error)) if os.environ.get("CI") else pytest.skip(str(error))
    outputs = [out for cell in executed(NOTEBOOKS[0]).cells for out in cell.get("outputs", [])]
    cell, findings = [out.data["text/html"] for out in outputs if "data" in out]
    assert "! misprint" in findings
    assert re.search(r"\bC_B +N\*m +0\.73575 .* 1\.4715 ", cell)
    page_text = textwrap.dedent(f"""\
        <!doctype html><meta charset="utf-8"><body>{cell}<script>(async () => {{
        const frame = document.querySelector("iframe");
        frame.scrollIntoView();
        const inner = () => frame.contentDocument?.querySelector("iframe");
        while (!inner()) await new Promise((done) => setTimeout(done, 20));
        inner().scrollIntoView();
        while (!inner().contentWindow.replay) await new Promise((done) => setTimeout(done, 20));
        document.documentElement.dataset.ready = "yes";
        }})()</script>""")
    (tmp_path / "saved.html").write_text(page_text, encoding="utf-8")
    with browser() as page:
        page.open(tmp_path / "saved.html")
        asked = [event["params"]["request"]["url"] for event in page.events
                 if event["method"] == "Network.requestWillBeSent"]  # fmt: skip
        assert {url.split(":")[0] for url in asked} <= {"file", "data", "about"}
        report = "document.querySelector('iframe').contentDocument"
        assert page.evaluate(f"[...{report}.querySelectorAll('figure svg')].map((x) => x.clientWidth > 400)")[:1] == [
            True
        ]
        there = f"{report}.querySelector('iframe').contentWindow.replay"
        moves = []
        for phi in (-1.0, 1.0):
            page.evaluate(f"{there}.show({phi})")
            moves.append(page.evaluate(f"{there}.placements()"))
        assert len(moves[0]) == 3
        assert moves[0] != moves[1]
