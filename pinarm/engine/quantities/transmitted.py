"""Components of wrenches that joints and couplings transmit, told only where rigid bodies determine them."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.nullspace import ACTS
from pinarm.engine.quantities.family import AXES, NEWTON, NEWTON_METRE, Asked, Family
from pinarm.engine.series import Series
from pinarm.errors import InputError, several
from pinarm.mechanics.geometry.vectors import crossed

WRENCH = ("force", "moment")

SAY_HOW = "in couplings: a gear or rack with its pressure_angle, a belt with its pretension, gears with planets"
"""What makes the forces of a coupling known."""


class WrenchFamily(Family, frozen=True):
    """A family of things that transmit wrenches."""

    undetermined: ClassVar[bool] = True

    def wrench(self, asked: Asked, origins: Array, wrench: Array, stresses: list[Array], about: Array) -> Series:
        """Return a component of a wrench.

        Args:
            asked: The name.
            origins: Where the wrench is taken [m], shape (n, 3).
            wrench: [f; m] there, world axes, shape (n, 6).
            stresses: What each self-stress of length 1 adds to it, shape (n, 6).
            about: The points of moments where the name gives none [m], shape (n, 3).

        Raises:
            InputError: A self-stress adds to the component, see ``doubt``.
        """
        values, *added = (self.wrench_component(asked, origins, each, about) for each in (wrench, *stresses))
        terms = np.linalg.norm(wrench[..., :3], axis=-1)
        if asked.part == "force":
            return Series(asked.name, NEWTON, values, self.doubt(asked, added), terms=terms)
        arms = self.evaluation.reactions.reach + np.linalg.norm(origins - self.about(asked, about), axis=-1)
        terms = np.linalg.norm(wrench[..., 3:], axis=-1) + arms * terms
        return Series(asked.name, NEWTON_METRE, values, self.doubt(asked, added), terms=terms)

    def wrench_component(self, asked: Asked, origins: Array, wrench: Array, about: Array) -> Array:
        """Return the component of wrenches at origins that a name asks for, shape (n,)."""
        if asked.part == "force":
            return self.component(asked, wrench[..., :3])
        arm = origins - self.about(asked, about)
        return self.component(asked, wrench[..., 3:] + crossed(arm, wrench[..., :3]))

    def doubt(self, asked: Asked, added: list[Array]) -> str:
        """Return what is in doubt about a component; nothing where self-stresses add nothing to it.

        Args:
            asked: The name.
            added: What each self-stress of length 1 adds to the component, shape (n,).

        Raises:
            InputError: They add to it, and the least values are not asked for.
        """
        if not any(acts(part) for part in added):
            return ""
        doubt = f"hyperstatic of degree {self.evaluation.reactions.degree}: rigid bodies do not determine it"
        if self.evaluation.undetermined != "minimum_norm":
            raise self._hyperstatic(asked, doubt)
        return f"least multipliers; {doubt}"

    def _hyperstatic(self, asked: Asked, doubt: str) -> InputError:
        """Return the refusal of a component that is not determined, with the joints that share it."""
        mobility = self.evaluation.mobility
        names = several(list(mobility.undetermined))
        shared = f", only what {names} carry together" if names else ""
        looser = f": {mobility.loosenings[0]}" if mobility.loosenings else ""
        flat = self._across_axis(asked)
        return InputError(
            f"'{asked.name}': {doubt}{shared}", expected=f"a component that is determined, or looser joints{looser}",
            hint=f"{flat}, the size of what is across the axis" if flat else
                 "undetermined: minimum_norm, for the least multipliers",
        )  # fmt: skip

    def _across_axis(self, asked: Asked) -> str:
        """Return the name of the size across the joint's axis in place of a length, where only that is determined.

        It is the length in the plane of a flat mechanism, which rigid bodies do not hold out of its plane.
        """
        if asked.words[-1] != "norm":
            return ""
        name = f"{asked.name.removesuffix('norm')}radial"
        try:
            self.series(Asked(name, (*asked.words[:-1], "radial")))
        except InputError:
            return ""
        return name


def acts(component: Array) -> bool:
    """Tell whether wrenches of length 1 act on a component, given what they add to it, shape (n,)."""
    return bool(np.abs(component).max(initial=0.0) > ACTS)


def components(parts: tuple[str, ...] = WRENCH) -> list[str]:
    """Return the names of the components of a force and a moment."""
    return [f"{part}.{axis}" for part in parts for axis in AXES]
