"""The kinds of joint that close loops."""

from __future__ import annotations

from pinarm.mechanics.loops.cable import Cable
from pinarm.mechanics.loops.lower_pairs import LowerKind
from pinarm.mechanics.loops.rod import Rod
from pinarm.mechanics.loops.screw import Helical
from pinarm.mechanics.loops.universal import Universal

LoopJointKind = LowerKind | Helical | Universal | Rod
"""Any loop joint. A new one is a module or class beside these and one entry here."""

Loop = LoopJointKind | Cable
"""Whatever closes a loop: a joint between two links, or a cable."""
