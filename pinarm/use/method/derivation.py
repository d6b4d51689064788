"""The search for one wanted unknown, with names for the bodies, theorems and terms that it finds, and their numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.kinematics.assembly import GOLDEN, generic_near
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.quantities.states import quantities as state_quantities
from pinarm.engine.series import Series
from pinarm.engine.statics.actuation import along, everywhere
from pinarm.errors import InputError
from pinarm.input.units import unit
from pinarm.language import in_language, said
from pinarm.mechanics.geometry.vectors import crossed, moved
from pinarm.mechanics.joints import METRE
from pinarm.records import Record, replace
from pinarm.use.method.actions import (
    Actions,
    Carrier,
    Source,
    body_name,
    forces_of,
    inertias_of,
    sources,
    unknown_actions,
    weights_of,
)
from pinarm.use.method.isolation import (
    ROLES,
    WORDS,
    Equation,
    Isolation,
    Term,
    Wanted,
    efforts_of,
    function_of,
    symbols_of,
    wanted_of,
)
from pinarm.use.method.search import NOTHING, Chain, Landmarks, Search, Step, configurations, motion_of_whole
from pinarm.use.result.curve_figures import is_figure
from pinarm.use.result.numbers import RunNumber
from pinarm.use.result.result import Result

ALTERNATIVES = 3
"""Other derivations that are named."""

AGREE = 1e-9
"""Difference of the equations from the full solution, relative to their largest term, that rounding and tolerances of
solvers explain."""

ROUNDED = 1e-13
"""Size of a term, relative to the largest of its equation, that is rounding."""

ALIKE = 1e2 * NOTHING
"""Distance of rows and directions of length 1 below which they are the same."""

TINY = float(np.finfo(float).tiny)


class Derivation(Record, frozen=True):
    """The search for a wanted unknown.

    Attributes:
        quantities: Quantities of the mechanism, whose run says which drives act.
        wanted: What is wanted.
        start: A closed configuration, shape (nq,), near which those are at which ranks are taken.
        senses: Signs of the multipliers of couplings in the state of the numbers.
    """

    quantities: Quantities
    wanted: Wanted
    start: Array
    senses: Mapping[str, float] = {}

    @property
    def mechanism(self) -> Mechanism:
        return self.quantities.trajectory.mechanism

    @cached_property
    def _acting(self) -> tuple[Any, ...]:
        return efforts_of(self.quantities.trajectory, self.wanted)

    def _actions(self, q: Array) -> Actions:
        efforts, balls, law = self._acting
        loaded = bool(self.quantities.trajectory.dynamics.forces)
        return unknown_actions(self.mechanism, q, efforts, balls, law, self.senses, loaded=loaded)

    @cached_property
    def search(self) -> Search:
        """The search at configurations of no special kind."""
        actions = self._actions(configurations(self.mechanism, self.start))
        function = function_of(self.wanted, actions, self.quantities)
        if not np.abs(function).max(initial=0.0) > NOTHING:
            raise InputError(
                f"'{self.wanted.name}': no unknown of '{self.wanted.of}' acts along it: it is 0, or known",
                expected="a component that the joint transmits",
            )
        return Search(actions, Landmarks.at(self.mechanism, actions.links), function)

    @cached_property
    def whole(self) -> tuple[str, Chain] | None:
        """The power of the whole: ``whole``, the theorem of kinetic energy, or ``power``; ``None`` without such."""
        search, (efforts, balls, _) = self.search, self._acting
        if self.wanted.kind not in ("effort", "law") or balls or not self.mechanism.closure.size:
            return None
        if (motion := motion_of_whole(self.mechanism, search.actions.links.q, efforts, self.wanted.of)) is None:
            return None
        twists, alone = motion
        group = np.isin(np.arange(twists.shape[1]), search.actions.bodies) & (np.abs(twists).max(axis=(0, 2)) > NOTHING)
        step = search.step(group, None, twists)
        left = [unknown.name for unknown in step.unknowns(search.actions)]
        return ("whole" if alone else "power", Chain((step,))) if left == [self.wanted.of] else None

    @cached_property
    def chains(self) -> list[tuple[str, Chain]]:
        """Derivations with the key of their verdict, the shortest first."""
        chains, search = [("alone", Chain((step,))) for step in self.search.single()], self.search
        energy = self.whole is not None and self.whole[0] == "whole"
        several = search.chain() if not chains and (search.complete or not energy) else None
        key = "screw" if search.possible else "chain" if search.complete else "tried"
        later = [*([self.whole] if self.whole else []), *([(key, several)] if several else [])]
        return [*chains, *(later if energy else reversed(later))]

    def isolation(self, state: Quantities | None, where: str = "") -> Isolation:
        """Return the derivation, with numbers in a state, a row with efforts, where there is one."""
        title = self.mechanism.title
        if not self.chains:
            return Isolation(self.wanted, title, said(WORDS["nothing"], wanted=self.wanted.symbol))
        key, chain = self.chains[0]
        others = [other for other in dict.fromkeys(self._other(*chain) for chain in self.chains)][1 : 1 + ALTERNATIVES]
        equations = tuple(self._equation(step, chain) for step in chain.steps)
        isolation = Isolation(self.wanted, title, self._verdict(key, chain), equations, (*others,))
        return isolation if state is None else self._in_numbers(isolation, chain, state, where)

    def _verdict(self, key: str, chain: Chain) -> str:
        names = {"wanted": self.wanted.symbol, "opened": ", ".join(place.name for place in chain.opened)}
        return said(WORDS[key], groups=len(self.search.groups), count=len(chain.steps), **names)

    def _other(self, key: str, chain: Chain) -> str:
        if len(chain.steps) > 1:
            return self._verdict(key, chain)
        [step] = chain.steps
        return said(WORDS["isolate"], bodies=" + ".join(self._bodies(step)), theorem=self._theorem(step))

    def _bodies(self, step: Step) -> tuple[str, ...]:
        return tuple(body_name(self.mechanism.model, body) for body in np.flatnonzero(step.group).tolist())

    def _theorem(self, step: Step) -> str:
        marks = self.search.landmarks
        if step.screw is None:
            key = "energy" if self.whole and self.whole[0] == "whole" else "virtual"
            return said(WORDS[key], wanted=self.wanted.of)
        axis = marks.directions[step.screw.direction]
        way = marks.directions * np.sign((marks.directions * axis).sum(axis=-1, keepdims=True) + TINY)
        direction = _direction(self._named(way, marks.direction_names, step.screw.direction, step))
        if step.screw.point is None:
            return said(WORDS["resultant"], direction=direction)
        across = crossed(marks.points / marks.extent, axis)  # the same for all points on one axis
        point = self._named(across, marks.point_names, step.screw.point, step)
        return said(WORDS["moment"], point=point, direction=direction)

    def _named(self, vectors: Array, names: Sequence[str], place: int, step: Step) -> str:
        """Return the name of a point or direction: that of a joint that is cut, where it has the same."""
        alike = np.flatnonzero(np.abs(vectors - vectors[place]).max(axis=(1, 2)) < NOTHING).tolist()
        cut = {carrier.name for carrier in self.search.actions.carriers if carrier.is_cut(step.group)}
        return min((names[k] for k in alike), key=lambda name: name.removeprefix("axis of ") not in cut)

    def _equation(self, step: Step, chain: Chain) -> Equation:
        carriers, left = self.search.actions.carriers, step.unknowns(self.search.actions)
        vanishing = [
            (said(WORDS[carrier.kind], name=carrier.name), said(WORDS[self._reason(carrier, step)]))
            for carrier in carriers
            if step.screw and carrier not in left and carrier.is_cut(step.group)
        ]
        opened = [self._component(place, step) for place in chain.opened if place in left]
        given = said(WORDS["gives" if len(opened) == 1 else "ties"], of=said(" and ").join(opened))
        gives = "" if step is chain.steps[-1] else given
        perfect = [] if step.screw else [("", said(WORDS["perfect"]))]
        terms = tuple(replace(term, value=np.nan) for term in self._terms(step, self._arbitrary))
        return Equation(self._bodies(step), self._theorem(step), gives, (*vanishing, *perfect), terms)

    def _reason(self, carrier: Carrier, step: Step) -> str:
        """Return the key of why what something transmits to the group has no part in the equation."""
        marks, screw = self.search.landmarks, step.screw
        if screw is None or screw.point is None:
            return "no force along"
        wrenches = self.search.actions.wrenches[0, step.group][..., carrier.columns, :].sum(axis=0)
        axis, place = marks.directions[screw.direction, 0], marks.place(carrier.name)
        if place is None or np.abs(moved(wrenches, -place)[:, 3:] @ axis).max(initial=0.0) > NOTHING * marks.extent:
            return "no work"
        meets = np.abs(np.cross(place - marks.points[screw.point, 0], axis)).max() < NOTHING * marks.extent
        return "meets" if meets else "meets or parallel"

    def _component(self, carrier: Carrier, step: Step) -> str:
        """Return the component of an opened joint in an equation, in words, or its symbol."""
        place, actions = self.search.landmarks.place(carrier.name), self.search.actions
        if place is None:
            return said(WORDS[carrier.kind], name=carrier.name)
        body = next(body for body in reversed(carrier.bodies) if step.group[body])
        wrenches, twist = moved(actions.wrenches[0, body, carrier.columns], -place), step.twists[0, body]
        velocity = twist[:3] + np.cross(twist[3:], place)
        ways = {"force": (wrenches[:, :3], velocity), "moment": (wrenches[:, 3:], twist[3:])}
        acting = [part for part, (held, way) in ways.items() if np.abs(held @ way).max() > NOTHING]
        if len(acting) != 1:
            return said(WORDS["relation"], of=carrier.name)
        held, way = ways[acting[0]]
        along = held.T @ np.linalg.pinv(held.T) @ way  # what the joint transmits of it
        return self._along(acting[0], carrier, along / np.linalg.norm(along))

    def _along(self, part: str, carrier: Carrier, way: Array) -> str:
        marks = self.search.landmarks
        apart = np.linalg.norm(np.cross(marks.directions[:, 0], way), axis=1)
        names = [marks.direction_names[k] for k in np.flatnonzero(apart < ALIKE)]
        for axis, _, link in (name.partition(" of ") for name in names):
            quantity = f"{carrier.kind}.{carrier.name}.{part}.{f'along.{link}.' if link else ''}{axis}"
            if symbol := self._symbols.get(quantity):
                return symbol
        words = WORDS[f"{part} of" if names else "relation"]
        return said(words, of=carrier.name, direction=_direction(names[0]) if names else "")

    @cached_property
    def _symbols(self) -> Mapping[str, str]:
        return {expression.text.strip(): name for name, expression in symbols_of(self.quantities).items()}

    @cached_property
    def _arbitrary(self) -> list[Source]:
        """Known actions in an arbitrary motion, by which equations that contain them are found."""
        model, q = self.mechanism.model, self.search.actions.links.q[:1]
        frictions = (friction.quantity for friction in self.mechanism.frictions)
        moving = np.remainder(GOLDEN * np.arange(1.0, 1.0 + model.nv), 1.0)[None]
        row = Trajectory.schema_row(self.mechanism, q[0], "t", unit("s"))
        row = replace(row, v=moving, a=moving, columns={name: Series(name, None, np.ones(1)) for name in frictions})
        return [*forces_of(row), *weights_of(row), *inertias_of(row)]

    def _terms(self, step: Step, acting: Sequence[Source]) -> tuple[Term, ...]:
        """Return the terms of an equation in a state: its unknowns, and what acts and is not rounding."""
        unknown = [(carrier.name, carrier.kind) for carrier in step.unknowns(self.search.actions)]
        size, known = self._size(acting, step), {(source.name, source.kind) for source in acting}
        terms = [Term(self._label(*name, step), "unknown", value=0.0) for name in unknown if name not in known]
        for source in acting:
            is_unknown, value = (source.name, source.kind) in unknown, source.power(step.twists[0])
            role = "unknown" if is_unknown else source.kind if source.kind in ROLES else "known"
            if is_unknown or abs(value) > ROUNDED * size:
                label = self._label(source.name, source.kind, step)
                terms.append(Term(label, role, source.name.partition(",")[0], value))
        return tuple(sorted(terms, key=lambda term: ROLES.index(term.role)))

    def _label(self, name: str, kind: str, step: Step) -> str:
        if kind in ("drive", "law"):
            own = self.wanted.symbol if (name, self.wanted.kind) == (self.wanted.of, "effort") else ""
            return own or self._symbols.get(f"joint.{name}.effort") or _named(kind, name)
        function, carrier = self.search.wanted, self.search.actions.carrier(name, kind)
        along = (step.rows * function).sum(axis=1) / (function**2).sum(axis=1)
        if carrier is not None and name == self.wanted.of and self._is_multiple(step, carrier, along):
            sign = {1.0: "", -1.0: "-"}.get(round(float(along[0]), 9)) if np.ptp(along) < ALIKE else None
            part = "lever" if step.screw is None or step.screw.point is not None else "projection"
            return said(WORDS[part], of=self.wanted.symbol) if sign is None else sign + self.wanted.symbol
        return _named(kind, name)

    def _is_multiple(self, step: Step, carrier: Carrier, along: Array) -> bool:
        """Tell whether a carrier's term in an equation is the wanted unknown times ``along``, shape (c,)."""
        own = np.any(self.search.wanted != 0.0, axis=0)
        own[carrier.columns] = True
        rest = (step.rows - along[:, None] * self.search.wanted)[:, own]
        return bool(np.abs(rest).max() < ALIKE * np.abs(step.rows).max() and np.abs(along).min() > NOTHING)

    def _in_numbers(self, isolation: Isolation, chain: Chain, state: Quantities, where: str) -> Isolation:
        """Return a derivation with the terms of its equations in a state, and the unknown that follows from them."""
        row = state.trajectory
        actions = self._actions(row.q)
        acting = sources(state, actions, split=self.wanted.kind == "law")
        steps = [self._placed(step, row.q, Landmarks.at(row.mechanism, actions.links)) for step in chain.steps]
        inner = np.any([step.left for step in steps], axis=0)
        rows = np.array([np.einsum("bkw,bw->k", actions.wrenches[0], step.twists[0])[inner] for step in steps])
        weights = np.linalg.lstsq(rows.T, function_of(self.wanted, actions, state)[0, inner], rcond=None)[0]
        solution, value = self._solution(state), float(weights @ [_rest(acting, step, actions) for step in steps])
        scale = max(float(np.abs(weights) @ [self._size(acting, step) for step in steps]), abs(solution), TINY)
        if not abs(value - solution) <= AGREE * scale:
            raise InputError(
                f"'{self.wanted.name}': the equations give {value:.9g}, the full solution {solution:.9g}: "
                "something acts that isolations do not tell, such as a spring in the joint or losses of a drive",
                expected="the derivation without numbers: Mechanism.isolate(name)",
            )
        equations = tuple(
            replace(equation, terms=self._terms(step, acting), unit=self._unit(step), scale=self._size(acting, step))
            for equation, step in zip(isolation.equations, steps, strict=True)
        )
        measured = self._unit(None) if self.wanted.kind == "law" else str(state[self.wanted.quantity].unit)
        asked = state[self.wanted.name] if self.wanted.formula else None
        text = "" if asked is None else f"{asked.values[0]:.9g} {asked.unit}"
        isolation = replace(isolation, equations=equations, where=where, unit=measured)
        return replace(isolation, value=value, solution=solution, scale=scale, asked=text)

    def _size(self, acting: Sequence[Source], step: Step) -> float:
        return max((source.size(step.twists[0], self.search.landmarks.extent) for source in acting), default=0.0)

    def _placed(self, step: Step, q: Array, marks: Landmarks) -> Step:
        """Return an equation with the motion of its bodies at another configuration, shape (1, nq)."""
        if step.screw is not None:
            return replace(step, twists=step.group[None, :, None] * marks.twists([step.screw])[0][:, None])
        if (moving := motion_of_whole(self.mechanism, q, self._acting[0], self.wanted.of)) is None:
            raise InputError(
                f"'{self.wanted.of}' does not move the mechanism here: a dead point", expected="another instant"
            )
        return replace(step, twists=moving[0])

    def _unit(self, step: Step | None) -> str:
        if step is None or step.screw is None:
            return "N" if self.mechanism.coordinates[self.wanted.of].unit == METRE else "N*m"
        return "N" if step.screw.point is None else "N*m"

    def _solution(self, state: Quantities) -> float:
        if self.wanted.kind != "law":
            return float(state[self.wanted.quantity].values[0])
        effort, joint = state.trajectory.effort_along(self.wanted.of), self.mechanism.joints.get(self.wanted.of)
        given = 0.0 if joint is None else state.trajectory.tau[0, joint.v]
        return float(given if effort is None else effort[0])


