"""Threads that run one scenario."""

import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import pinarm

ROOT = Path(pinarm.__file__).parents[1]


@pytest.mark.parametrize("name", ["servo_backlash", "olive_vibrator_shaking"])
def test_threads_that_run_one_scenario_get_the_same_numbers(name):
    """As those of a single thread, though they share buffers; threads change often here."""
    scenario = pinarm.load(ROOT / "scenarios" / f"{name}.yaml")
    alone, interval = scenario.run(), sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:
        with ThreadPoolExecutor(4) as threads:
            results = [*threads.map(lambda _: scenario.run(), range(4))]
    finally:
        sys.setswitchinterval(interval)
    for result in results:
        for one, other in zip(result.columns(), alone.columns(), strict=True):
            assert np.array_equal(one.values, other.values), one.name
