"""Friction under given efforts in a tree: its complementarity in every joint, by the masses of Pinocchio."""

import numpy as np
import pinocchio as pin
import pytest

LIMITS = np.array([3.0, 1.0, 2.0, 0.5, 4.0, 1.5])
"""Friction of the joints that have some [N*m]; the last joint has none."""


@pytest.fixture
def tree(mechanism, chain):
    """Return a chain of seven rods that turn about different axes."""
    axes = ["0 -1 0", "1 0 0", "0 0 1"]
    rods = [{"name": f"j{k}", "axis": axes[k % 3], "mass": 1.0 + 0.3 * k, "com": "0.1 0.2 0.05", "at": "0.2 0.1 0.1"}
            for k in range(7)]  # fmt: skip
    laws = {f"j{k}": {"constant": f"{limit} N*m"}
            for k, limit in enumerate(LIMITS.tolist())}  # fmt: skip
    return mechanism(chain(*rods), friction=laws)


@pytest.mark.parametrize("moving", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("effort", [0.1, 20.0])
def test_joints_stick_slip_or_begin_to_slip_by_their_law(tree, moving, effort):
    """``f = M a + nle - tau``: -c sign(v) in motion, at most c at rest, -c sign(a) where a slip begins."""
    rng, model = np.random.default_rng(3), tree.model
    data, k = model.createData(), len(LIMITS)
    for _ in range(20):
        q, v = rng.normal(size=7), rng.normal(size=7) * (rng.random(7) < moving)
        v[6] = 1.0
        tau = pin.rnea(model, data, q, v, np.zeros(7)) + effort * rng.normal(size=7)
        a = tree.forward(q, v, tau)
        f = (pin.rnea(model, data, q, v, a) - tau)[:k]
        slack, at_rest = 1e-9 * (np.abs(tau).max() + np.abs(a).max()), v[:k] == 0.0
        stuck = at_rest & (np.abs(a[:k]) < slack)
        way = np.where(at_rest, np.sign(a[:k]), np.sign(v[:k]))
        assert (np.abs(f[stuck]) <= LIMITS[stuck] + slack).all()
        assert f[~stuck] == pytest.approx(-(LIMITS * way)[~stuck], abs=slack)
