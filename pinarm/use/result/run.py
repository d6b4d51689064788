"""Run: what numbers are asked of, the record below results."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING

from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.series import Series
from pinarm.records import AbstractRecord
from pinarm.use.result.row_lookup import Lookup

if TYPE_CHECKING:
    from pinarm.engine.labelled_array import LabelledArray
    from pinarm.engine.motion.outcome import Outcome
    from pinarm.use.result.section import Numbered, Section


class Run(AbstractRecord, frozen=True):
    """The rows of a run, the motion between them, and sections of what is concluded from it.

    Attributes:
        name: Name of the scenario.
        outcome: What came out of the problem, for the whole mechanism.
        quantities: Everything that can be asked of the run, by name.
    """

    name: str
    outcome: Outcome
    quantities: Quantities

    @property
    def trajectory(self) -> Trajectory:
        return self.outcome.rows

    @property
    def arrays(self) -> Mapping[str, LabelledArray]:
        """Results that are no columns over the rows, such as mode shapes, by name."""
        return self.outcome.arrays

    def __getitem__(self, name: str) -> Series:
        """Return a quantity by name, symbol or formula, as an array with its unit."""
        return self.quantities[name]

    def __len__(self) -> int:
        return len(self.trajectory)

    @cached_property
    def lookup(self) -> Lookup:
        return Lookup(self.quantities, self.outcome.motion)

    @property
    @abstractmethod
    def numbered(self) -> Mapping[str, Numbered]:
        """Search and assessments of the run, by the key of their section."""

    @abstractmethod
    def section(self, key: str) -> Section:
        """Return one section, evaluated when it is first asked for.

        Raises:
            InputError: There is none of that key, or the run does not have what it needs.
        """
