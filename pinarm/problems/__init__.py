"""Layer 3: the kinds of problem. Each is imported when a scenario first asks for it: start-up is part of speed."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from pinarm.errors import InputError, Place, choices

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.engine.motion.outcome import Outcome
    from pinarm.engine.motion.trajectory import Trajectory
    from pinarm.problems.accuracy import Accuracy


class ProblemKind(NamedTuple):
    """A kind of problem.

    Attributes:
        module: Module of its class, below ``pinarm.problems``.
        examples: Scenarios of it that ``pinarm.selftest`` solves in a few seconds, with answers from elsewhere.
        prescribing: Whether laws determine the motion: ``prepare`` then returns a ``PrescribedTable``.
    """

    module: str
    name: str
    question: str
    examples: tuple[str, ...]
    prescribing: bool = False


KINDS: Mapping[str, ProblemKind] = {
    "statics": ProblemKind(
        "inverse", "Statics", "Which efforts of the drives hold the mechanism still?", ("gen411_arm_static",),
        prescribing=True,
    ),
    "state": ProblemKind(
        "inverse", "State", "Which efforts of the drives belong to the given positions, velocities and accelerations?",
        ("exoskeleton_leg_state",), prescribing=True,
    ),
    "inverse": ProblemKind(
        "inverse", "Inverse", "Which efforts must the drives give, so that the mechanism moves as the given laws say?",
        ("gen411_arm_dynamic_true",), prescribing=True,
    ),
    "forward": ProblemKind(
        "forward", "Forward", "How does the mechanism move from its initial state under the loads that act on it?",
        ("brick_thrown", "crank_rocker_free"),
    ),
    "kinematics": ProblemKind(
        "inverse", "KinematicMotion",
        "How do all parts of the mechanism move when the given coordinates follow their laws?",
        ("magic_arms_kinematics",), prescribing=True,
    ),
    "equilibria": ProblemKind(
        "equilibria", "Equilibria",
        "In which positions does the mechanism rest without any drive, and are these positions stable?",
        ("gen411_arm_equilibria",),
    ),
    "linear": ProblemKind(
        "linear", "Linear",
        "Which natural frequencies, damping and mode shapes do small motions about a state have?",
        ("gen411_arm_modes",),
    ),
    "recorded": ProblemKind(
        "recorded", "Recorded",
        "Which velocities, forces and energies belong to a motion that was recorded?", ("gen411_arm_recorded",),
    ),
}  # fmt: skip
"""Name of a kind -> the kind. A new kind is one class and one entry."""


class Problem(Protocol):
    """A question about a mechanism, as it stands in a file."""

    @property
    def kind(self) -> str:
        """Name of the kind."""
        ...

    def schema_row(self, mechanism: Mechanism) -> Trajectory:
        """Return one row near the start: enough to see which quantities there are, and which are determined."""
        ...

    def prepare(self, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> Any:
        """Check all names and units against the mechanism; return what ``solve`` begins with, the same in every run."""
        ...

    def solve(self, mechanism: Mechanism, accuracy: Accuracy, place: Place, prepared: Any = None) -> Outcome:
        """Return the answer; ``prepared`` is what ``prepare`` has returned for the same arguments, if it was called."""
        ...


def problem_class(kind: object) -> type[Any]:
    """Return the class of a kind of problem."""
    if not isinstance(kind, str) or kind not in KINDS:
        expected, hint = choices(str(kind), KINDS)
        raise InputError(f"unknown kind '{kind}'", expected=expected, hint=hint)
    entry = KINDS[kind]
    kind_class: type[Any] = getattr(import_module(f"pinarm.problems.{entry.module}"), entry.name)
    return kind_class
