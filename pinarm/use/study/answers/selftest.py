"""Self-test of an installation: a scenario of every kind against its answer key, and versions of the programs."""

from __future__ import annotations

import platform
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pinarm.errors import fault
from pinarm.problems import KINDS
from pinarm.use.start.new import example_files
from pinarm.use.study.answers.check import check
from pinarm.use.workers.worker import versions as programs


@dataclass(frozen=True)
class KindCheck:
    """Test of one kind of problem: the scenario, the number of its answers, and what is wrong, if anything."""

    kind: str
    scenario: str
    answers: int
    problem: str = ""

    def __str__(self) -> str:
        told = f"FAILED: {self.problem}" if self.problem else f"passed, {self.answers} answers"
        return f"{self.kind} ({self.scenario}): {told}"


@dataclass(frozen=True)
class SelfTest:
    """Test of the installation: versions of the software that numbers depend on, a test of each kind of problem."""

    versions: dict[str, str]
    checks: tuple[KindCheck, ...]

    @property
    def passed(self) -> bool:
        """Whether every kind of problem gives what its answer key says."""
        return not any(check.problem for check in self.checks)

    def summary(self) -> dict[str, Any]:
        """Return all of it as plain data."""
        return {"passed": self.passed, "versions": self.versions, "checks": [vars(check) for check in self.checks]}

    def __str__(self) -> str:
        versions = [f"{name} {version}" for name, version in self.versions.items()]
        return "\n".join([*versions, *map(str, self.checks), "passed" if self.passed else "FAILED"])


def selftest() -> SelfTest:
    """Solve a scenario of every kind and compare it with its answer key; nothing is written.

    Raises:
        InputError: pinarm was installed without its example files.
    """
    folder = example_files() / "scenarios"
    return SelfTest(versions(), tuple(_checks(folder)))


def _checks(folder: Path) -> Iterator[KindCheck]:
    for kind, name in ((kind, name) for kind, entry in KINDS.items() for name in entry.examples):
        try:
            findings = check(folder / f"{name}.yaml")
        except Exception as error:  # whatever it is, it is what is wrong with this installation
            yield KindCheck(kind, name, 0, " ".join(fault(error).split()))
            continue
        missed = [f"{finding.expectation.quantity} = {finding.computed:.9g}" for finding in findings if not finding.ok]
        yield KindCheck(kind, name, len(findings), f"not as in the answer key: {', '.join(missed)}" if missed else "")


def versions() -> dict[str, str]:
    """Return the versions of what numbers depend on, to their last digits."""
    known = programs()
    named = {name: known[name] for name in ("pinarm", "python", "pinocchio", "numpy", "scipy")}
    return {**named, "platform": f"{sys.platform} {platform.machine()}", "linear algebra": _blas()}


def _blas() -> str:
    config: Any = np.show_config("dicts")  # type: ignore[call-overload,unused-ignore]
    built = config["Build Dependencies"]["blas"]
    return f"{built.get('name', '?')} {built.get('version', '')}".strip()
