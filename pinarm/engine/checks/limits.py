"""Limits of joints: a run is not held to them, but what goes beyond them is told."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.constraint import OneSidedConstraint, one_sided
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.input.units import DIMENSIONLESS, Unit, unit
from pinarm.mechanics.forces.joint_definitions import effort_unit
from pinarm.mechanics.joints import RADIAN, Joint
from pinarm.records import ValueRecord

ROUNDING = 1e-9
"""Part of a limit by which it may be passed: a motion that ends at a limit ends there to rounding."""


class Excess(ValueRecord, frozen=True):
    """A limit of a joint that a run goes beyond.

    Attributes:
        joint: Name of the joint.
        of: ``position``, ``velocity`` or ``effort``.
        unit: Unit of the limit.
        limit: The limit; that of velocities and efforts holds both ways.
        value: What is farthest beyond it, with its sign.
        at: Parameter of the first row beyond it.
        rows: Number of rows beyond it.
    """

    joint: str
    of: str
    unit: Unit
    limit: float
    value: float
    at: float
    rows: int

    def words(self, run: Trajectory) -> str:
        """Return it as a sentence."""
        passes = "is below" if self.of == "position" and self.value < self.limit else "exceeds"
        where = f"{run.parameter} = {self.at:.6g} {'' if str(run.unit) == '1' else run.unit}".rstrip()
        return (f"joint {self.joint}: {self.of} {self.value:.6g} {self.unit} {passes} its limit {self.limit:.6g} "
                f"{self.unit}, first at {where} ({self.rows} of {len(run)} rows)")  # fmt: skip


class Opening(Excess, frozen=True):
    """A cam or a cable that would have to pull, or push, where it cannot: ``joint`` is its name, the limit 0.

    ``value`` is the largest pull between the rows, too; where no row pulls, ``at`` is where it does most.

    Attributes:
        kind: ``cam`` or ``cable``.
        opens: What happens there in truth, in words.
        whereabouts: Where it is there, in words; may be empty.
    """

    kind: str
    opens: str
    whereabouts: str

    def words(self, run: Trajectory) -> str:
        """Return it as a sentence."""
        where = f"{run.parameter} = {self.at:.6g} {'' if str(run.unit) == '1' else run.unit}".rstrip()
        where += f", {self.whereabouts}" if self.whereabouts else ""
        where = (
            f"first at {where} ({self.rows} of {len(run)} rows)" if self.rows else f"between two rows, most at {where}"
        )
        act = f"would have to {'push' if self.kind == 'cable' else 'pull'} with {-self.value:.6g} {self.unit}"
        return f"{self.kind} {self.joint} {act}: {self.opens}, {where}; from there on it moves otherwise"


class Slackness(Excess, frozen=True):
    """A belt that carries more than its pretension allows: ``joint`` is its name, ``value`` the tension it transmits.

    The limit is twice the pretension, at which one strand has no tension left; the other one carries the rest alone.
    """

    def words(self, run: Trajectory) -> str:
        """Return it as a sentence."""
        where = f"{run.parameter} = {self.at:.6g} {'' if str(run.unit) == '1' else run.unit}".rstrip()
        return (f"belt {self.joint}: a strand is slack, as the tensions differ by {self.value:.6g} {self.unit}, more "
                f"than twice the pretension of {0.5 * self.limit:.6g} {self.unit}, first at {where} ({self.rows} of "
                f"{len(run)} rows); the other strand carries all of it")  # fmt: skip


class Flaw(Excess, frozen=True):
    """A cam that cannot be made: ``joint`` is its name, ``value`` how many rows show it.

    Attributes:
        kind: ``cam``.
        flaw: What is wrong, in words.
        whereabouts: Where it is at the first row, in words.
    """

    kind: str
    flaw: str
    whereabouts: str

    def words(self, run: Trajectory) -> str:
        """Return it as a sentence."""
        return f"{self.kind} {self.joint} {self.flaw}, first at {self.whereabouts} ({self.rows} of {len(run)} rows)"


Highest = Callable[[Callable[[Trajectory], Array]], Trajectory]
"""A function of rows, of shape (n,) for n of them -> the row of a run at which it is largest, between its rows too."""


def highest_row(run: Trajectory, height: Callable[[Trajectory], Array]) -> Trajectory:
    """Return the row at which a function of rows is largest."""
    return run.some(np.array([height(run).argmax()]))


def excesses(run: Trajectory, highest: Highest | None = None) -> list[Excess]:
    """Return the limits that a run goes beyond, joint by joint; efforts are those of drives, or of couplings.

    Then cams and cables that would have to act against their sense, belts with a slack strand, and cams that cannot be
    made.

    Args:
        run: The rows.
        highest: Finds what is largest between the rows too, for cams and cables; the rows alone where it is left out.
    """
    found = [excess for joint in run.mechanism.joints.values() for excess in _of(run, joint)]
    return [*found, *_openings(run, highest or partial(highest_row, run)), *_slackness(run), *_flaws(run)]


def _flaws(run: Trajectory) -> Iterator[Flaw]:
    for one in run.mechanism.relations:
        rows = np.flatnonzero(one.flawed(run.q))
        if len(rows):
            first, count = rows[0], len(rows)
            yield Flaw(one.name, "outline", DIMENSIONLESS, 0.0, float(count), float(run.grid.t[first]), count,
                       one.kind, one.flaw, one.whereabouts(run.q[first]))  # fmt: skip


def _openings(run: Trajectory, highest: Highest) -> Iterator[Opening]:
    sided = one_sided(run.mechanism.constraints)
    if not sided or run.no_efforts:
        return
    for one in sided:
        pull = partial(_pull, one)
        pulls, worst = pull(run), highest(pull)
        rows, most = np.flatnonzero(pulls > ROUNDING * np.abs(pulls).max()), float(pull(worst)[0])
        if most > ROUNDING * max(most, float(np.abs(pulls).max())):
            first = run.some(rows[:1]) if len(rows) else worst
            yield Opening(
                one.name, "contact", one.push_unit(), 0.0, -most, float(first.grid.t[0]), len(rows), one.kind,
                one.opens, one.whereabouts(first.q[0]),
            )  # fmt: skip


def _pull(one: OneSidedConstraint, run: Trajectory) -> Array:
    """Return with what a one-sided constraint acts against its sense, shape (n,)."""
    return -one.push(run.q, np.asarray(run.lam)[:, run.closure.slices[one.name].start])


def _slackness(run: Trajectory) -> Iterator[Slackness]:
    """Yield the belts whose pretension a run uses up; chains, which have none, have a slack strand at all times."""
    if run.no_efforts or not run.mechanism.relations:
        return
    from pinarm.mechanics.couplings.coupling import Coupling
    from pinarm.mechanics.couplings.transmissions import Strands

    for one in run.mechanism.relations:
        known = one.transmission if isinstance(one, Coupling) else None
        if not isinstance(known, Strands):
            continue
        apart = np.abs(known.difference * np.asarray(run.lam)[:, run.closure.slices[one.name].start])
        rows = np.flatnonzero(apart > 2.0 * known.pretension * (1.0 + ROUNDING))
        if len(rows) and known.pretension:
            yield Slackness(one.name, "tension", unit("N"), 2.0 * known.pretension, float(apart.max()),
                            float(run.grid.t[rows[0]]), len(rows))  # fmt: skip


def _of(run: Trajectory, joint: Joint) -> Iterator[Excess]:
    model, q = run.mechanism.model, run.q[:, joint.q]
    v, most = run.v[:, joint.v], model.effortLimit[joint.v]
    tau = run.effort(joint.v) if np.isfinite(most) else run.tau[:, joint.v]
    rate = unit("rad/s") if joint.unit == RADIAN else joint.unit / unit("s")
    for of, measured, limit, values, beyond in (
        ("position", joint.unit, model.lowerPositionLimit[joint.q], q, model.lowerPositionLimit[joint.q] - q),
        ("position", joint.unit, model.upperPositionLimit[joint.q], q, q - model.upperPositionLimit[joint.q]),
        ("velocity", rate, model.velocityLimit[joint.v], v, np.abs(v) - model.velocityLimit[joint.v]),
        ("effort", effort_unit(joint), most, tau, np.abs(tau) - most),
    ):
        rows = np.flatnonzero(beyond > ROUNDING * max(abs(limit), 1e-3))  # infinite limits are not passed
        if len(rows):
            farthest = float(values[beyond.argmax()])
            yield Excess(joint.name, of, measured, float(limit), farthest, float(run.grid.t[rows[0]]), len(rows))
