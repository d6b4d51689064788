"""Families of quantities, by the word that their names begin with. Each is imported when it is first asked for."""

from __future__ import annotations

from importlib import import_module

from pinarm.engine.quantities.evaluation import Evaluation
from pinarm.engine.quantities.family import Family

FAMILIES = {
    "joint": ("joint", "JointQuantities"),
    "loop": ("loop", "LoopQuantities"),
    "coupling": ("coupling", "CouplingQuantities"),
    "coordinate": ("coordinate", "CoordinateQuantities"),
    "point": ("link", "PointQuantities"),
    "body": ("link", "BodyQuantities"),
    "drive": ("drive", "DriveQuantities"),
    "energy": ("energy", "EnergyQuantities"),
    "momentum": ("momentum", "MomentumQuantities"),
    "dynamic": ("momentum", "DynamicQuantities"),
    "power": ("power", "PowerQuantities"),
    "force": ("force", "ForceQuantities"),
}
"""First word of the names, and the module and class of the family. A new one is a class and an entry here."""


def family(word: str, evaluation: Evaluation) -> Family:
    """Return the family of a word of ``FAMILIES``, of one trajectory."""
    module, name = FAMILIES[word]
    made: Family = getattr(import_module(f"{__name__}.{module}"), name)(evaluation)
    return made
