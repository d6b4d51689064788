"""The figures of a run: which of them tell its accuracy, and which its cost."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cached_property

import numpy as np

from pinarm.engine.checks.balance import LOST
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.input.units import Unit

RESIDUALS = {
    "equilibrium": "virtual power for every unit velocity, relative to its terms",
    "power": "balance of power along the motion, relative to its terms",
    "energy": "energy that nothing accounts for, relative to the energy exchanged",
    "return trip": "accelerations from the efforts by forward dynamics, relative to the largest",
    "friction": "law of friction with the reactions of the rows, relative to the largest friction",
    "bodies": "Newton's and Euler's equations of every body with the reactions, relative to their terms",
}
CLOSURES = {
    "closure": "largest gap of a loop [m or rad]",
    "closure rate": "largest velocity against a loop [m/s or rad/s]",
    "closure acceleration": "largest acceleration against a loop [m/s^2 or rad/s^2]",
}
PATHS = {
    "path": "largest distance of a prescribed coordinate from its law, where a posture chooses the motion [m or rad]",
    "path rate": "largest difference of its velocity [m/s or rad/s]",
    "path acceleration": "largest difference of its acceleration [m/s^2 or rad/s^2]",
}
CONSISTENCIES = {
    "velocity consistency": "difference of given velocities from the rate of the positions, relative to the largest",
    "acceleration consistency": "difference of given accelerations from the rate of the velocities, likewise",
    "spline velocity": "change of the spline's velocities, relative to the largest, without every second row",
    "spline acceleration": "change of its accelerations, likewise",
}
"""Figures of a motion that was given row by row."""

MEASURES = {
    **RESIDUALS,
    **CLOSURES,
    **PATHS,
    **CONSISTENCIES,
    "regularity": "smallest singular value of the loops' rows relative to the largest: 0 at a singular position",
    "least regular at": "where along the run that is",
    "relative regularity": "that singular value relative to its largest in the run: 1 where it does not fall",
    "rounding": "what errors of steps add up to where rounding keeps them from being smaller, relative to the motion",
    "rolled": "what errors of steps add up to in positions that follow from rolling [rad or m]",
    "small motion": "difference of a small motion of the integrator from exp(A t), extrapolated to the amplitude 0",
    "linear up to": "amplitude at which that difference is 1 % of the motion [rad or m]",
    "condition": "condition number of the mass matrix of the free motions, scaled to a diagonal of ones",
}
"""Figures that tell the accuracy of a run, and what they mean."""


class Figures(Mapping[str, float]):
    """The figures of a run, of which measures of accuracy are computed when they are first asked for.

    Args:
        known: Figures that the solution brings along, such as the steps of its integrator.
        measure: Computes the measures of accuracy.
    """

    def __init__(self, known: Mapping[str, float], measure: Callable[[], Mapping[str, float]]) -> None:
        self._known, self._measure = known, measure

    @cached_property
    def _all(self) -> Mapping[str, float]:
        return {**self._known, **self._measure()}

    def __getitem__(self, name: str) -> float:
        return self._known[name] if name in COSTS else self._all[name]

    def __contains__(self, name: object) -> bool:
        return name in self._known or (name not in COSTS and name in self._all)

    def __iter__(self) -> Iterator[str]:
        return iter(self._all)

    def __len__(self) -> int:
        return len(self._all)

    def __repr__(self) -> str:
        return repr(dict(self))


def unexplained(figures: Mapping[str, float]) -> dict[str, float]:
    """Return the residuals that rounding does not explain, by name: the motion errs by about as much."""
    return {name: figures[name] for name in RESIDUALS if figures.get(name, 0.0) >= LOST}


def unexplained_notes(figures: Mapping[str, float]) -> list[str]:
    """Return a note for each residual that rounding does not explain."""
    return [
        f"{name}: a residual of {size:.2g} is more than rounding: the motion errs by about as much, or more"
        for name, size in unexplained(figures).items()
    ]


FALLEN, NEARLY_SINGULAR = 0.5, 1e-4
"""Relative regularity from which on a run is said to come near a singular position, and regularity at which it is there
all along: small ratios of gears, screws and arms alone give 1e-3."""


def singularity_words(figures: Mapping[str, float]) -> str:
    """Return the nearness of loops to a singular position, from the figures of a run; empty far from one.

    The smallest singular value of the loops' rows is as small as the ratios of a mechanism. Only its fall shows a
    singular position, or where it does not vary, a value close to 0.
    """
    regularity, relative = figures.get("regularity", 1.0), figures.get("relative regularity", 1.0)
    if relative < FALLEN:
        return f"falls to {relative:.2g} of its largest in the run"
    return f"{regularity:.2g} all along" if regularity < NEARLY_SINGULAR else ""


NOT_ESTIMATED = "not estimated"
"""Text for the global error of an integrated motion where no estimate was requested: residuals do not bound it."""

COSTS = ("steps", "evaluations", "rejected steps", "steps at the noise floor")
"""Figures that count work; what is neither is part of the answer."""

SOLVED = 1e-13
"""Relative error of quantities that follow from equations solved to rounding, as in statics and inverse dynamics."""

ZERO = 1e-14
"""Size of an output, relative to what the masses, lengths and times of the run make of its unit, that rounding
explains; outputs that are 0 are up to 4e-15 in the scenarios that come with pinarm."""


def natural_sizes(run: Trajectory) -> Callable[[Unit | None], float]:
    """Return the natural size of a unit as a function, from mass, length and time: of N, ``mass * length / time²``.

    The mass is that of all bodies, the length that of all links from end to end, or the longest way of a sliding joint
    where that is longer, and the time the shortest in which gravity, or the motion, changes anything by its own size.
    """
    model = run.mechanism.model
    mass = sum(inertia.mass for inertia in model.inertias) or 1.0
    levers = [np.linalg.norm(inertia.lever) for inertia in model.inertias]
    ways = [np.abs(run.q[:, joint.q]).max() for joint in run.mechanism.joints.values() if joint.unit.dimension[0]]
    links = float(sum(levers) + sum(np.linalg.norm(place.translation) for place in model.jointPlacements))
    length = max(links, *map(float, ways), 0.0) or 1.0
    reach = np.array([length if joint.unit.dimension[0] else 1.0 for joint in run.mechanism.joints.values()])
    index = [joint.v for joint in run.mechanism.joints.values()]
    rate = float((np.abs(run.v[:, index]) / reach).max(initial=0.0))
    change = float((np.abs(run.a[:, index]) / reach).max(initial=0.0))
    frequency = max(rate, change**0.5, (run.mechanism.gravity / length) ** 0.5) or 1.0

    def size(unit: Unit | None) -> float:
        if unit is None:
            return 1.0
        metres, kilograms, seconds, _ = (float(exponent) for exponent in unit.dimension)
        return float(length**metres * mass**kilograms * frequency**-seconds)

    return size
