"""Families of quantities, by the word that their names begin with. Each is imported when it is first asked for."""

from __future__ import annotations

from importlib import import_module

from pinarm.engine.quantities.family import Evaluation, Family

FAMILIES = {
    "joint": ("joints", "JointQuantities"),
    "loop": ("loops", "LoopQuantities"),
    "coupling": ("loops", "CouplingQuantities"),
    "coordinate": ("joints", "CoordinateQuantities"),
    "point": ("bodies", "PointQuantities"),
    "body": ("bodies", "BodyQuantities"),
    "drive": ("joints", "DriveQuantities"),
    "energy": ("bodies", "EnergyQuantities"),
    "momentum": ("bodies", "MomentumQuantities"),
    "dynamic": ("bodies", "DynamicQuantities"),
    "power": ("forces", "PowerQuantities"),
    "force": ("forces", "ForceQuantities"),
}
"""First word of the names, and the module and class of the family. A new one is a class and an entry here."""


def family(word: str, evaluation: Evaluation) -> Family:
    """Return the family of a word of ``FAMILIES``, of one trajectory."""
    module, name = FAMILIES[word]
    kind: type[Family] = getattr(import_module(f"{__name__}.{module}"), name)
    return kind(evaluation)
