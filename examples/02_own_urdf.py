"""A model of one's own: any URDF file is a mechanism, which answers for arrays of states at once."""

import tempfile
from pathlib import Path

import numpy as np

import pinarm

URDF = """
<robot name="pendulum">
  <link name="ceiling"/>
  <link name="bob">
    <inertial>
      <origin xyz="0 0 -0.8"/> <mass value="2"/>
      <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <joint name="swing" type="continuous">
    <parent link="ceiling"/> <child link="bob"/> <axis xyz="0 1 0"/>
  </joint>
</robot>
"""

with tempfile.TemporaryDirectory() as folder:
    file = Path(folder) / "pendulum.urdf"
    file.write_text(URDF)
    pendulum = pinarm.Mechanism.load(file)

angles = np.linspace(0.0, np.pi, 7)[:, None]  # n states, one coordinate
still = np.zeros_like(angles)
holding = pendulum.inverse(angles, still, still)  # torques that hold it
print("torques that hold it [N*m]:", np.round(holding[:, 0], 3))
assert np.allclose(holding, 2 * 9.81 * 0.8 * np.sin(angles))

falling = pendulum.forward(angles, still)  # accelerations if nothing holds it
assert np.allclose(falling, -holding / (2 * 0.8**2 + 0.01))
