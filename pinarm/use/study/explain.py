"""Structure of a model or a scenario: coordinates, loops, mobility, redundancy, loads, parts left out; equations."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.constraint_rows import joint_ties
from pinarm.engine.constraints.self_stresses import Loosening, Mobility, joint_kind, mobility_of
from pinarm.engine.kernel.library import absence
from pinarm.engine.kinematics.assembly import beside, closed_drawing, generic
from pinarm.engine.kinematics.newton import start_configuration
from pinarm.engine.mechanism import Mechanism
from pinarm.errors import LISTED, InputError, UnitError, choices, require_map, several
from pinarm.input.units import read_quantity
from pinarm.input.yaml.document import Values
from pinarm.mechanics.couplings.coupling import JointRelation, left_open
from pinarm.mechanics.loading.pinocchio_layout import FLOATING
from pinarm.mechanics.loops.loop_joints import CableLoop, LoopJoint
from pinarm.mechanics.rotors import GearedRotor
from pinarm.problems.simplification import Removal
from pinarm.records import replace
from pinarm.use.facade import Scenario
from pinarm.use.mechanism import with_methods
from pinarm.use.result.failures import failures_in_words
from pinarm.use.show.text import counted
from pinarm.use.study.quantities import Subject, subject
from pinarm.use.study.run import run

if TYPE_CHECKING:
    from pinarm.engine.motion.segmented.hybrid_system import HybridSystem
    from pinarm.mechanics.forces.force_element import ForceElement
    from pinarm.problems.control import ControlOfRun
    from pinarm.problems.linear import Linear
    from pinarm.use.letters.equations import Equations
    from pinarm.use.method.isolation import Isolation
    from pinarm.use.show.picture import Picture


ROWS = 9
"""Number of rows of a scenario's motion among which the usual mobility is looked for."""


