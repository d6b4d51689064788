"""What quantities are computed from: a trajectory, its kinematics row by row, and the reactions of its joints."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING

from pinarm.engine.motion.trajectory import Trajectory
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.kinematics.mobility import Mobility
    from pinarm.engine.quantities.reactions import Reactions
    from pinarm.engine.quantities.row_kinematics import RowKinematics


class Evaluation(Record, frozen=True):
    """A trajectory, and what is computed of it once, when a quantity first needs it.

    Attributes:
        run: The trajectory.
        undetermined: ``refuse`` components of reactions that rigid bodies do not determine, or give those of the least
            multipliers.
        judged: Whether it is judged which components are determined. Some states of a run are not: in a single state a
            component may seem to be.
    """

    run: Trajectory
    undetermined: str = "refuse"
    judged: bool = True

    @cached_property
    def reactions(self) -> Reactions:
        """What the joints transmit."""
        from pinarm.engine.quantities.reactions import SAMPLE, Reactions

        return Reactions(self.run, SAMPLE if self.judged else 0)

    @cached_property
    def mobility(self) -> Mobility:
        """How the mechanism can move where the run begins, and how it is tied."""
        from pinarm.engine.kinematics.mobility import mobility_of

        return mobility_of(self.run.mechanism, self.run.q[0])

    @property
    def doubtful(self) -> bool:
        """Whether rigid bodies may leave something undetermined: loads of constraints, or of frictions."""
        return bool(self.run.closure.constraints or self.run.mechanism.frictions)

    @cached_property
    def friction_doubts(self) -> Mapping[str, str]:
        """What is in doubt about frictions whose loads rest on a rule, by quantity; see ``friction_law``."""
        if not any(contact.shared for contact in self.run.mechanism.frictions):
            return {}
        from pinarm.engine.quantities.friction_law import friction_doubts

        return friction_doubts(self.run)

    @cached_property
    def kinematics(self) -> RowKinematics:
        """Coordinates, frames, energies and momenta, row by row."""
        from pinarm.engine.quantities.row_kinematics import RowKinematics

        return RowKinematics(self.run)
