"""The kinds of coupling."""

from __future__ import annotations

from pinarm.mechanics.couplings.belt import Belt
from pinarm.mechanics.couplings.cam import Cam
from pinarm.mechanics.couplings.gear import Gear
from pinarm.mechanics.couplings.rack import Rack
from pinarm.mechanics.couplings.screw import Screw
from pinarm.mechanics.couplings.weighted_sum import WeightedSum

CouplingDefinition = Gear | Rack | Screw | Belt | Cam | WeightedSum
"""Any coupling. A new kind is one module beside these and one entry here."""
