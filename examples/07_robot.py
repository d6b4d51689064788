"""A robot of example-robot-data by its name: torques along a motion of all joints."""

from pathlib import Path

import numpy as np

import pinarm

result = pinarm.load(Path(__file__).parents[1] / "scenarios" / "panda_quintic.yaml").run()
for series in result.columns()[1:4]:
    print(series.label, np.round(series.values[:: len(result) // 4], 3))

panda = pinarm.Mechanism.load("panda")
q, v, a = np.random.default_rng(0).normal(size=(3, 1000, panda.model.nv))
first, second = (panda.joints[f"panda_finger_joint{k}"].q for k in (1, 2))
for state in (q, v, a):
    state[:, second] = state[:, first]  # the model has the second finger mimic the first, which alone has a drive
tau = panda.inverse(q, v, a)
assert np.allclose(panda.forward(q, v, tau), a)
