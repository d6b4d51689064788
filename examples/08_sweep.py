"""A sweep: a scenario solved for many loads and lengths, on all cores, and for parts that are not exact."""

from pathlib import Path

import pinarm

SCENARIO = Path(__file__).parents[1] / "scenarios" / "gen411_arm_static.yaml"

lengths = {"arguments.m_A": "0.1:0.5:5 kg", "arguments.l2": [0.2, 0.25, 0.3]}  # bare numbers are in metres, as declared
sweep = pinarm.sweep(SCENARIO, lengths, results=["C_B @ max", "phi @ max(C_B)"])
print(sweep["C_B @ max"].label, sweep["C_B @ max"].values.reshape(5, 3).round(3), sep="\n")

parts = {"arguments.m_A": "normal(0.1, 0.002) kg", "arguments.l2": "tolerance(0.25, 0.001) m"}
torque = pinarm.sweep(SCENARIO, parts, samples=100, sampling="latin", results=["C_B @ max"])["C_B @ max"].values
print(f"{torque.mean():.4f} N*m on average, and {torque.std(ddof=1):.4f} N*m more or less")
