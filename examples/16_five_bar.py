"""A five-bar above a table: its lengths are parameters, and ``close`` finds the motor angles of every point at once."""

from pathlib import Path

import numpy as np

import pinarm

MODEL = Path(__file__).parents[1] / "models" / "five_bar" / "mechanism.yaml"

x, y = np.meshgrid(np.linspace(0.0, 0.25, 40), np.linspace(0.2, 0.45, 40))  # points of the table [m]
for forearm in (0.25, 0.3, 0.35):
    robot = pinarm.Mechanism.load(MODEL, {"l2": forearm})
    motors = [robot.joints[name].v for name in ("A", "E")]
    there = {"point.P.position.x": x, "point.P.position.y": y}
    q, v = robot.close(there, {"point.P.position.x": 1.0}, unreached="nan")  # the tip moves at 1 m/s along x
    reached, speeds = np.isfinite(q).all(axis=-1).mean(), np.nanmedian(np.abs(v[..., motors]).max(axis=-1))
    print(f"forearms of {forearm} m reach {reached:.0%} of the table; the faster motor turns at {speeds:.1f} rad/s")
