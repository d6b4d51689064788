"""Variants of a mechanism: other values of its model's arguments, as far as these change numbers only."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.mechanism import Mechanism
from pinarm.input.numbers import decimal
from pinarm.input.roots import file_root, root_of
from pinarm.input.xacro.expansion import expand_columns
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.geometry.model_variants import ModelVariants, VariantsDiffer
from pinarm.mechanics.loading.urdf.variants import model_variants
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.records import replace


def mechanism_variants(
    mechanism: Mechanism, given: Mapping[str, float | str], columns: Mapping[str, Sequence[float] | Array]
) -> tuple[Mechanism, Flags]:
    """Return a mechanism whose model and arguments are those of k variants, and which of them are such, shape (k,).

    The others take other branches of the model, or have numbers that no body can have: they are to be read alone.

    Args:
        mechanism: The first of the variants.
        given: The arguments that it was read with [SI].
        columns: Those that vary, with their values in all variants [SI].

    Raises:
        VariantsDiffer: They differ in more than numbers, or this is not known.
        PinarmError: A file may not be read any more, or a number follows that cannot be computed.
    """
    _require_plain(mechanism)
    source = mechanism.source
    if source.model is not None or source.base is not None or mechanism.description.planar is not None:
        raise VariantsDiffer("a model that is not read from a file as it is")
    with file_root(None, source.packages):
        expanded = expand_columns(source.robot, given, columns, root=root_of(source.folder / "mechanism.yaml"))
    if expanded is None or not expanded.columns:
        raise VariantsDiffer("a model whose expansion is not recorded, or in which no number varies")
    variants, possible = model_variants(mechanism.model, mechanism.xml, expanded.xml, expanded.columns)
    arguments = {name: _numbers(told) for name, told in expanded.arguments.items() if name in mechanism.arguments}
    changed = replace(mechanism, model=variants, arguments=arguments)
    return changed, possible & expanded.holds


def alike_variants(mechanism: Mechanism, count: int) -> Mechanism:
    """Return a mechanism as variants of itself that do not differ, but may move in different ways.

    Raises:
        VariantsDiffer: More depends on the model than the motion of its links.
    """
    _require_plain(mechanism)
    return replace(mechanism, model=ModelVariants.alike(mechanism.model, count))


def some_variants(mechanism: Mechanism, places: Indices) -> Mechanism:
    """Return the mechanism of some of its variants."""
    variants = mechanism.model
    assert isinstance(variants, ModelVariants)
    columns = {name: np.asarray(value) for name, value in mechanism.arguments.items()}
    arguments = {name: column[places] if column.ndim else float(column) for name, column in columns.items()}
    return replace(mechanism, model=variants.some(places), arguments=arguments)


def _require_plain(mechanism: Mechanism) -> None:
    """Raise where more depends on the model than the motion of its links; of forces see ``require_joint_forces``.

    Raises:
        VariantsDiffer: Says what.
    """
    if mechanism.frictions or mechanism.control or mechanism.balls:
        raise VariantsDiffer("friction, controllers or ball joints")
    if not all(isinstance(constraint, LoopJoint) for constraint in mechanism.constraints):
        raise VariantsDiffer("couplings or cables")


def require_joint_forces(forces: Mapping[str, ForceElement]) -> None:
    """Raise where force elements do more than push joints evenly, or by their coordinates and velocities.

    Raises:
        VariantsDiffer: One depends on where links are.
    """
    if not forces:
        return
    from pinarm.mechanics.forces.joint_forces import SpringDamper

    if others := [name for name, force in forces.items() if not (force.steady or isinstance(force, SpringDamper))]:
        raise VariantsDiffer(f"the force element '{others[0]}'")


def _numbers(text: str | Sequence[str] | Array) -> float | Array:
    """Return an argument, or those of all variants, shape (k,).

    Raises:
        VariantsDiffer: It is a word in some of them.
    """
    if isinstance(text, np.ndarray) and text.dtype == np.float64:
        return text
    texts = [text] if isinstance(text, str) else text
    try:
        found = [*map(decimal, texts)]
    except ValueError:
        raise VariantsDiffer("an argument that is a word in some variants") from None
    return found[0] if isinstance(text, str) else np.array(found)
