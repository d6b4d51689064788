"""A wanted unknown, and its derivation as a correction writes it: bodies, theorems, what vanishes, terms, numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from msgspec import field

from pinarm.arrays import Array
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.families import family
from pinarm.engine.quantities.family import RATES, WRENCH, Asked, WrenchFamily
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError
from pinarm.input.formulas.expressions import Expression
from pinarm.language import Language, decimals, said, spoken, writing
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


WORDS = {
    "resultant": "resultant along {direction}",
    "moment": "moment about {point}, along {direction}",
    "energy": "kinetic energy of the whole, per unit rate of {wanted}",
    "virtual": "power of the whole in the motion in which only {wanted} of the driven coordinates moves, at the rate 1",
    "isolate": "isolate {bodies}: {theorem}",
    "alone": "one isolation gives {wanted}",
    "chain": "no isolation gives {wanted} alone, as the ranks for all {groups} connected groups of bodies show; "
    "{count} equations with the unknowns of {opened} do",
    "tried": "none of the {groups} groups of bodies that were tried gives {wanted} alone; {count} equations with the "
    "unknowns of {opened} do",
    "screw": "no theorem about its points and axes gives {wanted} alone; {count} equations with the unknowns of "
    "{opened} do",
    "whole": "the theorem of kinetic energy gives {wanted}: the mechanism has one degree of freedom",
    "power": "the principle of virtual power gives {wanted}",
    "nothing": "no equations give {wanted}: on every body other unknowns act as it does",
    "no force along": "transmits no force along it",
    "meets": "its force meets the axis, it transmits no moment along it",
    "meets or parallel": "its force meets the axis or is parallel to it, it transmits no moment along it",
    "no work": "does no work in this motion",
    "perfect": "joints and loop joints, inside and to the ground: the power of their actions is 0",
    "gives": "gives {of}",
    "ties": "ties {of}",
    "force of": "force of {of} along {direction}",
    "moment of": "moment of {of} along {direction}",
    "lever": "moment of {of}",
    "projection": "projection of {of}",
    "relation": "a relation between the unknowns of {of}",
    **dict.fromkeys(("joint", "loop", "coupling"), "action of {name}"),
    **dict.fromkeys(("drive", "law"), "effort at {name}"),
    **dict.fromkeys(("force", "given", "tie"), "{name}"),
    **{kind: f"{kind} of {{name}}" for kind in ("weight", "inertia", "friction", "pretension")},
    "rotor": "rotor at {name}",
    "hence": "hence {wanted} = {value:.9g} {unit}; the full solution differs by {residual:.1e}",
    "holds": "the equation holds but for {residual:.1e}",
    "or": "or: {other}",
}
"""Texts, with names in braces."""

ROLES = ("unknown", "known", "weight", "inertia")
"""Roles of terms, in their order: inertias are the right side."""


class Term(Record, frozen=True):
    """A term of an equation.

    Attributes:
        name: What it is, in words, or the symbol of an unknown.
        role: One of ``ROLES``.
        of: The body, of weights and inertias.
        value: In the state of the numbers [N, N*m or W per unit rate]; NaN where there is none.
    """

    name: str
    role: str
    of: str = ""
    value: float = float("nan")


class Equation(Record, frozen=True):
    """One isolation.

    Attributes:
        bodies: Names of the isolated bodies.
        theorem: The theorem in words.
        gives: What follows from it and the equations before, in words; empty of the last one.
        vanishing: What is cut and has no part in it, with the reason.
        terms: Its terms, in the order of their roles.
        unit: Their unit; empty without numbers.
        scale: Size of the largest term, or of the parts of one.
    """

    bodies: tuple[str, ...]
    theorem: str
    gives: str
    vanishing: tuple[tuple[str, str], ...]
    terms: tuple[Term, ...]
    unit: str = ""
    scale: float = 1.0

    @property
    def residual(self) -> float:
        """Residual of the equation in numbers, relative to its scale."""
        left = sum(-term.value if term.role == "inertia" else term.value for term in self.terms)
        return abs(left) / self.scale

    def lines(self, number: int) -> Iterator[str]:
        """Yield it as text, with its number."""
        yield f"{number}. {said(WORDS['isolate'], bodies=' + '.join(self.bodies), theorem=self.theorem)}"
        yield from (f"   {said(': ').join(filter(None, each))}" for each in self.vanishing)
        single = [term.name for term in self.terms if term.role in ROLES[:2]]
        left, right = " + ".join([*single, *self._together("weight")]), "".join(self._together("inertia"))
        yield f"   {left or '0'} = {right or '0'}"
        width = max((len(term.name) for term in self.terms), default=0)
        for term in self.terms:
            if not np.isnan(term.value):
                yield f"      {term.name:<{width}}  {decimals(f'{term.value:>14.7g}')} {self.unit}"
        yield from (f"   {self.gives}",) if self.gives else ()

    def _together(self, role: str) -> list[str]:
        names = dict.fromkeys(term.of for term in self.terms if term.role == role)
        return [said(WORDS[role], name=", ".join(names))] if names else []


class Isolation(Record, frozen=True):
    """A derivation of a wanted unknown.

    Attributes:
        wanted: What is wanted.
        title: Title of the mechanism.
        verdict: What gives it, in words.
        equations: The equations, in the order in which a correction writes them; none where it is not determined.
        alternatives: Other derivations, in words, the simplest first.
        where: State of the numbers, in words; empty where there are none.
        value: The wanted unknown from the equations [SI]; NaN without numbers. Of a law of motion the known effort
            along the coordinate.
        solution: The same in the full solution.
        unit: Its unit.
        scale: Largest term of the equations, in terms of the unknown.
        asked: Value of the symbol or formula that was asked for, with its unit; empty where it is the unknown itself.
        language: Language of its words.
    """

    wanted: Wanted
    title: str
    verdict: str
    equations: tuple[Equation, ...] = ()
    alternatives: tuple[str, ...] = ()
    where: str = ""
    value: float = float("nan")
    solution: float = float("nan")
    unit: str = ""
    scale: float = 1.0
    asked: str = ""
    language: Language = field(default_factory=spoken)

    @property
    def residual(self) -> float:
        """Difference of the value from the full solution, relative to the largest term of the equations."""
        return abs(self.value - self.solution) / self.scale

    def __repr__(self) -> str:
        return f"<Isolation for '{self.wanted.name}' of '{self.title}': {len(self.equations)} equations>"

    def __str__(self) -> str:
        with writing(self.language):
            return "\n".join(self._lines())

    def _lines(self) -> list[str]:
        lines = [f"{self.title}{said(': ')}{self.verdict}"]
        formula = [f"{self.wanted.name} = {self.wanted.formula}"] if self.wanted.formula != self.wanted.name else []
        lines += formula if self.wanted.formula else []
        lines += [said("numbers {where}", where=self.where)] if self.where else []
        for number, equation in enumerate(self.equations, 1):
            lines += equation.lines(number)
        if self.where:
            numbers = {"value": self.value, "unit": self.unit, "residual": self.residual}
            words = WORDS["holds" if self.wanted.kind == "law" else "hence"]
            lines.append(said(words, wanted=self.wanted.symbol, **numbers))
            lines += [f"{self.wanted.name} = {decimals(self.asked)}"] if self.asked else []
        return [*lines, *(said(WORDS["or"], other=other) for other in self.alternatives)]

    def summary(self) -> dict[str, Any]:
        """Return it as plain data."""
        import msgspec

        told: dict[str, Any] = msgspec.to_builtins(self)
        return {**told, "residual": self.residual}

    def _repr_html_(self) -> str:
        from pinarm.use.show.text import lines

        return lines(str(self))
