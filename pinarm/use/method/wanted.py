"""The wanted unknown: an effort, a component of a reaction, or a law of motion, as a function of all unknowns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.families import family
from pinarm.engine.quantities.family import RATES, WRENCH, Asked, WrenchFamily
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError
from pinarm.input.formulas.expressions import Expression
from pinarm.mechanics.coordinates import Coordinate
from pinarm.mechanics.geometry.vectors import moved
from pinarm.records import Record
from pinarm.use.method.actions import Actions, motions

WHAT = "an effort, a component of a reaction, or a coordinate whose law of motion is wanted"
EXAMPLES = "joint.knee.effort, joint.knee.force.x, loop.D.force.along.rod.y, or knee"
LENGTHS = ("norm", "radial")


class Wanted(Record, frozen=True):
    """Wanted unknown of an isolation.

    Attributes:
        name: Name, symbol or formula, as the user gave it.
        quantity: Quantity behind the name, such as ``joint.B.effort``.
        kind: ``effort``, ``reaction``, ``multiplier`` or ``law``.
        of: Name of the coordinate, joint, loop joint or coupling.
        symbol: Symbol of the quantity in equations.
        formula: Formula behind the name; empty where it is the quantity itself.
    """

    name: str
    quantity: str
    kind: str
    of: str
    symbol: str
    formula: str = ""


def wanted_of(quantities: Quantities, name: str) -> Wanted:
    """Return the unknown of a name, a symbol or a formula.

    Raises:
        InputError: No equation gives the unknown, or there are several unknowns.
    """
    kinds = {leaf: kind for leaf, kind in _leaves(quantities, name, 0)}
    unknown = {leaf: kind for leaf, kind in kinds.items() if kind[0] != "law"} or kinds
    if len(unknown) != 1:
        said = f"depends on {', '.join(unknown)}" if unknown else "is none of them"
        raise InputError(f"'{name}' {said}: an isolation is looked for {WHAT}", expected="one of them", hint=EXAMPLES)
    [(leaf, (kind, of))] = unknown.items()
    symbols = symbols_of(quantities)
    own = symbols[name].text.strip() if name in symbols else name
    word = "joint" if of in quantities.trajectory.mechanism.joints else "coordinate"
    quantity = f"{word}.{of}.effort" if leaf.startswith("drive.") else leaf
    alias = next((symbol for symbol, text in symbols.items() if text.text.strip() == quantity), quantity)
    return Wanted(name, quantity, kind, of, alias if own != quantity else name, "" if own == quantity else own)


def symbols_of(quantities: Quantities) -> Mapping[str, Expression]:
    """Return the formulas of the symbols of a mechanism and a scenario, by name."""
    return {**quantities.trajectory.mechanism.symbols, **quantities.symbols}


def _leaves(quantities: Quantities, name: str, depth: int) -> Iterator[tuple[str, tuple[str, str]]]:
    symbols = symbols_of(quantities)
    if name not in symbols and (kind := _kind(quantities, name)):
        yield name, kind
    elif name in symbols or set(name) & set("+-*/("):
        for inner in (symbols.get(name) or Expression.parse(name)).names if depth < 50 else ():
            if inner != name:
                yield from _leaves(quantities, inner, depth + 1)
    elif not depth:
        quantities[name]  # an unknown name is refused there, with what there is


def _kind(quantities: Quantities, name: str) -> tuple[str, str] | None:
    mechanism, asked = quantities.trajectory.mechanism, quantities.asked(name)
    word, words = name.partition(".")[0], asked.words
    if name in mechanism.coordinates:
        return "law", name
    if word in ("joint", "coordinate") and words[-1] in RATES and ".".join(words[:-1]) in mechanism.coordinates:
        return "law", ".".join(words[:-1])
    if word in ("joint", "coordinate") and words[-1] == "effort":
        return "effort", ".".join(words[:-1])
    if word == "drive" and asked.part == "torque" and asked.of in mechanism.drives:
        return "effort", mechanism.drives[asked.of].coordinate
    if word in ("joint", "loop") and asked.part in WRENCH and len(words) > 2:
        if words[-1] in LENGTHS:
            raise InputError(
                f"'{name}' is the length of a vector, no component",
                expected="one of its components",
                hint=name.removesuffix(words[-1]) + "x",
            )
        return "reaction", asked.of
    if (word, asked.part) in (("coupling", "effort"), ("loop", "tension")):
        return "multiplier", asked.of
    return None


def efforts_of(run: Trajectory, wanted: Wanted) -> tuple[dict[str, Coordinate], list[str], str]:
    """Return coordinates with unknown efforts by name, ball joints with drives, and the coordinate of a wanted law.

    Raises:
        InputError: No drive acts where an effort is wanted.
    """
    mechanism = run.mechanism
    efforts = {name: mechanism.coordinates[name] for name in run.drives if name in mechanism.coordinates}
    driven = np.zeros(run.v.shape[-1], dtype=bool) if run.driven is None else run.driven
    balls = [name for name, ball in mechanism.balls.items() if driven[mechanism.model.joints[ball.index].idx_v]]
    law = ""
    if wanted.kind == "law" and wanted.of not in efforts:
        law, efforts[wanted.of] = wanted.of, mechanism.coordinates[wanted.of]
    if wanted.kind == "effort" and wanted.of not in efforts:
        raise InputError(
            f"'{wanted.name}': no drive acts along '{wanted.of}'",
            expected="the effort of a drive",
            hint=f"drives act along {', '.join(efforts) or 'nothing'}",
        )
    return efforts, balls, law


def function_of(wanted: Wanted, actions: Actions, quantities: Quantities) -> Array:
    """Return the wanted quantity as a function of all unknowns, shape (c, K)."""
    function = np.zeros(actions.wrenches.shape[::2][:2])
    if wanted.kind == "reaction":
        own, place = _own_wrenches(wanted, actions)
        for k, q in enumerate(actions.links.q):
            function[k] = _component(wanted, quantities, q, moved(own[k], -place[k]), place[k])
        return function
    kinds = ("drive", "law") if wanted.kind in ("effort", "law") else ("coupling", "loop")
    carrier = actions.carrier(wanted.of, *kinds)
    if carrier is None or carrier.count != 1:
        raise InputError(f"'{wanted.name}': '{wanted.of}' has no single unknown", expected=WHAT, hint=EXAMPLES)
    function[:, carrier.columns] = -1.0 if wanted.quantity.endswith("tension") else 1.0
    return function


def _own_wrenches(wanted: Wanted, actions: Actions) -> tuple[Array, Array]:
    """Return wrenches of unknowns in a joint or loop joint at the world's origin, (c, K, 6), and its place, (c, 3)."""
    mechanism, links = actions.mechanism, actions.links
    own = np.zeros((len(links.q), actions.wrenches.shape[2], 6))
    loop = actions.carrier(wanted.of, "loop")
    if loop is not None and wanted.quantity.startswith("loop."):
        joint = next(constraint for constraint in mechanism.constraints if constraint.name == wanted.of)
        second = mechanism.model.frames[joint.second].parentJoint  # type: ignore[attr-defined]
        own[:, loop.columns] = actions.wrenches[:, second, loop.columns]
        return own, links.frame(joint.second)[1]  # type: ignore[attr-defined]
    body = (mechanism.joints.get(wanted.of) or mechanism.balls[wanted.of]).index
    held, model = actions.carrier(wanted.of, "joint"), mechanism.model.joints[body]
    assert held is not None
    own[:, held.columns] = actions.wrenches[:, body, held.columns]
    own += actions.efforts[..., model.idx_v : model.idx_v + model.nv] @ motions(mechanism, links, body)
    return own, links.places[:, body]


def _component(wanted: Wanted, quantities: Quantities, q: Array, wrenches: Array, place: Array) -> Array:
    """Return the wanted component of wrenches at a place, shape (k, 6), at a configuration, as an array (k,)."""
    run = quantities.trajectory
    row = Quantities(Trajectory.schema_row(run.mechanism, q, run.parameter, run.unit), quantities.symbols)
    of, asked = family(wanted.quantity.partition(".")[0], row.evaluation), quantities.asked(wanted.quantity)
    assert isinstance(of, WrenchFamily)
    about = place[None]
    if asked.words[1:3] == ("moment", "at_parent"):
        about = row.reactions.markers((run.mechanism.joints.get(wanted.of) or run.mechanism.balls[wanted.of]).index)
        asked = Asked(asked.name, (*asked.words[:2], *asked.words[3:]))
    return of.wrench_component(asked, place[None], wrenches, about)
