"""Small models that the tests of mechanics and engine are made of."""

from __future__ import annotations

import gc
import itertools
import json
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import nullcontext
from pathlib import Path
from typing import Any, NamedTuple

import pytest

if "PYTEST_XDIST_WORKER" in os.environ:  # a worker a core: threads of linear algebra would wait for each other
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("OMP_NUM_THREADS", "1")

from pinarm.engine.integration.methods.explicit import CompiledSteps
from pinarm.engine.kernel import tree as kernel_tree
from pinarm.engine.motion.systems import compiled_motion
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.mechanics.laws import Harmonic
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.inverse import Inverse
from pinarm.problems.time_grid import TimeGrid
from pinarm.use.mechanism import Mechanism
from pinarm.use.study.sweep import sweep
from pinarm.use.workers import dispatch
from pinarm.use.workers.dispatch import LocalProcesses


def pytest_collection_finish() -> None:
    """Leave the 400,000 objects of imports and tests out of every later search for garbage."""
    gc.freeze()


def body(name, parent, *, kind="continuous", axis="0 0 1", at="0 0 0", mass=1.0, com="0 0 0",
         inertia=(0.1, 0.1, 0.1), damping=0.0):  # fmt: skip
    """Return a link and the joint of the same name that carries it."""
    ixx, iyy, izz = inertia
    return f"""
  <link name="{name}_link"><inertial><origin xyz="{com}"/><mass value="{mass!r}"/>
    <inertia ixx="{ixx!r}" iyy="{iyy!r}" izz="{izz!r}" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{name}_link"/><origin xyz="{at}"/>
    <axis xyz="{axis}"/><limit lower="-1000" upper="1000" effort="1000" velocity="1000"/>
    <dynamics damping="{damping!r}"/></joint>"""


def chain(*bodies: dict) -> str:
    """Return the URDF of bodies that hang one from the other; the first from ``base``."""
    parent, parts = "base", []
    for given in bodies:
        parts.append(body(parent=parent, **given))
        parent = f"{given['name']}_link"
    return f'<robot name="test"><link name="base"/>{"".join(parts)}\n</robot>'


@pytest.fixture(name="chain")
def _chain() -> Callable[..., str]:
    return chain


@pytest.fixture
def mechanism(tmp_path: Path) -> Callable[..., Mechanism]:
    """Return a function that builds a mechanism from a URDF text and the content of its mechanism file."""

    def build(xml: str, **description) -> Mechanism:
        (tmp_path / "model.urdf").write_text(xml)
        content = {"pinarm": 1, "robot": "model.urdf", **description}
        (tmp_path / "mechanism.yaml").write_text(json.dumps(content))
        return Mechanism.load(tmp_path / "mechanism.yaml")

    return build


@pytest.fixture
def differentiate() -> Callable[..., object]:
    """Return the derivative of a function by central differences, extrapolated to order 8."""

    def derivative(function, t, h=0.02):
        rows = [(function(t + h / 2**k) - function(t - h / 2**k)) / (2 * h / 2**k) for k in range(4)]
        for order in (4.0, 16.0, 64.0):
            rows = [(order * fine - coarse) / (order - 1.0) for coarse, fine in itertools.pairwise(rows)]
        return rows[0]

    return derivative


@pytest.fixture
def swing() -> Callable[[Mechanism], Trajectory]:
    """Return a function that moves the joint ``arm`` of a mechanism to and fro."""

    def run(mechanism):
        law = Harmonic(mean=0.4, amplitude=0.9, pulsation=2.0)
        problem = Inverse(time=TimeGrid(end=3.0, samples=61), motion={"arm": law})
        return problem.solve(mechanism, Accuracy(), lambda *path: nullcontext()).rows

    return run


class ThisProcess(LocalProcesses):
    """Workers that are none: each call is done at once in this process, which needs no second for its imports."""

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_result(pickle.loads(pickle.dumps(function(*arguments))))
        return future

    def result(self, future: Future[Any]) -> Any:
        return future.result()


@pytest.fixture
def one_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Solve sweeps and batches in this process, where a test asks for no second worker."""
    processes = LocalProcesses
    for module in (dispatch, sweep):
        monkeypatch.setattr(module, "cores", lambda: 1)
    monkeypatch.setattr(dispatch, "LocalProcesses", lambda number: (ThisProcess if number == 1 else processes)(number))


@pytest.fixture
def no_hang() -> Iterator[None]:
    """Fail a test that hangs: a last resort, ten times what a test takes on a loaded machine."""

    def ring(*_: object) -> None:
        raise AssertionError("no answer after a minute")

    previous = signal.signal(signal.SIGALRM, ring)
    signal.alarm(60)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, previous)


# The peak of a process counts the pages of whoever started it: a small process must stand between it and pytest.
WATCHER = """\
import json, resource, subprocess, sys
limit, *command = sys.argv[1:]
try:
    done = subprocess.run(command, stdin=subprocess.DEVNULL, stdout=2, timeout=float(limit))
    status = done.returncode
except subprocess.TimeoutExpired:
    status = None
used = resource.getrusage(resource.RUSAGE_CHILDREN)
unit = 1 if sys.platform == "darwin" else 1024
print(json.dumps([status, used.ru_maxrss * unit]))
"""


class Spent(NamedTuple):
    """How a command ended, what it took and what it said.

    Attributes:
        status: its exit code; ``None`` where it had to be killed.
        peak: bytes of memory.
        text: its output and its errors.
    """

    status: int | None
    peak: int
    text: str


@pytest.fixture
def spend() -> Callable[..., Spent]:
    """Return a function that runs ``python -m pinarm`` with arguments in a folder and watches what it takes."""

    def run(folder: Path, *arguments: str, limit: float = 600.0, **environment: str) -> Spent:
        command = [sys.executable, "-m", "pinarm", *arguments]
        known = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1]), **environment}
        watcher = [sys.executable, "-c", WATCHER, str(limit), *command]
        done = subprocess.run(watcher, cwd=folder, env=known, capture_output=True, check=True)
        return Spent(*json.loads(done.stdout), done.stderr.decode(errors="replace"))

    return run


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[tuple]:
    """The calls of the compiled library for steps."""
    made, take = [], CompiledSteps.take
    monkeypatch.setattr(CompiledSteps, "take", lambda self, *given: made.append(given) or take(self, *given))
    return made


@pytest.fixture
def forget_loops() -> Callable[[], None]:
    """Return a function that lets no compiled loops of one call serve another."""

    def forget() -> None:
        compiled_motion._loops.cache_clear()

    return forget


@pytest.fixture
def without(monkeypatch: pytest.MonkeyPatch, forget_loops: Callable[[], None]) -> Callable[[Callable[[], Any]], Any]:
    """Return a function that calls another as where the compiled library was not built."""

    def call(function: Callable[[], Any]) -> Any:
        forget_loops()
        with monkeypatch.context() as context:
            context.setattr(kernel_tree, "library", lambda: None)
            found = function()
        forget_loops()
        return found

    return call
