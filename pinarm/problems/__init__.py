"""Layer 3: the kinds of problem."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from pinarm.problems.forward import Forward
from pinarm.problems.inverse import Inverse
from pinarm.problems.statics import Statics

Problem = Annotated[Statics | Inverse | Forward, Field(discriminator="kind")]
"""Any kind of problem. A new kind is one module and one entry here."""
