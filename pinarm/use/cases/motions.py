"""Motions of cases that are solved together: prescribed by laws, or free from initial states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, cast

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.checks.balance import variant_energies
from pinarm.engine.kinematics.joint_motion import DeterminedMotion
from pinarm.engine.motion.integrated_motion import IntegratedMotion
from pinarm.engine.motion.prescribed_motion import PrescribedMotion, PrescribedTable
from pinarm.engine.motion.systems.tree_system import TreeSystem
from pinarm.engine.motion.variants import FreeMotion, IntegratedVariants, PrescribedVariants, compiled, follows_alike
from pinarm.input.yaml.document import varied
from pinarm.mechanics.geometry.model_variants import VariantsDiffer
from pinarm.problems.forward import Forward
from pinarm.use.cases.case import Case, Value
from pinarm.use.cases.case_table import INITIAL, number_of

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.engine.motion.segmented.hybrid_system import HybridSystem
    from pinarm.mechanics.forces.force_element import ForceElement
    from pinarm.use.result.result import Result


@dataclass(frozen=True, eq=False)
class PrescribedCases:
    """Cases whose laws and rows are those of the first, or each their own.

    Attributes:
        result: The first case.
        motion: Its motion.
    """

    result: Result
    motion: PrescribedMotion

    @classmethod
    def of(cls, result: Result) -> PrescribedCases | None:
        """Return the cases of a first one; ``None`` where more is told of it, or less is solved, than its states."""
        motion = result.outcome.motion
        if not isinstance(motion, PrescribedMotion) or result.outcome.figures:
            return None
        whole = motion.prescription.mechanism is result.scenario.mechanism
        return cls(result, motion) if whole and isinstance(motion.prescription.motion, DeterminedMotion) else None

    @property
    def forces(self) -> Mapping[str, ForceElement]:
        """The force elements of all cases."""
        return self.motion.prescription.dynamics.forces

    @property
    def length(self) -> int:
        """Number of rows."""
        return len(self.result.trajectory)

    @cached_property
    def first(self) -> PrescribedTable:
        """What the first case follows."""
        return PrescribedTable(self.motion.prescription, self.result.trajectory.grid, self.motion.start)

    def read(self, values: Case, mechanism: Mechanism, place: int) -> PrescribedTable | None:
        """Return what a case follows, ``None`` where its rows are others; the same object where it is the first's."""
        if not values:
            return self.first
        scenario = self.result.scenario
        table = scenario.with_document(varied(scenario.document, values)).prescribed_table(scenario)
        return table if table is not None and follows_alike(table, self.first) else None

    def variants(self, mechanism: Mechanism, motions: Sequence[PrescribedTable]) -> PrescribedVariants:
        """Return the motions of variants."""
        return PrescribedVariants(self.motion, self.result.trajectory, mechanism, motions)

    def figures(self, variants: PrescribedVariants) -> dict[str, Array]:
        """Return nothing: what is measured are the states."""
        return {}


@dataclass(frozen=True, eq=False)
class ForwardCases:
    """Cases that move freely from initial states, without loops, laws, end stops, friction, events and controllers.

    Attributes:
        result: The first case.
        motion: Its motion.
        values: Its values.
    """

    result: Result
    motion: IntegratedMotion
    values: Case

    @classmethod
    def of(cls, result: Result, values: Case) -> ForwardCases | None:
        """Return the cases of a first one; ``None`` where its motion is another, or takes no compiled steps."""
        motion, whole = result.outcome.motion, result.scenario.mechanism
        if not isinstance(motion, IntegratedMotion) or motion.mechanism is not whole or motion.pace is not None:
            return None
        if not _is_free(motion.hybrid) or compiled(motion.hybrid) is None:
            return None
        return cls(result, motion, values)

    @property
    def forces(self) -> Mapping[str, ForceElement]:
        """The force elements of all cases."""
        return self.motion.hybrid.dynamics.on(*self.motion.hybrid.time).forces

    @property
    def length(self) -> int:
        """Number of rows, or of steps where these are more."""
        return max(len(self.result.trajectory), int(self.motion.motion.cost()["steps"]))

    @cached_property
    def first(self) -> FreeMotion:
        """The first case."""
        hybrid = self.motion.hybrid
        return FreeMotion(*hybrid.start, hybrid.time, self.result.trajectory.grid)

    def read(self, values: Case, mechanism: Mechanism, place: int) -> FreeMotion | None:
        """Return the motion of a case; ``None`` where it is of another kind or has other rows.

        Raises:
            PinarmError: The case has a mistake.
        """
        if not values:
            return self.first
        if values.keys() <= self._joints.keys():
            return self._from(values)
        scenario = self.result.scenario
        own = scenario.with_document(varied(scenario.document, values))
        problem = cast("Forward", own.problem)
        hybrid = problem.prepare(self.motion.mechanism, own.content.accuracy, own.place)
        if not _is_free(hybrid):
            return None
        grid = hybrid.grid(problem.time.instants())
        return FreeMotion(*hybrid.start, hybrid.time, grid) if len(grid.t) == len(self.first.grid.t) else None

    def _from(self, values: Case) -> FreeMotion | None:
        """Return the motion of a case that differs in coordinates and velocities of joints at the start only."""
        state = np.concatenate(self.first[:2])
        for path, value in values.items():
            try:
                state[self._joints[path]] = number_of(value, self.values[path])
            except VariantsDiffer:
                return None
        q, v = np.split(state, [self.motion.mechanism.model.nq])
        return self.first._replace(q=q, v=v)

    @cached_property
    def _joints(self) -> dict[str, int]:
        """Paths of the first case to coordinates and velocities of joints, and the places of these in the state."""
        joints, nq = self.motion.mechanism.joints, self.motion.mechanism.model.nq
        places = {f"{INITIAL}position.{name}": joint.q for name, joint in joints.items()}
        places |= {f"{INITIAL}velocity.{name}": nq + joint.v for name, joint in joints.items()}
        state = np.concatenate(self.first[:2])
        given = {path: place for path, place in places.items() if path in self.values}
        return {path: place for path, place in given.items() if _number(self.values[path]) == state[place]}

    def variants(self, mechanism: Mechanism, motions: Sequence[FreeMotion]) -> IntegratedVariants:
        """Return the motions of variants."""
        return IntegratedVariants.integrated(self.result.trajectory, self.motion, mechanism, motions)

    def figures(self, variants: IntegratedVariants) -> dict[str, Array]:
        """Return the energy that nothing accounts for."""
        return {"energy": variant_energies(variants.dynamics, variants.ensemble, variants.interpolated)}


def _number(value: Value) -> float | None:
    """Return a value [SI]; ``None`` where it is no plain number."""
    try:
        return number_of(value, value)
    except VariantsDiffer:
        return None


def _is_free(hybrid: HybridSystem) -> bool:
    """Whether one smooth motion of a tree is integrated, and nothing else is looked for."""
    if hybrid.bounds or hybrid.watches or hybrid.frictions or hybrid.controls or len(hybrid.cuts) > 2 or hybrid.knots:
        return False
    given = hybrid.initial.rates or hybrid.initial.followers  # these depend on lengths
    return isinstance(hybrid.closed_system, TreeSystem) and hybrid.closed_system.reduction is None and not given
