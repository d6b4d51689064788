"""The kinds of coupling, and the one that says nothing of its parts: any linear relation between joints of one kind."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import msgspec
import numpy as np
import pinocchio as pin

from pinarm.errors import InputError, Key, within
from pinarm.input.yaml.schema import AnyQuantity, InputStruct, Measured, Weight
from pinarm.mechanics.couplings.belt import Belt
from pinarm.mechanics.couplings.cam import Cam
from pinarm.mechanics.couplings.coupling import Coupling, coupled
from pinarm.mechanics.couplings.gear import Gear, Rack
from pinarm.mechanics.couplings.screw import Screw
from pinarm.mechanics.joints import Joint, joint_of
from pinarm.records import replace


class WeightedSum(InputStruct, frozen=True, tag_field="kind", tag="sum"):
    """A weighted sum of joint coordinates stays constant: ``sum_i w_i q_i = value``, as of a differential.

    Which parts do it is not said: the reactions of the joints between are refused.

    Attributes:
        weights: Joint -> its weight w.
        value: The constant.
    """

    weights: Annotated[dict[str, Weight], msgspec.Meta(min_length=2)]
    value: AnyQuantity = 0.0

    def check(self) -> None:
        """Refuse weights of 0 or infinity."""
        for name, weight in self.weights.items():
            if not 0.0 < abs(weight) < np.inf:
                with within("weights", Key(name)):
                    raise InputError(f"the weight of {name} cannot be {weight:g}", expected="a finite number but 0")

    def bind(self, joints: Mapping[str, Joint], model: pin.Model, name: str) -> Coupling:
        """Return the coupling of one model.

        Raises:
            InputError: A joint is unknown, or angles and lengths are mixed.
        """
        weights = {joint_of(joints, joint): float(weight) for joint, weight in self.weights.items()}
        first = next(iter(weights))
        if any(joint.unit != first.unit for joint in weights):
            raise InputError("a sum of joint coordinates cannot mix angles and lengths", expected="joints of one kind",
                             hint="kind: screw or rack")  # fmt: skip
        if isinstance(self.value, Measured):
            self.value.check(first.unit)
        found = coupled(model, joints, name, "sum", weights, float(self.value))
        return replace(found, missing="a sum says nothing of the parts between them")


CouplingDefinition = Gear | Rack | Screw | Belt | Cam | WeightedSum
"""Any coupling. A new kind is one module beside these and one entry here."""
