"""A derivation as a correction would write it: isolated bodies, theorems, what vanishes, terms in words and numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from msgspec import field

from pinarm.language import Language, decimals, said, spoken, writing
from pinarm.records import Record
from pinarm.use.method.wanted import Wanted

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

        return lines(str(self).split("\n"))