def _direction(name: str) -> str:
    """Return the name of a direction in words; that of an axis of the world is its letter."""
    axis, of, link = name.partition(" of ")
    if axis == "axis":
        return said("axis of {name}", name=link)
    return said("{axis} of {link}", axis=axis, link=link) if of else name


def _named(kind: str, name: str) -> str:
    """Return the name of a term; what demands only a part of an inertia has this part after a comma."""
    body, comma, part = name.partition(", ") if kind == "inertia" else (name, "", "")
    words = said(WORDS[kind], name=said(body) if body in UNNAMED else body)
    return f"{words}, {said(part)}" if comma else words


UNNAMED = ("joint damping", "end stops and given efforts")
"""Actions that have no name in a file."""


def _rest(acting: Sequence[Source], step: Step, actions: Actions) -> float:
    """Return the sum of the unknown terms of an equation: inertias less known terms."""
    left = {(unknown.name, unknown.kind) for unknown in step.unknowns(actions)}
    known = (source for source in acting if (source.name, source.kind) not in left)
    return sum((1.0 if source.kind == "inertia" else -1.0) * source.power(step.twists[0]) for source in known)


def _senses(state: Quantities) -> dict[str, float]:
    """Return the signs of the multipliers of couplings in one row."""
    run, lam = state.trajectory, state.trajectory.lam[0]
    starts = {relation.name: run.closure.slices[relation.name].start for relation in run.mechanism.relations}
    return {name: float(np.sign(lam[start])) for name, start in starts.items()}


