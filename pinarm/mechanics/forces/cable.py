"""The cable that stretches."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import msgspec
import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags
from pinarm.input.units import unit
from pinarm.input.yaml.schema import Damping, InputStruct, Span, Stiffness
from pinarm.mechanics.forces.along_coordinate import TOUCHING, AlongCoordinate
from pinarm.mechanics.forces.force_element import Edge, ElementQuantity, ForceElement
from pinarm.mechanics.joints import METRE, Joint
from pinarm.mechanics.paths import PathLength


class ElasticCable(InputStruct, frozen=True, tag_field="kind", tag="cable"):
    """An elastic cable from one link over others to the last one; it pulls, and is slack where it is too long.

    While the path through the links, of length l, is longer than the free length l0, the tension is
    ``S = max(stiffness (l - l0) + damping l', 0)``. On the way it runs without friction over small pulleys or through
    eyes, as the loop joint ``cable``, which does not stretch.

    Attributes:
        through: The links, from one end to the other, such as ``[weight, pulley, door]``.
        stiffness: Of the whole cable: modulus times cross-section over its length.
        damping: Such as ``50 N*s/m``.
        free_length: Length without tension.
    """

    through: Annotated[list[str], msgspec.Meta(min_length=2)]
    stiffness: Stiffness
    free_length: Span
    damping: Damping = 0.0

    def bind(self, model: pin.Model, joints: Mapping[str, Joint]) -> ForceElement:
        """Return the element of one model.

        Raises:
            InputError: A link does not exist, or the cable ties nothing that moves.
        """
        path = PathLength.through(model, self.through)
        return TautSpring(model, path, path, float(self.stiffness), float(self.damping), float(self.free_length))


class TautSpring(AlongCoordinate, frozen=True):
    """``effort = -max(k (w - w0) + c w', 0)`` along a path of the length w where ``w > w0``, and 0 elsewhere.

    Steps end where it becomes taut or slack and, with a damper, where the tension ends.

    Attributes:
        path: The same as ``coordinate``.
        stiffness: k [N/m].
        damping: c [N*s/m].
        rest: w0 [m].
    """

    path: PathLength
    stiffness: float
    damping: float
    rest: float

    def effort(self, t: Array | float, w: Array, rate: Array) -> Array:
        return -self._tension(w, rate)

    def _tension(self, w: Array, rate: Array) -> Array:
        return np.where(self._taut(w), np.maximum(self._pull(w, rate), 0.0), 0.0)

    def _taut(self, w: Array) -> Flags:
        return np.asarray(w > self.rest - TOUCHING * (1.0 + self.rest))

    def _pull(self, w: Array, rate: Array) -> Array:
        return np.asarray(self.stiffness * (w - self.rest) + self.damping * rate)

    def potential_energy(self, q: Array) -> Array:
        """Return ``k d^2 / 2`` of the extension d."""
        return np.asarray(0.5 * self.stiffness * np.maximum(self._length(q) - self.rest, 0.0) ** 2)

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        """Return ``(S - k d) w'``: of the damper, and of a cable that slackens before it has drawn back."""
        w, rows = self._evaluated(q, v)
        rate = (rows * v).sum(axis=-1)
        return np.asarray((self._tension(w, rate) - self.stiffness * np.maximum(w - self.rest, 0.0)) * rate)

    @property
    def conservative(self) -> bool:
        return not self.damping

    def edges(self) -> list[Edge]:
        """Return where the cable becomes taut or slack and, with a damper, where the tension of a taut one ends."""
        found = [self._edge(lambda w, rate: w - self.rest)]
        return [*found, self._edge(self._pull, self._taut)] if self.damping else found

    def _length(self, q: Array) -> Array:
        return self._evaluated(q, np.zeros((*q.shape[:-1], self.model.nv)))[0]

    @property
    def points(self) -> tuple[int, ...]:
        return self.path.frames

    def measures(self) -> Mapping[str, ElementQuantity]:
        return {
            "length": ElementQuantity(METRE, lambda t, q, v: self._length(q)),
            "tension": ElementQuantity(unit("N"), lambda t, q, v: -self.efforts(t, q, v)),
        }

    @property
    def description(self) -> str:
        return f"cable through {self.path.words(self.model)}"
