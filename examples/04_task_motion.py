"""A motion of the task: the hip of an exoskeleton rises, and the joints' motion, torques and powers follow from it."""

from pathlib import Path

import pinarm

SCENARIO = Path(__file__).parents[1] / "scenarios" / "exoskeleton_leg_knee.yaml"

result = pinarm.load(SCENARIO, ["arguments.m4=80 kg"]).run()  # any number of the file can be replaced
print("ankle, which has no motor:", abs(result["joint.ankle.effort"].values).max(), "N*m")
print("largest torque of the motor:", abs(result["Cm"].values).max(), result["Cm"].unit)
print("largest power of the motor:", result["drive.knee_motor.power"].values.max(), "W")

# where the law jumps an instant has two rows: just before and just after
torque, t = result["Cr"].values, result["t"].values
print([(float(t[i]), round(float(torque[i]), 2)) for i in range(1, len(t)) if t[i] == t[i - 1] for i in (i - 1, i)])
