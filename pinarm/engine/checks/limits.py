"""Limits of joints: a run is not held to them, but what goes beyond them is told."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pinarm.engine.constraints.constraint import one_sided
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

    Attributes:
        kind: ``cam`` or ``cable``.
        opens: What happens there in truth, in words.
        whereabouts: Where it is at the first row, in words; may be empty.
    """

    kind: str
    opens: str
    whereabouts: str

    def words(self, run: Trajectory) -> str:
        """Return it as a sentence."""
        where = f"{run.parameter} = {self.at:.6g} {'' if str(run.unit) == '1' else run.unit}".rstrip()
        where += f", {self.whereabouts}" if self.whereabouts else ""
        act = f"would have to {'push' if self.kind == 'cable' else 'pull'} with {-self.value:.6g} {self.unit}"
        return (f"{self.kind} {self.joint} {act}: {self.opens}, first at {where} ({self.rows} of {len(run)} rows); "
                "from there on it moves otherwise")  # fmt: skip


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


def excesses(run: Trajectory) -> list[Excess]:
    """Return the limits that a run goes beyond, joint by joint; efforts are those of drives, or of couplings.

    Then cams and cables that would have to act against their sense, belts with a slack strand, and cams that cannot be
    made.
    """
    found = [excess for joint in run.mechanism.joints.values() for excess in _of(run, joint)]
    return [*found, *_openings(run), *_slackness(run), *_flaws(run)]


def _flaws(run: Trajectory) -> Iterator[Flaw]:
    for one in run.mechanism.relations:
        rows = np.flatnonzero(one.flawed(run.q))
        if len(rows):
            first, count = rows[0], len(rows)
            yield Flaw(one.name, "outline", DIMENSIONLESS, 0.0, float(count), float(run.grid.t[first]), count,
                       one.kind, one.flaw, one.whereabouts(run.q[first]))  # fmt: skip


def _openings(run: Trajectory) -> Iterator[Opening]:
    sided = one_sided(run.mechanism.constraints)
    if not sided or run.no_efforts:
        return
    lam, places = np.asarray(run.lam), run.closure.slices
    for one in sided:
        push = one.push(run.q, lam[:, places[one.name].start])
        rows = np.flatnonzero(push < -ROUNDING * np.abs(push).max())
        if len(rows):
            yield Opening(
                one.name, "contact", one.push_unit(), 0.0, float(push.min()), float(run.grid.t[rows[0]]), len(rows),
                one.kind, one.opens, one.whereabouts(run.q[rows[0]]),
            )  # fmt: skip


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