@dataclass(frozen=True)
class Explanation:
    """The structure of a mechanism, in one configuration.

    Attributes:
        mechanism: The mechanism.
        mobility: What its constraints do.
        q: Pinocchio's configuration, shape (nq,).
        where: Which configuration that is, in words.
        removals: Joints that the scenario is solved without.
        control: Controllers of the scenario's problem, beside those of the mechanism.
        modes: Modes of a linear analysis, in words, and why some have the frequency 0.
    """

    mechanism: Mechanism
    mobility: Mobility
    q: Array = field(repr=False)
    where: str
    removals: Sequence[Removal] = ()
    control: Sequence[ControlOfRun] = ()
    modes: Sequence[str] = ()

    def __repr__(self) -> str:
        return f"<Explanation of '{self.mechanism.title}': mobility {self.mobility.mobility} {self.where}>"

    def __str__(self) -> str:
        """Return it as text, a heading a paragraph."""
        lines = [*self._joints(), *self._ties(), *self._transmitted(), *self._mobility(), *self._counted()]
        return "\n".join([self.mechanism.title, *lines, *self._acting(), *self.modes, *self._modelled()])

    def summary(self) -> dict[str, Any]:
        """Return the mobility, what is left undetermined, and what need not be solved for, as plain data."""
        import msgspec

        told = ("mobility", "joints", "rows", "rank", "degree", "regularity", "undetermined", "loosenings", "spins")
        mobility = {name: msgspec.to_builtins(getattr(self.mobility, name)) for name in told}
        removals = msgspec.to_builtins(self.removals)
        return {"mechanism": self.mechanism.title, "where": self.where, **mobility, "not solved for": removals}

    def sketch(self) -> Picture:
        """Return a drawing of the mechanism in that configuration, with the names of parts, points, joints, loops."""
        from pinarm.use.show.drawings import structure

        return structure(self.mechanism, self.q, f"mobility {self.mobility.mobility} {self.where}")

    def graph(self) -> Picture:
        """Return the graph of links: bodies, and the joints, loop joints and couplings between them."""
        from pinarm.use.show.structure import link_graph

        return link_graph(self.mechanism)

    def draw(self, file: str | Path, *, dpi: int = 200, graph: bool = False) -> Path:
        """Write the drawing to a file and return its path.

        Args:
            file: Its suffix says the format: ``.svg``, ``.png`` or ``.pdf``.
            dpi: Pixels per inch of PNG.
            graph: Whether it is the graph of links in place of the drawing.

        Raises:
            InputError: It has another suffix, or cannot be written.
        """
        from pinarm.use.output import write_file
        from pinarm.use.show.picture_files import picture_format

        path = Path(file)
        form = picture_format(path.suffix[1:], dpi)
        write_file(path, [(self.graph() if graph else self.sketch()).encoded(form, dpi)])
        return path

    def _repr_html_(self) -> str:
        from pinarm.use.show.text import figure, lines

        return figure(self.sketch()) + lines(str(self))

    def _joints(self) -> list[str]:
        model = self.mechanism.model
        lines = [f"joints of the tree: {model.nv} degrees of freedom"]
        for index in range(1, model.njoints):
            mass = model.inertias[index].mass
            carried = f"moves {mass:g} kg" if mass else "moves no mass of its own"
            parent = f" on {model.names[model.parents[index]]}" if model.parents[index] else ""
            lines.append(f"  {model.names[index]}: {joint_kind(model, index)}{parent}, {carried}")
        return lines

    def _ties(self) -> list[str]:
        model, lines = self.mechanism.model, ["loops and couplings:"]
        for constraint in self.mechanism.constraints:
            if isinstance(constraint, LoopJoint):
                between = f"{model.frames[constraint.first].name} and {model.frames[constraint.second].name}"
                lines.append(f"  {constraint.name}: {constraint.kind} between {between}, {constraint.size} rows")
            elif isinstance(constraint, JointRelation):
                lines.append(f"  {constraint.name}: {constraint.kind}, 1 row; {constraint.description}")
            elif isinstance(constraint, CableLoop):
                given = self.mechanism.description.loops.get(constraint.name)
                drawn = ", as with all joint coordinates at 0" if getattr(given, "length", 0.0) is None else ""
                course = f"through {constraint.path.words(model)}, {constraint.offset:g} m long{drawn}"
                lines.append(f"  {constraint.name}: cable {course}, 1 row; pulls only")
            elif isinstance(constraint, GearedRotor):
                lines.append(f"  {constraint.name}: ties {constraint.rotor.name}, 1 row")
        belts = [friction.coupling for friction in self.mechanism.frictions if friction.coupling and friction.replaces]
        lines += [f"  {belt.name}: belt, no row: friction ties its wheels; {belt.description}" for belt in belts]
        return lines if len(lines) > 1 else ["no loops: an open chain"]

    def _mobility(self) -> list[str]:
        mobility = self.mobility
        counted = f"{mobility.joints} joint coordinates, {mobility.rank} independent of {mobility.rows} constraint rows"
        lines = [f"mobility {mobility.mobility} {self.where}: {counted}"]
        if (closure := self.mechanism.closure).rolls:
            held = closure.holonomic
            free = held.split_at(self.q).free.shape[1]
            lines.append(f"{free} positions may be chosen: rolling binds velocities alone")
        if mobility.rows:
            lines.append(
                f"regularity {mobility.regularity:.2g} in this position: smallest singular value of the rows "
                "over the largest. Runs tell how far it falls: 0 at a singular position"
            )
        if mobility.spins:
            lines.append(
                f"{len(mobility.spins)} of these are links that spin by themselves about their own axis, such as rods "
                f"between two ball joints: {', '.join(mobility.spins)}. They move nothing else; a universal joint in "
                "place of one of the ball joints, or a loop of the kind rod in place of the link, leaves them out"
            )
        opened = self._left_open()
        if not mobility.degree:
            but = " but for what couplings leave open:" if opened else ""
            return [*lines, f"isostatic: every reaction is determined{but}", *opened]
        lines.append(f"hyperstatic of degree {mobility.degree}; not determined by rigid bodies:")
        lines += _together((name, f": {', '.join(parts)}") for name, parts in mobility.undetermined.items())
        lines += ["left open by couplings:", *opened] if opened else []
        best: dict[str, Loosening] = {}
        for loosening in mobility.loosenings:
            best.setdefault(loosening.changes[0][0], loosening)
        alone = {name: str(change).removeprefix(name) for name, change in best.items() if len(change.changes) == 1}
        looser = [*_together(alone.items()), *(f"  {change}" for name, change in best.items() if name not in alone)]
        return [*lines, *(["what could be loosened without more mobility, one at a time:", *looser] if best else [])]

    def _transmitted(self) -> list[str]:
        """Return the shapes of the static torsors of joints, those of one shape in one line."""
        from pinarm.use.method.torsors import shapes

        words_of_joints = ((name, f": {shape}") for name, shape in shapes(self.mechanism, self.q).items())
        return ["forces X Y Z and moments L M N that joints transmit, in their own axes:", *_together(words_of_joints)]

    def _counted(self) -> list[str]:
        """Return the degree of hyperstatism from the numbers of bodies, joints and freedoms, line by line."""
        mechanism, model, free = self.mechanism, self.mechanism.model, self.mobility.mobility
        idle = {tie.rotor.index for tie in joint_ties(mechanism.constraints)}
        moving = [model.joints[k].nv for k in range(1, model.njoints) if k not in idle]
        closing = [
            6 - constraint.size for constraint in mechanism.constraints if isinstance(constraint, LoopJoint | CableLoop)
        ]
        if not closing and not mechanism.relations:
            return []
        joints, freedoms, ties = len(moving) + len(closing), sum(moving) + sum(closing), len(mechanism.relations)
        loops, added = joints - len(moving), (f" + {ties}" if ties else "")
        return [
            "counted from the graph of links:",
            f"  bodies without the ground: {len(moving)}; joints between them: {joints}; "
            f"independent loops: {joints} - {len(moving)} = {loops}",
            f"  freedoms of the joints: {freedoms}" + (f"; couplings: {ties}" if ties else ""),
            f"  degree of hyperstatism: mobility + 6 * loops - freedoms{' + couplings' if ties else ''} = "
            f"{free} + {6 * loops} - {freedoms}{added} = {free + 6 * loops - freedoms + ties}",
        ]

    def _left_open(self) -> list[str]:
        """Return a line for every joint whose reaction depends on how couplings transmit their forces."""
        mechanism = self.mechanism
        couplings = [constraint for constraint in mechanism.constraints if isinstance(constraint, JointRelation)]
        return [
            f"  {mechanism.model.names[joint]}: by {', '.join(coupling.name for coupling in reaction.couplings)}"
            for joint, reaction in left_open(mechanism.model, couplings).items()
        ]

    def _acting(self) -> list[str]:
        mechanism = self.mechanism
        direction = mechanism.model.gravity.linear
        lines = [f"gravity: {', '.join(f'{x:g}' for x in direction)} m/s^2" if direction.any() else "no gravity"]
        lines += [
            ": ".join(filter(None, (f"force {name}", force.description))) + self._pulling(force)
            for name, force in mechanism.forces.items()
        ]
        frictions = {friction.name: friction.law.words(friction.effort) for friction in mechanism.frictions}
        lines += [f"friction of {name.replace('.', ' ', 1)}: {law}" for name, law in frictions.items()]
        lines += [f"drive {name} at {drive.coordinate}" for name, drive in mechanism.drives.items()]
        acting = [*mechanism.control, *self.control]
        lines += [f"controller of {', '.join(control.drives)}: {control.description}" for control in acting]
        return [*lines, *(f"note: {note}" for note in counted(mechanism.notes))]

    def _pulling(self, element: ForceElement) -> str:
        """Return length and pull or push of an element between two points, at rest; empty for other elements."""
        measures = element.measures()
        if not {"length", "tension"} <= measures.keys():
            return ""
        state = np.zeros(1), self.q[None], np.zeros((1, self.mechanism.model.nv))
        length, tension = (float(measures[name].values(*state)[0]) for name in ("length", "tension"))
        acts = f"pulls with {tension:.4g} N" if tension >= 0.0 else f"pushes with {-tension:.4g} N"
        return f", {length:.4g} m long {self.where}, {acts}"

    def _modelled(self) -> list[str]:
        """Return remarks on the convention of q and v, joints left out with reasons, and a missing kernel."""
        model = self.mechanism.model
        lines = self._convention()
        if self.removals:
            count = model.njoints - 1
            lines.append(f"solved for: {count - len(self.removals)} of {count} joints")
        lines += [f"  {removal.joint}: {removal.how}, {removal.why}" for removal in self.removals]
        reason = absence()
        return [*lines, f"compiled kernel: {reason}; steps of motions are computed in Python"] if reason else lines

    def _convention(self) -> list[str]:
        """Return the convention of q and v where it differs from that of Pinocchio's reader; empty elsewhere."""
        if self.mechanism.description.planar is not None:
            return []
        with suppress(InputError):  # Pinocchio's reader has no such model
            words = self.mechanism.pinocchio_layout.words()
            return [f"q and v: {words}. Mechanism.from_pinocchio converts"] if words else []
        floating = [name for name in self.mechanism.balls if f"{name}.x" in self.mechanism.joints]
        return [f"q and v: of {', '.join(floating)} {FLOATING}"] if floating else []


