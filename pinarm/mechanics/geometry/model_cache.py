"""What is computed of a Pinocchio model once, and kept for as long as the model lives."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from functools import update_wrapper
from typing import TypeVar

import pinocchio as pin

T = TypeVar("T")


def cached_by_model(compute: Callable[[pin.Model], T]) -> Callable[[pin.Model], T]:
    """Return a function of a model that computes its value once for each model.

    Models are told apart by identity, since Pinocchio compares them number by number. A model must not change any more
    once the function has been called with it, and the value must not refer to it: neither would ever be freed.
    """
    known: dict[int, T] = {}

    def value(model: pin.Model) -> T:
        try:
            return known[id(model)]
        except KeyError:
            known[id(model)] = found = compute(model)
            weakref.finalize(model, known.pop, id(model), None)
            return found

    return update_wrapper(value, compute)
