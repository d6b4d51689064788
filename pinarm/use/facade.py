"""``pinarm.Scenario`` and ``pinarm.Result``: the records with methods for users, which reach every view and study.

Nothing below imports them: there the records of ``use.scenario.scenario`` and ``use.result.result`` serve.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self, cast

from pinarm.engine.checks.balance import plain, power_balance
from pinarm.engine.checks.residuals import residual_figures
from pinarm.engine.constraints.nullspace import one_blas_thread
from pinarm.engine.mechanism import Mechanism as MechanismParts
from pinarm.engine.motion.outcome import Outcome
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError, NumericsError
from pinarm.input.yaml.document import Values
from pinarm.language import decimals, in_language, told
from pinarm.records import replace
from pinarm.use.mechanism import Mechanism, with_methods
from pinarm.use.result import result as results
from pinarm.use.result.failures import failures_in_words
from pinarm.use.scenario import scenario as scenarios
from pinarm.use.workers.runners import Runners

if TYPE_CHECKING:
    from concurrent.futures import Executor

    import meshcat
    from control import StateSpace

    from pinarm.mechanics.control.function import ControlFunction
    from pinarm.use.method.isolation import Isolation
    from pinarm.use.method.torsors import Torsor
    from pinarm.use.show.picture import Picture
    from pinarm.use.show.replay.page import Replay


class Result(results.Result, frozen=True):
    """The answer to a scenario: quantities by name, numbers, sections, figures of accuracy, plots, replays, files.

    Its fields, such as ``scenario``, ``figures``, ``errors``, ``setting`` and ``removals``, are those of
    ``use.result.result.Result``.
    """

    def to_control(self) -> StateSpace:
        """Return a linear analysis as a state space of python-control, with names of states, inputs and outputs.

        All is in SI. Dots in names, which python-control does not allow, become underscores. The states are the outputs
        where the problem names none.

        Raises:
            InputError: It is no linear analysis, or python-control is not installed.
        """
        from pinarm.use.result.vibrations import state_space

        return state_space(self)

    def torsor(self, of: str, at: str = "", along: str = "", kind: str = "") -> Torsor:
        """Return a torsor over the rows of the run, which prints as two columns, resultant and moment.

        Args:
            of: A joint, loop joint or coupling: its action, of the parent on the child or of the first link on the
                second, or with ``kind="kinematic"`` the motion of one in the other; or a link.
            at: Point of the moment: a link or point, a joint or a loop joint; its own origin where it is left out.
            along: Link in whose axes components are; the world's where it is left out.
            kind: ``static``, ``kinematic``, ``kinetic`` or ``dynamic``; static of joints and kinematic of links where
                it is left out.

        Raises:
            InputError: There is no such thing, or the run has no efforts.
        """
        from pinarm.use.method.torsors import torsor

        return torsor(self, of, at, along, kind)

    def isolate(self, wanted: str, at: str = "") -> Isolation:
        """Return the bodies to isolate, and the theorems to apply, for an effort, a reaction or a law of motion.

        Args:
            wanted: A quantity such as ``joint.B.effort`` or ``loop.D.force.x``, a symbol or a formula of one, or a
                coordinate, whose law of motion is wanted.
            at: Instant of the numbers, such as ``phi=0 deg``, ``t=1.5 s, side=left`` or ``max``; where it is left out
                the row in which the unknown is largest, or of laws of motion the one in the middle.

        Raises:
            InputError: It is nothing that an equation can give, or the run does not come to the instant.
        """
        from pinarm.use.method.derivation import isolation_in_run

        return isolation_in_run(self, wanted, at)

    def plot(self, *names: str, against: str | None = None) -> Picture:
        """Return a figure with one axis per quantity.

        Args:
            names: Quantities, symbols or formulas; the outputs of the scenario where none is given. Of a linear
                analysis also a graph: ``eigenvalues``, ``bode`` or ``nyquist``, with ``_OUTPUT`` where there are
                several.
            against: What runs along the horizontal axis; the run's parameter where it is left out.
        """
        from pinarm.use.show.picture import graph, graph_named, plot

        chosen = names or tuple(self.content.outputs)
        drawn = graph_named(self, chosen)
        return plot(self, chosen, against=against) if drawn is None else graph(drawn, self.presentation)

    def sketch(self, *, forces: bool = False, at: float | str | None = None) -> Picture:
        """Return a drawing of the mechanism at the start and the end of the run, or its free-body diagrams.

        Args:
            forces: Whether to draw every body by itself with all its loads at one instant: an arrow for each force, to
                one scale; moments with their sizes; weight and inertia relief at the centre of mass.
            at: Value of the run's parameter for ``forces``, with its unit, such as ``40 deg``, or in SI, such as
                ``result.number("t @ max(C_B)")[0]``; the first row where it is left out.

        Raises:
            InputError: The run does not come there.
        """
        from pinarm.use.show.drawings import free_body_diagrams, sketch

        return free_body_diagrams(self, at) if forces else sketch(self)

    def replay(
        self,
        path: str | Path | None = None,
        *,
        traces: Sequence[str] = (),
        arrows: Sequence[str] = (),
        plots: Sequence[str] | None = None,
        named: bool = False,
    ) -> Replay:
        """Return the moving picture of the run: one HTML page, which a notebook shows and ``save`` writes.

        Args:
            path: Where to write it; nowhere where it is left out.
            traces: Links whose origins leave a path; ``com`` for the centre of mass.
            arrows: Of ``forces``, ``torques``, ``reactions``, or ``all``.
            plots: Quantities beside the picture; the outputs of the scenario where it is ``None``.
            named: Whether names of parts, points and joints are shown from the start; the key N shows and hides them.

        Raises:
            InputError: A name is unknown, or the run does not have what is asked.
        """
        from pinarm.use.show.replay.page import replay_page

        shown = replay_page(self, traces=traces, arrows=arrows, plots=plots, named=named)
        if path is not None:
            shown.save(path)
        return shown

    def show(self, visualizer: Any = None, *, name: str = "pinarm") -> meshcat.Visualizer:
        """Show the run in a live meshcat viewer, as an animation with meshcat's own controls, and return the viewer.

        ``viewer.open()`` shows it in the browser, ``viewer.jupyter_cell()`` in a notebook. Angles and lengths are those
        of the replay; bodies stand below ``name`` by the names of their joints, ``viewer["pinarm"]["knee"]``.

        Args:
            visualizer: A ``meshcat.Visualizer``, or Pinocchio's ``MeshcatVisualizer``; a new one, which only this
                machine can reach, where it is left out.
            name: Path of the mechanism in the viewer's tree; what stood there is replaced, all else stays.

        Raises:
            InputError: It is no viewer.
        """
        from pinarm.use.show.replay import live

        return live.show(self, visualizer, name=name)

    def save(self, folder: str | Path, *, plots: Literal["svg", "png", "pdf"] | bool = True, dpi: int = 200) -> Path:
        """Write the result as a folder: scenario, summary, CSV, npz, plots; return the folder.

        Args:
            folder: Where to; an earlier result there is replaced.
            plots: Format of the plots, ``svg`` (the default), ``png`` or ``pdf``; ``False`` for none.
            dpi: Pixels per inch of PNG.
        """
        from pinarm.use.store.save import save

        return save(self, Path(folder), plots=plots, dpi=dpi)

    @in_language
    def _repr_html_(self) -> str:
        """Return numbers to seven digits, and the report with its replay, for notebooks; saved ones keep it."""
        from pinarm.use.show.text import aligned, lines, ranges, remarks

        heads, *rows = ranges(self)
        numbers = aligned([heads, *([*row[:2], *map(decimals, row[2:])] for row in rows)])
        page: str = import_module("pinarm").report(self)._repr_html_()  # by its public name: reports stand above
        return lines("\n".join([*numbers, *map(told, remarks(self))])) + page

    def __reduce__(self) -> tuple[Any, ...]:
        from pinarm.use.result.stored_rows import arrays_of, result_of

        outcome = {name: getattr(self.outcome, name) for name in ("notes", "decisions")}
        outcome["figures"] = dict(self.outcome.figures)
        measured = {name: getattr(self, name) for name in results.MEASURED} | {"figures": dict(self.figures)}
        return result_of, (self.scenario, self.trajectory.mechanism, arrays_of(self), outcome, measured)


class Scenario(scenarios.Scenario, frozen=True):
    """A scenario, read and checked; nothing is computed before ``run``.

    Its fields, such as ``document``, ``content``, ``problem`` and ``folder``, are those of
    ``use.scenario.scenario.Scenario``.
    """

    @cached_property
    def mechanism(self) -> Mechanism:
        """The mechanism, with the scenario's arguments and gravity, and controllers given in Python."""
        return with_methods(self.read_mechanism())

    def with_mechanism(self, mechanism: MechanismParts) -> Self:
        return super().with_mechanism(with_methods(mechanism))

    def result(self, outcome: Outcome) -> Result:
        quantities = Quantities(outcome.rows, self.symbols, self.content.undetermined)
        return Result(self.name, outcome, quantities, self)

    def controlled(
        self, control: Mapping[str | tuple[str, ...], ControlFunction], period: float | None = None, delay: float = 0.0
    ) -> Self:
        """Return the scenario with drives whose efforts are functions; see ``run``.

        Raises:
            InputError: It is no forward problem, a function cannot be called, or the period is not positive.
        """
        from pinarm.mechanics.control.function import function_controls

        if self.problem.kind != "forward":
            raise InputError(
                f"the problem is of the kind '{self.problem.kind}': its motion is known",
                expected="a forward problem, whose drives can react",
            )
        return replace(self, functions=(*self.functions, *function_controls(control, period, delay)))

    def with_forces(self, forces: Mapping[str, tuple[str, ControlFunction]]) -> Self:
        """Return the scenario with loads that are functions; see ``run``.

        Raises:
            InputError: One is no coordinate with a function.
        """
        from pinarm.mechanics.forces.function_effort import function_forces

        return replace(self, function_forces=(*self.function_forces, *function_forces(forces)))

    def run(
        self,
        control: Mapping[str | tuple[str, ...], ControlFunction] | None = None,
        *,
        period: float | None = None,
        delay: float = 0.0,
        forces: Mapping[str, tuple[str, ControlFunction]] | None = None,
    ) -> Result:
        """Solve the problem; with ``accuracy.target``, at the cheapest setting whose error is below it.

        Args:
            control: Drives whose efforts are functions: drive, or several in a tuple, -> ``u(t, state)``, which returns
                an effort, or a sequence of them [N*m or N]; ``state["knee"]`` is a quantity of the present state [SI].
                See docs/control.md.
            period: Of sampled functions [s]: called once each period, their effort is held until the next; continuous
                where it is left out.
            delay: From a sample to the change of the effort [s].
            forces: Loads that are functions, in problems of any kind: name -> coordinate that the load acts along, and
                ``f(t, state)``, which returns an effort [N*m or N]: ``{"brake": ("knee", f)}``. It has to depend on its
                arguments only, and to be smooth in them.

        Raises:
            PinarmError: The input is impossible, or the numerics failed; then ``partial`` holds the result until there.
        """
        if control is None and (period is not None or delay):
            raise InputError(
                "a period or a delay is given, but no function", expected="control, with functions of drives"
            )
        asked = self.controlled(control, period, delay) if control is not None else self
        asked = asked.with_forces(forces) if forces else asked
        asked.check_answer_key()
        return asked._reaching_target()

    def _reaching_target(self) -> Result:
        """Return the result; with ``accuracy.target``, at the cheapest setting whose error is below it."""
        search = self.content.find
        if self.content.accuracy.target is None or (search and search.objective):  # every run of which reaches it
            return self.solve()
        from pinarm.use.accuracy.tolerance_search import reach_target

        return cast("Result", reach_target(self))

    def with_workers(self, workers: int | None = None, executor: Executor | None = None) -> Self:
        """Return the scenario whose searches and sensitivities give their runs to others; the numbers are the same.

        Args:
            workers: Processes of this machine; this process where it is left out. Of an executor, how many workers it
                has, where it cannot tell.
            executor: Who solves the runs in place of processes of this machine; see ``pinarm.sweep``. It has to live as
                long as sections of results are asked for.

        Raises:
            InputError: There are less than one.
        """
        return replace(self, runners=Runners(workers, executor))

    def verified(self) -> Result:
        """Return the result with its global error estimated, and every row of it checked.

        Raises:
            PinarmError: See ``run``.
        """
        from pinarm.use.accuracy.error_estimate import estimate_errors

        self.check_answer_key()
        result = self._reaching_target()
        run, rows = result.trajectory, len(result)
        with one_blas_thread(self.mechanism.model.nv):
            figures = plain({**power_balance(run, rows), **residual_figures(run, result.outcome.motion, rows)})
        result = replace(result, figures={**result.figures, **figures})
        if result.errors:
            return result
        scenario = self.restated(result.data) if "find" in result.known else self
        return cast("Result", estimate_errors(scenario, result))

    def solve(self) -> Result:
        """Solve the problem once, at its own setting; with ``find``, for the values that bring about what is wanted.

        Raises:
            PinarmError: See ``run``.
        """
        self.check_presentation()
        if self.problem.kind == "recorded":  # the headings say what can be asked: a long table is not read in vain
            self.document.with_each("outputs", self.content.outputs, self.quantities().__getitem__)
        if self.content.find:
            from pinarm.use.scenario.searches import solve_found

            return cast("Result", solve_found(self, self.content.find))
        try:
            with failures_in_words():
                return cast("Result", self.solve_once())
        except NumericsError as error:
            if isinstance(error.partial, Outcome):
                error.partial = self.broken_off(error.partial, error.message)
            raise

    def validate(self) -> None:
        """Check everything that can be checked without solving: the model, all names, all units.

        Raises:
            PinarmError: Something is wrong; the message says where.
        """
        self._check_asked()
        self.quantities().check_symbols(self.symbols, self.document.locating)
        for name in self.content.variants:
            with self.document.locating("variants", name):
                self.variant(name)._check_asked()

    def _check_asked(self) -> None:
        """Check what is solved and what is asked of it; symbols of variants that do not ask for them may be others'."""
        self.require_memory()
        with failures_in_words():
            self.problem.prepare(self.mechanism, self.content.accuracy, self.place)
            quantities = self.quantities()
            self.document.with_each("outputs", self.content.outputs, quantities.__getitem__)
            self.check_presentation()
            if self.content.numbers:
                from pinarm.use.result.numbers import read_number
            for index, text in enumerate(self.content.numbers):
                with self.document.locating("numbers", index):
                    read_number(text).described(quantities, self.numbered)
            if self.content.find:
                from pinarm.use.scenario.searches import check_search

                check_search(self, self.content.find, quantities)
            for key, assessment in self.content.assessments.items():
                with self.document.locating(key):
                    assessment.check_names(quantities, self)
        self.check_answer_key()


