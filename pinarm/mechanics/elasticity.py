"""Elasticity and backlash between a motor's rotor and what it drives, as files give them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pinarm.errors import within
from pinarm.input.units import unit
from pinarm.input.yaml.schema import InputStruct, NotNegative, Positive, check_unit

if TYPE_CHECKING:
    import pinocchio as pin

    from pinarm.mechanics.coordinates import LinearCoordinate
    from pinarm.mechanics.forces.force_element import ForceElement


class Elasticity(InputStruct, frozen=True):
    """A spring and damper between the rotor, reflected to the joint by the ratio, and the joint.

    With the deflection w, the rotor's angle over the ratio less the joint's, the joint gets ``k w + c w'``. Behind a
    backlash b it is ``k d + c w'`` with ``d = |w| - b/2``, towards the free travel, while flanks touch and this pushes.

    Attributes:
        stiffness: k at the joint, effort per deflection.
        damping: c at the joint, effort per rate of the deflection.
    """

    stiffness: Positive
    damping: NotNegative = 0.0

    def bind(self, model: pin.Model, deflection: LinearCoordinate, backlash: float) -> ForceElement:
        """Return the element of one model.

        Args:
            model: Pinocchio's model.
            deflection: w.
            backlash: b [rad or m].

        Raises:
            UnitError: A unit is not that of the joint.
        """
        from pinarm.mechanics.forces.along_coordinate import SpringAlong, effort_along
        from pinarm.mechanics.forces.flanks import Flanks

        stiff = effort_along(deflection) / deflection.unit
        for key, given, expected in (
            ("stiffness", self.stiffness, stiff),
            ("damping", self.damping, stiff * unit("s")),
        ):
            with within("elasticity", key):
                check_unit(given, expected)
        with within("backlash"):
            check_unit(backlash, deflection.unit)
        spring = SpringAlong(model, deflection, float(self.stiffness), float(self.damping), 0.0)
        return Flanks(model, deflection, spring, 0.5 * float(backlash)) if backlash else spring
