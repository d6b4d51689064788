"""Records: copies with other fields, what they keep, and which of them are equal."""

import pickle
from functools import cached_property

import numpy as np
import pytest

from pinarm.records import Record, ValueRecord, replace


class Rod(Record, frozen=True):
    length: float
    loads: object = ()

    @cached_property
    def doubled(self):
        return 2.0 * self.length


class Length(ValueRecord, frozen=True):
    value: float


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
