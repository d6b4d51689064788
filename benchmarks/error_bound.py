"""True errors over the differences that ``--verify`` bounds them by: which factor holds in 99 of 100 cases.

``python benchmarks/error_bound.py [CHAINS]`` solves the free motion of random open chains and loops by every method, at
a random tolerance or step. The true error is that to a solution at a tolerance of 1e-13; what is not 30 times larger
than the difference of that to one of 1e-12 is left out. A second table has the errors of oscillators ``A cos(w t)`` at
tolerances down to 1e-14, where rounding decides; the cosine is computed with 64 bits. A third says by how much the
error of a setting differs where initial velocities differ by 1 %: the margin of a recommended setting.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "tests" / "loops"))

from random_chains import closed_chain, open_chain, scenario

from pinarm.engine.integration.methods import METHODS
from pinarm.errors import NumericsError
from pinarm.use.accuracy.error_estimate import BOUND, estimate_errors, output_differences, with_setting
from pinarm.use.facade import Result, Scenario, load
from pinarm.use.study.tradeoff import MARGIN

RESOLVED = 30.0
"""True error over that of the reference, from which on it counts."""

SATURATED = 0.3
"""Error up to which differences are in proportion to it."""

STEPS = 20_000
QUANTILES = (0.5, 0.9, 0.95, 0.98, 0.99, 0.995)
Numbers = np.random.Generator


@dataclass(frozen=True)
class Compared:
    """The true error of an output, and the difference that its bound is made of.

    Attributes:
        kind: ``open chains`` or ``loops``.
        method: The method of integration.
        difference: Difference to the second solution, relative to the output's scale.
        error: True error, likewise.
    """

    kind: str
    method: str
    difference: float
    error: float

    @property
    def ratio(self) -> float:
        """Return the factor that the difference would have needed."""
        return self.error / self.difference


def random_motion(folder: Path, seed: int) -> tuple[str, Scenario, Numbers]:
    """Return the kind and the free motion of a random open chain, or of a loop in two of five cases."""
    numbers = np.random.default_rng([seed, 7])
    chain = open_chain if numbers.random() < 0.6 else closed_chain
    return "open chains" if chain is open_chain else "loops", scenario(folder, chain(numbers), 1e-9, numbers), numbers


def random_setting(method: str, asked: Scenario, numbers: Numbers) -> dict[str, Any]:
    """Return a setting of a method between a coarse and a fine one."""
    if METHODS[method].setting == "step":
        span = asked.problem.time.end - asked.problem.time.start
        return {"method": method, "step": f"{float(span) / (16 * 2 ** int(numbers.integers(1, 7)))!r} s"}
    finest = -9.0 if method in ("dopri5", "stiff") else -11.0
    return {"method": method, "tolerance": float(10.0 ** numbers.uniform(finest, -3.0))}


def reference(asked: Scenario) -> tuple[Result, float]:
    """Return a solution at a tolerance of 1e-13, and its difference to another one.

    Raises:
        NumericsError: There is none.
    """
    exact = with_setting(asked, {"tolerance": 1e-13}, STEPS).solve()
    other = with_setting(asked, {"tolerance": 1e-12}, STEPS, seed=5).solve()
    return exact, max(output_differences(exact, other).values())


def chains(folder: Path, count: int) -> Iterator[Compared]:
    """Yield the outputs of random chains by every method that integrates them."""
    for seed in range(count):
        kind, asked, numbers = random_motion(folder, seed)
        try:
            exact, known = reference(asked)
        except NumericsError:
            continue
        for method in METHODS:
            variant = with_setting(asked, random_setting(method, asked, numbers), STEPS)
            yield from (one for one in compared(kind, variant, lambda run, exact=exact: output_differences(exact, run))
                        if RESOLVED * known < one.error < SATURATED)  # fmt: skip


def compared(kind: str, asked: Scenario, true: Callable[[Result], dict[str, float]]) -> list[Compared]:
    """Return the outputs of a scenario; nothing where it cannot be solved."""
    try:
        result = estimate_errors(asked, asked.solve())
    except NumericsError:
        return []
    method = asked.content.accuracy.method
    return [Compared(kind, method, result.errors[name] / BOUND, error) for name, error in true(result).items()]


def oscillators(folder: Path, count: int) -> Iterator[Compared]:
    """Yield the outputs of oscillators at tight tolerances."""
    for seed in range(count):
        numbers = np.random.default_rng([seed, 3])
        mass, stiffness, amplitude = map(float, 10.0 ** numbers.uniform((-0.5, 0.0, -0.7), (0.7, 3.0, 0.5)))
        end = float(numbers.uniform(1.0, 10.0) * 2.0 * np.pi * (mass / stiffness) ** 0.5)
        (folder / "slide.xml").write_text(
            '<mujoco><option gravity="0 0 0"/><worldbody><body name="body"><joint name="x" type="slide"/>'
            f'<inertial pos="0 0 0" mass="{mass!r}" diaginertia="1 1 1"/></body></worldbody></mujoco>'
        )
        tolerance = float(10.0 ** numbers.uniform(-14.0, -11.0))
        (folder / "oscillator.yaml").write_text(f"""
