"""Records: copies with other fields, what they keep, and which of them are equal."""

import pickle
from abc import ABC, abstractmethod
from functools import cached_property

import numpy as np
import pytest

from pinarm.records import AbstractRecord, Record, ValueRecord, replace


class Rod(Record, frozen=True):
    length: float
    loads: object = ()

    @cached_property
    def doubled(self):
        return 2.0 * self.length


class Length(ValueRecord, frozen=True):
    value: float


class Named(Record, frozen=True):
    name: str
    place: int = 0

    def __eq__(self, other):
        return self.name == other.name if isinstance(other, Named) else NotImplemented

    def __hash__(self):
        return hash(self.name)


def test_a_copy_with_other_fields():
    rod = Rod(1.0, "own")
    changed = replace(rod, length=3.0)
    assert (type(changed), changed.length, changed.loads, rod.length) == (Rod, 3.0, "own", 1.0)
    with pytest.raises(TypeError):
        replace(rod, mass=1.0)
    with pytest.raises(AttributeError):
        rod.length = 2.0


def test_what_is_kept_belongs_to_one_record():
    rod = Rod(1.0)
    assert rod.doubled == 2.0
    assert "doubled" in vars(rod)
    assert replace(rod, length=2.0).doubled == 4.0
    assert pickle.loads(pickle.dumps(rod)).doubled == 2.0


def test_equality():
    """Records with arrays are keys of a dictionary, by what they are, and not by what is in them."""
    rod, other = Rod(1.0, np.zeros(2)), Rod(1.0, np.zeros(2))
    assert {rod: 1, other: 2} == {rod: 1, other: 2}
    assert rod != other
    assert {Length(1.0), Length(1.0)} == {Length(1.0)}


class Element(ABC):
    @abstractmethod
    def energy(self): ...


class Spring(AbstractRecord, Element, frozen=True):
    unshown = ("model",)

    model: object
    stiffness: float
    _kept: tuple = ()

    def energy(self):
        return 0.5 * self.stiffness


class Unfinished(AbstractRecord, Element, frozen=True):
    stiffness: float


def test_a_record_of_an_abstract_base():
    spring = Spring(object(), 3.0)
    assert isinstance(spring, Element)
    assert replace(spring, stiffness=4.0).energy() == 2.0
    with pytest.raises(TypeError, match="abstract"):
        Unfinished(1.0)


def test_unequal_is_the_opposite_of_equal():
    one, same, other, rod = Named("A", 1), Named("A", 2), Named("B", 1), Rod(1.0)
    assert [one == x for x in (same, other, rod)] == [True, False, False]
    assert [one != x for x in (same, other, rod)] == [False, True, True]
    assert [rod != x for x in (rod, Rod(1.0))] == [False, True]
