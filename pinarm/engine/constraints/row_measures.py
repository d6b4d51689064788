"""What one constraint or coordinate measures, at many configurations at once: value, rows of J and drifts.

The same numbers as those of ``Constraint`` and ``Coordinate``, for mechanisms whose joints turn or slide. Arrays have
the n configurations along their last axis, or 1 where a number is the same in all of them.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import TYPE_CHECKING, Protocol

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.constraint import Constraint, GuidedCoordinate
from pinarm.engine.constraints.nullspaces.elimination import Row
from pinarm.mechanics.coordinates import Coordinate, DistanceCoordinate, FrameCoordinate, LinearCoordinate
from pinarm.mechanics.couplings.coupling import Coupling, JointRelation
from pinarm.mechanics.geometry.chains import Chain, Placed
from pinarm.mechanics.geometry.model_variants import Model
from pinarm.mechanics.geometry.vectors import dot
from pinarm.mechanics.joints import UNIVERSE
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.mechanics.loops.lower_pairs import PointOnPlane
from pinarm.mechanics.loops.rod import Tie
from pinarm.records import Record, replace

if TYPE_CHECKING:
    from pinarm.mechanics.loops.pair import Pair


class EvaluatedRows(Protocol):
    """The rows of one constraint or coordinate, at many configurations."""

    def gap(self) -> list[Array]:
        """Return the value of every row [m or rad], shape (n,) or (1,)."""
        ...

    def rows(self, wanted: Container[int]) -> Mapping[int, Row]:
        """Return the wanted rows of J."""
        ...

    def drift(self, wanted: Container[int], v: Array) -> dict[int, Array]:
        """Return J' v of the wanted rows, shape (n,) or (1,), for velocities v, shape (nv, n)."""
        ...


class PairMeasure(Record, frozen=True):
    """What a pair measures between two frames.

    Attributes:
        pair: The pair.
        chain: The joints between the frames.
    """

    pair: Pair
    chain: Chain

    @property
    def size(self) -> int:
        """Number of rows."""
        return len(self.pair.along)

    def repeated(self, n: int) -> PairMeasure:
        """Return the measure for n rows of all variants."""
        return replace(self, chain=self.chain.repeated(n))

    def at(self, q: Array, cosine: Array, sine: Array) -> EvaluatedPair:
        """Return its rows at configurations q; cos(q) and sin(q) serve all measures. Each of shape (nv, n)."""
        return EvaluatedPair(self.pair, self.chain.placed(q, cosine, sine))


class EvaluatedPair(Record, frozen=True):
    """The rows of a pair at many configurations.

    Attributes:
        pair: The pair.
        placed: The chain between its frames.
    """

    pair: Pair
    placed: Placed

    def gap(self) -> list[Array]:
        """Return the open lengths and angles."""
        return self.pair.gap(self.placed.p, self.placed.axes)

    def rows(self, wanted: Container[int]) -> Mapping[int, Row]:
        """Return ``e . p' + w . omega``."""
        e, w = self._directions(wanted)
        found: dict[int, Row] = {k: self.placed.along(direction) for k, direction in e.items()}
        return found | {k: _sum(found.get(k, {}), self.placed.about(direction)) for k, direction in w.items()}

    def drift(self, wanted: Container[int], v: Array) -> dict[int, Array]:
        """Return ``e . p'' + w . omega' + e' . p' + w' . omega``, for a = 0."""
        dp, omega, ddp, domega = self.placed.rates(v)
        if self.pair.constant is not None:
            along, about = self.pair.constant
            return {k: x for k, x in enumerate(along @ ddp + about @ domega) if k in wanted}
        e, w = self._directions(wanted)
        bend = self.pair.bend(self.placed.p, self.placed.axes, dp, omega)
        found = {k: dot(direction, ddp) + bend[k] for k, direction in e.items()}
        return found | {k: dot(direction, domega) + found.get(k, bend[k]) for k, direction in w.items()}

    def _directions(self, wanted: Container[int]) -> tuple[dict[int, Array], dict[int, Array]]:
        """Return e and w of the wanted rows that have them, shape (3, n) or (3, 1)."""
        e, w = self.pair.directions(self.placed.p, self.placed.axes)
        along = {k: e[k].reshape(3, -1) for k, there in enumerate(self.pair.along) if there and k in wanted}
        return along, {k: w[k].reshape(3, -1) for k, there in enumerate(self.pair.about) if there and k in wanted}


