"""Many variants of one mechanism: 10,000 two-rod arms that are held, 5,000 crank-rockers that turn once.

Run with ``python -m benchmarks.race.variants``; it writes ``results/race/full/variants.json``, from which the page of
the race is written. Every engine has a process of its own and one core. References are closed forms: the moment of the
weights about the held joint; Freudenstein's equation and the power of the motor against weights and inertias.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from benchmarks.race.other_load import quietly

ROOT = Path(__file__).parents[2]
FILE = "variants.json"
G = 9.81
ROUNDS = 3

ANGLES = np.deg2rad(np.linspace(-60.0, 60.0, 5))
"""Positions in which an arm is held [rad]."""

SPEED, ROWS = 10.0, 241
"""Of the crank [rad/s]; instants of one revolution."""


@dataclass(frozen=True)
class Question:
    """What is asked of many variants; the answer: a torque of each [N*m], shape (n,).

    Attributes:
        title: For the table.
        ranges: Least and greatest value of what varies [SI], in the order of the columns of the variants.
        count: Number of variants.
        fewer: Number of variants that are run of an engine whose user writes a loop: each takes as long as another.
        reference: Variants, shape (n, w), to the answer.
    """

    title: str
    ranges: dict[str, tuple[float, float]]
    count: int
    fewer: int
    reference: Callable[[np.ndarray], np.ndarray]

    def variants(self) -> np.ndarray:
        """Return the values of all variants [SI], shape (count, w)."""
        least, most = np.array([*self.ranges.values()]).T
        return np.random.default_rng(7).uniform(least, most, (self.count, len(least)))


def held_arms(variants: np.ndarray) -> np.ndarray:
    """Return the largest torque that holds the second rod, ``g l2 cos(phi) (m_A + m_BA / 2)``."""
    m_load, m_rod, length = variants.T
    return np.asarray(G * length * (m_load + m_rod / 2.0) * np.cos(ANGLES).max())


def turned_cranks(variants: np.ndarray) -> np.ndarray:
    """Return the largest torque that turns the crank at constant speed, by the power of weights and inertias."""
    a, b, c, d, m2, m3, m4 = variants.T[..., None]
    crank = np.exp(2j * np.pi * np.arange(ROWS) / (ROWS - 1))  # directions in the complex plane
    back = a * crank - d  # from O4 to A
    length = np.abs(back)
    rocker = np.exp(1j * (np.angle(back) - np.arccos((length**2 + c**2 - b**2) / (2.0 * length * c))))
    coupler = (c * rocker - back) / b

    def sine(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.imag(x * np.conj(y))

    w3 = a * SPEED / b * sine(rocker, crank) / sine(coupler, rocker)
    w4 = a * SPEED / c * sine(crank, coupler) / sine(rocker, coupler)
    inwards = a * SPEED**2 * crank + b * w3**2 * coupler - c * w4**2 * rocker
    dw3 = -np.real(inwards * np.conj(rocker)) / (b * sine(coupler, rocker))
    dw4 = np.real(inwards * np.conj(coupler)) / (c * sine(rocker, coupler))
    v = 1j * (a * SPEED * crank + b / 2.0 * w3 * coupler)  # of the middle of the coupler
    dv = -a * SPEED**2 * crank + b / 2.0 * (1j * dw3 - w3**2) * coupler
    rising = m2 * a / 2.0 * SPEED * np.real(crank) + m3 * np.imag(v) + m4 * c / 2.0 * w4 * np.real(rocker)
    turning = m3 * b**2 / 12.0 * w3 * dw3 + m4 * c**2 / 3.0 * w4 * dw4
    return np.asarray((m3 * np.real(v * np.conj(dv)) + turning + G * rising).max(axis=-1) / SPEED)


QUESTIONS = {
    "arms": Question(
        "10,000 variants of the arm, held in 5 positions",
        {"m_A": (0.1, 0.5), "m_BA": (0.5, 1.5), "l2": (0.2, 0.3)},
        10_000, 2000, held_arms,
    ),
    "cranks": Question(
        "5,000 crank-rockers, one revolution in 241 rows",
        {"a": (0.095, 0.105), "b": (0.34, 0.36), "c": (0.245, 0.255), "d": (0.39, 0.41), "m2": (0.9, 1.1),
         "m3": (3.0, 4.0), "m4": (2.0, 3.0)},
        5000, 40, turned_cranks,
    ),
}  # fmt: skip


def measured(engine: str, name: str) -> dict[str, float]:
    """Return the seconds that a variant takes an engine, the best of several, and its largest relative error."""
    from benchmarks.race import variant_engines

    question, times, found = QUESTIONS[name], list[float](), np.zeros(0)
    variants = question.variants()[: None if engine == "pinarm" else question.fewer]
    run = variant_engines.ROUTES[engine](name, variants)
    for _ in range(ROUNDS):
        begin = time.process_time()
        found = run()
        times.append(time.process_time() - begin)
    answer = question.reference(variants)
    return {"seconds": min(times) / len(variants), "error": float(np.abs(found / answer - 1.0).max())}


def section(folder: Path) -> str:
    """Return the section of the page on variants; nothing where they have not been run."""
    from benchmarks.race.engines import ENGINES

    if not (folder / FILE).exists():
        return ""
    known = json.loads((folder / FILE).read_text())
    lines = [
        "## Many variants [µs a variant, processor time of one core]", "",
        f"The largest holding torque of two-rod arms with other masses and lengths; the largest torque that turns "
        f"crank-rockers\nwith other lengths and masses at constant speed. pinarm: `pinarm.sweep` over a table of "
        f"cases, with one process and all\nmeasures of accuracy. The others: a loop over variants, which sets masses, "
        f"inertias and places in the built model; loops\nclosed by Newton's method on the engine's Jacobians, from "
        f"the row before; inverse dynamics of the tree. All agree with\nclosed forms to {known['error']:.0e}. "
        f"{known['when']}; other programs used {known['others']:.1f} cores at most.", "",
        f"| problem | {' | '.join(ENGINES.values())} | pinarm / best other |",
        "| --- |" + " ---: |" * (len(ENGINES) + 1),
    ]  # fmt: skip
    for name, question in QUESTIONS.items():
        times = {engine: known[name][engine]["seconds"] for engine in ENGINES if engine in known[name]}
        least, others = min(times.values()), min(t for engine, t in times.items() if engine != "pinarm")
        cells = [f"{'**' * (times[engine] == least)}{1e6 * times[engine]:.0f}{'**' * (times[engine] == least)}"
                 if engine in times else "—" for engine in ENGINES]  # fmt: skip
        lines.append(f"| {question.title} | {' | '.join(cells)} | {times['pinarm'] / others:.2f} |")
    return "\n".join(["", *lines, ""])


def main() -> None:
    """Run all engines, and keep what they took."""
    from benchmarks.race import variant_engines

    folder = ROOT / "results" / "race" / "full"
    folder.mkdir(parents=True, exist_ok=True)
    told: dict[str, object] = {"when": time.strftime("%Y-%m-%d")}
    worst = others = 0.0
    for name in QUESTIONS:
        told[name] = found = {}
        for engine in variant_engines.ROUTES:
            with ProcessPoolExecutor(1, get_context("spawn")) as pool:
                found[engine], used, _ = quietly(lambda: pool.submit(measured, engine, name).result())  # noqa: B023
            others, worst = max(others, used), max(worst, found[engine]["error"])
            print(f"{name:8s} {engine:10s} {1e6 * found[engine]['seconds']:10.1f} µs, error "
                  f"{found[engine]['error']:.0e}", flush=True)  # fmt: skip
    (folder / FILE).write_text(json.dumps({**told, "error": worst, "others": others}))


if __name__ == "__main__":
    main()
