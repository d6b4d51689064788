"""Cases whose motion laws determine: what each of them follows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from pinarm.arrays import Array
from pinarm.engine.kinematics.joint_motion import DeterminedMotion
from pinarm.engine.motion.prescribed_motion import PrescribedMotion, PrescribedTable
from pinarm.engine.motion.prescribed_variants import PrescribedVariants, follows_alike
from pinarm.input.yaml.values import varied
from pinarm.use.cases.case import Case

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
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
