"""The ways of the rows of loop joints through a tree, to the links at which their multipliers are eliminated."""

from __future__ import annotations

from collections.abc import Iterable

import pinocchio as pin

from pinarm.records import Record


class Way(Record, frozen=True):
    """What the rows of a loop joint pass on their way to the link at which it ends.

    Attributes:
        end: The last link that moves all that its rows hold; -1 for the world.
        passed: Links, children before their parents, and ``~k`` where loop joint k is eliminated.
        unknowns: The unknowns there: velocities, and multipliers behind all velocities.
        own: Its own multipliers.
        before: How many of the unknowns are not eliminated at the link at which it ends.
    """

    end: int
    passed: list[int]
    unknowns: list[int]
    own: list[int]
    before: int

    @property
    def support(self) -> list[int]:
        """All these unknowns."""
        return self.unknowns + self.own


class Ways(Record, frozen=True):
    """The ways of loop joints, those first that end at links farther from the world.

    Attributes:
        model: Pinocchio's model.
        found: The ways.
        meeting: Link and unknown -> those that end at the link and have the unknown.
    """

    model: pin.Model
    found: list[Way]
    meeting: dict[tuple[int, int], list[int]]

    def add(self, ends: Iterable[int], moving: Iterable[int], rows: int) -> None:
        """Add the way of a loop joint with some rows; ``ends`` and ``moving`` as in ``Tied``."""
        model, end, passed, unknowns = self.model, end_of(self.model, ends), list[int](), list[int]()
        for link in sorted(_moved_by(model, moving) - _moved_by(model, [end + 1]), reverse=True):
            self._meet(link, passed, unknowns)
            passed.append(link)
            joint = model.joints[link + 1]
            unknowns += range(joint.idx_v, joint.idx_v + joint.nv)
        before = len(unknowns)
        self._meet(end, passed, unknowns)
        first = self.found[-1].own[-1] + 1 if self.found else model.nv
        way = Way(end, passed, unknowns, list(range(first, first + rows)), before)
        for unknown in way.support:
            self.meeting.setdefault((end, unknown), []).append(len(self.found))
        self.found.append(way)

    def _meet(self, link: int, passed: list[int], unknowns: list[int]) -> None:
        """Pass the loop joints that end at a link and share an unknown, those that these bring along too."""
        pending = {k for unknown in unknowns for k in self.meeting.get((link, unknown), [])}
        while pending:
            pending.discard(k := min(pending))
            passed.append(~k)
            unknowns += self.found[k].own
            pending.update(j for unknown in self.found[k].own for j in self.meeting[link, unknown] if j > k)


def end_of(model: pin.Model, joints: Iterable[int]) -> int:
    """Return the last link that moves the links of all of some joints; -1 for the world."""
    return max(set.intersection(*(_moved_by(model, [joint]) | {-1} for joint in joints)))


def _moved_by(model: pin.Model, joints: Iterable[int]) -> set[int]:
    """Return the links that move the link of one of some joints."""
    return {link - 1 for joint in joints for link in model.supports[joint].tolist()} - {-1}