def _together(said: Iterable[tuple[str, str]]) -> list[str]:
    """Return lines of names and what is said of them, in one line where the same is said of several."""
    names: dict[str, list[str]] = {}
    for name, words in said:
        names.setdefault(words, []).append(f"'{name}'" if set(name) & set(" ,:'") else name)
    return [f"  {several(some, LISTED)}{words}" for words, some in names.items()]


def explain(path: Subject, values: Values | None = None) -> Explanation:
    """Return the structure of a scenario's mechanism where its motion begins, or of a model near its zero position.

    Where that is a singular position it is that of a closed one beside it.

    Args:
        path: A scenario or a mechanism, or the file or the data of either; a model file, or the name of a robot.
        values: Other values than those of the scenario (see ``pinarm.load``), or of the mechanism file (see
            ``Mechanism.load``).

    Raises:
        PinarmError: The file has a mistake, or the loops cannot be closed.
    """
    meant = subject(path, values)
    if isinstance(meant, Mechanism):
        return _structure(meant)
    removals = meant.simplification.removals
    explanation = _explained(meant.mechanism, _positions(meant), "where the motion begins", removals)
    modes = _modes(meant) if meant.problem.kind == "linear" else ()
    return replace(explanation, control=getattr(meant.problem, "control", ()), modes=modes)


