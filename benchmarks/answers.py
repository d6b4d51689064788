"""Answers of this tree compared with those of another commit: every scenario and every example of a kind.

``python -m benchmarks.answers COMMIT`` checks COMMIT out into a folder of its own, compiles its kernel, and solves
COMMIT's files with both trees, as processes ``python -m pinarm run FILE --verify``. It prints a line for each
difference and ends with code 1 where there is one.

Two answers agree where each column differs by at most ``CLOSE`` of its largest value, or by the sum of the errors that
both trees print for it. A column that is 0 may hold rounding: ``ZERO`` of the largest value of its unit in the result.
Measures of accuracy that grew by a decade and notes that differ are listed and do not fail.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import os
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[1]
STORE = ROOT / "results" / "answers"
FILES = ("scenarios", "docs/kind_examples")
CLOSE = 1e-9
"""Largest difference of two values, of the largest value of their column."""
ZERO = 1e-12
"""Largest value of a column that is 0, of the largest value of its unit in the same result."""
TABLES = 1e-6
"""Largest difference of two numbers of a section's table, of the larger one: tables print six digits."""
ROUNDING = 1e-11
"""Measures of accuracy below this one are rounding: a decade more or less says nothing."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("commit", help="the reference")
    parser.add_argument("files", nargs="*", type=Path, help="files of the reference; all of them if left out")
    parser.add_argument("-j", "--jobs", type=int, default=os.cpu_count(), help="processes at a time")
    given = parser.parse_intermixed_args()
    commit = git("rev-parse", "--short=12", f"{given.commit}^{{commit}}")
    tree = checkout(commit)
    files = given.files or list(scenario_files(tree))
    expected, computed = STORE / commit / "reference", STORE / commit / "present"
    solve(tree, tree, [file for file in files if not log(expected / file).exists()], expected, given.jobs)
    solve(ROOT, tree, files, computed, given.jobs)
    failures = 0
    for file in files:
        misses, remarks = compare(expected / file, computed / file)
        failures += bool(misses)
        for word, lines in (("MISS", misses), ("note", remarks)):
            for line in lines:
                print(f"{word}  {file}: {line}")
    print(f"{len(files) - failures} of {len(files)} files have the answers of {commit}")
    return 1 if failures else 0


def git(*words: str) -> str:
    return subprocess.run(("git", *words), cwd=ROOT, check=True, capture_output=True, text=True).stdout.strip()


def checkout(commit: str) -> Path:
    """Return a work tree of a commit with its kernel compiled; it stays for the next comparison."""
    tree = STORE / commit / "tree"
    if not tree.exists():
        git("worktree", "prune")
        git("worktree", "add", "--detach", str(tree), commit)
        subprocess.run((sys.executable, "hatch_build.py"), cwd=tree, check=True, stdout=subprocess.DEVNULL)
    return tree


def scenario_files(tree: Path) -> Iterator[Path]:
    for folder in FILES:
        for file in sorted((tree / folder).rglob("*.yaml")):
            if "\nproblem:" in file.read_text(encoding="utf-8"):
                yield file.relative_to(tree)


def solve(package: Path, tree: Path, files: list[Path], store: Path, jobs: int) -> None:
    """Solve files of a tree with the package of another one; what a process prints goes beside its result folder."""
    # without PYTHONSAFEPATH, -m would put the folder of the process, the reference tree, before the package
    environment = os.environ | {"PYTHONPATH": str(package), "PYTHONSAFEPATH": "1", "OPENBLAS_NUM_THREADS": "1"}

    def one(file: Path) -> None:
        folder = store / file
        folder.parent.mkdir(parents=True, exist_ok=True)
        command = (sys.executable, "-m", "pinarm", "run", str(file), "--verify", "--no-plots", "-o", str(folder))
        process = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, check=False)
        printed = f"exit {process.returncode}\n{process.stdout}\n{process.stderr}"
        log(folder).write_text(printed, encoding="utf-8")

    with ThreadPoolExecutor(jobs) as pool:
        list(pool.map(one, files))


def log(folder: Path) -> Path:
    return folder.with_suffix(".log")


def compare(expected: Path, computed: Path) -> tuple[list[str], list[str]]:
    """Return what differs between two result folders, and what is remarkable and no failure."""
    logs = [log(folder).read_text(encoding="utf-8") for folder in (expected, computed)]
    codes = [log.splitlines()[0] for log in logs]
    if codes[0] != codes[1]:
        return [f"{codes[1]}, reference {codes[0]}: {logs[1].strip().splitlines()[-1]}"], []
    summaries = [summary(folder) for folder in (expected, computed)]
    misses = [*column_misses(expected, computed, *summaries), *number_misses(*summaries)]
    misses += [miss for table in sorted(expected.glob("*.csv")) if table.name != "trajectory.csv"
               for miss in table_misses(table, computed / table.name)]  # fmt: skip
    return misses, [*grown_measures(*summaries), *changed_notes(*summaries)]


def summary(folder: Path) -> dict[str, Any]:
    file = folder / "summary.json"
    return json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}


def column_misses(expected: Path, computed: Path, before: dict[str, Any], after: dict[str, Any]) -> Iterator[str]:
    if not (expected / "trajectory.npz").exists():
        return
    with np.load(expected / "trajectory.npz") as old, np.load(computed / "trajectory.npz") as new:
        outputs = before.get("outputs", {})
        columns = {name: old[name] for name in outputs}
        scales: dict[str, float] = {}
        for name, values in columns.items():
            unit = outputs[name]["unit"]
            scales[unit] = max(scales.get(unit, 0.0), largest(values))
        for name, values in columns.items():
            if name not in new or new[name].shape != values.shape:
                yield f"{name}: shape {new[name].shape if name in new else 'missing'}, reference {values.shape}"
                continue
            errors = claimed(before, name) + claimed(after, name)
            unit_scale = scales[outputs[name]["unit"]] or 1.0
            allowed = max((CLOSE + errors) * largest(values), ZERO * unit_scale)
            difference = largest(new[name] - values)
            if not difference <= allowed or (np.isnan(new[name]) != np.isnan(values)).any():
                yield f"{name}: differs by {difference:.1e}, allowed {allowed:.1e}, largest {largest(values):.3g}"


def largest(values: np.ndarray) -> float:
    return float(np.nanmax(np.abs(values), initial=0.0)) if np.isfinite(values).any() else 0.0


def claimed(result: dict[str, Any], name: str) -> float:
    """Return the error printed for an output, relative to its largest value; 0 where nothing is integrated."""
    error = result.get("accuracy", {}).get("error of outputs", {}).get(name, 0.0)
    return float(error) if math.isfinite(float(error)) else 0.0


def number_misses(before: dict[str, Any], after: dict[str, Any]) -> Iterator[str]:
    """Compare the numbers of curves, such as ``C_B @ max``, and the values that a search chose."""
    for group in ("numbers", "findings"):
        for name, entry in before.get(group, {}).items():
            other = after.get(group, {}).get(name)
            if not isinstance(entry, dict) or not isinstance(entry.get("value"), int | float):
                continue
            if not isinstance(other, dict) or "value" not in other:
                yield f"{name}: missing"
                continue
            errors = sum(float(each.get("error") or 0.0) for each in (entry, other))
            allowed = CLOSE * abs(entry["value"]) + errors
            if not abs(other["value"] - entry["value"]) <= max(allowed, ZERO):
                yield f"{name}: {other['value']!r}, reference {entry['value']!r}, allowed {allowed:.1e}"


def table_misses(expected: Path, computed: Path) -> Iterator[str]:
    if not computed.exists():
        yield f"{expected.name}: missing"
        return
    tables = [list(csv.reader(file.read_text(encoding="utf-8").splitlines())) for file in (expected, computed)]
    cells = [[cell for row in table for cell in row] for table in tables]
    if len(cells[0]) != len(cells[1]):
        yield f"{expected.name}: {len(cells[1])} cells, reference {len(cells[0])}"
        return
    unlike = [(new, old) for old, new in zip(*cells, strict=True) if not alike(old, new)]
    if unlike:
        yield f"{expected.name}: {len(unlike)} cells differ, the first one {unlike[0][0]!r}, reference {unlike[0][1]!r}"


def alike(old: str, new: str) -> bool:
    try:
        return math.isclose(float(old), float(new), rel_tol=TABLES, abs_tol=ZERO) or old == new
    except ValueError:
        return old == new


def grown_measures(before: dict[str, Any], after: dict[str, Any]) -> Iterator[str]:
    old, new = (result.get("accuracy", {}) for result in (before, after))
    for name, value in old.items():
        other = new.get(name)
        if type(value) is float and type(other) is float and other > max(10 * value, ROUNDING):
            yield f"{name}: {other:.1e}, reference {value:.1e}"


def changed_notes(before: dict[str, Any], after: dict[str, Any]) -> Iterator[str]:
    old, new = (set(map(str, result.get("notes", []))) for result in (before, after))
    yield from (f"no longer noted: {note}" for note in sorted(old - new))
    yield from (f"newly noted: {note}" for note in sorted(new - old))


if __name__ == "__main__":
    raise SystemExit(main())
