"""What is computed of a model is computed once, and goes with it."""

import gc
import weakref

import pinocchio as pin

from pinarm.mechanics.geometry.model_cache import cached_by_model


class Value:
    """Something that can be seen to be gone."""


def test_a_value_is_computed_once_for_each_model_and_goes_with_it():
    computed = []

    @cached_by_model
    def value(model):
        computed.append(model.nv)
        return Value()

    first, second = pin.buildSampleModelManipulator(), pin.buildSampleModelManipulator()
    assert first == second, "equal by their numbers"
    assert value(first) is value(first) is not value(second)
    assert computed == [first.nv, second.nv]
    gone = weakref.ref(value(first))
    del first
    gc.collect()
    assert gone() is None and value(second) is not None