def isolate(path: Subject, wanted: str, values: Values | None = None, *, at: str = "") -> Isolation:
    """Return the bodies to isolate, and the theorems to apply, for an effort, a reaction or a law of motion.

    A scenario is solved, and the equations have numbers at an instant; those of a mechanism have none. See
    ``Result.isolate`` and ``Mechanism.isolate``.

    Args:
        path: A scenario or a mechanism, or the file or the data of either; a model file, or the name of a robot.
        wanted: A quantity such as ``joint.B.effort``, a symbol or a formula of one, or a coordinate.
        values: Other values than those of the file; see ``pinarm.load`` and ``Mechanism.load``.
        at: Instant of the numbers, such as ``phi=0 deg``; see ``Result.isolate``.

    Raises:
        PinarmError: The file has a mistake, or it is nothing that an equation can give.
    """
    meant = subject(path, values)
    if not isinstance(meant, Mechanism):
        return meant.run().isolate(wanted, at)
    if at:
        raise InputError("an instant is given, and a mechanism without a motion", expected="a scenario")
    return with_methods(meant).isolate(wanted)


def _modes(scenario: Scenario) -> list[str]:
    """Return a line for each mode of a linear analysis, and why modes have the frequency 0."""
    from pinarm.engine.linear.linear_states import rigid_modes

    problem: Linear = scenario.problem  # type: ignore[assignment]
    place = partial(scenario.document.locating, "problem")
    linear = problem.linearisation(scenario.mechanism, scenario.content.accuracy, place)
    modes, shapes = linear.modes, np.abs(linear.shapes())
    lines = [f"modes of small motions of {', '.join(linear.joints[k] for k in linear.motion.independent.tolist())}:"]
    for k, (frequency, damping) in enumerate(zip(modes.frequencies, modes.damping_ratios, strict=True)):
        largest = linear.joints[int(shapes[:, k].argmax())]
        lines.append(f"  {k + 1}: {frequency:.4g} Hz, damping {damping:.3g}, most at {largest}")
    notes = [linear.friction.note] if linear.friction.note else []
    return [*lines, *(f"  {line}" for line in (*notes, *rigid_modes(linear)))]


def _positions(scenario: Scenario) -> list[Array]:
    """Return where a scenario begins, and further closed configurations: beside it, of an integrated motion."""
    if scenario.problem.kind == "forward" and not scenario.content.find:
        return beside(scenario.mechanism, _start(scenario))
    q = run(scenario).trajectory.q
    return [q[k] for k in np.unique(np.linspace(0, len(q) - 1, ROWS).astype(int))]


def _start(scenario: Scenario) -> Array:
    """Return where an integrated motion begins, its loops closed, shape (nq,); the motion is not solved."""
    place = partial(scenario.document.locating, "problem")
    with failures_in_words():
        system: HybridSystem = scenario.problem.prepare(scenario.mechanism, scenario.content.accuracy, place)
        with place("initial"):
            return system.begin()[0]


def _structure(mechanism: Mechanism) -> Explanation:
    drawing = closed_drawing(mechanism.closure, start_configuration(mechanism, {}))
    where = "in a closed position far from zero" if drawing.notes else "in the closed position nearest to zero"
    where = "in the closed position nearest to the file's start" if mechanism.start else where
    return _explained(mechanism, beside(mechanism, drawing.q), where)


def _explained(mechanism: Mechanism, q: Sequence[Array], where: str, removals: Sequence[Removal] = ()) -> Explanation:
    """Return the structure at the first of some closed configurations that is of no special kind."""
    judged = generic(mechanism, q)
    first = where if judged is q[0] else f"beside a singular position, which is {where}"
    return Explanation(mechanism, mobility_of(mechanism, judged), judged, first, removals)


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
