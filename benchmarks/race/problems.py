"""The questions of the race: what every engine is asked, and what the answer looks like."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache

import numpy as np

from benchmarks.race import mechanisms
from benchmarks.race.mechanisms import Linkage
from pinarm.records import replace

SAMPLES = 20
STARTS = 256


@dataclass(frozen=True)
class Problem:
    """A question.

    Attributes:
        name: Short.
        title: For headings.
        linkage: What moves.
    """

    name: str
    title: str
    linkage: Linkage = field(repr=False)


@dataclass(frozen=True)
class Motion(Problem):
    """Free motion from the start of the linkage.

    The answer: the angles of all joints [rad] at SAMPLES equally spaced instants after the start, shape (SAMPLES, n);
    of a body that flies, before them, its place [m] and the nine entries of its rotation matrix.

    Attributes:
        end: Last instant [s].
        regular: Whether no position on the way is singular, and no constraint redundant.
        alike: Columns of the answer that are equal; where they are not, the motion is on another branch.
    """

    end: float = 0.0
    regular: bool = True
    alike: tuple[int, ...] = ()

    @property
    def times(self) -> np.ndarray:
        """The instants of the answer [s]."""
        return self.end * np.arange(1, SAMPLES + 1) / SAMPLES


@dataclass(frozen=True)
class Batch(Problem):
    """Free motions from STARTS starts around that of the linkage; the answer: the last angles, shape (STARTS, n).

    Attributes:
        end: Last instant [s].
    """

    end: float = 0.0

    def starts(self) -> tuple[np.ndarray, np.ndarray]:
        """Return q and v at the starts, each (STARTS, n)."""
        noise = np.random.default_rng(256).uniform(-0.2, 0.2, (2, STARTS, len(self.linkage.q)))
        return self.linkage.q + noise[0], self.linkage.v + noise[1]


@dataclass(frozen=True)
class Inverse(Problem):
    """Torques of motors at random states: of all joints, shape (samples, n), or of one drive, shape (samples, 1).

    A linkage with loops has one freedom, and the states are given whole: all joints, closed to rounding.

    Attributes:
        drive: Index of the joint that is driven, where there are loops.
        samples: Number of states.
    """

    drive: int | None = None
    samples: int = 100_000

    def states(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return q, v and a, each (samples, n)."""
        random = np.random.default_rng(1)
        if self.drive is None:
            q, v, a = random.uniform(-2.0, 2.0, (3, self.samples, len(self.linkage.q)))
            return q, v, a
        s, ds, dds = (x[:, None] for x in random.uniform(-1.0, 1.0, (3, self.samples)))
        return closed_states(self.linkage, s, ds, dds)


def closed_states(linkage: Linkage, s: np.ndarray, ds: np.ndarray, dds: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return q, v and a of a four-bar of equal rods, or of the manipulator, from those of the drive, shape (n, 1).

    The couplers only translate; the cylinder of the manipulator follows a point 0.75 m behind the arm's axis.
    """
    if len(linkage.bodies) == 3:
        return tuple(np.hstack([x, -x, x]) for x in (s, ds, dds))
    r, h, sin, cos = 0.75, 2.0, np.sin(s), np.cos(s)
    x, y = (
        (-r * cos, r * sin * ds, r * (cos * ds**2 + sin * dds)),
        (-r * sin, -r * cos * ds, r * (sin * ds**2 - cos * dds)),
    )
    return (np.hstack([s, -s, s, x[0], h + y[0]]), *(np.hstack([a, -a, a, x[k], y[k]]) for k, a in ((1, ds), (2, dds))))


def _uprights(count: int) -> tuple[int, ...]:
    return tuple(range(0, 2 * count + 1, 2))


def unpowered(linkage: Linkage) -> Linkage:
    """Return a linkage whose motors are asked for: they have no torques of their own."""
    return replace(linkage, bodies=tuple(replace(body, torque=0.0) for body in linkage.bodies))


@cache
def problems() -> dict[str, Problem]:
    """Return all problems by name."""
    panda = mechanisms.panda()
    found: list[Problem] = [
        Motion("double_pendulum", "Double pendulum, 10 s", mechanisms.double_pendulum(), 10.0),
        Motion("panda", "Panda, 2 s", panda, 2.0),
        Motion("four_bar_1", "Four-bar, 10 s", mechanisms.four_bars(1), 10.0, False, _uprights(1)),
        Motion("four_bar_2", "Two four-bars, 10 s", mechanisms.four_bars(2), 10.0, False, _uprights(2)),
        Motion("four_bar_40", "Forty four-bars, 10 s", mechanisms.four_bars(40), 10.0, False, _uprights(40)),
        Motion("four_bar_100", "A hundred four-bars, 10 s", mechanisms.four_bars(100), 10.0, False, _uprights(100)),
        Motion("scissor_50", "Scissor of 50 stages, 1 s", mechanisms.scissor(50), 1.0),
        Motion("chain_1000", "Chain of 1,000 links, 0.5 s", mechanisms.chain(1000), 0.5),
        Motion("andrews", "Andrews' mechanism, 0.03 s", mechanisms.andrews(), 0.03),
        Motion("bricard", "Bricard's linkage, 10 s", mechanisms.bricard(), 10.0, regular=False),
        Motion("beam", "Stiff beam, 2 s", mechanisms.beam(), 2.0),
        Motion("satellite", "Satellite with two arms, 3 s", mechanisms.satellite(), 3.0),
        Batch("panda_256", f"Panda, {STARTS} starts, 2 s", panda, 2.0),
        Inverse("inverse_two_rods", "Inverse dynamics, two rods", mechanisms.double_pendulum()),
        Inverse("inverse_panda", "Inverse dynamics, Panda", unpowered(panda)),
        Inverse("inverse_four_bar", "Inverse dynamics, four-bar", mechanisms.four_bars(1), 0),
        Inverse("inverse_manipulator", "Inverse dynamics, manipulator", mechanisms.manipulator(), 0),
    ]
    return {problem.name: problem for problem in found}
