"""Force elements: lengths, tensions, displacements and forces; powers of forces, of weights and of friction."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from typing import ClassVar

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.quantities.family import AXES, WATT, Asked, Family, Offered
from pinarm.engine.series import Series
from pinarm.mechanics.forces.force_element import ElementQuantity, ForceElement, power
from pinarm.mechanics.joints import Joint, effort_unit


def _measures_of(element: ForceElement, joints: Mapping[str, Joint]) -> Mapping[str, ElementQuantity]:
    """Return the quantities of an element: its measures, or else the effort where it acts at a single joint."""
    if own := element.measures():
        return own
    acts_at = np.atleast_1d(getattr(element, "v", ())).tolist()
    joint = next((joint for joint in joints.values() if [joint.v] == acts_at), None)
    return (
        {}
        if joint is None
        else {"effort": ElementQuantity(effort_unit(joint.unit), partial(_effort, element, joint.v))}
    )


def _effort(element: ForceElement, index: int, t: Array, q: Array, v: Array) -> Array:
    """Return the load of an element at an index of v in n states, shape (n,)."""
    tau = np.zeros_like(v)
    element.add_load(t, q, v, tau)
    return tau[..., index]


class ForceQuantities(Family, frozen=True):
    """``force.F...``: the measures of force element F."""

    element: ClassVar[str] = "F"
    meanings: ClassVar[Mapping[str, str]] = {
        "length": "distance of the ends of a point spring",
        "tension": "pull of a point spring on its ends",
        "effort": "effort along the coordinate, or at the joint, that the element acts along",
        "displacement": "of a bushing: of its second frame from the first",
        "rotation": "of a bushing: rotation vector of its second frame from the first",
        "force": "of a bushing: force of the first link on the second, at the second one's frame",
        "moment": "of a bushing: moment of the first link on the second, about the second one's frame",
    }

    def entries(self) -> Iterator[Offered]:
        for name, force in self.run.dynamics.forces.items():
            for part, measure in _measures_of(force, self.run.mechanism.joints).items():
                yield Offered(name, part, AXES if measure.vector else ())

    def series(self, asked: Asked) -> Series:
        run, force = self.run, self.run.dynamics.forces.get(asked.of)
        measure = _measures_of(force, run.mechanism.joints).get(asked.part) if force else None
        if measure is None or (len(asked.words) > 2) != measure.vector or "about" in asked.words[2:]:
            raise asked.unknown

        def values(dynamics: Dynamics, rows: slice) -> Array:
            here = _measures_of(dynamics.forces[asked.of], run.mechanism.joints)[asked.part]
            return here.values(run.grid.t[rows], run.q[rows], run.v[rows])

        measured = run.gather(values)
        return Series(asked.name, measure.unit, self.component(asked, measured) if measure.vector else measured)


class PowerQuantities(Family, frozen=True):
    """``power.gravity``, ``power.friction``, and ``power.F`` of force element F."""

    element: ClassVar[str] = ""
    meanings: ClassVar[Mapping[str, str]] = {
        "gravity": "power of the weights",
        "friction": "power of all friction that sticks",
        "": "power of the force element on the mechanism",
    }

    def entries(self) -> Iterator[Offered]:
        yield Offered("", "gravity")
        if self.run.mechanism.frictions:
            yield Offered("", "friction")
        yield from (Offered(name, "") for name in self.run.dynamics.forces)

    def series(self, asked: Asked) -> Series:
        run, wanted = self.run, ".".join(asked.words)
        if wanted == "gravity":
            return Series(asked.name, WATT, self.evaluation.gravity_power)
        if wanted == "friction" and run.mechanism.frictions:
            self.require_efforts(asked)
            return Series(asked.name, WATT, (run.friction_loads * run.v).sum(axis=1))
        if wanted not in run.dynamics.forces:
            raise asked.unknown
        values = run.gather(
            lambda dynamics, rows: power(dynamics.forces[wanted], run.grid.t[rows], run.q[rows], run.v[rows])
        )
        return Series(asked.name, WATT, values)
