"""How much a joint resists: Coulomb's law with a limit at rest, Stribeck's transition, constant and viscous parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinarm.arrays import Array
from pinarm.input.units import Unit, unit
from pinarm.mechanics.joints import METRE, RADIAN


@dataclass(frozen=True)
class FrictionLaw:
    """Resistance of one joint to slip, as a function of its load N and its speed u >= 0.

    While it slips ``F = mu(u) N + c(u) + viscous u``; at rest the friction is whatever keeps the joint at rest, up to
    ``static_mu N + static_constant``. With Stribeck's velocity w, ``mu(u) = mu + (static_mu - mu) exp(-(u / w)^2)``, c
    likewise; without one both drop at once when slip begins.

    N is in units of F: the normal forces in a bearing times their levers (``Bearing.load``).

    Attributes:
        mu: Coefficient while it slips.
        static_mu: Coefficient at rest.
        constant: Part that does not depend on the load, while it slips [N*m or N].
        static_constant: The same at rest.
        viscous: [N*m*s/rad or N*s/m].
        stribeck: w [rad/s or m/s]; 0 without a transition.
    """

    mu: float
    static_mu: float
    constant: float
    static_constant: float
    viscous: float = 0.0
    stribeck: float = 0.0

    @classmethod
    def plain(cls, constant: float) -> FrictionLaw:
        """Return the law of a friction that neither load nor speed changes."""
        return cls(0.0, 0.0, constant, constant)

    def slipping(self, speed: Array | float) -> tuple[Array, Array]:
        """Return ``mu(u)`` and ``c(u) + viscous u``, each of the shape of the speeds u >= 0."""
        speed = np.asarray(speed)
        rest = np.exp(-((speed / self.stribeck) ** 2)) if self.stribeck else np.zeros_like(speed)
        mu = self.mu + (self.static_mu - self.mu) * rest
        constant = self.constant + (self.static_constant - self.constant) * rest
        return mu, constant + self.viscous * speed

    def words(self, effort: Unit) -> str:
        speed = RADIAN if effort == unit("N*m") else METRE
        parts = [f"{name}{slipping:g}{measure}" + (f" ({resting:g}{measure} at rest)" if resting != slipping else "")
                 for name, slipping, resting, measure in (
                     ("mu ", self.mu, self.static_mu, ""), ("", self.constant, self.static_constant, f" {effort}"))
                 if resting]  # fmt: skip
        parts += [f"viscous {self.viscous:g} {effort}*s/{speed}"] if self.viscous else []
        parts += [f"Stribeck's velocity {self.stribeck:g} {speed}/s"] if self.stribeck else []
        return ", ".join(parts) or "none"

    @property
    def resting(self) -> tuple[float, float]:
        """``static_mu`` and ``static_constant``."""
        return self.static_mu, self.static_constant

    @property
    def loaded(self) -> bool:
        """Whether it depends on the load."""
        return self.static_mu > 0.0
