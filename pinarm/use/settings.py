"""Settings of the time integration: what decides how a motion is integrated, as the keys of a scenario's accuracy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from pinarm.problems.common import Accuracy
from pinarm.use.result import Result

if TYPE_CHECKING:
    from pinarm.use.scenario import Scenario

FINER = 100.0
"""Quotient of the tolerances of a solution and of the finer one that it is compared with."""

LOOSEST, TIGHTEST = 1e-2, 1e-14
"""Tolerances that can be asked for."""

PATIENCE = 10.0
"""Steps of a finer solution over those of the coarser one beyond which it is given up; order 5 needs 2.5 times."""


def setting_of(accuracy: Accuracy) -> dict[str, Any]:
    """Return what decides how a motion is integrated, as the keys of a scenario."""
    key, value = accuracy.setting
    return {"method": accuracy.method, key: value}


def comparable(accuracy: Accuracy) -> list[dict[str, Any]]:
    """Return settings whose errors differ much from that of another, finer ones first.

    A coarser one serves where the given one is at the limit of rounding: the difference is then the coarser's error.
    """
    key, own = accuracy.setting
    if key == "step":
        return [{"method": accuracy.method, key: own / 2.0}]
    near = [own / FINER, own / 10.0, own * 10.0]
    return [{"method": accuracy.method, key: value} for value in near if TIGHTEST < 1.001 * value < LOOSEST]


def patience(result: Result, most: int) -> int:
    """Return how many steps a comparison may take before it is given up.

    Close to singular positions a tighter tolerance can be below the noise, and would take steps without end.
    """
    steps = sum(result.figures[name] for name in ("steps", "rejected steps"))
    return min(most, int(PATIENCE * steps) + 1000)


def spoken(setting: Mapping[str, Any]) -> str:
    """Return a setting in words."""
    return ", ".join(f"{key} {value:.3g}" if isinstance(value, float) else str(value) for key, value in setting.items())


def varied(
    scenario: Scenario, setting: Mapping[str, Any], max_steps: int | None = None, *, seed: int | None = None
) -> Scenario:
    """Return a scenario with another setting of the integration and no target, and with other last digits."""
    accuracy = {**setting, "max_steps": max_steps or scenario.content.accuracy.max_steps}
    return replace(scenario, seed=seed).varied({"accuracy": accuracy})


def references() -> list[dict[str, Any]]:
    """Return tight settings for a reference, the tightest last."""
    return [{"tolerance": tolerance} for tolerance in (1e-11, 1e-12, 1e-13, 1e-14)]


def ladders(result: Result) -> dict[str, list[dict[str, Any]]]:
    """Return the settings that are worth trying, by method, the coarsest first."""
    return {
        "dop853": [{"method": "dop853", "tolerance": float(f"1e-{k}")} for k in range(2, 13)],
        "dopri5": [{"method": "dopri5", "tolerance": float(f"1e-{k}")} for k in range(2, 11)],
    }
