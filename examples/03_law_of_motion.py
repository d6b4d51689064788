"""A law of motion: a gyroscope moves freely, and its energy stays constant, as well as the tolerance asks."""

from pathlib import Path

import numpy as np

import pinarm

SCENARIO = Path(__file__).parents[1] / "scenarios" / "gyroscope_free.yaml"

for tolerance in (1e-6, 1e-9, 1e-12):
    result = pinarm.load(SCENARIO, [f"accuracy.tolerance={tolerance}"]).run()
    energy = result["energy.kinetic"].values
    steps, balance = int(result.figures["steps"]), result.figures["energy"]
    off = np.ptp(energy) / energy.max()
    print(f"tolerance {tolerance:.0e}: {steps} steps, energy off by {off:.1e}; the run itself says {balance:.1e}")
