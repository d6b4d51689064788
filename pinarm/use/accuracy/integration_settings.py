"""Settings of the time integration that a motion is solved with beside its own: finer, coarser, from loose to tight.

A setting is written as the keys of a scenario's ``accuracy``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.engine.integration.methods import METHODS, MethodName
from pinarm.problems.accuracy import Accuracy, setting_keys
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.use.result.result import Result
    from pinarm.use.scenario.scenario import Scenario

FINER = 100.0
"""Quotient of the tolerances of a solution and of the finer one that it is compared with."""

LOOSEST, TIGHTEST = 1e-2, 1e-14
"""Tolerances that can be asked for."""

GROWN = 1.5
"""Steps of a finer solution over one more than those of another from which on they are other steps: a tolerance finer
by 100 takes 1.8 times as many of order 8. Where they are the same, as samples of a controller or the end of the run
limit them, so are their errors, and the difference shows none of them: less than half, where less than half of them are
divided. One step more of few is the first one's."""

PATIENCE = 10.0
"""Steps of a finer solution over those of the coarser one beyond which it is given up; order 5 needs 2.5 times."""


def comparison_settings(accuracy: Accuracy) -> list[dict[str, Any]]:
    """Return settings whose errors differ much from that of another, finer ones first.

    A coarser one serves where the given one is at the limit of rounding: the difference is then the coarser's error.
    """
    by, own = accuracy.setting
    if by == "step":
        return [setting_keys(accuracy.method, own / 2.0), setting_keys(accuracy.method, own * 2.0)]
    near = [own / FINER, own / 10.0, own * 10.0]
    return [setting_keys(accuracy.method, value) for value in near if TIGHTEST < 1.001 * value < LOOSEST]


def finer_setting(setting: Mapping[str, Any], taken: Result) -> dict[str, Any] | None:
    """Return a finer setting where one has taken the same steps as a coarser one; ``None`` where none is so fine.

    That is a tolerance finer by another ``FINER``, or half of the mean of the steps that were taken.
    """
    if "step" in setting:
        return {**setting, "step": f"{float(np.ptp(taken.trajectory.grid.t)) / taken.figures['steps'] / 2.0!r} s"}
    tolerance = max(setting["tolerance"] / FINER, TIGHTEST)
    return {**setting, "tolerance": tolerance} if tolerance < setting["tolerance"] else None


def other_method(method: MethodName) -> dict[str, Any]:
    """Return the tightest setting of another method: its errors are others, even in steps that are the same."""
    return setting_keys("dopri5" if method == "dop853" else "dop853", TIGHTEST)


def takes_other_steps(first: Result, second: Result) -> bool:
    """Tell whether of two solutions one takes more steps than the other; see ``GROWN``."""
    fewer, more = sorted(each.figures["steps"] for each in (first, second))
    return more >= GROWN * (fewer + 1.0)


def ladder(method: MethodName, span: float) -> list[dict[str, Any]]:
    """Return settings of a method, the coarsest first: tolerances by decades from 1e-2 on, or halves of the step.

    Args:
        method: The method.
        span: Time of the motion [s], a 64th of which is the longest step.
    """
    if METHODS[method].setting == "step":
        return [setting_keys(method, float(f"{span / 2.0**rung:.3g}")) for rung in range(6, 16)]
    return [setting_keys(method, float(f"1e-{rung}")) for rung in range(2, 14)]


def step_limit(result: Result, most: int) -> int:
    """Return the number of steps after which a comparison is given up.

    Close to singular positions a tighter tolerance can be below the noise, and would take steps without end.
    """
    steps = sum(result.figures[name] for name in ("steps", "rejected steps"))
    return min(most, int(PATIENCE * steps) + 1000)


def format_setting(setting: Mapping[str, Any]) -> str:
    """Return a setting in words."""
    words = {key: f"{value:.3g}" if isinstance(value, float) else str(value) for key, value in setting.items()}
    return ", ".join(value if key == "method" else f"{key} {value}" for key, value in words.items())


def with_setting(
    scenario: Scenario, setting: Mapping[str, Any], max_steps: int | None = None, *, seed: int | None = None
) -> Scenario:
    """Return a scenario with another setting of the integration and no target, and with other last digits."""
    given = scenario.content.accuracy
    accuracy = {**setting, "max_steps": max_steps or given.max_steps, "max_events": given.max_events}
    known = scenario if seed == scenario.seed else replace(scenario, seed=seed)
    return known.varied({"accuracy": accuracy})


def reference_settings() -> list[dict[str, Any]]:
    """Return tight settings for a reference, the tightest last."""
    return [setting_keys("dop853", tolerance) for tolerance in (1e-11, 1e-12, 1e-13, 1e-14)]


def settings_by_method(result: Result) -> dict[str, list[dict[str, Any]]]:
    """Return the settings that are worth trying on a motion, by method, the coarsest first."""
    span = float(np.ptp(result.trajectory.grid.t))
    return {method: ladder(method, span)[: entry.finest - 1] for method, entry in METHODS.items()}
