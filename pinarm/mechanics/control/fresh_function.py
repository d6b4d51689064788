"""A function that remembers, as it was given, at the beginning of every integration.

A motion is integrated more than once where it is small, where its error is estimated or a target of it is looked for.
What the function of a sampled controller has seen in one integration it must not know in the next.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from types import CellType, FunctionType
from typing import Any


class FreshFunction:
    """A function whose first integration calls itself, and every later one a copy of what it was before that.

    Of an object that is called, and of the variables of a function that belong to it, that is what ``copy.deepcopy``
    makes of them; what cannot be copied, and what is remembered elsewhere, as in global variables, stays.

    Args:
        function: The function.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self.own, self.kept, self.now = function, copied(function, {}), function
        self.begun = False

    def begin(self) -> None:
        self.now = copied(self.kept, {}) if self.begun else self.own
        self.begun = True

    def __call__(self, *given: Any) -> Any:
        return self.now(*given)


def copied(thing: Any, known: dict[int, Any]) -> Any:
    """Return a copy of a function, with its variables, or of another object; the same where it cannot be copied.

    Args:
        thing: What is copied.
        known: Copies that were made already, by the ``id`` of the originals, as for ``copy.deepcopy``.
    """
    if isinstance(thing, FunctionType):
        return _copied_function(thing, known)
    try:
        return copy.deepcopy(thing, known)
    except Exception:  # whatever an object of the user's raises there
        return thing


def _copied_function(function: FunctionType, known: dict[int, Any]) -> FunctionType:
    held = function.__closure__, function.__defaults__, function.__kwdefaults__, function.__dict__
    if id(function) in known or not any(held):
        return known.get(id(function), function)  # type: ignore[no-any-return]
    cells = function.__closure__ or ()
    fresh = {id(cell): CellType() for cell in cells if id(cell) not in known}
    known.update(fresh)
    closure = tuple(known[id(cell)] for cell in cells)
    made = FunctionType(function.__code__, function.__globals__, function.__name__, None, closure)
    known[id(function)] = made
    made.__defaults__, made.__kwdefaults__ = (
        copied(function.__defaults__, known),
        copied(function.__kwdefaults__, known),
    )
    made.__dict__.update(copied(function.__dict__, known))
    for cell in cells:
        if id(cell) in fresh and _is_filled(cell):
            known[id(cell)].cell_contents = copied(cell.cell_contents, known)
    return made


def _is_filled(cell: CellType) -> bool:
    try:
        cell.cell_contents  # noqa: B018  raises where a variable has no value yet
    except ValueError:
        return False
    return True