pinarm: 1
mechanism: slide.xml
problem:
  kind: forward
  time: {{end: {end!r} s, samples: 41}}
  initial: {{position: {{x: {amplitude!r} m}}}}
  loads: {{spring: {{kind: joint_spring, joint: x, stiffness: {stiffness!r} N/m}}}}
outputs: [joint.x.position, joint.x.velocity]
accuracy: {{tolerance: {tolerance!r}}}
""")
        pulsation = np.sqrt(np.longdouble(stiffness) / np.longdouble(mass))
        yield from compared("oscillators", load(folder / "oscillator.yaml"), harmonic(amplitude, pulsation))


def harmonic(amplitude: float, pulsation: np.longdouble) -> Callable[[Result], dict[str, float]]:
    """Return what gives the errors of ``A cos(w t)`` and of its velocity in a result."""

    def errors(result: Result) -> dict[str, float]:
        phase = pulsation * result.trajectory.grid.t.astype(np.longdouble)
        exact = amplitude * np.cos(phase), -amplitude * pulsation * np.sin(phase)
        return {
            name: float(np.abs(result[name].values - values).max() / np.abs(values).max())
            for name, values in zip(result.content.outputs, exact, strict=True)
        }

    return errors


def scatter(folder: Path, count: int) -> Iterator[float]:
    """Yield by which factor the error of a setting changes with initial velocities that differ by 1 %."""
    methods = list(METHODS)
    for seed in range(count):
        _, asked, numbers = random_motion(folder, seed)
        setting = random_setting(methods[seed % len(methods)], asked, numbers)
        errors = []
        for factor in (1.0, 1.01):
            given = asked.problem.initial.velocity
            faster = asked.varied({"problem.initial.velocity": {
                name: f"{factor * float(rate)!r} rad/s" for name, rate in given.items()}})  # fmt: skip
            try:
                exact = with_setting(faster, {"tolerance": 1e-12}, STEPS).solve()
                errors.append(max(output_differences(exact, with_setting(faster, setting, STEPS).solve()).values()))
            except NumericsError:
                break
        if len(errors) == 2 and min(errors) > 1e-10 and max(errors) < SATURATED:
            yield max(errors) / min(errors)


def row(name: str, ratios: list[float], bound: float) -> str:
    """Return a line of a table: how many, quantiles, the largest, and the share below a bound."""
    values = np.array(ratios)
    cells = [name, str(len(values)), *(f"{x:.2f}" for x in np.quantile(values, QUANTILES)), f"{values.max():.3g}"]
    return f"| {' | '.join(cells)} | {100.0 * (values <= bound).mean():.2f} % |"


def heading(of: str, bound: float) -> str:
    """Return the heading of a table."""
    names = [of, "number", *(f"{100 * x:g} %" for x in QUANTILES), "largest", f"below {bound:g}"]
    return f"| {' | '.join(names)} |\n|{' --- |' * len(names)}"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description="The factor of the bounds that --verify gives.")
    parser.add_argument("chains", nargs="?", type=int, default=300)
    count = parser.parse_args().chains
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        found = list(chains(folder, count))
        print(heading("error over difference", BOUND))
        print(row("all", [one.ratio for one in found], BOUND))
        for key in ("open chains", "loops", *METHODS):
            print(row(key, [one.ratio for one in found if key in (one.kind, one.method)], BOUND))
        print(row("oscillators, to rounding", [one.ratio for one in oscillators(folder, count)], BOUND))
        print(f"\n{heading('error at 1 % more speed', MARGIN)}\n{row('all', list(scatter(folder, count)), MARGIN)}")


if __name__ == "__main__":
    main()
