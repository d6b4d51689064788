"""Layer 3: the kinds of problem. Each is imported when a scenario first asks for it: start-up is part of speed."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, Protocol

from pinarm.errors import InputError, Place, choices

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.engine.motion.outcome import Outcome
    from pinarm.engine.motion.prescribed_motion import PrescribedTable
    from pinarm.engine.motion.trajectory import Trajectory
    from pinarm.problems.accuracy import Accuracy
    from pinarm.problems.declaration import Declaration

KINDS = {
    "statics": ("states", "Statics"),
    "state": ("states", "State"),
    "inverse": ("inverse", "Inverse"),
    "forward": ("forward", "Forward"),
    "kinematics": ("kinematics", "KinematicMotion"),
    "equilibria": ("equilibria", "Equilibria"),
    "recorded": ("recording.recorded", "Recorded"),
}
"""Kind, and its module and class. A new kind is one class and one entry."""


PRESCRIBING = ("statics", "state", "inverse", "kinematics")
"""Kinds in which laws determine the motion: those of ``PrescribingProblem``."""


class Problem(Protocol):
    """A question about a mechanism, as it stands in a file."""

    @property
    def kind(self) -> str:
        """Name of the kind."""
        ...

    def schema_row(self, mechanism: Mechanism) -> Trajectory:
        """Return one row near the start: enough to see which quantities there are, and which are determined."""
        ...

    def declaration(self) -> Declaration | None:
        """Return what the problem says about coordinates; ``None`` where the mechanism is not to be simplified."""
        ...

    def prepare(self, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> Any:
        """Check all names and units against the mechanism; return what ``solve`` begins with, the same in every run.

        Args:
            mechanism: What moves.
            accuracy: How it is solved.
            place: Gives mistakes their place.
        """
        ...

    def solve(self, mechanism: Mechanism, accuracy: Accuracy, place: Place, prepared: Any = None) -> Outcome:
        """Return the answer; ``prepared`` is what ``prepare`` has returned for the same arguments, if it was called."""
        ...


class PrescribingProblem(Problem, Protocol):
    """A question about a mechanism whose motion laws determine."""

    def table(self, mechanism: Mechanism, accuracy: Accuracy, place: Place, prepared: Any = None) -> PrescribedTable:
        """Return what is prescribed at which rows, with nothing solved; see ``solve``."""
        ...


if TYPE_CHECKING:  # mypy compares the kinds with the protocol, which are imported by name
    from pinarm.problems.equilibria import Equilibria
    from pinarm.problems.forward import Forward
    from pinarm.problems.inverse import Inverse
    from pinarm.problems.kinematics import KinematicMotion
    from pinarm.problems.recording.recorded import Recorded
    from pinarm.problems.states import State, Statics

    _PROBLEMS: tuple[type[Problem], ...] = (Statics, State, Inverse, Forward, KinematicMotion, Equilibria, Recorded)
    _PRESCRIBING: tuple[type[PrescribingProblem], ...] = (Statics, State, Inverse, KinematicMotion)


def problem_class(kind: object) -> type[Any]:
    """Return the class of a kind of problem.

    Raises:
        InputError: There is no such kind.
    """
    if not isinstance(kind, str) or kind not in KINDS:
        expected, hint = choices(str(kind), KINDS)
        raise InputError(f"unknown kind '{kind}'", expected=expected, hint=hint)
    module, name = KINDS[kind]
    found: type[Any] = getattr(import_module(f"pinarm.problems.{module}"), name)
    return found
