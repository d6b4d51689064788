"""Modes of a linear analysis as moving pictures: positions along ``a Re(x exp(i phi))`` at several amplitudes a.

Loops are closed anew in every position, by the least change. What decays or grows is shown with a constant amplitude.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Complex
from pinarm.engine.kinematics.assembly import OPEN
from pinarm.engine.kinematics.newton import assembled
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.series import ROUNDING
from pinarm.errors import AssemblyError, InputError
from pinarm.input.units import unit
from pinarm.language import decimals, said
from pinarm.mechanics.ball_joints import coordinate_name
from pinarm.mechanics.joints import METRE
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import Record, replace
from pinarm.use.result.vibrations import mode_shapes

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.use.result.result import Result

LEVELS, PHASES = 5, 33
"""Amplitudes, of which the first is 0, and positions of a period; the page goes evenly from one to the next."""

MOST_MODES = 14
"""Modes in the page, those of the lowest frequencies."""

TURN, SLIDE = np.radians(20.0), 0.12
"""Largest deviation of a joint at full amplitude: of an angle [rad], of a length relative to the mechanism."""

FAR = 0.5
"""Change that closes loops, relative to the deviation, beyond which the position is no longer that of the mode."""

CYCLE = 2.0
"""Seconds of a period in the page, whatever the frequency is."""


class ModePictures(Record, frozen=True):
    """Positions of the modes.

    Attributes:
        run: Positions of all modes: the phase varies fastest, then the amplitude, then the mode.
        phases: Phases of a period [rad], shape (PHASES,).
        plain: Data of the page beside the positions: number of amplitudes, names and descriptions of the modes.
        notes: Modes whose loops do not close, and modes that are left out.
    """

    run: Trajectory
    phases: Array
    plain: dict[str, Any]
    notes: tuple[str, ...]

    @property
    def period(self) -> Trajectory:
        """The first mode over one period, to name a phase of it."""
        grid, first = Grid.cover(self.phases, []), self.run.some(np.arange(PHASES))
        return replace(first, grid=grid, parameter="phase", unit=unit("rad"), separate=False)


def mode_pictures(result: Result) -> ModePictures:
    """Return the positions of the modes of a linear analysis."""
    run, phases = result.trajectory, np.linspace(0.0, 2.0 * np.pi, PHASES)
    shapes, notes, positions, names, texts = mode_shapes(result), list[str](), [], [], []
    if (more := shapes.shape[1] - MOST_MODES) > 0:
        notes.append(said("{count} modes more", count=more))
    for number, shape in enumerate(shapes.T[:MOST_MODES], 1):
        factor, largest, unit_of_size = _full_amplitude(run.mechanism, shape)
        q, closed = _positions(run.mechanism, run.q[0], factor * shape, phases)
        if not closed:
            notes.append(said("mode {number}: to first order, its loops do not close", number=number))
        size = f"{np.abs(factor * shape[largest]) * unit_of_size[0]:.3g}{unit_of_size[1]}"
        where = f"{coordinate_name(run.mechanism.model, largest)} {decimals(size)}"
        words = {"description": _description(result, number), "size": where}
        positions.append(q)
        names.append(said("mode {number}", number=number))
        texts.append(said("{description}; full amplitude: {size}", **words))
    rows = np.concatenate(positions)
    many = replace(run.some(np.zeros(len(rows), np.intp)), grid=Grid.cover(np.arange(float(len(rows))), []), q=rows)
    return ModePictures(many, phases, {"levels": LEVELS, "names": names, "texts": texts}, tuple(notes))


def require_bare(traces: object, arrows: object, plots: object) -> None:
    """Raise where a picture of modes is to have what only motions have."""
    for asked, name in ((traces, "paths"), (arrows, "arrows"), (plots, "plots")):
        if asked:
            raise InputError(f"the replay of modes has no {name}", hint="a run of the kind forward has them")


def _full_amplitude(mechanism: Mechanism, shape: Complex) -> tuple[float, int, tuple[float, str]]:
    """Return the factor of a shape at full amplitude, the velocity that is largest then, and its unit as printed."""
    sliding = [joint.v for joint in mechanism.joints.values() if joint.unit == METRE]
    allowed = np.full(len(shape), TURN)
    allowed[sliding] = SLIDE * float(mechanism.closure.extent)
    largest = int(np.argmax(np.abs(shape) / allowed))
    shown = (1000.0, " mm") if largest in sliding else (np.degrees(1.0), "°")
    return float(allowed[largest] / np.abs(shape[largest])), largest, shown


def _positions(mechanism: Mechanism, q: Array, shape: Complex, phases: Array) -> tuple[Array, bool]:
    """Return the positions of a mode, shape (LEVELS * PHASES, nq), and whether they close loops, not to first order."""
    turning = np.real(shape * np.exp(1j * phases)[:, None])
    steps = (np.linspace(0.0, 1.0, LEVELS)[:, None, None] * turning).reshape(-1, len(shape))
    moved = np.array([pin.integrate(mechanism.model, q, step) for step in steps])
    with suppress(AssemblyError):
        closed = np.array([assembled(mechanism.closure, OPEN, near, np.zeros(0), 0.0) for near in moved])
        changes = [pin.difference(mechanism.model, *pair) for pair in zip(moved, closed, strict=True)]
        least = ROUNDING * (1.0 + mechanism.closure.extent)
        if (np.linalg.norm(changes, axis=1) <= FAR * np.linalg.norm(steps, axis=1) + least).all():
            return closed, True
    return moved, False


def _description(result: Result, number: int) -> str:
    row = next(cells for cells in result.section("modes").tables[0].rows if cells[0] == str(number))
    frequency, damping, nature = float(row[1]), float(row[3]), str(row[-1])
    if nature == "rigid":
        return said("rigid")
    if nature and not float(row[2]):
        words = "grows without oscillation, {time:.4g} s" if nature == "unstable" else (
            "decays without oscillation, {time:.4g} s"
        )  # fmt: skip
        return said(words, time=abs(float(row[4])))
    words = "{frequency:.4g} Hz, damping ratio {damping:.3g}"
    return said(words, frequency=frequency, damping=damping) + (said(", unstable") if nature else "")