Given = Scenario | str | Path | Mapping[str, Any]
"""A scenario, its file, or what such a file would hold as plain data."""


def load(scenario: Given, values: Values | None = None) -> Scenario:
    """Read and check a scenario file; nothing is computed before ``run``.

    Args:
        scenario: The file; or what such a file would hold, ``{"pinarm": 1, "mechanism": "panda", ...}``, with paths
            relative to the working folder, and a ``Mechanism``, or the data of its file, in place of the file; or a
            scenario that has been read, of which values are to be replaced.
        values: Other values than those of the file: ``{"problem.time.end": "3 s", "arguments.m_A": 0.2}``, or texts
            ``["problem.time.end=3 s"]``. A bare number is in SI, and allowed where the file has an SI unit or none.

    Raises:
        InputError: The file cannot be read or has a mistake, or a path leads nowhere; the message says where.
    """
    if isinstance(scenario, Mapping):
        scenario = Scenario.of_data(scenario)
    if isinstance(scenario, Scenario):
        return scenario.varied(values) if values else scenario
    if not isinstance(scenario, str | PathLike):
        raise InputError(
            f"a value of the type {type(scenario).__name__} is no scenario",
            expected="a Scenario, its file, or a map of what the file would hold",
        )
    return Scenario.load(scenario, values)
