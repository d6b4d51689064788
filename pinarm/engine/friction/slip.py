"""Which joints with friction slip, and which it holds; nothing of either where there is no friction."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pinarm.records import ValueRecord

if TYPE_CHECKING:
    from pinarm.engine.friction.balance import SlipGroup


class Slip(ValueRecord, frozen=True):
    """What the joints with friction do on a stretch of the motion.

    Attributes:
        direction: 1 or -1 of a joint that slips, 0 of one at rest, for each of k joints; of a slip with several
            components a unit vector, the direction from which it does not turn away by more than 60 deg.
        stuck: Groups of joints that friction keeps at rest.
        begun: When it begins [s].
        rest: Slips [rad/s or m/s] that rounding of the instant of a switch leaves, shape (k,).
        slack: Friction [N*m or N] of the groups that rounding leaves; see ``watches.NOTHING``, shape (g,).
    """

    direction: tuple[float, ...] = ()
    stuck: tuple[SlipGroup, ...] = ()
    begun: float = 0.0
    rest: tuple[float, ...] = ()
    slack: tuple[float, ...] = ()
