"""Whether laws are as many as a mechanism has degrees of freedom, counted where its loops close."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.errors import AssemblyError

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.mechanics.laws.motion_law import MotionLaw


def determining(mechanism: Mechanism, motion: Mapping[str, MotionLaw]) -> PrescribedCoordinates:
    """Return the prescribed coordinates of a mechanism all of whose joints are to follow.

    What takes no closed configuration is checked: that they are not fewer than coordinates less constraint rows, and
    not more than coordinates. The rest is, once the mechanism is assembled.

    Raises:
        InputError: A coordinate does not exist, or there are too few or too many.
        AssemblyError: There are too many, and loops that cannot be closed.
    """
    prescribed, closure = PrescribedCoordinates.bound(mechanism, motion), mechanism.closure
    least = mechanism.model.nv - closure.size  # redundant rows leave more freedom than this says
    if len(prescribed.names) < least:
        raise prescribed.miscounted(mechanism, _mobility(mechanism, least))
    if len(prescribed.names) > mechanism.model.nv - int(closure.ties):
        check_excess(mechanism, prescribed)
    return prescribed


def check_excess(mechanism: Mechanism, prescribed: PrescribedCoordinates) -> None:
    """Raise where coordinates are more than the degrees of freedom: their values fit one another nowhere, or by chance.

    Raises:
        InputError: Says how many of them can follow laws.
        AssemblyError: The loops cannot be closed.
    """
    from pinarm.engine.kinematics.closed_configurations import mobility_when_closed

    mobility = mobility_when_closed(mechanism)
    if len(prescribed.names) > mobility:
        raise prescribed.miscounted(mechanism, mobility)


def _mobility(mechanism: Mechanism, least: int) -> int:
    """Return the degrees of freedom where the loops are closed; the least there may be where they cannot be."""
    from pinarm.engine.kinematics.closed_configurations import mobility_when_closed

    try:
        return mobility_when_closed(mechanism)
    except AssemblyError:
        return least
