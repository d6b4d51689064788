"""Arrays of states with any leading axes: folded into rows where they come in, unfolded where results go out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from operator import truediv
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, real
from pinarm.engine.series import Series, require_unit
from pinarm.errors import InputError
from pinarm.input.units import DIMENSIONLESS, Unit, unit

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pinarm.engine.mechanism import Mechanism
    from pinarm.mechanics.loading.pinocchio_layout import PinocchioLayout


def refuse_foreign(mechanism: Mechanism, q: ArrayLike, **rates: ArrayLike | None) -> None:
    """Raise where arrays are not what the mechanism takes.

    Args:
        mechanism: The mechanism.
        q: Configurations.
        rates: ``v``, ``a`` and ``tau``, as far as they are given.

    Raises:
        InputError: Configurations have the width of those of ``pin.buildModelFromUrdf``; says what converts them.
        UnitError: A ``Series`` measures what no coordinate of the mechanism has.
    """
    for name, x in {"q": q, **rates}.items():
        if isinstance(x, Series):
            require_unit(x, name, *_measures(mechanism, name))
    nq, shape = mechanism.model.nq, real(q, "q").shape
    layout = _foreign(mechanism) if shape and shape[-1] != nq else None
    if layout is not None and shape[-1] == layout.p_nq:
        raise InputError(f"q has the shape {shape}, as Pinocchio has it", expected=f"(..., {nq})",
                         hint=f"q, v = mechanism.from_pinocchio(q, v): {layout.words()}")  # fmt: skip


def _measures(mechanism: Mechanism, name: str) -> set[Unit]:
    """Return in what q, v, a or tau of the coordinates of a mechanism are measured."""
    second, angles = unit("s"), [unit("rad")] if mechanism.balls else []
    coordinates = {*(joint.unit for joint in mechanism.joints.values()), *angles}
    if name == "tau":
        return {unit("N*m" if own.dimension == DIMENSIONLESS.dimension else "N") for own in coordinates}
    per = {"q": [], "v": [second], "a": [second, second]}[name]
    return {reduce(truediv, per, own) for own in coordinates}


def _foreign(mechanism: Mechanism) -> PinocchioLayout | None:
    """Return where Pinocchio's reader has the joints; ``None`` where it has no such model."""
    try:
        return mechanism.pinocchio_layout
    except InputError:
        return None


@dataclass(frozen=True)
class LeadingAxes:
    """The leading axes of the arrays of one call.

    Attributes:
        shape: Their lengths; none where a single state was given.
    """

    shape: tuple[int, ...]

    @classmethod
    def fold(cls, **given: tuple[ArrayLike, int]) -> tuple[LeadingAxes, list[Array]]:
        """Return the leading axes that arrays share, and the arrays as rows, each of shape (n, width).

        Args:
            given: Name -> array of shape (..., width), and its width.

        Raises:
            InputError: A last axis has another length, the leading axes differ, or something is no real number.
        """
        arrays = {name: real(x, name) for name, (x, _) in given.items()}
        for name, x in arrays.items():
            width = given[name][1]
            if x.ndim == 0 or x.shape[-1] != width:
                raise InputError(f"{name} has the shape {x.shape}", expected=f"(..., {width}), such as ({width},)")
        if len({x.shape[:-1] for x in arrays.values()}) > 1:
            shapes = ", ".join(f"{name}: {x.shape}" for name, x in arrays.items())
            raise InputError(f"the arrays have the shapes {shapes}", expected="the same axes before the last one")
        shape = next(iter(arrays.values())).shape[:-1]
        return cls(shape), [x.reshape(-1 if x.size else 0, given[name][1]) for name, x in arrays.items()]

    def unfold(self, rows: Array) -> Array:
        """Return what was computed row by row, shape (n, ...), with the leading axes in place of the first."""
        return rows.reshape((*self.shape, *rows.shape[1:]))

    def place(self, row: int) -> str:
        """Return how messages call a row."""
        if len(self.shape) == 1:
            return f"row {row}"
        return f"state {tuple(map(int, np.unravel_index(row, self.shape)))}" if self.shape else "the state"
