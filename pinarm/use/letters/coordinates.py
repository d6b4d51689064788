"""The coordinates in which equations are written, with the symbols that the mechanism has for them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import sympy

from pinarm.engine.mechanism import Mechanism
from pinarm.errors import InputError
from pinarm.mechanics.coordinates import LinearCoordinate
from pinarm.records import ValueRecord
from pinarm.use.letters.traced_model import exact, letter


class LetteredCoordinate(ValueRecord, frozen=True):
    """A coordinate w of a mechanism.

    Attributes:
        name: Its name.
        value: Symbol of w.
        rate: Symbol of its velocity.
        second: Symbol of its acceleration.
    """

    name: str
    value: sympy.Symbol
    rate: sympy.Symbol
    second: sympy.Symbol


class LetteredCoordinates(ValueRecord, frozen=True):
    """Coordinates that equations are written in.

    Attributes:
        mechanism: Whose they are.
        chosen: They, as many as joints, and those that are prescribed beside them.
        joints: Joint -> its coordinate as a formula of these.
    """

    mechanism: Mechanism
    chosen: tuple[LetteredCoordinate, ...]
    joints: Mapping[str, sympy.Expr]

    def shares(self, name: str) -> dict[str, sympy.Expr]:
        """Return the joints that a coordinate is a sum of, with their weights.

        Raises:
            InputError: It is another coordinate.
        """
        if isinstance(self.mechanism.coordinates.get(name), LinearCoordinate):
            return _weights(self.mechanism, name)
        raise InputError(f"a force along '{name}' is not written in letters", expected="a joint or a sum of joints")

    def rate(self, formula: Any) -> Any:
        """Return the derivative of a formula, or of each entry of a matrix, with respect to time."""
        pairs = [pair for c in self.chosen for pair in ((c.value, c.rate), (c.rate, c.second))]
        first, *others = (formula.diff(known) * rate for known, rate in pairs)
        return sum(others, first)


def named_symbols(mechanism: Mechanism) -> dict[str, str]:
    """Return quantity -> the symbol that the mechanism's file has for it."""
    return {formula.text: name for name, formula in reversed([*mechanism.symbols.items()])}


def lettered_coordinates(mechanism: Mechanism, prescribed: Iterable[str] = ()) -> LetteredCoordinates:
    """Return the coordinates of the joints; a sum of joint coordinates takes the place of the last joint in it."""
    symbols, sums = named_symbols(mechanism), _sums(mechanism)
    joints: dict[str, sympy.Expr] = {}
    chosen: list[LetteredCoordinate] = []
    for name in mechanism.joints:
        total = sums.get(name, name)
        chosen.append(_coordinate(total, "joint" if total == name else "coordinate", symbols))
        value: Any = chosen[-1].value
        if total != name:
            weights = _weights(mechanism, total)
            value = (value - sum(weights[other] * joints[other] for other in weights if other != name)) / weights[name]
        joints[name] = value
    others = (name for name in prescribed if name not in joints and name not in sums.values())
    chosen += [_coordinate(name, "coordinate", symbols) for name in others]
    return LetteredCoordinates(mechanism, tuple(chosen), joints)


def _sums(mechanism: Mechanism) -> dict[str, str]:
    """Return joint -> the sum of several joint coordinates that ends with it."""
    order, sums = [*mechanism.joints], dict[str, str]()
    for name, coordinate in mechanism.coordinates.items():
        if name not in mechanism.joints and isinstance(coordinate, LinearCoordinate) and coordinate.joint is None:
            sums.setdefault(max(_weights(mechanism, name), key=order.index), name)
    return sums


def _weights(mechanism: Mechanism, name: str) -> dict[str, sympy.Expr]:
    weights: Sequence[float] = mechanism.coordinates[name].weights.tolist()  # type: ignore[union-attr]
    places = {joint.v: joint.name for joint in mechanism.joints.values()}
    return {places[v]: exact(weight) for v, weight in enumerate(weights) if weight}


def _coordinate(name: str, kind: str, symbols: Mapping[str, str]) -> LetteredCoordinate:
    plain = symbols.get(f"{kind}.{name}.position", re.sub(r"\W", "_", name))
    rate = symbols.get(f"{kind}.{name}.velocity", f"{plain}d")
    second = symbols.get(f"{kind}.{name}.acceleration", f"{plain}dd")
    return LetteredCoordinate(name, *map(letter, (plain, rate, second)))
