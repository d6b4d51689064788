"""Extreme cases: what is asked, by which independent route the answer is known, and how exact it has to be."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from catalogue import ABOUT_Y
from linkage import GROUND, Body, Joint, Linkage
from scipy.special import ellipj, ellipk, ellipkm1

from pinarm.engine.motion.outcome import Outcome as Run
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.errors import PinarmError
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.forward import Forward, InitialState
from pinarm.problems.time_grid import TimeGrid
from pinarm.use.mechanism import Mechanism

G = 9.81
FINE = 1e-12
WRONG = float("inf")
"""Error of an answer where there is none to give, or that does not say what it has to."""


@dataclass(frozen=True)
class Case:
    """One extreme case.

    Attributes:
        area: What it is an extreme of.
        name: What it is.
        reference: The independent route.
        error: Error of the program's answer, mostly relative, found in an empty folder; refusals are raised.
        tolerance: Largest error that is right.
        reason: Why not less.
        when: ``fast`` cases run with every test, ``slow`` ones with ``pytest -m slow``, the others by command only.
    """

    area: str
    name: str
    reference: str
    error: Callable[[Path], float]
    tolerance: float
    reason: str
    when: Literal["fast", "slow", "command"] = "fast"


@dataclass(frozen=True)
class Outcome:
    """What has become of a case: an error, or why it was refused."""

    error: float = WRONG
    refusal: str = ""

    @classmethod
    def of(cls, case: Case, folder: Path) -> Outcome:
        """Run a case."""
        try:
            return cls(float(case.error(folder)))
        except PinarmError as error:
            return cls(refusal=error.message)

    def verdict(self, case: Case) -> str:
        """Right, refused or wrong."""
        return "refused" if self.refusal else "right" if self.error <= case.tolerance else "WRONG"


def solved(mechanism: Mechanism, end: float, samples: int = 21, **more) -> Trajectory:
    """The rows of ``integrated``."""
    return integrated(mechanism, end, samples, **more).rows


def integrated(mechanism: Mechanism, end: float, samples: int = 21, *, position=None, velocity=None, **more) -> Run:
    """Forward dynamics; keys of ``Accuracy`` are given to it, the tolerance is 1e-12 where none is."""
    chosen = {key: more.pop(key) for key in ("method", "tolerance", "step", "max_steps") if key in more}
    accuracy = Accuracy(**({} if "step" in chosen else {"tolerance": FINE}) | chosen)
    initial = InitialState(position=position or {}, velocity=velocity or {})
    problem = Forward(time=TimeGrid(end=end, samples=samples), initial=initial, **more)
    return problem.solve(mechanism, accuracy, lambda *path: nullcontext())


def hinge(first: str, second: str, x: float = 0.0, z: float = 0.0) -> Joint:
    """A joint about y."""
    return Joint("revolute", first, second, np.array([x, 0.0, z]), ABOUT_Y)


def pendulum(length: float = 1.0, mass: float = 1.0, gravity: float = G) -> Linkage:
    """A point on a rod without mass that hangs down at 0."""
    return Linkage({"bob": Body(mass, np.array([0.0, 0.0, -length]))}, {"arm": hinge(GROUND, "bob")}, gravity)


def swing(t: np.ndarray, amplitude: float, rate: float) -> np.ndarray:
    """Angle of a pendulum let go at an amplitude, by Jacobi's functions; rate: that of small swings [rad/s]."""
    m = np.sin(amplitude / 2) ** 2
    sn, _, _, _ = ellipj(rate * t + ellipk(m), m)
    return np.sign(amplitude) * 2 * np.arcsin(np.sqrt(m) * sn)


def quarter(amplitude: float, rate: float) -> float:
    """Time that a pendulum takes from its amplitude to the bottom [s]; exact close to the top as well."""
    return float(ellipkm1(np.cos(amplitude / 2) ** 2) / rate)


def largest(difference: np.ndarray) -> float:
    return float(np.abs(difference).max())
