"""Weights by which quantities of different kinds are added: of drives that share a load, of joints near a posture."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Self

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, Key, UnitError, choices, within
from pinarm.input.units import DIMENSIONLESS, Unit
from pinarm.input.yaml.schema import Measured, check_unit


class Weight(Measured):
    """A positive number, bare or with the reciprocal of the unit of what it weighs, such as ``0.02 1/N``."""

    above = 0.0

    @classmethod
    def read(cls, value: object, *, bare: bool = True) -> Self:
        """Read a weight; see ``Measured.read``. A number without unit is one, in files too."""
        return super().read(value, bare=True)

    @property
    def plain(self) -> bool:
        return self.unit is None or self.unit.dimension == DIMENSIONLESS.dimension


def weights_of(weights: Mapping[str, Weight], units: Mapping[str, Unit], kind: str, key: str, apart: str) -> Array:
    """Return the weights of quantities in the order of their units, shape (n,); 1 where none are given.

    Args:
        weights: Name -> weight.
        units: Name -> unit of what is weighed.
        kind: What the names are, for messages, such as ``drive of this run``.
        key: Key of the problem that holds the weights.
        apart: Why quantities of several dimensions need weights, in words.
    """
    several = len({measured.dimension for measured in units.values()}) > 1
    if not weights and several:
        hint = ", ".join(f"{name}: 1 {reciprocal(measured)}" for name, measured in units.items())
        raise InputError(
            f"{apart} have no common sum of squares: it would depend on the unit of length",
            expected="weights with units, such as the reciprocals of rated efforts, or of the ranges of joints",
            hint=f"{key}: {{weights: {{{hint}}}}}",
        )
    if not weights:
        return np.ones(len(units))
    with within("weights"):
        check_names(weights, units, kind)
        if missing := [name for name in units if name not in weights]:
            raise InputError(
                f"no weight is given for {', '.join(missing)}", expected=f"one for every {kind.split()[0]}"
            )
        if several or not all(weight.plain for weight in weights.values()):
            for name, measured in units.items():
                with within(name):
                    _check_reciprocal(weights[name], measured)
    return np.array([float(weights[name]) for name in units])


def check_names(names: Iterable[str], known: Iterable[str], kind: str) -> None:
    """Raise where a name is none of those known."""
    for name in names:
        if name not in known:
            with within(Key(name)):
                expected, hint = choices(name, known)
                raise InputError(f"'{name}' is no {kind}", expected=expected, hint=hint)


def reciprocal(measured: Unit) -> str:
    """Return the unit of a weight as files have it."""
    return f"1/{measured}".replace("*", "/")


def _check_reciprocal(weight: Weight, measured: Unit) -> None:
    if weight.plain and measured.dimension != DIMENSIONLESS.dimension:
        raise UnitError(
            f"the weight {weight:g} has no unit",
            hint=f"{weight:g} {reciprocal(measured)}",
            expected="a unit for every weight, where different kinds of quantities are weighed, or another "
            "weight has one",
        )
    check_unit(weight, DIMENSIONLESS / measured)
