"""Sections of a linear analysis: modes with their eigenvalues, frequency responses as Bode and Nyquist plots.

They are made from the tables of the result, so that a saved result has them too.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import import_module
from itertools import groupby, product
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Complex, Flags
from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.input.units import HERTZ, Unit, unit
from pinarm.mechanics.ball_joints import coordinate_name
from pinarm.records import Record, replace
from pinarm.use.result.section import Cell, Curve, Graph, Section, SectionTable

if TYPE_CHECKING:
    from control import StateSpace

    from pinarm.engine.labelled_array import LabelledArray
    from pinarm.engine.mechanism import Mechanism
    from pinarm.engine.quantities.names import Quantities
    from pinarm.errors import Place
    from pinarm.problems import Problem
    from pinarm.problems.accuracy import Accuracy
    from pinarm.use.result.run import Run

PARTS = {
    "springs": ("Parts in the stiffness of each mode", "most stiffness from"),
    "masses": ("Parts in the kinetic energy of each mode", "most mass in"),
    "dampers": ("Parts in the dissipation of each mode", "most damping from"),
}
"""Tables of what takes part in a mode, their headings, and words for the largest part."""

ALIKE = 1e-6
"""Difference of parts that is rounding."""

MOST_SAID = 6
"""Modes of which the largest parts are said."""

FINE = 1e-9
"""Distance to which the frequency of a peak is sought, relative to it."""

MEASURES = ("frequency", "damped_frequency", "damping", "time_constant", "growth")
"""Measures of a mode in the table."""


class Response(Record, frozen=True):
    """The frequency response of an output to an input.

    Attributes:
        output: Name of the output.
        input: Name of the input.
        unit: Unit of the amplitude; ``None`` where it is not known.
        frequencies: [Hz], shape (n,).
        values: Per unit of the input, shape (n,).
    """

    output: str
    input: str
    unit: Unit | None
    frequencies: Array
    values: Complex

    @property
    def number(self) -> str:
        return _number(self.output, self.input)

    @property
    def amplitude(self) -> Series:
        return Series(f"|{self.output} / {self.input}|", self.unit, np.abs(self.values))

    @property
    def phase(self) -> Series:
        """Phase of the output relative to the input, without jumps of a turn."""
        turned = np.unwrap(np.angle(self.values))
        return Series("phase", unit("rad"), turned - 2.0 * np.pi * np.ceil(turned.max() / (2.0 * np.pi) - 0.51))


class ResponseNumbers(Record, frozen=True):
    """Names and units of the numbers of frequency responses, known before these are solved; see ``Numbered``.

    Attributes:
        problem: The question of a linear analysis.
        accuracy: How accurate its answer is wanted.
        place: Gives errors their place in it.
        mechanism: The mechanism, loaded when it is called.
        outputs: Its outputs.
    """

    problem: Problem
    accuracy: Accuracy
    place: Place
    mechanism: Callable[[], Mechanism]
    outputs: Sequence[str]

    def units(self, quantities: Quantities) -> Mapping[str, Unit | None]:
        inputs = self.problem.prepare(self.mechanism(), self.accuracy, self.place).inputs
        units = dict[str, Unit | None]()
        for output, driven in product(self.outputs, inputs):
            name, own = _number(output, driven.position or driven.name), quantities[output].unit
            units |= {f"{name}.largest": _quotient(own, unit("1") / driven.unit), f"{name}.frequency": HERTZ}
        return units


def _number(output: str, text: str) -> str:
    return ".".join(re.sub(r"\W+", "_", name).strip("_") for name in (output, text))


def linear_sections(result: Run) -> dict[str, Section]:
    """Return the sections of a linear analysis by key; none of other results."""
    sections = dict[str, Section]()
    if "eigenvalues" in result.arrays:
        sections["modes"] = _modes(result)
    if "response" in result.arrays:
        sections["frequency_response"] = _frequency_response(result)
    return sections


def responses(arrays: Mapping[str, LabelledArray]) -> list[Response]:
    """Return the frequency responses among the tables of a linear analysis: outputs first, inputs second."""
    table = arrays["response"]
    frequencies = np.array([float(name.split()[0]) for name in table.rows])
    outputs = zip(arrays["C"].rows, arrays["C"].row_units, strict=True)
    inputs = [_answered(*column) for column in zip(arrays["B"].columns, arrays["B"].column_units, strict=True)]
    pairs = product(outputs, inputs)
    return [
        Response(output, driven, _quotient(own, per), frequencies, np.asarray(table.values[:, k]))
        for k, ((output, own), (driven, per)) in enumerate(pairs)
    ]


def _answered(name: str, per: Unit | None) -> tuple[str, Unit | None]:
    """Return the input of a response, with the inverse of its unit: of a prescribed acceleration the position."""
    position = name.removesuffix("''")
    return (name, per) if position == name or per is None else (position, per / unit("s^2"))


def _quotient(own: Unit | None, per: Unit | None) -> Unit | None:
    """Return the unit of an output per unit of an input, written as their quotient; ``per`` is the inverse of that."""
    if own is None or per is None:
        return None
    whole, below = own * per, str(unit("1") / per)
    if below == "1" or str(own) == below:
        return own if below == "1" else whole
    return Unit(whole.factor, whole.dimension, f"{own}/({below})" if re.search(r"\W", below) else f"{own}/{below}")


def state_space(result: Run) -> StateSpace:
    """Return a linear analysis as a state space of python-control; see ``Result.to_control``.

    Raises:
        InputError: It is no linear analysis, or python-control is not installed.
    """
    tables = result.arrays
    if "A" not in tables:
        raise InputError("the result has no matrices A, B, C, D", expected="a run of the kind linear")
    try:
        control = import_module("control")
    except ImportError:
        raise InputError("python-control is not installed", hint="pip install 'pinarm[control]'") from None
    a, b = tables["A"], tables["B"]
    matrices = [a.values, b.values, np.eye(len(a.rows)), np.zeros((len(a.rows), len(b.columns)))]
    if "C" in tables:
        matrices[2:] = tables["C"].values, tables["D"].values
    names = {"states": a.rows, "inputs": b.columns, "outputs": tables["C"].rows if "C" in tables else a.rows}
    allowed = {key: [name.replace(".", "_") for name in some] for key, some in names.items()}
    return control.ss(*matrices, name=result.name.replace(".", "_"), **allowed)


def mode_shapes(result: Run) -> Complex:
    """Return the mode shapes of a linear analysis in all joint velocities, shape (nv, k)."""
    table, model = result.arrays["shapes"], result.trajectory.mechanism.model
    rows = [list(table.rows).index(coordinate_name(model, index)) for index in range(model.nv)]
    return np.asarray(table.values[rows], complex)


def _modes(result: Run) -> Section:
    eigenvalues = _eigenvalues(result)
    numbers = range(1, len(eigenvalues) + 1)
    measured = [[result[f"mode.{k}.{name}"] for name in MEASURES] for k in numbers]
    growths = np.array([row[-1].values[0] for row in measured])
    said = [_nature(value, growth) for value, growth in zip(eigenvalues, growths, strict=True)]
    rows: list[Sequence[Cell]] = [
        (f"{k}", *(float(series.values[0]) for series in row), nature)
        for k, row, nature in zip(numbers, measured, said, strict=True)
    ]
    units = [series.unit for series in measured[0]] if measured else [None] * len(MEASURES)
    headings = ("mode", *(name.replace("_", " ") for name in MEASURES), "")
    table = SectionTable("modes", "Modes, by ascending frequency", headings, (None, *units, None), rows)
    plane = Graph("eigenvalues", "Eigenvalues", list(_plane(eigenvalues, said)), marks=[(0.0, "")])
    parts = dict(_parts(result.arrays, growths == 0.0))
    tables = [_part_table(name, parts[name]) for name in parts]
    remarks = list(_leading(parts, said))
    return Section("modes", "Modes", [table, *tables], remarks=remarks, graphs=[plane] if measured else [])


def _parts(arrays: Mapping[str, LabelledArray], undamped: Flags) -> Iterator[tuple[str, LabelledArray]]:
    """Yield the tables of what takes part in the modes; of undamped modes, parts of dampers are rounding."""
    for name in (name for name in PARTS if name in arrays):
        lost = undamped if name == "dampers" else np.zeros_like(undamped)
        yield name, replace(arrays[name], values=np.where(lost, np.nan, np.real(arrays[name].values)))


def _part_table(name: str, table: LabelledArray) -> SectionTable:
    rows = [
        (row, *("" if np.isnan(part) else round(100.0 * part, 4) + 0.0 for part in parts))
        for row, parts in zip(table.rows, table.values.tolist(), strict=True)
    ]
    headings = ("", *table.columns)
    return SectionTable(name, f"{PARTS[name][0]} [%]", headings, (None,) * len(headings), rows)


def _leading(parts: Mapping[str, LabelledArray], said: Sequence[str]) -> Iterator[str]:
    """Yield, of each mode that oscillates, the spring, the body and the damper with the largest parts.

    Of several with the same part it is the first.
    """
    for k in [k for k, nature in enumerate(said) if nature in ("", "unstable")][:MOST_SAID]:
        known = {name: np.nan_to_num(table.values[:, k], nan=-np.inf) for name, table in parts.items()}
        tops = {name: int(np.argmax(shares > shares.max() - ALIKE)) for name, shares in known.items()}
        words = [
            f"{PARTS[name][1]} {parts[name].rows[top]} ({100.0 * known[name][top]:.3g} %)"
            for name, top in tops.items()
            if np.isfinite(known[name][top])
        ]
        if words:
            yield f"mode {k + 1}: {', '.join(words)}"


def _nature(eigenvalue: complex, growth: float) -> str:
    """Return a word for a mode whose table of numbers would be misread without it."""
    if not eigenvalue:
        return "rigid"
    if growth > 0.0:
        return "unstable"
    return "" if eigenvalue.imag else "no oscillation"


def _plane(eigenvalues: Complex, said: Sequence[str]) -> Iterator[Curve]:
    """Yield the eigenvalues as points: both of a conjugate pair, unstable ones apart."""
    both = np.concatenate([eigenvalues, eigenvalues[eigenvalues.imag > 0.0].conj()])
    unstable = np.array([word == "unstable" for word in said])
    unstable = np.concatenate([unstable, unstable[eigenvalues.imag > 0.0]])
    for chosen, label in ((~unstable, "stable" if unstable.any() else ""), (unstable, "unstable")):
        if chosen.any():
            yield Curve(
                Series("real part", unit("1/s"), both[chosen].real),
                Series("imaginary part", unit("rad/s"), both[chosen].imag),
                label,
                points=True,
            )


def _frequency_response(result: Run) -> Section:
    known = responses(result.arrays)
    groups = [list(group) for _, group in groupby(known, key=lambda own: (own.output, str(own.unit)))]
    low, high = known[0].frequencies[[0, -1]].tolist()
    damped = [result[f"mode.{k}.damped_frequency"].values[0] for k in range(1, len(_eigenvalues(result)) + 1)]
    marks = [(float(place), f"{k}") for k, place in enumerate(damped, 1) if low <= place <= high]
    names = _names(groups)
    bodes = [_bode(f"bode{name}", group, marks) for name, group in zip(names, groups, strict=True)]
    nyquists = [_nyquist(f"nyquist{name}", group) for name, group in zip(names, groups, strict=True)]
    remarks = ["dashed lines: damped frequencies of the modes, by their numbers"] if marks else []
    peaks = [_peak(response, result) for response in known]
    numbers = {
        f"{own.number}.{name}": Series(name, own.unit if name == "largest" else HERTZ, np.array([value]))
        for own, peak in zip(known, peaks, strict=True)
        for name, value in zip(("largest", "frequency"), peak, strict=True)
    }
    return Section(
        "frequency_response", "Frequency response", [_largest(known, peaks)], numbers, remarks, [*bodes, *nyquists]
    )


def _peak(response: Response, result: Run) -> tuple[float, float]:
    """Return the largest amplitude between the lowest and the highest frequency, and its frequency [Hz].

    It is sought between the samples beside the largest; infinite where a mode there has no damping.
    """
    from scipy.optimize import minimize_scalar

    tables, top = result.arrays, int(np.argmax(np.abs(response.values)))
    column = [name.removesuffix("''") for name in tables["B"].columns].index(response.input)
    row, squared = list(tables["C"].rows).index(response.output), tables["B"].columns[column] != response.input
    a, b, c = tables["A"].values, tables["B"].values[:, column], tables["C"].values[row]

    def amplitude(frequency: float) -> float:
        s = 2j * np.pi * frequency
        value = c @ np.linalg.solve(s * np.eye(len(a)) - a, b) + tables["D"].values[row, column]
        return float(np.abs(value * (s**2 if squared else 1.0)))

    near = response.frequencies[max(top - 1, 0) : top + 2]
    for k, eigenvalue in enumerate(_eigenvalues(result), 1):
        place = eigenvalue.imag / (2.0 * np.pi)
        if near[0] <= place <= near[-1] and result[f"mode.{k}.growth"].values[0] == 0.0:
            return np.inf, float(place)
    optimum = minimize_scalar(
        lambda x: -amplitude(x), bounds=(near[0], near[-1]), method="bounded", options={"xatol": FINE * near[-1]}
    )
    sample = float(np.abs(response.values[top]))
    return (
        (-float(optimum.fun), float(optimum.x)) if -optimum.fun > sample else (sample, float(response.frequencies[top]))
    )


def _eigenvalues(result: Run) -> Complex:
    return np.asarray(result.arrays["eigenvalues"].values[0], complex)


def _names(groups: Sequence[Sequence[Response]]) -> list[str]:
    """Return endings of names of graphs: none for a single graph, else the output, with a number where it recurs."""
    if len(groups) == 1:
        return [""]
    names = list[str]()
    for group in groups:
        name = "_" + re.sub(r"\W+", "_", group[0].output).strip("_")[:40]
        names.append(f"{name}_{len(names) + 1}" if name in names else name)
    return names


def _largest(known: Sequence[Response], peaks: Sequence[tuple[float, float]]) -> SectionTable:
    rows = [
        (own.output, own.input, str(own.unit or "?"), float(np.abs(own.values[0])), *peak)
        for own, peak in zip(known, peaks, strict=True)
    ]
    headings = ("output", "input", "unit", "at the lowest frequency", "largest", "at")
    units = (None, None, None, None, None, HERTZ)
    return SectionTable("largest", "Largest amplitudes", headings, units, rows, row_unit=2)


def _bode(name: str, group: Sequence[Response], marks: Sequence[tuple[float, str]]) -> Graph:
    across = Series("frequency", HERTZ, group[0].frequencies)
    if len(group) == 1:
        above = [Curve(across, group[0].amplitude)]
    else:
        above = [Curve(across, replace(own.amplitude, name="amplitude"), f"input {own.input}") for own in group]
    below = [Curve(across, own.phase) for own in group]
    return Graph(name, _title("Frequency response", group), above, below=below, logarithmic="xy", marks=marks)


def _nyquist(name: str, group: Sequence[Response]) -> Graph:
    curves = [
        Curve(
            Series("real part", own.unit, own.values.real),
            Series("imaginary part", own.unit, own.values.imag),
            f"input {own.input}" if len(group) > 1 else "",
        )
        for own in group
    ]
    return Graph(name, _title("Nyquist plot", group), curves, equal=True)


def _title(words: str, group: Sequence[Response]) -> str:
    inputs = group[0].input if len(group) == 1 else "its inputs"
    return f"{words} of {group[0].output} to {inputs}"
