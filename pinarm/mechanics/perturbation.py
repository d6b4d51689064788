"""A problem whose numbers differ in their last digits: what rounding can do to a result is seen by solving it again.

Algorithms of mechanics are backward stable in the main: what they give is exact for numbers that differ from the given
ones in the last digits. How far that moves a result, its conditioning, is what the difference of two solutions tells.
The numbers are those of the model, and those of forces and initial states: a spring of 1 N/m that is free at 1 km has
another force by 1e-13 N wherever its end is, as much as 1e-13 m of that is.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

import msgspec
import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.input.units import unit
from pinarm.input.yaml.schema import Measured, PureNumber
from pinarm.mechanics.loading.model_tree import inertia

PERTURBATION = 4.0 * float(np.finfo(float).eps)
"""Largest relative change of a number: the rounding of a few operations."""

SECOND = unit("s")


Given = TypeVar("Given")


def perturbed_numbers(given: Given, generator: np.random.Generator) -> Given:
    """Return the content of a file with its quantities changed by between a half and all of ``PERTURBATION``.

    None by much less: of few numbers, as an initial position, one that hardly changes would show nothing. What is 0
    stays 0. Times, and what else laws run along, stay, so that rows and jumps stand where they did; so do numbers
    without a unit, such as an efficiency of 1.
    """
    changed: object = given
    if isinstance(given, PureNumber):
        return given
    if isinstance(given, Measured):
        is_time = given.unit is not None and given.unit.dimension == SECOND.dimension
        changed = given if is_time or given.along == 1 else _near(given, generator)
    elif isinstance(given, msgspec.Struct):
        fields = {name: perturbed_numbers(getattr(given, name), generator) for name in given.__struct_fields__}
        changed = msgspec.structs.replace(given, **fields)
    elif isinstance(given, Mapping):
        changed = {name: perturbed_numbers(value, generator) for name, value in given.items()}
    elif isinstance(given, list | tuple):
        changed = type(given)(perturbed_numbers(value, generator) for value in given)
    return changed  # type: ignore[return-value]


def _near(quantity: Measured, generator: np.random.Generator) -> Measured:
    change = PERTURBATION * generator.uniform(0.5, 1.0) * generator.choice((-1.0, 1.0))
    near = type(quantity)(quantity * (1.0 + change))
    near.unit = quantity.unit
    return near


def perturbed(model: pin.Model, seed: int) -> pin.Model:
    """Return a copy of a model whose lengths, masses, moments of inertia and gravity differ by up to ``PERTURBATION``.

    What is 0 stays 0, so that planes stay planes, but a loop that closes only at special lengths is off by the change.
    """
    generator, changed = np.random.default_rng(seed), pin.Model(model)

    def near(numbers: Array) -> Array:
        return numbers * (1.0 + PERTURBATION * generator.uniform(-1.0, 1.0, np.shape(numbers)))

    for index in range(1, model.njoints):
        joint, body = model.jointPlacements[index], model.inertias[index]
        changed.jointPlacements[index] = pin.SE3(joint.rotation, near(joint.translation))
        moments = near(body.inertia)
        mass = float(near(np.array(body.mass)))
        changed.inertias[index] = inertia(mass, near(body.lever), (moments + moments.T) / 2.0)
    for index, frame in enumerate(model.frames):
        if frame.type != pin.FrameType.JOINT:
            changed.frames[index].placement = pin.SE3(frame.placement.rotation, near(frame.placement.translation))
    changed.armature = near(model.armature)
    changed.gravity.linear = near(model.gravity.linear)
    return changed
