"""Shaking force and moment: what the inertia of all moving bodies does to the frame, and its harmonics.

    F = -dP/dt,    M_O = -dH_O/dt

P and H_O are the momentum and the angular momentum about O of all bodies. Weights and other loads are not in them. With
w = 2 pi / T, T the length of the run, a component x has the harmonics

    x = a_0/2 + sum_k (a_k cos k w t + b_k sin k w t),    a_k, b_k = 2/T ∫ x (cos, sin) k w t dt,

of the amplitude (a_k² + b_k²)^(1/2): see Norton, Design of Machinery, chapter 13 (shaking forces of engines).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError, within
from pinarm.input.units import DIMENSIONLESS, Unit, unit
from pinarm.input.yaml.schema import InputStruct
from pinarm.records import replace
from pinarm.use.result.curve_figures import CurveFigure, figure, integrals, rms_values
from pinarm.use.result.row_lookup import Lookup
from pinarm.use.result.section import Curve, Graph, Section, SectionTable, numbered

if TYPE_CHECKING:
    from pinarm.use.result.result import Result
    from pinarm.use.scenario.scenario import Scenario

PERIODIC = 1e-6
"""Difference between start and end, relative to the largest size, below which a run is a whole number of periods."""

ROUNDING = 1e-12
"""Shaking force, relative to the inertia forces that it sums, below which it is 0 but for rounding."""

PARTS = ("force.x", "force.y", "force.z", "moment.x", "moment.y", "moment.z")
PEAKS = ("peak", "rms")
PULSATION = unit("rad/s")


class Shaking(InputStruct, frozen=True):
    """Shaking force and moment of the mechanism on its frame.

    Attributes:
        about: The link about whose origin the moment is taken, such as ``frame``; the world's origin where it is left
            out.
        harmonics: How many harmonics of the run's length are told; 0 for runs that are not periodic.
    """

    about: str | None = None
    harmonics: Annotated[int, msgspec.Meta(ge=0, le=50)] = 0

    def quantity(self, part: str) -> str:
        """Return the formula of a component or a norm, such as ``force.x``: the rate of momentum, reversed."""
        kind, axis = part.split(".")
        about = f".about.{self.about}" if self.about and kind == "moment" else ""
        sign = "" if axis == "norm" else "-"
        return f"{sign}dynamic.all.{kind}{about}.{axis}"

    def units(self, quantities: Quantities) -> Mapping[str, Unit | None]:
        parts = [*PARTS, "force.norm", "moment.norm"]
        return {f"{part}.{name}": quantities[self.quantity(part)].unit for part in parts for name in PEAKS}

    def check_names(self, quantities: Quantities, scenario: Scenario) -> None:
        with within("about"):
            _ = quantities[self.quantity("moment.x")]

    def evaluate(self, result: Result) -> Section:
        figures = self._figures(result.lookup)
        units = [figures[f"{part}.peak"].unit for part in PARTS]
        tables = [_figures_table(figures)]
        remarks = [f"the moment is taken about {self.about or 'the origin of the world'}"]
        if result.trajectory.mechanism.model.armature.any():
            remarks.append("the spin of rotors has no part in it: only their drives' joints have their inertia")
        balanced = figures["force.norm.peak"].value <= ROUNDING * _terms(result)
        if balanced:
            remarks.append("the shaking force is balanced: it is 0 but for rounding")
        if self.harmonics:
            amplitudes, error = _harmonics(result.lookup, [self.quantity(part) for part in PARTS], self.harmonics)
            tables.append(_harmonics_table(amplitudes, units, 2.0 * np.pi / _length(result.lookup)))
            remarks.append(f"harmonics: quadrature error at most {error:.1e} of the largest component")
        graphs = [] if balanced else [_hodograph(result, [self.quantity(part) for part in PARTS[:3]])]
        title = "Shaking force and moment on the frame"
        return Section("shaking", title, tables, remarks=remarks, graphs=graphs, **numbered(figures))

    def _figures(self, run: Lookup) -> dict[str, CurveFigure]:
        parts = [*PARTS, "force.norm", "moment.norm"]
        peaks = {part: figure(run, self.quantity(part), "peak") for part in parts}
        scales = np.array([peaks[f"{part.partition('.')[0]}.norm"].value for part in parts])
        rms, errors = rms_values(run, [self.quantity(part) for part in parts], scales)
        figures = {f"{part}.peak": peaks[part] for part in parts}
        for part, value, error in zip(parts, rms.tolist(), errors.tolist(), strict=True):
            figures[f"{part}.rms"] = CurveFigure(value, error, peaks[part].unit)
        return figures


def _figures_table(figures: Mapping[str, CurveFigure]) -> SectionTable:
    rows: list[tuple[str | float, ...]] = []
    for part in ("force.norm", *PARTS[:3], "moment.norm", *PARTS[3:]):
        peak, rms = (figures[f"{part}.{name}"] for name in PEAKS)
        rows.append((part, str(peak.unit), peak.value, peak.error, rms.value, rms.error))
    columns = ("", "unit", "peak", "its error", "rms", "its error ")
    return SectionTable("figures", "Peak and rms value", columns, (None,) * len(columns), rows, row_unit=1)


def _terms(result: Result) -> float:
    """Return the largest inertia force [N] of the bodies behind any joint: the terms that the shaking force sums."""
    joints = list(result.trajectory.mechanism.model.names)[1:]
    return max(float(result[f"dynamic.{joint}.force.norm"].values.max()) for joint in joints)


def _length(run: Lookup) -> float:
    start, end = run.run.grid.cuts[0], run.run.grid.cuts[-1]
    return float(end - start)


def _harmonics(run: Lookup, quantities: Sequence[str], count: int) -> tuple[Array, float]:
    """Return the amplitudes of orders 1 to count, shape (count, number of quantities), and the error of the largest."""
    ends = np.array([[run.at(place, name)[name].values[0] for place in ("start", "end")] for name in quantities])
    size = np.array([np.abs(run.quantities[name].values).max() for name in quantities])
    size = np.where(size > 0.0, size, 1.0)
    if run.run.parameter != "t" or (np.abs(ends[:, 1] - ends[:, 0]) > PERIODIC * size.max()).any():
        raise InputError(
            "the run is no whole number of periods: its shaking force at the end is not that at the start",
            expected="a run over whole turns of a steady motion",
            hint="harmonics: 0, or another end of the run",
        )
    (start, length), orders = (run.run.grid.cuts[0], _length(run)), np.arange(1, count + 1)

    def products(rows: Quantities) -> Array:
        angles = 2.0 * np.pi / length * np.outer(rows.trajectory.grid.t - start, orders)
        waves = np.stack([np.cos(angles), np.sin(angles)], axis=2)
        values = np.stack([rows[name].values for name in quantities], axis=1) / size.max()
        return np.asarray(np.einsum("nkc,nm->nkmc", waves, values).reshape(len(angles), -1))

    total, error = integrals(run, products)
    parts = 2.0 / length * total.reshape(count, len(quantities), 2)
    return size.max() * np.linalg.norm(parts, axis=2), float(2.0 / length * error.max())


def _harmonics_table(amplitudes: Array, units: Sequence[Unit | None], pulsation: float) -> SectionTable:
    rows = [(float(k), k * pulsation, *row) for k, row in enumerate(amplitudes.tolist(), start=1)]
    return SectionTable(
        "harmonics",
        "Amplitudes of the harmonics of the run's length",
        ("order", "pulsation", *PARTS),
        (DIMENSIONLESS, PULSATION, *units),
        rows,
    )


def _hodograph(result: Result, forces: Sequence[str]) -> Graph:
    sizes = [float(np.abs(result[name].values).max()) for name in forces]
    plane = sorted(np.argsort(sizes)[-2:].tolist())
    across, up = (replace(result[forces[k]], name=PARTS[k]) for k in plane)
    return Graph("hodograph", "Shaking force, path of its tip", [Curve(across, up)], equal=True)
