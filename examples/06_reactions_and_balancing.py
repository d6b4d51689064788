"""Sizing and balancing a rotor's bearings: the two masses that take every rotating part out of their forces."""

from pathlib import Path

import pinarm

SCENARIOS = Path(__file__).parents[1] / "scenarios"

before = pinarm.load(SCENARIOS / "rotor_horizontal.yaml").run()
after = pinarm.load(SCENARIOS / "rotor_balanced.yaml").run()  # its key ``find`` asks for masses and angles

for bearing in ("joint.tilt_x.force.x", "loop.B.force.x"):
    print(f"{bearing}: {before[bearing].values.max():.1f} N before, {after[bearing].values.max():.1e} N after")
for name, value in after.figures.items():
    if name.startswith("arguments."):
        print(f"{name}: {value:.6g}")
