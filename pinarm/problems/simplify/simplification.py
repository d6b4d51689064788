"""A problem solved with the joints locked that it holds still, and the outcome put back into the whole mechanism.

A joint is locked where a law, a value of ``hold`` or a coupling keeps it still: with what it carries it becomes one
body with its parent. See ``problems.simplify.locking`` for the joints that stay.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

from pinarm.engine.constraints.constraint_rows import joint_ties
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.outcome import Outcome
from pinarm.errors import AssemblyError, DynamicsError, InputError, NumericsError, Place, listed
from pinarm.problems import Problem
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.loads import bind_loads
from pinarm.records import Record, ValueRecord

if TYPE_CHECKING:
    from pinarm.problems.simplify.locked_mechanism import LockedMechanism


class Removal(ValueRecord, frozen=True):
    """A joint that is not solved for.

    Attributes:
        joint: Its name.
        how: ``locked``; files of earlier versions also have ``dropped``, with its bodies.
        why: In words.
    """

    joint: str
    how: Literal["locked", "dropped"]
    why: str


class Simplification(Record, frozen=True):
    """A problem, and what is solved in its place.

    Attributes:
        question: The problem on the whole mechanism.
        mechanism: The whole.
        accuracy: How it is solved.
        place: Gives errors their place.
        problem: The problem on the part.
        part: What is solved; ``None`` where that is the whole.
    """

    question: Problem
    mechanism: Mechanism
    accuracy: Accuracy
    place: Place
    problem: Problem
    part: LockedMechanism | None = None

    @classmethod
    def whole(cls, problem: Problem, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> Simplification:
        return cls(problem, mechanism, accuracy, place, problem)

    @classmethod
    def required(
        cls, problem: Problem, mechanism: Mechanism, accuracy: Accuracy, place: Place, requested: Collection[str]
    ) -> Simplification:
        """Return what a problem requires.

        Args:
            problem: The problem.
            mechanism: The mechanism.
            accuracy: How it is solved.
            place: Gives errors their place.
            requested: Names of the joints at which forces are asked.

        Raises:
            InputError: The problem has a mistake.
        """
        declared, whole = problem.declaration(), cls.whole(problem, mechanism, accuracy, place)
        tied = joint_ties(mechanism.constraints) or any(drive.turns_rotor for drive in mechanism.drives.values())
        if declared is None or tied or mechanism.frictions:  # these move, or stick and slip, with several joints
            return whole
        from pinarm.problems.simplify.locking import locking

        try:
            lock = locking(declared, mechanism, requested)
        except KeyError:  # a name that does not exist: the question tells of it when it is solved
            lock = None
        if lock is None:
            return whole
        from pinarm.problems.simplify.locked_mechanism import LockedMechanism

        forces = bind_loads(mechanism, declared.loads, place)
        part = LockedMechanism.of(mechanism, forces, declared.loads, lock)
        if part is None:
            return whole
        problem.prepare(mechanism, accuracy, place)
        removed = mechanism.coordinates.keys() - part.mechanism.coordinates.keys()
        return cls(problem, mechanism, accuracy, place, declared.without(removed), part)

    def solve(self) -> tuple[Outcome, Outcome]:
        """Return what came out for the mechanism that was solved, and the same of the whole mechanism.

        Where the part cannot be solved the whole is tried, so that what is wrong is told in its terms.

        Raises:
            PinarmError: As the problem itself.
        """
        if self.part is None:
            return self._as_put()
        try:
            run = self.problem.solve(self.solved, self.accuracy, self.place, self._prepared_part)
        except (InputError, AssemblyError, DynamicsError):
            return self._as_put()
        except NumericsError as error:
            if isinstance(error.partial, Outcome):
                error.partial = self.part.restored(error.partial)
            raise
        return run, self.part.restored(run)

    @property
    def solved(self) -> Mechanism:
        """The mechanism that is solved."""
        return self.mechanism if self.part is None else self.part.mechanism

    def _as_put(self) -> tuple[Outcome, Outcome]:
        run = self.question.solve(self.mechanism, self.accuracy, self.place, self._prepared)
        return run, run

    @cached_property
    def _prepared(self) -> Any:
        return self.question.prepare(self.mechanism, self.accuracy, self.place)

    @cached_property
    def _prepared_part(self) -> Any:
        return self.problem.prepare(self.solved, self.accuracy, self.place)

    @property
    def removals(self) -> tuple[Removal, ...]:
        """What is removed and why, joint by joint."""
        if self.part is None:
            return ()
        positions, joints = self.part.locking.positions, self.mechanism.joints.values()
        return tuple(
            Removal(joint.name, "locked", f"held at {positions[joint.v]:.6g} {joint.unit}")
            for joint in joints
            if joint.v in positions
        )


def removal_lines(removals: Sequence[Removal]) -> list[str]:
    """Return what is removed in a line, many joints counted."""
    names = [removal.joint for removal in removals]
    return [f"locked: {listed('joint', names)} (held still)"] if names else []
