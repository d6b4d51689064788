"""The benchmark bicycle: eigenvalues of its small motions about riding straight ahead, as published.

Meijaard, Papadopoulos, Ruina and Schwab, Linearized dynamics equations for the balance and steer of a bicycle: a
benchmark and review, Proceedings of the Royal Society A 463 (2007): table 2, and the matrices of
``M x'' + v C x' + (g K0 + v^2 K2) x = 0`` with lean and steer angle.
"""

from pathlib import Path
from shutil import copytree

import numpy as np
import pytest

import pinarm

SCENARIO = Path(pinarm.__file__).parents[1] / "scenarios" / "bicycle_stability.yaml"
M = np.array([[80.81722, 2.31941332208709], [2.31941332208709, 0.29784188199686]])
C = np.array([[0.0, 33.86641391492494], [-0.85035641456978, 1.68540397397560]])
K0 = np.array([[-80.95, -2.59951685249872], [-2.59951685249872, -0.80329488458618]])
K2 = np.array([[0.0, 76.59734589573222], [0.0, 2.65431523794604]])
RIGID = 6
"""Modes with the eigenvalue 0: where the bicycle is, its heading, how far its wheels have turned, and its speed."""

PRINTED = {
    0.0: [-3.131643247906656, 3.131643247906656, -5.530943717653894, 5.530943717653894],
    5.0: [-0.32286642900409, -0.77534188219585 + 4.46486771378823j, -14.07838969279822],
    10.0: [0.16105338653172, -3.72016840437287 + 10.90681139476287j, -24.62459635017404],
}


@pytest.mark.parametrize("speed", [0.0, 1.05, 3.9, 4.95, 5.0, 10.0])
def test_it_leans_and_steers_as_published(speed):
    result = pinarm.run(SCENARIO, {"problem.about.steady.rear": f"{speed / 0.3!r} rad/s"})
    found = result.arrays["eigenvalues"].values[0]
    stiffness = 9.81 * K0 + speed**2 * K2
    a = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(M, stiffness), -np.linalg.solve(M, speed * C)]])
    wanted = np.linalg.eigvals(a)
    wanted = wanted[wanted.imag >= 0.0]
    assert not found[:RIGID].any()
    assert np.sort_complex(found[RIGID:]) == pytest.approx(np.sort_complex(wanted), rel=1e-10)
    if speed in PRINTED:
        assert found[RIGID:] == pytest.approx(PRINTED[speed], rel=1e-12)


def test_it_wobbles_back_when_it_rides_alone_at_five_metres_a_second(tmp_path):
    """The free motion, not linearised: a lean of 1e-4 rad decays as the eigenvalues say, and energy is kept."""
    copytree(SCENARIO.parents[1] / "models" / "bicycle", tmp_path / "bicycle")
    (tmp_path / "ride.yaml").write_text(f"""pinarm: 1
mechanism: bicycle/mechanism.yaml
problem:
  kind: forward
  time: {{end: 3 s, samples: 61}}
  initial: {{position: {{lean: 1e-4 rad}}, velocity: {{rear: {5.0 / 0.3!r} rad/s}}}}
outputs: [lean, steer, energy.total]
""")
    result = pinarm.run(tmp_path / "ride.yaml")
    lean, steer, t = (np.asarray(result[name]) for name in ("lean", "joint.steer.position", "t"))
    a = np.block(
        [[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(M, 9.81 * K0 + 25.0 * K2), -5.0 * np.linalg.solve(M, C)]]
    )
    values, vectors = np.linalg.eig(a)
    parts = np.linalg.solve(vectors, [1e-4, 0.0, 0.0, 0.0])
    expected = (vectors[:2] * parts @ np.exp(np.outer(values, t))).real
    assert np.abs(lean) == pytest.approx(np.abs(expected[0]), abs=1e-8)
    assert np.abs(steer) == pytest.approx(np.abs(expected[1]), abs=1e-8)
    assert np.ptp(np.asarray(result["energy.total"])) < 1e-6


def test_modes_that_nothing_drives_back_have_no_parts_of_stiffness():
    """The bicycle rolls on, and stands anywhere: what weights and constraints have in such modes is rounding."""
    result = pinarm.run(SCENARIO.with_name("bicycle_at_rest.yaml"))
    rigid, parts = result.arrays["eigenvalues"].values[0] == 0.0, result.arrays["springs"].values
    assert np.count_nonzero(rigid) == RIGID
    assert np.isnan(parts[:, rigid]).all()
    assert parts[:, ~rigid].sum(axis=0) == pytest.approx(1.0, rel=1e-12)
