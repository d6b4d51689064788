"""Trees whose free motion the compiled library computes, under springs, dampers and steady efforts at joints.

Pinocchio judges it: before the first step the accelerations of the two are compared, which share no code.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.kernel.library import Flow, library, pointer
from pinarm.engine.kernel.links import links_of
from pinarm.engine.kernel.structures import (
    DegreeStateStructure,
    DegreeStructure,
    FlowStructure,
    LinkStateStructure,
    LinkStructure,
    RotationSpringStructure,
    ScrewStructure,
    TreeStructure,
)
from pinarm.mechanics.forces.force_element import ForceElement

if TYPE_CHECKING:
    from pinarm.engine.integration.integrator import Acceleration
    from pinarm.mechanics.forces.joint_springs import SpringDamper

AGREEMENT = 1e-12
"""Largest difference to Pinocchio's accelerations, relative to these and to the squares of velocities: a thousand
times the rounding on usual trees, and below what any tolerance of an integration asks for."""

STATES = 3
"""Number of states at which they are compared."""

DISAGREES = "the compiled kernel is not used: its accelerations differ from Pinocchio's by {:.1e}"


@dataclass(frozen=True, eq=False)
class CompiledTree:
    """A tree as the library knows it.

    Attributes:
        model: Pinocchio's model.
        links: Its links.
        screws: The screw of each velocity.
    """

    model: pin.Model
    links: Sequence[LinkStructure]
    screws: Sequence[ScrewStructure]

    @classmethod
    def of(cls, model: pin.Model) -> CompiledTree | None:
        """Return the tree of a model; ``None`` where there is no library, or it does not know a joint of the model."""
        known = links_of(model) if library() is not None and model.nv else None
        return cls(model, *known) if known else None

    def flow(self, steady: Array, changing: Sequence[ForceElement]) -> Flow | None:
        """Return the free motion under loads; ``None`` where the library does not know one of them, or refuses.

        Args:
            steady: The sum of the steady loads [N*m or N], shape (nv,).
            changing: The other force elements; springs and dampers at joints as one, see ``forces.summed``.
        """
        from pinarm.mechanics.forces.joint_springs import BallSpring, SpringDamper

        springs = [one for one in changing if isinstance(one, SpringDamper)]
        balls = [
            RotationSpringStructure(one.q, one.v, one.stiffness) for one in changing if isinstance(one, BallSpring)
        ]
        if len(springs) + len(balls) < len(changing) or len(springs) > 1:
            return None
        model, links = self.model, _array(LinkStructure, self.links)
        degrees, held = _array(DegreeStructure, self._degrees(steady, springs)), _array(RotationSpringStructure, balls)
        buffers = (LinkStateStructure * len(links))(), (DegreeStateStructure * model.nv)(), np.zeros(model.nv)
        tree = TreeStructure(
            len(links), model.nq, model.nv, len(balls), tuple(model.gravity.linear),
            *map(ctypes.addressof, (links, degrees, held, *buffers[:2])), pointer(buffers[2]),
        )  # fmt: skip
        compiled = library()
        if compiled is None or compiled.tree_check(ctypes.byref(tree)):
            return None
        rates = ctypes.cast(compiled.tree_rates, ctypes.c_void_p).value
        structure = FlowStructure(model.nq + model.nv, rates, ctypes.addressof(tree))
        return Flow(structure, (tree, links, degrees, held, buffers))

    def _degrees(self, steady: Array, springs: Sequence[SpringDamper]) -> list[DegreeStructure]:
        """Return each velocity with its rotor and what acts along it."""
        rotors, efforts = self.model.armature.tolist(), steady.tolist()
        degrees = [
            DegreeStructure(*each) for each in zip(self.screws, (0,) * len(rotors), rotors, efforts, strict=True)
        ]
        for spring in springs:
            numbers = (spring.q, spring.v, spring.stiffness, spring.damping, spring.rest)
            for q, v, *coefficients in zip(*(each.tolist() for each in numbers), strict=True):
                degree = degrees[v]
                degree.sprung, (degree.stiffness, degree.damping, degree.rest) = q, coefficients
        return degrees


def rates(flow: Flow, y: Array) -> Array:
    """Return the slope of a state [q, v], shape (nq + nv,)."""
    state, slope = np.array(y, float), np.empty(len(y))
    compiled = library()
    if compiled is None:
        raise ValueError("there is no compiled library")
    system = ctypes.c_void_p(flow.structure.system)
    compiled.tree_rates(system, ctypes.c_double(0.0), *(ctypes.c_void_p(pointer(x)) for x in (state, slope)))
    return slope


def disagreement(model: pin.Model, flow: Flow, acceleration: Acceleration) -> float:
    """Return the largest difference of a flow's accelerations to those of another route, relative to ``|a| + |v|^2``.

    They are compared in states of no special kind, whose coordinates and velocities are about 1, the same every time.
    """
    k, differences = np.arange(model.nv), []
    for i in range(STATES):
        q = pin.integrate(model, pin.neutral(model), np.sin(1.0 + 7.1 * i + 1.3 * k))
        v = np.cos(2.0 + 3.7 * i + 2.9 * k)
        expected = acceleration(0.0, q, v)
        apart = rates(flow, np.concatenate([q, v]))[model.nq :] - expected
        differences.append(float(np.linalg.norm(apart) / (np.linalg.norm(expected) + v @ v)))
    return float(np.max(differences))


def _array(structure: type[ctypes.Structure], items: Sequence[Any]) -> Any:
    return (structure * len(items))(*items)
