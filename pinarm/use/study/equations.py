"""Equations of motion in letters, of a scenario or of a mechanism."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from pinarm.engine.mechanism import Mechanism
from pinarm.errors import InputError, UnitError, choices, require_map
from pinarm.input.units import read_quantity
from pinarm.input.yaml.document import Values
from pinarm.use.study.quantities import Subject, subject

if TYPE_CHECKING:
    from pinarm.use.letters.equations import Equations


def equations(
    path: Subject, values: Values | None = None, *, small: Mapping[str, float | str] | None = None
) -> Equations:
    """Return the equations of a mechanism in its own symbols: what closes its loops, its motion, constant momenta.

    Newton and Euler's equations are projected on the joints, in SymPy, with the arguments of a xacro model as symbols,
    and compared with the numeric ones at random states.

    Args:
        path: A scenario or a mechanism, or the file or the data of either; a model file. A scenario says which joints
            are driven, what is prescribed and what stays constant.
        values: Other values than those of the file; see ``pinarm.load`` and ``Mechanism.load``.
        small: Coordinates and their values, such as ``{"theta": "90 deg"}``, about which the equations are linear:
            symbols of coordinates then stand for deviations from these values, from 0 for coordinates that are left
            out.

    Raises:
        PinarmError: The file has a mistake, something of the mechanism is not written in letters, or SymPy is missing.
        DynamicsError: The equations differ from the numeric ones.
    """
    try:
        from pinarm.use.letters.equations import Question, equations_of
    except ModuleNotFoundError:
        raise InputError("SymPy is not installed", hint="pip install 'pinarm[equations]'") from None
    meant = subject(path, values)
    mechanism = meant if isinstance(meant, Mechanism) else meant.mechanism
    question = Question() if isinstance(meant, Mechanism) else Question.of(meant)
    return equations_of(mechanism, question, None if small is None else _about(mechanism, small))


def _about(mechanism: Mechanism, small: Mapping[str, float | str]) -> dict[str, float]:
    require_map(small, "small", "{'theta': '90 deg'}")
    numbers = {}
    for name, value in small.items():
        if name not in mechanism.coordinates:
            expected, hint = choices(name, mechanism.coordinates)
            raise InputError(f"there is no coordinate '{name}'", expected=expected, hint=hint)
        numbers[name], unit = read_quantity(value) if isinstance(value, str) else (float(value), None)
        wanted = mechanism.coordinates[name].unit
        if unit is not None and not unit.fits(wanted):
            raise UnitError(f"'{value}' is no value of '{name}'", expected=f"a number in {wanted.text}")
    return numbers
