"""A prescribed motion in variants of its mechanism: states and efforts with an axis of variants after the rows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Flags
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.constraints.variant_closure import VariantClosure
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.kinematics.joint_motion import DeterminedMotion, prescribed_at_start
from pinarm.engine.kinematics.variant_motion import VariantMotion, VariantStates
from pinarm.engine.motion.prescribed_motion import PrescribedMotion
from pinarm.engine.motion.standstill import lossy
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.statics.actuation import Actuation, DriveAtEveryJoint
from pinarm.engine.statics.effort_distribution import UNIQUE
from pinarm.engine.statics.selected_drives import SelectedDrives
from pinarm.mechanics.coordinates import LinearCoordinate
from pinarm.mechanics.geometry.model_variants import VariantsDiffer
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism


def prescribed_variants(motion: PrescribedMotion, run: Trajectory, mechanism: Mechanism) -> tuple[Trajectory, Flags]:
    """Return the states of variants with the efforts that the motion takes, and which are on its branch, shape (k,).

    Args:
        motion: The motion of the first variant.
        run: Its rows.
        mechanism: The variants.

    Raises:
        VariantsDiffer: Something is computed of one mechanism at a time.
    """
    variants, closure, prescription = mechanism.model, mechanism.closure, motion.prescription
    assert isinstance(closure, VariantClosure)
    if lossy(prescription.mechanism):
        raise VariantsDiffer("the directions of joints, on which the losses of gears depend")
    dynamics = Dynamics.of_variants(variants, prescription.dynamics.forces)
    drives = None if prescription.drives is None else _drives(prescription.drives, closure)
    q, v, a, sound = _states(motion, run, closure)
    lam = Multipliers.known(np.zeros((*q.shape[:2], closure.size)), closure.size)
    states = replace(run, mechanism=mechanism, q=q, v=v, a=a, tau=np.zeros_like(v), lam=lam, closure=closure,
                     dynamics=dynamics)  # fmt: skip
    known = replace(prescription, mechanism=mechanism, dynamics=dynamics, drives=drives)
    return known.solved(states, motion.pace), sound


def _drives(drives: Actuation, closure: VariantClosure) -> Actuation:
    """Return the same drives on variants.

    Raises:
        VariantsDiffer: They share the load, act along task coordinates, or leave joints that mimic others.
    """
    if isinstance(drives, DriveAtEveryJoint):
        return DriveAtEveryJoint(closure)
    if not isinstance(drives, SelectedDrives) or drives.tasks or drives.distribution is not UNIQUE:
        raise VariantsDiffer("drives that share the load, act along task coordinates, or move joints that mimic others")
    return replace(drives, own=closure, closure=closure)


def _states(motion: PrescribedMotion, run: Trajectory, closure: VariantClosure) -> VariantStates:
    """Return the states: those of the first variant where lengths do not matter."""
    prescription, k = motion.prescription, len(closure.model)
    followed, start = prescription.motion, motion.start
    assert isinstance(followed, DeterminedMotion)
    by_joints = all(isinstance(coordinate, LinearCoordinate) for coordinate in followed.coordinates)
    if closure.model.in_place or (by_joints and not closure.size):
        return VariantStates(run.q[:, None], run.v[:, None], run.a[:, None], np.ones(k, dtype=bool))
    start = prescribed_at_start(prescription.mechanism, followed.prescribed, run.grid, start)
    variants = VariantMotion.of(closure, followed.prescribed, run.q[0])
    laws = np.array([run.grid.evaluate(law) for law in followed.laws]).transpose(1, 2, 0)
    states = variants.follow(run.grid.t, laws, run.q, start)
    if prescription.rates is None:
        return states
    v, a = variants.rates(states.q, *prescription.rates)
    return states._replace(v=v, a=a)
