"""What the coordinates of a controller follow, in the forms that files may give it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self, get_args

import msgspec

from pinarm.errors import InputError, Key, choices, within
from pinarm.input.yaml.schema import Readable, convert
from pinarm.input.yaml.validation_messages import explain, failing_path, unknown_key
from pinarm.mechanics.control.signals import Signal
from pinarm.mechanics.laws import Law
from pinarm.mechanics.laws.motion_law import MotionLaw


class References(Readable):
    """One law; a list of laws in the order of the coordinates; or coordinate -> law.

    Attributes:
        given: The laws.
    """

    __slots__ = ("given",)

    def __init__(self, given: Law | list[Law] | dict[str, Law]) -> None:
        self.given = given

    def __eq__(self, other: object) -> bool:
        return isinstance(other, References) and self.given == other.given

    def __hash__(self) -> int:
        return hash(repr(self.given))

    def __repr__(self) -> str:
        return repr(self.given)

    @classmethod
    def read(cls, value: object) -> Self:
        """Read any of the forms.

        Raises:
            InputError: A law has a mistake; its path leads there.
        """
        if isinstance(value, cls):
            return value
        if isinstance(value, list):
            return cls([_law(each, row) for row, each in enumerate(value)])
        if isinstance(value, dict) and all(isinstance(each, dict | MotionLaw) for each in value.values()):
            return cls({name: _law(each, name) for name, each in value.items()})
        return cls(_law(value))

    @classmethod
    def schema(cls) -> dict[str, object]:
        """Return the JSON Schema of the forms."""
        law = {"anyOf": [{"$ref": f"#/$defs/{kind.__name__}"} for kind in get_args(Law)]}
        listed, named = {"type": "array", "items": law}, {"type": "object", "additionalProperties": law}
        return {"anyOf": [law, listed, named]}

    def plain(self) -> object:
        """Return the laws, in the form in which they were given."""
        return self.given

    def laws(self, names: Sequence[str], signals: Sequence[Signal], rest: Law | None = None) -> tuple[Law, ...]:
        """Return the laws that signals follow, checked.

        Args:
            names: Names of the coordinates or drives, as the controller has them.
            signals: What is measured of them.
            rest: What coordinates follow that a map leaves out; ``None`` where it must not.

        Raises:
            InputError: A unit is another, the number of laws, or a name.
        """
        with within("follows"):
            laws = self._named(names, rest) if isinstance(self.given, dict) else self._listed(names)
            for key, law, signal in zip(self._keys(names), laws, signals, strict=True):
                with within(*key):
                    law.check_units(signal.unit)
        return tuple(laws)

    def _listed(self, names: Sequence[str]) -> list[Law]:
        laws: list[Any] = self.given if isinstance(self.given, list) else [self.given]
        if len(laws) != len(names):
            raise InputError(f"{len(laws)} law{'s are' if len(laws) != 1 else ' is'} given, for {', '.join(names)}",
                             expected=f"{len(names)}, one for each coordinate, as a list or by their names",
                             hint=f"{{{', '.join(f'{name}: ...' for name in names)}}}")  # fmt: skip
        return laws

    def _named(self, names: Sequence[str], rest: Law | None) -> list[Law]:
        assert isinstance(self.given, dict)
        for name in self.given:
            if name not in names:
                expected, hint = choices(name, names)
                with within(Key(name)):
                    raise InputError(
                        f"'{name}' is not what this controller moves or measures", expected=expected, hint=hint
                    )
        laws = {name: self.given.get(name, rest) for name in names}
        if missing := [name for name, law in laws.items() if law is None]:
            raise InputError(f"{', '.join(missing)} has no law to follow", expected="a law for each coordinate")
        return [law for law in laws.values() if law is not None]

    def _keys(self, names: Sequence[str]) -> list[tuple[str | int, ...]]:
        """Return where the law of each coordinate stands."""
        if isinstance(self.given, dict):
            return [(name,) for name in names]
        return [(row,) for row in range(len(names))] if isinstance(self.given, list) else [()]


def _law(value: Any, *at: str | int) -> Law:
    """Return the law that plain data say; one that was built in Python as it is.

    Raises:
        InputError: It has a mistake.
    """
    if isinstance(value, MotionLaw):
        return value  # type: ignore[return-value]  # Law is the union of its kinds
    try:
        return msgspec.convert(value, Law, dec_hook=convert)  # type: ignore[no-any-return]
    except msgspec.ValidationError as error:
        path = failing_path(error, value, Law)  # type: ignore[arg-type]  # a union of structs
        mistake = explain(error, value, path, Law)  # type: ignore[arg-type]
        mistake.path = (*at, *path, *map(Key, unknown_key(error)), *mistake.path)
        raise mistake from None
