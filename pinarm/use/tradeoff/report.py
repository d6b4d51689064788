"""What a terminal shows of a trade-off."""

from __future__ import annotations

import math
from collections.abc import Sequence

from pinarm.use.tradeoff.study import Tradeoff


def report(trade: Tradeoff) -> str:
    """Return the tables of settings and variants, and what is recommended, as text."""
    lines = [trade.scenario.content.title or trade.scenario.name]
    if trade.reference:
        lines += [*_settings(trade), f"reference: {trade.reference.words}; known to {trade.reference.bound:.1e}"]
        lines += [
            f"for {wanted:g}: {point.setting}" if point else f"for {wanted:g}: no setting tried"
            for wanted, point in trade.recommended().items()
        ]
    return "\n".join(lines + _variants(trade))


def _settings(trade: Tradeoff) -> list[str]:
    assert trade.reference
    rows = [["setting", "error", "largest in", "evaluations", "time [ms]"]]
    for point in trade.points:
        worst = max(point.errors, key=lambda name: point.errors[name])
        error = f"{point.error:.1e}" if point.error > trade.reference.bound else f"< {trade.reference.bound:.0e}"
        told = [error, worst[:24]] if math.isfinite(point.error) else ["failed", ""]
        rows.append([point.setting, *told, f"{point.evaluations}", f"{1e3 * point.seconds:.1f}"])
    return _table(rows)


def _variants(trade: Tradeoff) -> list[str]:
    if not trade.variants:
        return []
    parameter = trade.variants[0].result.trajectory.parameter if trade.variants[0].result else ""
    rows = [["variant", "output", "error", "unit", "relative", f"at {parameter}", "time [ms]"]]
    failures = []
    for variant in trade.variants[1:]:
        if variant.result is None:
            failures.append(f"{variant.name}: failed: {variant.failure}")
            continue
        for k, (name, error) in enumerate(variant.errors.items()):
            unit = str(variant.result[name].unit or "?")
            first = [variant.name if k == 0 else "", name[:32]]
            price = f"{1e3 * variant.seconds:.1f}" if k == 0 else ""
            numbers = [f"{error:.3g}", unit, f"{variant.relative[name]:.1e}", f"{variant.where[name]:.6g}", price]
            rows.append(first + numbers)
    exact = f"exact model: {1e3 * trade.variants[0].seconds:.1f} ms; relative to its largest value"
    return [*_table(rows), exact, *failures]


def _table(rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return ["  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows]
