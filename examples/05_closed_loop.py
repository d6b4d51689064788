"""A closed loop: a manipulator with two loops, its mobility and redundancy, and the forces in its joints."""

from pathlib import Path

import numpy as np

import pinarm

ROOT = Path(__file__).parents[1]

print(pinarm.explain(ROOT / "models" / "manipulator" / "mechanism.yaml"))  # mobility 1, hyperstatic of degree 4

result = pinarm.load(ROOT / "scenarios" / "manipulator_raised.yaml").run()
for series in result.columns()[:4]:
    print(series.label, series.values[[0, -1]])
print("loops closed to", result.figures["closure"], "m or rad")

force = np.hypot(result["loop.F.force.x"].values, result["loop.F.force.y"].values)
print("largest force in the joint F:", force.max(), "N")

try:  # rigid bodies do not determine how the two bearings of a flat mechanism share a force across it
    result["loop.F.force.z"]
except pinarm.PinarmError as error:
    print(error)
