"""How fast errors grow: of a chaotic double pendulum against Benettin's method, and of motions that are regular."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

from pinarm.use.show.terminal import report

WIDE = {"problem.time": {"end": "16 s", "samples": 161}, "accuracy": {"tolerance": 1e-9}}


def exponent(run, begin, end, every=0.1):
    """The mean rate at which two neighbouring motions part between two instants [1/s], drawn together again and again.

    Benettin, Galgani, Giorgilli, Strelcyn, Meccanica 15 (1980), by SciPy's integrator.
    """
    model, n = run.mechanism.model, run.mechanism.model.nv
    data, apart, rates = model.createData(), 1e-7, []

    def rate(_, y):
        return np.concatenate([y[n:], pin.aba(model, data, y[:n], y[n:], np.zeros(n))])

    def after(y):
        return solve_ivp(rate, (0.0, every), y, "DOP853", rtol=1e-11, atol=1e-12).y[:, -1]

    here = np.concatenate([run.q[0], run.v[0]])
    there = here + apart / np.sqrt(2 * n)
    for k in range(round(end / every)):
        here, there = after(here), after(there)
        grown = np.linalg.norm(there - here)
        rates += [np.log(grown / apart) / every] if k * every >= begin else []
        there = here + (there - here) * apart / grown
    return np.mean(rates)


@pytest.mark.slow
def test_errors_of_a_chaotic_motion_grow_by_its_lyapunov_exponent(chaos):
    result = chaos.varied(WIDE).verified()
    time = result.figures["e-folding"]
    assert 1.0 / time == pytest.approx(exponent(result.trajectory, 3.0, 12.0), rel=0.3)
    assert f"errors grow e-fold every {time:.2g} s" in report(result)


def test_errors_of_regular_motions_do_not_grow_exponentially(chaos):
    result = chaos.varied({**WIDE, "problem.initial.position": {"O": "-60 deg", "B": "-10 deg"}}).verified()
    assert result.error < 1e-5
    assert "e-folding" not in result.figures
    assert "e-fold" not in report(result)