@in_language
def isolation_in_run(result: Result, name: str, at: str = "") -> Isolation:
    """Return the derivation of a wanted unknown, with numbers at an instant of a run; see ``Result.isolate``."""
    quantities, run = result.quantities, result.trajectory
    wanted = wanted_of(quantities, name)
    if run.no_efforts:
        return Derivation(quantities, wanted, run.q[len(run) // 2]).isolation(None)
    if at:
        place = RunNumber.read(f"{wanted.quantity} @ {at}").at
        if isinstance(place, str) and is_figure(place):
            raise InputError(f"'{at}' is a figure of the whole run, no instant", expected="t=1.5 s, max, start or end")
        state = result.lookup.at(place, wanted.quantity)
    else:
        middle = wanted.kind == "law"
        row = len(run) // 2 if middle else int(np.nanargmax(np.abs(quantities[wanted.quantity].values)))
        state = quantities.of(run.some(np.array([row])))
    here = {"parameter": run.parameter, "value": state.trajectory.grid.t[0], "unit": run.unit}
    where = said("at {parameter} = {value:.6g} {unit}", **here)
    return Derivation(quantities, wanted, state.trajectory.q[0], _senses(state)).isolation(state, where)


def isolation_of(
    mechanism: Mechanism, name: str, states: Sequence[Array | None], drives: Sequence[str], t: float
) -> Isolation:
    """Return the derivation of a wanted unknown of a mechanism; see ``Mechanism.isolate``.

    Args:
        mechanism: The mechanism.
        name: What is wanted.
        states: q, v, a and tau of the state of the numbers, as far as they are given.
        drives: Coordinates that drives act along.
        t: Instant [s].
    """
    q, v, a, tau = states
    start = generic_near(mechanism, mechanism.start) if q is None else np.asarray(q, float)
    row = Trajectory.schema_row(mechanism, start, "t", unit("s"))
    wanted = wanted_of(Quantities(row), name)
    every = () if wanted.kind == "law" else everywhere(mechanism)
    if not drives and wanted.kind == "effort" and every is None:
        drives = [wanted.of]
    if q is None:
        acting = along(mechanism, drives) if drives else every
        driven, names = (acting.driven, (*acting.coordinates(mechanism),)) if acting else (None, ())
        return Derivation(Quantities(replace(row, driven=driven, drives=names)), wanted, start).isolation(None)
    if wanted.kind == "law" and not drives and a is None and tau is None:
        tau = np.zeros(mechanism.model.nv)
    rows = state_quantities(mechanism, start, v, a, tau, drives, t).rows
    state = None if rows.trajectory.no_efforts else rows
    senses, where = ({}, "") if state is None else (_senses(state), said("in the given state"))
    return Derivation(rows, wanted, start, senses).isolation(state, where)
