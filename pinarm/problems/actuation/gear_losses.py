"""Gears with losses behind motors that controllers command: friction at their rotors, in forward runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from pinarm.mechanics.rotors import GearedRotor, gear_name
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.problems.actuation.controls import ControlOfRun


def with_gear_losses(mechanism: Mechanism, control: Sequence[ControlOfRun]) -> Mechanism:
    """Return a mechanism with the friction of gears whose motors have controllers; itself where none has losses.

    Args:
        mechanism: The mechanism, or one that has them already, as that of a result.
        control: The controllers of the run, those of the mechanism included.
    """
    commanded = {drive for one in control for drive in one.drives}
    known = {one.name for one in mechanism.frictions}
    gears = {one.name: one for one in mechanism.constraints if isinstance(one, GearedRotor)}
    losing = {
        name: drive for name, drive in mechanism.drives.items()
        if name in commanded and drive.efficiency < 1.0 and gear_name(name) in gears
    }  # fmt: skip
    if not losing:
        return mechanism
    from pinarm.mechanics.friction.gear_loss import GearLoss

    losses = [GearLoss.of(name, gears[gear_name(name)], drive.efficiency) for name, drive in losing.items()]
    return replace(mechanism, frictions=(*mechanism.frictions, *(loss for loss in losses if loss.name not in known)))
