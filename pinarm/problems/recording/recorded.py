"""A recorded motion: measured, or of another program. Nothing is solved for but the efforts that belong to it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from copy import deepcopy
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import msgspec
import numpy as np

from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.friction.columns import with_friction_columns
from pinarm.engine.kinematics.closed_configurations import generic_near
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.recorded_motion import RecordedRows, Recording
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.statics.actuation import Actuation, everywhere
from pinarm.errors import InputError, Place, nowhere, within
from pinarm.input.roots import contained_file, root_of
from pinarm.input.yaml.deferred import Deferred
from pinarm.input.yaml.schema import InputStruct, current_folder
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.actuation.effort_sharing import Share, drives_of
from pinarm.problems.loads import LOADS, bind_loads
from pinarm.problems.recording.recorded_columns import check_rows, names_read, recorded_headings, recorded_rows
from pinarm.problems.time_grid import require_memory
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.motion.outcome import Outcome
    from pinarm.mechanics.forces.kinds import Force
else:  # imported where a file has loads, see LOADS
    Force = Any

Prepared = tuple[Recording, RecordedRows, tuple[str, ...]]
"""What makes the table, the rows, and the headings that are not read."""


class Recorded(InputStruct, frozen=True, tag_field="kind", tag="recorded"):
    """A motion that is given row by row, with all that can be said of it.

    What is not given is not invented. Without velocities and accelerations quantities that depend on them are refused,
    unless ``derivatives: spline`` takes both from the spline of degree 5 through the positions, which tells its error.
    Given efforts are taken as they are, 0 at joints without a column, and how far they are from the equation of motion
    is told as a residual; without any, they are those of inverse dynamics.

    Attributes:
        file: CSV table with a heading such as ``t [s],joint.knee.position [deg],joint.knee.velocity [deg/s]``: one
            column for every joint, by the names of quantities; other columns are not read.
        columns: The same in place of a file: heading -> numbers, in a list or as text, such as ``{'t [s]': [0, 0.1,
            0.2], 'knee [deg]': [10, 12, 15]}``.
        derivatives: ``given``, as far as there are columns of them, or those of a ``spline``.
        drives: Coordinates that the drives act along, such as ``[knee]``, where no efforts are given; every joint of an
            open chain where none is named. A mechanism with loops has no forces in its answer without any.
        share: How drives share the load where there are more of them than degrees of freedom, such as
            ``least_squares``; the kind ``inverse`` has the same key.
        loads: Applied forces, springs and dampers of this run, such as ``{spring: {kind: joint_spring, joint: O,
            stiffness: 20 N*m/rad}}``.
    """

    kind: ClassVar[str] = "recorded"
    deferred: ClassVar[Deferred] = LOADS
    file: str = ""
    columns: dict[str, list[float] | str] = {}
    derivatives: Literal["given", "spline"] = "given"
    drives: Annotated[list[str], msgspec.Meta(min_length=1)] = []
    share: Share | None = None
    loads: dict[str, Force] = {}

    def check(self) -> None:
        """Refuse a motion without rows, or with two sources of them; keep the file by its whole path."""
        if bool(self.file) == bool(self.columns):
            raise InputError("the motion has two sources, 'file' and 'columns'" if self.file else "there is no motion",
                             expected="file: a CSV table, or columns: heading -> numbers")  # fmt: skip
        if self.file:
            folder = current_folder() or Path()
            with within("file"):
                path = contained_file((folder / self.file).absolute(), root_of(folder))
            msgspec.structs.force_setattr(self, "file", str(path))

    def schema_row(self, mechanism: Mechanism) -> Trajectory:
        rows, _ = self._read(mechanism, most=1)
        drives = None if rows.tau is not None else self._drives(mechanism, nowhere)
        start = {name: float(rows.q[0, joint.q]) for name, joint in mechanism.joints.items()}
        dynamics = Dynamics.of(mechanism.model, bind_loads(mechanism, self.loads, nowhere))
        still = np.zeros((1, mechanism.model.nv))
        known = self.derivatives == "spline"
        v, a = (still if known or x is not None else None for x in (rows.v, rows.a))
        tau = None if rows.tau is None else still
        first = RecordedRows(np.zeros(1), generic_near(mechanism, start)[None], v, a, tau)
        recording = Recording(mechanism, drives, dynamics)
        row = recording.schema_row(first)
        if drives is not None:
            row = with_friction_columns(row, drives)
        return replace(row, sampled=not known or rows.tau is not None)

    def declaration(self) -> None:
        """Return nothing: the whole mechanism is given."""

    def prepare(self, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> Prepared:
        """Check all names and units; return what makes the table, the rows, and the headings that are not read."""
        with place("file" if self.file else "columns"):
            rows, unread = self.rows(mechanism)
        for key, given in (("drives", self.drives), ("share", self.share)):
            if rows.tau is not None and given:
                with place(key):
                    raise InputError("efforts are given, and drives whose efforts are to be found",
                                     expected="one of them")  # fmt: skip
        drives = None if rows.tau is not None else self._drives(mechanism, place)
        forces = bind_loads(mechanism, self.loads, place)
        return Recording(mechanism, drives, Dynamics.of(mechanism.model, forces)), rows, unread

    def solve(
        self, mechanism: Mechanism, accuracy: Accuracy, place: Place, prepared: Prepared | None = None
    ) -> Outcome:
        recording, rows, unread = prepared or self.prepare(mechanism, accuracy, place)
        rows = deepcopy(rows)  # what is prepared serves further runs
        with place("file" if self.file else "columns"):
            outcome = recording.splined(rows) if self.derivatives == "spline" else recording.outcome(rows)
        notes = (f"columns that are not read: {', '.join(unread)}",) if unread else ()
        return replace(outcome, notes=(*notes, *_doubts(mechanism, outcome.figures), *outcome.notes))

    def rows(self, mechanism: Mechanism) -> tuple[RecordedRows, tuple[str, ...]]:
        """Return the rows that are given, and the headings of columns that are not read.

        Raises:
            InputError: They are no motion of this mechanism.
        """
        rows, unread = self._read(mechanism)
        require_memory(len(rows.t), mechanism.model, 0, "file" if self.file else "table")
        check_rows(mechanism, rows)
        return rows, unread

    def _read(self, mechanism: Mechanism, most: int | None = None) -> tuple[RecordedRows, tuple[str, ...]]:
        """Return the rows, or the first ones of them, and the headings that are not read; headings are checked first.

        Raises:
            InputError: See ``rows``.
        """
        headings = recorded_headings(mechanism, self._headings())
        self._check_known(mechanism, headings.arrays)
        return recorded_rows(mechanism, headings, self._columns(mechanism, most)), headings.unread

    def _check_known(self, mechanism: Mechanism, arrays: Set[str]) -> None:
        """Refuse what does not go together of the question and of the arrays that there are columns of.

        Raises:
            InputError: See ``rows``.
        """
        if self.derivatives == "spline" and arrays & {"v", "a"}:
            raise InputError("velocities or accelerations are given, and those of a spline are asked for",
                             expected="derivatives: given, or positions only")  # fmt: skip
        if self.derivatives == "given" and "tau" in arrays and not {"v", "a"} <= arrays:
            lacking = "accelerations" if "v" in arrays else "velocities"
            raise InputError(f"efforts are given, but the {lacking} of this motion are not given",
                             hint="derivatives: spline")  # fmt: skip
        if "tau" in arrays and mechanism.frictions:
            sticking = ", ".join(dict.fromkeys(contact.name for contact in mechanism.frictions))
            raise InputError(f"efforts are given, and {sticking} has friction of its own: the two are not told apart",
                             expected="no efforts: they follow from the motion and the friction")  # fmt: skip
        if "a" in arrays and "v" not in arrays:
            raise InputError("accelerations are given without velocities", expected="both, or none")

    def _headings(self) -> Iterable[str]:
        if not self.file:
            return self.columns
        from pinarm.input.motion_tables import read_headings

        return read_headings(self.file)

    def _columns(self, mechanism: Mechanism, most: int | None) -> Mapping[str, Sequence[float] | str]:
        if not self.file:
            return self.columns if most is None else {heading: x[:most] for heading, x in _apart(self.columns)}
        from pinarm.input.motion_tables import read_columns

        state = Path(self.file).stat()
        return read_columns(self.file, names_read(mechanism), (state.st_mtime_ns, state.st_size), most)

    def _drives(self, mechanism: Mechanism, place: Place) -> Actuation | None:
        if not self.drives and self.share is None:
            return everywhere(mechanism)
        return drives_of(mechanism, self.drives, [], self.share, place)


def _apart(columns: Mapping[str, list[float] | str]) -> Iterator[tuple[str, Sequence[Any]]]:
    """Yield headings with their numbers, those of texts still as texts."""
    for heading, numbers in columns.items():
        yield heading, numbers.split() if isinstance(numbers, str) else numbers


def _doubts(mechanism: Mechanism, figures: Mapping[str, float]) -> tuple[str, ...]:
    """Return what given derivatives seem to be, where they are no rates of the rows."""
    doubts = []
    for derivative, of in (("velocity", "positions"), ("acceleration", "velocities")):
        left = figures.get(f"{derivative} consistency", 0.0)
        if left > DOUBTFUL:
            doubts.append(f"{derivative} consistency {left:.2g}: the given {derivative} is not the rate of the {of}, "
                          "or the rows are too far apart to tell")  # fmt: skip
    if doubts and mechanism.balls:
        doubts.append("of a floating base v has the velocity in the axes of the world, where Pinocchio has it in those "
                      "of the base: Mechanism.from_pinocchio converts")  # fmt: skip
    return tuple(doubts)


DOUBTFUL = 1e-2
"""Relative difference of a derivative from the rate of the rows that a note tells."""
