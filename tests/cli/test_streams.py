"""Output that cannot be written ends a command with words where there is room for them, and with an exit code."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

SCENARIO = Path(__file__).parents[2] / "scenarios" / "gen411_arm_static.yaml"


def shell(tail: str) -> "subprocess.CompletedProcess[str]":
    command = f"'{sys.executable}' -m pinarm explain '{SCENARIO}' {tail}"
    buffered = {key: value for key, value in os.environ.items() if key != "PYTHONUNBUFFERED"}
    return subprocess.run(["sh", "-c", command], env=buffered, capture_output=True, text=True, timeout=60)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no full device")
@pytest.mark.parametrize(("tail", "code", "said"), [
    (">&- 2>&- <&-", 0, ""), (">/dev/full", 2, "error: the output: No space left on device"),
])  # fmt: skip
def test_streams_that_are_closed_or_full(tail: str, code: int, said: str) -> None:
    done = shell(tail)
    assert done.returncode == code
    assert "Traceback" not in done.stderr
    assert len(done.stderr.strip()) == len(said) and (len(said) == 1 or done.stderr.strip() == said)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no full device")
@pytest.mark.parametrize(("arguments", "said", "unbuffered"), [
    ("run --help >/dev/full 2>&1", "", "1"),
    ("--version >/dev/full", "error: the output: No space left on device\n", "1"),
])  # fmt: skip
def test_help_and_mistakes_that_cannot_be_written_are_exit_2(arguments: str, said: str, unbuffered: str) -> None:
    command, settings = f"'{sys.executable}' -m pinarm {arguments}", {**os.environ, "PYTHONUNBUFFERED": unbuffered}
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, timeout=60, check=False, env=settings)
    assert (done.returncode, done.stderr) == (2, said)
