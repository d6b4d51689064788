"""The kinds of controller that files may name."""

from __future__ import annotations

from pinarm.mechanics.control.computed_torque import ComputedTorque
from pinarm.mechanics.control.pid import Pid
from pinarm.mechanics.control.state_feedback import StateFeedback
from pinarm.mechanics.control.switching import Switching

Control = Pid | StateFeedback | ComputedTorque | Switching
"""Any controller. A new one is a module beside these and one entry here."""
