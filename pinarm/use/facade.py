"""``pinarm.Result``: the record with methods for users, which reach every view; below, ``use.result.result`` serves."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pinarm.records import public_face
from pinarm.use.result import result as results

if TYPE_CHECKING:
    import meshcat
    from control import StateSpace

    from pinarm.use.assessments.limits import Limits
    from pinarm.use.assessments.loads import Loads
    from pinarm.use.assessments.path_error import PathError
    from pinarm.use.assessments.response import Response
    from pinarm.use.assessments.sensitivity import Sensitivity
    from pinarm.use.assessments.shaking import Shaking
    from pinarm.use.assessments.sizing import Sizing
    from pinarm.use.method.isolation import Isolation
    from pinarm.use.method.torsors import Torsor
    from pinarm.use.scenario.scenario_file import Assessment
    from pinarm.use.show.picture import Picture
    from pinarm.use.show.replay.page import Replay

    # mypy compares the classes with the protocol, which are imported by name
    _CLASSES: tuple[type[Assessment], ...] = (Shaking, Sizing, Loads, PathError, Limits, Response, Sensitivity)


class Result(results.Result, frozen=True):
    """The answer to a scenario: quantities by name, numbers, sections, figures of accuracy, plots, replays, files.

    Its fields, such as ``scenario``, ``figures``, ``errors``, ``setting`` and ``removals``, are those of
    ``use.result.result.Result``.
    """

    __dir__ = public_face(
        "arrays", "columns", "error", "errors", "events", "excesses", "figures", "kind", "linearise", "name", "notes",
        "number", "numbers", "outcome", "parameter", "quantities", "removals", "scenario", "section", "sections",
        "setting", "summary", "to_dataframe", "trajectory",
    )  # fmt: skip

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

    def _repr_html_(self) -> str:
        """Return the report, with its replay, for notebooks; saved ones keep it."""
        import pinarm

        return pinarm.report(self)._repr_html_()

    def __reduce__(self) -> tuple[Any, ...]:
        from pinarm.use.result.stored_rows import arrays_of, result_of

        outcome = {name: getattr(self.outcome, name) for name in ("notes", "decisions")}
        outcome["figures"] = dict(self.outcome.figures)
        measured = {name: getattr(self, name) for name in results.MEASURED} | {"figures": dict(self.figures)}
        return result_of, (self.scenario, self.trajectory.mechanism, arrays_of(self), outcome, measured)