def _sum(one: Row, two: Row) -> Row:
    """Return the sum of two rows."""
    return {**one, **{index: one[index] + x if index in one else x for index, x in two.items()}}


class SumMeasure(Record, frozen=True):
    """A weighted sum of joint coordinates less a constant.

    Attributes:
        weights: Place in q and v -> weight, shape (1,).
        constant: The constant [m or rad].
        size: One row.
    """

    weights: Row
    constant: float = 0.0
    size: int = 1

    @classmethod
    def of(cls, coordinate: LinearCoordinate, constant: float = 0.0) -> SumMeasure:
        """Return the sum that a coordinate is."""
        return cls({int(i): coordinate.weights[i : i + 1] for i in np.flatnonzero(coordinate.weights)}, constant)

    def repeated(self, n: int) -> SumMeasure:
        """Return the measure itself, which is the same in all variants."""
        return self

    def at(self, q: Array, cosine: Array, sine: Array) -> EvaluatedSum:
        """Return its row at configurations q, shape (nv, n)."""
        return EvaluatedSum(self, q)


class EvaluatedSum(Record, frozen=True):
    """The row of a sum at many configurations.

    Attributes:
        measure: The sum.
        q: Configurations, shape (nv, n).
    """

    measure: SumMeasure
    q: Array

    def gap(self) -> list[Array]:
        """Return the sum less its constant."""
        total = sum((weight * self.q[i] for i, weight in self.measure.weights.items()), np.zeros(1))
        return [total - self.measure.constant]

    def rows(self, wanted: Container[int]) -> dict[int, Row]:
        """Return the weights."""
        return {0: self.measure.weights} if 0 in wanted else {}

    def drift(self, wanted: Container[int], v: Array) -> dict[int, Array]:
        """Return nothing: the row is constant."""
        return {}


class RelationMeasure(Record, frozen=True):
    """A relation between joint coordinates whose row depends on them.

    Attributes:
        relation: The relation.
        size: One row.
    """

    relation: JointRelation
    size: int = 1

    def repeated(self, n: int) -> RelationMeasure:
        """Return the measure itself, which is the same in all variants."""
        return self

    def at(self, q: Array, cosine: Array, sine: Array) -> EvaluatedRelation:
        """Return its row at configurations q, shape (nv, n)."""
        return EvaluatedRelation(self.relation, q)


class EvaluatedRelation(Record, frozen=True):
    """The row of a relation at many configurations.

    Attributes:
        relation: The relation.
        q: Configurations, shape (nv, n).
    """

    relation: JointRelation
    q: Array

    def gap(self) -> list[Array]:
        """Return what is not closed."""
        return [self.relation.gaps_at(self.q.T)]

    def rows(self, wanted: Container[int]) -> dict[int, Row]:
        """Return the coefficients of the joints that it couples."""
        if 0 not in wanted:
            return {}
        rows = self.relation.rows_at(self.q.T)
        return {0: {int(v): rows[:, v] for v in self.relation.joints}}

    def drift(self, wanted: Container[int], v: Array) -> dict[int, Array]:
        """Return ``G' v``."""
        return {0: self.relation.drifts_at(self.q.T, v.T)} if 0 in wanted else {}


RowMeasure = PairMeasure | SumMeasure | RelationMeasure


def row_measure(model: Model, one: Constraint | Coordinate) -> RowMeasure | None:
    """Return what a constraint or coordinate measures; ``None`` where it cannot be had at many configurations."""
    if isinstance(one, GuidedCoordinate):
        return row_measure(model, one.coordinate)
    if isinstance(one, LinearCoordinate):
        return SumMeasure.of(one)
    if isinstance(one, Coupling):
        return SumMeasure.of(one.coordinate, one.constant)
    if isinstance(one, JointRelation):
        return RelationMeasure(one)
    if isinstance(one, LoopJoint):
        first, second, pair = one.first, one.second, one.pair
    elif isinstance(one, FrameCoordinate):
        first, second, pair = UNIVERSE, one.frame, PointOnPlane.around(one.axis)
    elif isinstance(one, DistanceCoordinate):
        first, second, pair = one.first, one.second, Tie(0.0)
    else:
        return None
    chain = Chain.between(model, first, second)
    return None if chain is None else PairMeasure(pair, chain)
