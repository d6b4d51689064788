"""One scenario from many initial states: what can be integrated together is, and every motion has its own result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.integrators import Ensemble
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.quantities import Quantities
from pinarm.engine.states import columns_of
from pinarm.engine.systems import Initial
from pinarm.engine.trajectory import Trajectory
from pinarm.engine.travel import Journey
from pinarm.errors import InputError, NumericsError, PinarmError, choices
from pinarm.problems.forward import Forward
from pinarm.use.result import Result
from pinarm.use.scenario import Scenario, load


@dataclass(frozen=True, eq=False)
class Batch:
    """Motions of one scenario from b initial states, at its n instants.

    Attributes:
        scenario: The scenario.
        problem: The question about what is solved.
        journey: What is integrated.
        q: Configurations at the start, shape (b, nq).
        v: Velocities there, shape (b, nv).
        ensemble: The motions, their first legs where there are end stops; ``None`` where each has to be taken alone.
    """

    scenario: Scenario
    problem: Forward = field(repr=False)
    journey: Journey = field(repr=False)
    q: Array = field(repr=False)
    v: Array = field(repr=False)
    ensemble: Ensemble | None = field(repr=False)
    _followed: dict[int, Trajectory | PinarmError] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        return len(self.q)

    @cached_property
    def t(self) -> Array:
        """Return the instants [s], shape (n,)."""
        return self.problem.time.instants()

    def run(self, number: int) -> Result:
        """Return the result of one motion, with its accuracy, as the scenario itself would have it.

        Raises:
            NumericsError: It could not be followed to its end; ``partial`` holds it until then.
        """
        solved = self._solved(number)
        if isinstance(solved, PinarmError):
            raise solved
        with np.errstate(all="ignore"):
            return self.scenario.measured(solved, self.scenario.scene.restored(solved))

    @cached_property
    def failures(self) -> dict[int, str]:
        """Return why motions could not be followed to their end, by their number."""
        if self.ensemble is not None and not self.journey.bounds:
            return self.ensemble.failures
        solved = ((number, self._solved(number)) for number in range(len(self)))
        return {number: one.message for number, one in solved if isinstance(one, PinarmError)}

    def __getitem__(self, name: str) -> Array:
        """Return a quantity of all motions, shape (b, n), not a number beyond the end of a motion.

        Raises:
            InputError: There is no quantity of that name.
        """
        return np.array([self._values(number, name) for number in range(len(self))])

    def _values(self, number: int, name: str) -> Array:
        found = np.full(len(self.t), np.nan)
        run, rows, there = self._rows(number)
        if run is not None:
            whole, content = self.scenario.scene.restored(run), self.scenario.content
            found[there] = Quantities(whole, self.scenario.symbols, content.undetermined)[name].values[rows]
        return found

    def _solved(self, number: int) -> Trajectory | PinarmError:
        """Return one motion of what is solved, or why there is none."""
        if number not in self._followed:
            ahead = None if self.ensemble is None else partial(self.ensemble.solution, number)
            try:
                solved = self.problem.followed(
                    self.scenario.scene.solved, self.journey, self.q[number], self.v[number], ahead
                )
            except NumericsError as error:
                self._followed[number] = error
            else:
                self._followed[number] = solved
        return self._followed[number]

    def states(self) -> tuple[Array, Array]:
        """Return q, shape (b, n, nq), and v, shape (b, n, nv), of the whole mechanism; not a number beyond an end."""
        scene, b, n = self.scenario.scene, len(self), len(self.t)
        if self.ensemble is not None and not self.journey.bounds:
            return scene.spread(self.t, *self.ensemble.states(self.t))
        q, v = np.full((b, n, self.q.shape[1]), np.nan), np.full((b, n, self.v.shape[1]), np.nan)
        for number in range(b):
            run, rows, there = self._rows(number)
            if run is not None:
                q[number, there], v[number, there] = run.q[rows], run.v[rows]
        return scene.spread(self.t, q, v)

    def _rows(self, number: int) -> tuple[Trajectory | None, Indices, Flags]:
        """Return as much of a motion as there is, its rows at the instants that it reached, and which these are."""
        found = self._solved(number)
        run = getattr(found, "partial", None) if isinstance(found, PinarmError) else found
        if not isinstance(run, Trajectory):
            return None, np.zeros(0, dtype=np.intp), np.zeros(len(self.t), dtype=bool)
        rows = np.maximum(np.searchsorted(run.grid.t, self.t, side="right") - 1, 0)
        there = run.grid.t[rows] == self.t
        return run, rows[there], there


def batch(
    scenario: Scenario | str | Path, position: Mapping[str, ArrayLike] | None = None,
    velocity: Mapping[str, ArrayLike] | None = None, *, overrides: list[str] | None = None,
) -> Batch:  # fmt: skip
    """Solve a scenario of kind ``forward`` from many initial states.

    Args:
        scenario: The scenario, or its file.
        position: Joint -> its initial coordinates [rad or m], shape (b,) or one for all; other joints begin as in the
            scenario.
        velocity: Joint -> its initial velocities [rad/s or m/s], likewise.
        overrides: Assignments such as ``problem.time.end=3 s`` that replace values of the scenario.

    Raises:
        InputError: The scenario is of another kind or looks for something, a joint has not one coordinate or follows a
            law, or the numbers of values differ.
        DynamicsError: Masses do not determine the accelerations.
    """
    one = load(scenario, overrides)
    scene, problem = one.scene, one.scene.problem
    if not isinstance(problem, Forward):
        raise InputError(f"the scenario '{one.name}' is of kind {problem.kind}", expected="kind: forward")
    if one.content.find or one.content.accuracy.target is not None:
        raise InputError(f"the scenario '{one.name}' looks for numbers, or for the setting that reaches an error",
                         expected="neither find nor accuracy.target", hint="accuracy.tolerance")  # fmt: skip
    journey = problem.prepare(scene.solved, partial(one.document.locating, "problem"), one.content.accuracy)
    starts = _starts(scene.solved, journey, position or {}, velocity or {})
    states = [replace(journey, initial=start).begin() for start in starts]
    q, v = np.array([state[0] for state in states]), np.array([state[1] for state in states])
    for row in q:
        problem.require_masses(scene.solved, journey, row)
    touching = any(journey.contacts.near(row) for row in q) if journey.bounds else False
    with np.errstate(all="ignore"):  # what is not finite is found in the results, and said in words
        return Batch(one, problem, journey, q, v, None if touching else journey.abreast(q, v))


def _starts(
    mechanism: Mechanism, journey: Journey, position: Mapping[str, ArrayLike], velocity: Mapping[str, ArrayLike]
) -> list[Initial]:
    """Return the initial states, not yet assembled."""
    for name in (*position, *velocity):
        if name not in mechanism.joints or name in journey.imposed.names:
            free = [joint for joint in mechanism.joints if joint not in journey.imposed.names]
            expected, hint = choices(name, free)
            raise InputError(
                f"no free joint '{name}' with one coordinate can begin elsewhere", expected=expected, hint=hint
            )
    given = {("position", name): x for name, x in position.items()}
    given |= {("velocity", name): x for name, x in velocity.items()}
    shape, columns = columns_of({" ".join(key): x for key, x in given.items()})
    if len(shape) > 1:
        raise InputError(f"the arrays have {len(shape)} axes", expected="one: a value for every motion")
    if shape == (0,):
        raise InputError("there are no initial values", expected="one motion or more")
    base, joints = journey.initial, mechanism.joints
    q, v = (np.tile(row, (*(shape or (1,)), 1)) for row in (base.q, base.v))
    for (what, name), column in zip(given, columns.values(), strict=True):
        if what == "position":
            q[:, joints[name].q] = column
        else:
            v[:, joints[name].v] = column
    positions = tuple(dict.fromkeys((*base.positions, *(joints[name].v for name in position))))
    velocities = tuple(dict.fromkeys((*base.velocities, *(joints[name].v for name in velocity))))
    return [Initial(*row, positions, velocities) for row in zip(q, v, strict=True)]
