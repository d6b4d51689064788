"""A first torque: solve a scenario, read its numbers with their units, and see what they are worth.

The question stands in ``scenarios/gen411_arm_static.yaml``: which torque must the motor at B give to hold the rod BA?
"""

from pathlib import Path

import pinarm

SCENARIOS = Path(__file__).parents[1] / "scenarios"

result = pinarm.load(SCENARIOS / "gen411_arm_static.yaml").run()

torque = result["C_B"]  # a named array with its unit
print(torque.label, "between", torque.values.min(), "and", torque.values.max())

share = result["C_B/(g*l2*(m_A + m_BA/2))"]  # formulas of quantities, symbols and arguments work too
print("the same over its largest value, cos(phi):", share.values[0], share.unit)

for name, figure in result.figures.items():  # measured in this run, by routes that did not solve it
    print(f"{name}: {figure:.1e}")
