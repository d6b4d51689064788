"""Value, rate and row of any coordinate at one state or at many, for the loads that depend on it or act along it."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate, PairCoordinate, PathLength
from pinarm.mechanics.forces.force_element import Edge
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.records import AbstractRecord

if TYPE_CHECKING:
    from pinarm.mechanics.geometry.frame_pairs import FramePairs
    from pinarm.mechanics.geometry.pairs import TiedFrames


class MeasuredCoordinate(AbstractRecord, frozen=True):
    """A coordinate w with the row J, ``w' = J v``."""

    unshown: ClassVar[tuple[str, ...]] = ("model",)

    model: pin.Model
    coordinate: Coordinate

    def edge(self, value: Callable[[Array, Array], Array], counts: Callable[[Array], Flags] | None = None) -> Edge:
        """Return an edge at zeros of a function of w and its rate, which count where another one of w says so."""
        return Edge(lambda t, q, v: value(*self.moving(q, v)[:2]), counts and (lambda t, q, v: counts(self.values(q))))

    def values(self, q: Array) -> Array:
        """Return w, shape (...)."""
        return self._evaluated(q)[0]

    def moving(self, q: Array, v: Array) -> tuple[Array, Array, Array]:
        """Return w and its rate, shape (...), and J, shape (..., nv)."""
        w, rows = self._evaluated(q)
        return w, (rows * v).sum(axis=-1), rows

    def _evaluated(self, q: Array) -> tuple[Array, Array]:
        """Return w, shape (...), and J, shape (..., nv)."""
        if isinstance(self.coordinate, LinearCoordinate):
            weights = self.coordinate.weights
            values = np.asarray(q[..., self.coordinate.places] @ weights)
            return values, np.broadcast_to(weights, (*values.shape, len(weights)))
        states = q.reshape(-1, q.shape[-1])
        if len(states) == 1 and np.isrealobj(q):
            w, rows = self._of_state(Kinematics.at(self.model, states[0]))
        else:
            w, rows = self._of_frames(states)
        return w.reshape(q.shape[:-1]), rows.reshape(*q.shape[:-1], self.model.nv)

    def _of_state(self, state: Kinematics) -> tuple[Array, Array]:
        if not isinstance(self.coordinate, PairCoordinate):
            return np.array(self.coordinate.value(state)), np.asarray(self.coordinate.row(state))
        w, rows = self.coordinate.way.measured(state)
        return w + self.coordinate.missing_turns(w, state.q), rows

    def _of_frames(self, states: Array) -> tuple[Array, Array]:
        """Return w, shape (n,), and J, shape (n, nv), by the motions of the frames that the coordinate measures."""
        w, rows = np.zeros(len(states), states.dtype), np.zeros((self.model.nv, len(states)), states.dtype)
        for way, frames in self._ways:
            motion = frames.at_configurations(states)
            w += way.pair.gap(*motion.flat)[0]
            rows[frames.velocities[:, 0]] += motion.rows(way.pair)[0, :, 0]
        if isinstance(self.coordinate, PairCoordinate):
            w += self.coordinate.missing_turns(w, states)
        return w, rows.T

    @cached_property
    def _ways(self) -> list[tuple[TiedFrames, FramePairs]]:
        """The pairs of frames that the coordinate measures."""
        from pinarm.mechanics.geometry.frame_pairs import FramePairs  # for many states only

        along = self.coordinate
        assert isinstance(along, PairCoordinate | PathLength)
        return [(way, FramePairs.between(self.model, way.first, way.second)) for way in along.ways]
