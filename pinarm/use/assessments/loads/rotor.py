"""Balance of a rigid rotor (ISO 21940-11:2016).

With u the axis, x the place of a particle from the origin of its joint, and x' its part at right angles to u:

    U = ∫ x' dm = m e,    D = ∫ x' (x . u) dm

The residual unbalance U has the balance quality ``e omega``. In two planes at z_1 and z_2 along the axis the rotor is
unbalanced like the two masses with ``U_1 + U_2 = U`` and ``z_1 U_1 + z_2 U_2 = D``. Each plane is permitted a share of
``m e omega``: that of the static load that it would carry of the centre of mass (section 7).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.quantities.reactions import tree_axis
from pinarm.errors import InputError, choices, within
from pinarm.input.units import Unit, unit
from pinarm.input.yaml.schema import InputStruct, Lead, ServiceSpeed
from pinarm.mechanics.joints import RADIAN
from pinarm.use.assessments.loads.joint import LoadNumber
from pinarm.use.result.row_lookup import Lookup

GRADES = (0.4, 1.0, 2.5, 6.3, 16.0, 40.0, 100.0, 250.0, 630.0, 1600.0, 4000.0)
"""Of balance quality: largest e omega of each [mm/s] (table 1)."""

UNBALANCE, QUALITY, METRE = unit("kg*m"), unit("m/s"), unit("m")
MILLIMETRE, RPM = 1e-3, 2.0 * np.pi / 60.0


class Rotor(InputStruct, frozen=True):
    """A rigid rotor: the body that a revolute joint moves.

    Attributes:
        speed: At which it works, such as ``3000 rpm``; the largest of the run where it is left out.
        planes: Places of two tolerance planes along the joint's axis, from its origin, on both sides of the centre of
            mass, such as ``[-50 mm, 50 mm]``; only the static unbalance is graded where they are left out.
    """

    speed: ServiceSpeed | None = None
    planes: tuple[Lead, Lead] | None = None

    def check(self) -> None:
        if self.planes and self.planes[0] == self.planes[1]:
            raise InputError("both planes are at the same place", expected="two planes")

    @property
    def units(self) -> Mapping[str, Unit]:
        inner = {f"unbalance.{k}": UNBALANCE for k in (1, 2)} if self.planes else {}
        return {"unbalance": UNBALANCE, "eccentricity": METRE, "quality": QUALITY, **inner}

    @staticmethod
    def check_joint(mechanism: Mechanism, name: str) -> None:
        """Check that a joint moves a rigid rotor."""
        joint = mechanism.joints.get(name)
        if joint is None or joint.unit != RADIAN:
            expected, hint = choices(name, [k for k, moved in mechanism.joints.items() if moved.unit == RADIAN])
            raise InputError(f"there is no revolute joint '{name}'", expected=expected, hint=hint)
        beyond = [mechanism.model.names[k] for k in mechanism.model.subtrees[joint.index] if k != joint.index]
        if beyond:
            raise InputError(
                f"{', '.join(beyond)} move beyond '{name}': it is no rigid rotor",
                expected="a joint that moves a single body",
            )
        if not mechanism.model.inertias[joint.index].mass > 0.0:
            raise InputError(f"'{name}' moves no mass", expected="a joint that moves a body with mass")

    def balance(self, run: Lookup, name: str) -> tuple[dict[str, LoadNumber], list[str]]:
        """Return unbalance and balance quality of the rotor of a joint, and its grade in words."""
        with within("rotors", name):
            omega, spread = (float(self.speed), 0.0) if self.speed else _largest(run, f"joint.{name}.velocity")
            if not omega:
                raise InputError(f"'{name}' does not turn in this run", expected="speed: that at which it works")
            mass, centre, static, couple = _unbalance(run.run.mechanism, name)
            unbalance = float(np.linalg.norm(static))
            numbers = {
                f"{name}.unbalance": LoadNumber(unbalance, UNBALANCE),
                f"{name}.eccentricity": LoadNumber(unbalance / mass, METRE),
            }
            eccentricity = unbalance / mass
            if self.planes:
                inner = _in_planes(static, couple, *self.planes)
                numbers |= {f"{name}.unbalance.{k}": LoadNumber(x, UNBALANCE) for k, x in enumerate(inner, start=1)}
                shares = _shares(centre, *self.planes)
                eccentricity = max(eccentricity, *(x / (mass * share) for x, share in zip(inner, shares, strict=True)))
            quality = eccentricity * omega
        planes = "in both planes" if self.planes else "static unbalance only"
        size = quality / MILLIMETRE
        remark = f"{name}: e omega = {size:.4g} mm/s at {omega / RPM:.5g} rpm, {planes}: {grade(quality)}"
        return numbers | {f"{name}.quality": LoadNumber(quality, QUALITY, error=eccentricity * spread)}, [remark]


def grade(quality: float) -> str:
    """Return the finest grade that a balance quality e omega [m/s] meets, in words."""
    met = next((limit for limit in GRADES if quality <= limit * MILLIMETRE * (1.0 + ROUNDING)), None)
    return f"G {met:g} of ISO 21940-11" if met else f"beyond G {GRADES[-1]:g}, the coarsest grade of ISO 21940-11"


LEAST_SHARE = 0.3
"""Of the permitted unbalance that a plane has, however far from the centre of mass it is."""

ROUNDING = 1e-9
"""By which a quality may be above its grade: the digits of a rotor that was balanced to it."""


def _unbalance(mechanism: Mechanism, name: str) -> tuple[float, float, Array, Array]:
    """Return mass [kg], place of its centre along the axis [m], U [kg*m] and D [kg*m²], each of shape (3,)."""
    index = mechanism.joints[name].index
    inertia, axis = mechanism.model.inertias[index], tree_axis(mechanism.model, index)
    assert axis is not None
    across, about = np.eye(3) - np.outer(axis, axis), inertia.matrix()[3:, 3:]
    second = 0.5 * np.trace(about) * np.eye(3) - about  # ∫ x x^T dm
    centre = inertia.lever
    return float(inertia.mass), float(centre @ axis), inertia.mass * (across @ centre), across @ second @ axis


def _largest(run: Lookup, rate: str) -> tuple[float, float]:
    row, error = run.extreme("largest", rate)
    return abs(float(row[rate].values[0])), error


def _in_planes(static: Array, couple: Array, first: float, second: float) -> tuple[float, float]:
    """Return the sizes of U_1 and U_2 [kg*m] in planes at places [m]."""
    other = (couple - first * static) / (second - first)
    return float(np.linalg.norm(static - other)), float(np.linalg.norm(other))


def _shares(centre: float, first: float, second: float) -> tuple[float, float]:
    """Return the shares of the permitted unbalance of planes at places [m].

    By the lever rule, ``L_2 / L`` and ``L_1 / L`` with L_k the distance of the centre of mass to plane k, but no less
    than 0.3 and no more than 0.7: ISO 21940-11:2016, section 7, on rotors whose centre of mass is between the planes.
    """
    share = (second - centre) / (second - first)
    if not 0.0 < share < 1.0:
        with within("planes"):
            raise InputError(
                f"the centre of mass at {centre:.4g} m is not between the planes", expected="a plane on each side of it"
            )
    share = min(max(share, LEAST_SHARE), 1.0 - LEAST_SHARE)
    return share, 1.0 - share
