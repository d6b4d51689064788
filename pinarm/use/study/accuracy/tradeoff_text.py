"""What is shown of a trade-off: the tables of settings and variants, and what is recommended."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pinarm.use.study.accuracy.setting_errors import TriedSetting
    from pinarm.use.study.accuracy.tradeoff import Tradeoff


def report(trade: Tradeoff) -> str:
    """Return the tables of settings and variants, and what is recommended, as text."""
    lines = [trade.scenario.content.title or trade.scenario.name]
    if trade.reference:
        lines += [*_aligned(settings(trade)), *advice(trade)]
    if trade.variants:
        lines += [*_aligned(solve_variants(trade)), *remarks(trade)]
    return "\n".join(lines)


def settings(trade: Tradeoff) -> list[list[str]]:
    """Return a heading and the error and cost of every setting that was tried."""
    assert trade.reference
    rows = [["setting", "error", "largest in", "evaluations", "time [ms]"]]
    for point in trade.points:
        worst = max(point.errors, key=lambda name: point.errors[name])
        error = f"{point.error:.1e}" if point.error > trade.reference.bound else f"< {trade.reference.bound:.0e}"
        cells = [error, worst[:24]] if math.isfinite(point.error) else [without_error(point), ""]
        rows.append([point.setting, *cells, f"{point.evaluations}", f"{1e3 * point.seconds:.1f}"])
    return rows


def without_error(point: TriedSetting) -> str:
    """Return why a setting has no error: it failed, or its solution has other events than the reference."""
    return "other events" if point.evaluations else "failed"


def advice(trade: Tradeoff) -> list[str]:
    """Return what errors were measured against, and the cheapest setting for every wanted error, with a margin."""
    assert trade.reference
    return [
        f"reference: {trade.reference.words}; known to {trade.reference.bound:.1e}",
        *(f"for {wanted:g}: {point.setting}; every finer one too" if point else f"for {wanted:g}: no setting tried"
          for wanted, point in trade.recommended().items()),
    ]  # fmt: skip


def solve_variants(trade: Tradeoff) -> list[list[str]]:
    """Return a heading and the errors of the outputs of every simplified model."""
    exact = trade.variants[0].result
    parameter = exact.trajectory.parameter if exact else ""
    rows = [["variant", "output", "error", "unit", "relative", f"at {parameter}", "time [ms]"]]
    for variant in trade.variants[1:]:
        for k, (name, error) in enumerate(variant.errors.items() if variant.result else ()):
            unit = str(variant.result[name].unit or "?") if variant.result else ""
            price = f"{1e3 * variant.seconds:.1f}" if k == 0 else ""
            numbers = [f"{error:.3g}", unit, f"{variant.relative[name]:.1e}", f"{variant.where[name]:.6g}", price]
            rows.append([variant.name if k == 0 else "", name[:32], *numbers])
    return rows


def remarks(trade: Tradeoff) -> list[str]:
    """Return what the errors of variants are relative to, and which variants failed or have other events."""
    exact = f"exact model: {1e3 * trade.variants[0].seconds:.1f} ms; relative to its largest value"
    simpler = trade.variants[1:]
    failed = [f"{variant.name}: failed: {variant.failure}" for variant in simpler if variant.result is None]
    parted = [f"{variant.name}: compared only in rows that both models have: {variant.course}"
              for variant in simpler if variant.course]  # fmt: skip
    return [exact, *failed, *parted]


def _aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return ["  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows]
