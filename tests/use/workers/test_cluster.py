"""Sweeps on a real scheduler of Dask and its worker processes, on loopback; whoever dies, the table is the same."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import pytest

import pinarm
from pinarm import PinarmError
from pinarm.cli.commands import BAD_INPUT
from pinarm.cli.main import NUMERICS_FAILED
from pinarm.use.workers.dispatch import cluster

pytest.importorskip("distributed")
ROOT = str(Path(__file__).parents[3])
WAIT = 120.0


def wait_for(condition: Callable[[], Any]) -> Any:
    deadline = time.monotonic() + WAIT
    while not (found := condition()):
        assert time.monotonic() < deadline, "it takes too long"
        time.sleep(0.05)
    return found


class Cluster:
    """A scheduler and workers, each a process."""

    def __init__(self, folder: Path, stack: ExitStack, protocol: str = "tcp", **environment: str) -> None:
        self.folder, self.stack, self.protocol = folder, stack, protocol
        own = {"TMPDIR": str(folder), "PYTHONPATH": ROOT, "DASK_LOGGING__DISTRIBUTED": "info"}
        self.environment = {**os.environ, **own, **environment}
        self.scheduler = self.start("scheduler", "--protocol", protocol, "--port", "0")
        self.address = self.said("scheduler", rf"Scheduler at: +({protocol}://127\.0\.0\.1:\d+)")
        self.workers = list[subprocess.Popen[bytes]]()

    def start(self, command: str, *arguments: str) -> "subprocess.Popen[bytes]":
        name = f"{command}{len(list(self.folder.glob('*.log')))}"
        with open(self.folder / f"{name}.log", "wb") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", "dask", command, "--host", "127.0.0.1", "--dashboard-address", "127.0.0.1:0",
                 *arguments],
                cwd=self.folder, env=self.environment, stdout=log, stderr=log, start_new_session=True,
            )  # fmt: skip
        self.stack.callback(process.wait)
        self.stack.callback(process.kill)
        return process

    def said(self, command: str, pattern: str) -> str:
        matches = lambda: (re.search(pattern, log) for log in logs_of(self.folder, command))  # noqa: E731
        return str(wait_for(lambda: next((match[1] for match in matches() if match), "")))

    def add_worker(self) -> "subprocess.Popen[bytes]":
        """Start a worker without a nanny, which would start it again."""
        before = len(self.present())
        options = ("--nthreads", "1", "--no-nanny", "--local-directory", str(self.folder))
        self.workers.append(self.start("worker", self.address, *options))
        wait_for(lambda: len(self.present()) > before)
        return self.workers[-1]

    def present(self) -> list[str]:
        log = "".join(logs_of(self.folder, "scheduler"))
        return re.findall(r"Register worker", log)


def logs_of(folder: Path, command: str) -> list[str]:
    return [log.read_text() for log in folder.glob(f"{command}*.log")]


@pytest.fixture
def start(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., Cluster]]:
    with ExitStack() as stack:
        yield lambda **given: Cluster(tmp_path_factory.mktemp("cluster"), stack, **given)


def sweep(path: Path, cases: int, *arguments: str, **environment: str) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "pinarm", "sweep", str(path), "--over", f"arguments.m=-1:3:{cases} kg"]
    known = {**os.environ, "PYTHONPATH": ROOT, **environment}
    heard = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)  # a shell's background jobs ignore interrupts
    return subprocess.Popen([*command, "--no-plots", *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                            text=True, env=known, preexec_fn=heard)  # fmt: skip


def files(folder: Path) -> dict[str, bytes]:
    names = ("cases.csv", "cases.npz", "summary.json", "sweep.yaml")
    return {name: (folder / name).read_bytes() for name in names}


def solved(folder: Path) -> int:
    journal = folder / "journal.jsonl"
    return journal.read_bytes().count(b'"case"') if journal.exists() else 0


def in_one_process(path: Path, cases: int, folder: Path) -> dict[str, bytes]:
    over = {"arguments.m": f"-1:3:{cases} kg"}
    pinarm.sweep(path, over, workers=1).save(folder, plots=False)
    return files(folder)


def listening(process: int) -> set[str]:
    """Return the addresses at which a process waits for connections."""
    sockets = {os.readlink(entry) for entry in Path(f"/proc/{process}/fd").iterdir() if entry.is_symlink()}
    tables = (Path(f"/proc/{process}/net/{name}").read_text() for name in ("tcp", "tcp6"))
    lines = [line.split() for table in tables for line in table.splitlines()[1:]]
    return {line[1] for line in lines if line[3] == "0A" and f"socket:[{line[9]}]" in sockets}


@pytest.mark.slow
def test_a_cluster_gives_the_bytes_of_one_process_and_nothing_listens_here(
    path: Path, tmp_path: Path, start: Callable[..., Cluster]
) -> None:
    dask = start()
    dask.add_worker()
    out = tmp_path / "out"
    client = sweep(path, 4000, "--cluster", dask.address, "-o", str(out))
    wait_for(lambda: solved(out) > 10)
    assert listening(client.pid) == set()
    assert {address.partition(":")[0] for address in listening(dask.scheduler.pid)} == {"0100007F"}, "of loopback"
    said, errors = client.communicate(timeout=WAIT)
    assert client.returncode == NUMERICS_FAILED, errors  # negative masses are failures
    assert errors == ""
    assert "cases: 4000, 1000 failed" in said
    assert files(out) == in_one_process(path, 4000, tmp_path / "one")


def killed(path: Path, tmp_path: Path, dask: Cluster, cases: int) -> None:
    """Kill a worker and then the scheduler of a sweep, and go on without and with a cluster."""
    out = tmp_path / "out"
    dask.add_worker()
    dask.add_worker()
    client = sweep(path, cases, "--cluster", dask.address, "-o", str(out))
    wait_for(lambda: solved(out) > cases // 10)
    dask.workers[0].kill()
    before = wait_for(lambda: solved(out) > cases // 5 and solved(out))
    dask.scheduler.kill()
    _, errors = client.communicate(timeout=WAIT)
    assert client.returncode == NUMERICS_FAILED
    assert re.match(r"error: the workers are lost \(.*\)\n  try: the same command", errors), errors
    assert "Traceback" not in errors
    assert before <= solved(out) < cases
    last = sweep(path, cases, "-j", "1", "-o", str(out))
    last.communicate(timeout=WAIT + 0.02 * cases)
    assert files(out) == in_one_process(path, cases, tmp_path / "one")
    entries = [
        entry["case"] for entry in map(json.loads, (out / "journal.jsonl").read_text().splitlines()) if "case" in entry
    ]
    assert len(entries) == len(set(entries)) == cases, "no case was solved twice"


@pytest.mark.slow
def test_ten_thousand_cases_survive_both(path: Path, tmp_path: Path, start: Callable[..., Cluster]) -> None:
    killed(path, tmp_path, start(), 10_000)


def certificates(folder: Path) -> dict[str, str]:
    """Make an authority and a certificate of it with openssl; return the settings of Dask that name them."""

    def openssl(*arguments: str) -> None:
        subprocess.run(["openssl", *arguments], cwd=folder, check=True, capture_output=True)

    openssl("req", "-x509", "-newkey", "rsa:2048", "-nodes", "-keyout", "ca.key", "-out", "ca.pem", "-days", "2",
            "-subj", "/CN=authority")  # fmt: skip
    openssl("req", "-newkey", "rsa:2048", "-nodes", "-keyout", "key.pem", "-out", "request.pem", "-subj", "/CN=dask")
    openssl("x509", "-req", "-in", "request.pem", "-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial",
            "-out", "certificate.pem", "-days", "2")  # fmt: skip
    roles = ("SCHEDULER", "WORKER", "CLIENT")
    named = {f"DASK_DISTRIBUTED__COMM__TLS__{role}__{key}": str(folder / file) for role in roles
             for key, file in (("KEY", "key.pem"), ("CERT", "certificate.pem"))}  # fmt: skip
    return {**named, "DASK_DISTRIBUTED__COMM__TLS__CA_FILE": str(folder / "ca.pem"),
            "DASK_DISTRIBUTED__COMM__REQUIRE_ENCRYPTION": "true"}  # fmt: skip


@pytest.mark.slow
def test_a_cluster_may_want_certificates(path: Path, tmp_path: Path, start: Callable[..., Cluster]) -> None:
    settings = certificates(tmp_path)
    dask = start(protocol="tls", **settings)
    dask.add_worker()
    out = tmp_path / "out"
    client = sweep(path, 20, "--cluster", dask.address, "-o", str(out), **settings)
    client.communicate(timeout=WAIT)
    assert files(out) == in_one_process(path, 20, tmp_path / "one")
    stranger = sweep(path, 20, "--cluster", dask.address, "-o", str(tmp_path / "other"))
    _, errors = stranger.communicate(timeout=WAIT)
    assert stranger.returncode == BAD_INPUT
    assert f"no scheduler of Dask answers at {dask.address}" in errors


def test_what_is_no_scheduler_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where nobody listens, where nobody answers, and what is no address; and without Dask it is said how to get it."""
    from pinarm.use.workers import dispatch as module

    monkeypatch.setattr(module, "TIMEOUT", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        for address in (f"tcp://127.0.0.1:{silent.getsockname()[1]}", "127.0.0.1:1", "nonsense://x"):
            with pytest.raises(PinarmError, match=f"no scheduler of Dask answers at {address}"), cluster(address):
                pass
    monkeypatch.setitem(sys.modules, "distributed", None)
    missing = pytest.raises(PinarmError, match=r"Dask is not installed\n  try: pip install 'pinarm\[cluster\]'")
    with missing, cluster("tcp://x"):
        pass
