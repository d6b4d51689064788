"""Cases that are integrated from initial states of their own, as free trees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.checks.balance import energy_of
from pinarm.engine.motion.integrated_motion import IntegratedMotion
from pinarm.engine.motion.integrated_variants import IntegratedVariants
from pinarm.engine.motion.small_motions import integrate_to_size
from pinarm.engine.motion.systems.free import FreeSystem
from pinarm.input.yaml.values import varied
from pinarm.mechanics.geometry.model_variants import VariantsDiffer
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.problems.forward import Forward
from pinarm.records import replace
from pinarm.use.cases.case import Case
from pinarm.use.cases.columns import INITIAL

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.engine.motion.segmented.hybrid_motion import HybridSystem
    from pinarm.mechanics.forces.force_element import ForceElement
    from pinarm.use.result.result import Result
    from pinarm.use.scenario.scenario import Scenario


class ForwardCase(NamedTuple):
    """A case that has been integrated.

    Attributes:
        motion: Its motion.
        grid: Its rows.
    """

    motion: IntegratedMotion
    grid: Grid


@dataclass(frozen=True, eq=False)
class ForwardCases:
    """Cases that move freely from initial states, without loops, laws, end stops, friction, events and controllers.

    Attributes:
        result: The first case.
        motion: Its motion.
    """

    result: Result
    motion: IntegratedMotion

    @classmethod
    def of(cls, result: Result) -> ForwardCases | None:
        """Return the cases of a first one; ``None`` where its motion is another."""
        motion, whole = result.outcome.motion, result.scenario.mechanism
        if not isinstance(motion, IntegratedMotion) or motion.mechanism is not whole or not _is_free(motion.hybrid):
            return None
        return cls(result, motion)

    @property
    def forces(self) -> Mapping[str, ForceElement]:
        """The force elements of all cases."""
        return self.motion.hybrid.dynamics.forces

    @property
    def length(self) -> int:
        """Number of rows, or of steps where these are more."""
        return max(len(self.result.trajectory), int(self.motion.motion.cost()["steps"]))

    @cached_property
    def first(self) -> ForwardCase:
        """The first case."""
        return ForwardCase(self.motion, self.result.trajectory.grid)

    def read(self, values: Case, mechanism: Mechanism, place: int) -> ForwardCase | None:
        """Return the motion of a case; ``None`` where it is of another kind or has other rows.

        Raises:
            PinarmError: The case has a mistake, or its motion cannot be followed to its end.
        """
        scenario = self.result.scenario
        own = scenario.with_document(varied(scenario.document, values)) if values else scenario
        hybrid, grid = self._prepared(own, values, mechanism, place), self.first.grid
        if hybrid is None:
            return None
        motion = integrate_to_size(hybrid, *hybrid.start)
        if hybrid.time != self.motion.hybrid.time:
            grid = hybrid.grid(_forward(own).time.instants())
        if len(grid.t) != len(self.first.grid.t) or len(motion.segments) > 1 or motion.end < hybrid.time[1]:
            return None
        return ForwardCase(IntegratedMotion(self.motion.mechanism, hybrid, motion), grid)

    def _prepared(self, scenario: Scenario, values: Case, mechanism: Mechanism, place: int) -> HybridSystem | None:
        """Return what is integrated, ``None`` where it is another motion; mostly only the start is a new one."""
        whole, variants, problem = self.motion.mechanism, mechanism.model, _forward(scenario)
        same = not variants.bodies and not variants.moved
        if same and all(path.startswith(INITIAL) for path in values):
            return replace(self.motion.hybrid, initial=problem.initial_state(whole, scenario.place))
        moved = whole if same else replace(whole, model=variants.tree(place))
        hybrid = problem.prepare(moved, scenario.content.accuracy, scenario.place)
        return hybrid if _is_free(hybrid) else None

    def variants(self, mechanism: Mechanism, motions: Sequence[ForwardCase]) -> IntegratedVariants:
        """Return the motions of variants."""
        rows, grids = self.result.trajectory, [each.grid for each in motions]
        return IntegratedVariants(rows, mechanism, [each.motion for each in motions], grids)

    def figures(self, motions: Sequence[ForwardCase]) -> dict[str, Array]:
        """Return the energy that nothing accounts for, and what rounding does to small motions.

        Raises:
            VariantsDiffer: Not all motions have the same of these.
        """
        found = [{**energy_of(each.motion.motion), **each.motion.motion.rounding} for each in motions]
        if any(one.keys() != found[0].keys() for one in found):
            raise VariantsDiffer("which figures can be measured")
        return {name: np.array([each[name] for each in found]) for name in found[0]}


def _forward(scenario: Scenario) -> Forward:
    problem = scenario.problem
    assert isinstance(problem, Forward)
    return problem


def _is_free(hybrid: HybridSystem) -> bool:
    """Whether one smooth motion of a tree is integrated, and nothing else is looked for."""
    if hybrid.bounds or hybrid.watches or hybrid.frictions or hybrid.controls or len(hybrid.cuts) > 2:
        return False
    return isinstance(hybrid.closed_system, FreeSystem) and not hybrid.closure.size
