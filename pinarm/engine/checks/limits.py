"""Limits of joints, cams, cables and belts that a run goes beyond: it is not held to them, but they are reported."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.constraints.constraint_rows import one_sided
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.input.units import DIMENSIONLESS, Unit, unit
from pinarm.mechanics.coordinates import Constraint
from pinarm.mechanics.joints import RADIAN, Joint, effort_unit
from pinarm.records import ValueRecord

ROUNDING = 1e-9
"""Part of a limit by which it may be passed: a motion that ends at a limit ends there to rounding."""


class Excess(ValueRecord, frozen=True):
    """A limit that a run goes beyond.

    Attributes:
        joint: Name of the joint, the cam, the cable or the belt.
        of: ``position``, ``velocity`` or ``effort``; ``contact`` of a cam or a cable that would have to act against its
            sense, ``tension`` of a belt with a slack strand, ``outline`` of a cam that cannot be made.
        limit: The limit; that of velocities and efforts holds both ways.
        value: The value farthest beyond it, with its sign, for ``contact`` between the rows too.
        at: Parameter of the first row beyond it; where no row is, of the largest value.
        sentence: What happens, with ``{where}`` and ``{count}`` in place of the parameter and the number of rows.
    """

    joint: str
    of: str
    unit: Unit
    limit: float
    value: float
    at: float
    rows: int
    sentence: str

    def words(self, run: Trajectory) -> str:
        """Return it as a sentence."""
        where = f"{run.parameter} = {self.at:.6g} {'' if str(run.unit) == '1' else run.unit}".rstrip()
        return self.sentence.replace("{where}", where).replace("{count}", f"({self.rows} of {len(run)} rows)")


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
        highest: Finds what is largest between the rows too, for cams and cables; the rows alone where it is left out.
    """
    limits = [excess for joint in run.mechanism.joints.values() for excess in _of_joint(run, joint)]
    return [*limits, *_openings(run, highest or partial(highest_row, run)), *_slack_belts(run), *_flaws(run)]


def beyond_points(run: Trajectory) -> list[str]:
    """Return a note for each load that is used beyond the points of its law: there it goes on with its last slope."""
    return [
        f"the law of the force '{name}' leaves its points: {said}, beyond them with its last slope"
        for name, force in run.dynamics.forces.items()
        if (law := force.law) is not None and (said := law.beyond(run.grid.t, run.q))
    ]


def _of_joint(run: Trajectory, joint: Joint) -> Iterator[Excess]:
    model, q, v = run.mechanism.model, run.q[:, joint.q], run.v[:, joint.v]
    low, high = model.lowerPositionLimit[joint.q], model.upperPositionLimit[joint.q]
    fastest, most = model.velocityLimit[joint.v], model.effortLimit[joint.v]
    tau = run.effort(joint.v) if np.isfinite(most) else run.tau[:, joint.v]
    rate = unit("rad/s") if joint.unit == RADIAN else joint.unit / unit("s")
    for of, measure, limit, values, beyond in (
        ("position", joint.unit, low, q, low - q),
        ("position", joint.unit, high, q, q - high),
        ("velocity", rate, fastest, v, np.abs(v) - fastest),
        ("effort", effort_unit(joint), most, tau, np.abs(tau) - most),
    ):
        rows = np.flatnonzero(beyond > ROUNDING * max(abs(limit), 1e-3))  # infinite limits are not passed
        if len(rows):
            value = float(values[beyond.argmax()])
            passes = "is below" if of == "position" and value < limit else "exceeds"
            text = f"joint {joint.name}: {of} {value:.6g} {measure} {passes} its limit {limit:.6g} {measure}, first at "
            yield Excess(joint.name, of, measure, float(limit), value, *_first(run, rows), text + "{where} {count}")


def _first(run: Trajectory, rows: Indices) -> tuple[float, int]:
    return float(run.grid.t[rows[0]]), len(rows)


def _openings(run: Trajectory, highest: Highest) -> Iterator[Excess]:
    """Yield cams and cables that would have to pull, or push, where they cannot: the limit is 0."""
    for tie in () if run.no_efforts else one_sided(run.mechanism.constraints):
        pull = partial(_pull, tie)
        pulls, worst = pull(run), highest(pull)
        rows, most = np.flatnonzero(pulls > ROUNDING * np.abs(pulls).max()), float(pull(worst)[0])
        if most <= ROUNDING * max(most, float(np.abs(pulls).max())):
            continue
        first = run.some(rows[:1]) if len(rows) else worst
        place = f", {text}" if (text := tie.whereabouts(first.q[0])) else ""
        where = f"first at {{where}}{place} {{count}}" if len(rows) else f"between two rows, most at {{where}}{place}"
        act = f"would have to {'push' if tie.kind == 'cable' else 'pull'} with {most:.6g} {tie.push_unit()}"
        sentence = f"{tie.kind} {tie.name} {act}: {tie.opens}, {where}; from there on it moves otherwise"
        at = float(first.grid.t[0])
        yield Excess(tie.name, "contact", tie.push_unit(), 0.0, -most, at, len(rows), sentence)


def _pull(tie: Constraint, run: Trajectory) -> Array:
    """Return with what a one-sided constraint acts against its sense, shape (n,)."""
    return -tie.push(run.q, run.lam[:, run.closure.slices[tie.name].start])


def _slack_belts(run: Trajectory) -> Iterator[Excess]:
    """Yield the belts whose pretension a run uses up; chains, which have none, have a slack strand at all times."""
    if run.no_efforts or not run.mechanism.relations:
        return
    from pinarm.mechanics.couplings.coupling import Coupling
    from pinarm.mechanics.couplings.transmissions import Strands

    for tie in run.mechanism.relations:
        known = tie.transmission if isinstance(tie, Coupling) else None
        if not isinstance(known, Strands):
            continue
        apart = np.abs(known.difference * run.lam[:, run.closure.slices[tie.name].start])
        rows, limit = np.flatnonzero(apart > 2.0 * known.pretension * (1.0 + ROUNDING)), known.pretension
        if len(rows) and limit:
            most = float(apart.max())
            sentence = (
                f"belt {tie.name}: a strand is slack, as the tensions differ by {most:.6g} N, more than twice the "
                f"pretension of {limit:.6g} N, first at {{where}} {{count}}; the other strand carries all of it"
            )
            yield Excess(tie.name, "tension", unit("N"), 2.0 * limit, most, *_first(run, rows), sentence)


def _flaws(run: Trajectory) -> Iterator[Excess]:
    """Yield cams that cannot be made."""
    for tie in run.mechanism.relations:
        rows = np.flatnonzero(tie.flawed(run.q))
        if len(rows):
            sentence = f"{tie.kind} {tie.name} {tie.flaw}, first at {tie.whereabouts(run.q[rows[0]])} {{count}}"
            count = float(len(rows))
            yield Excess(tie.name, "outline", DIMENSIONLESS, 0.0, count, *_first(run, rows), sentence)
