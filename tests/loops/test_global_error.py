"""The bound of the global error against the true one, of random chains in free motion."""

import numpy as np
import pytest
from random_chains import closed_chain, open_chain, reference, scenario

from pinarm.use.accuracy.error_estimate import estimate_errors
from pinarm.use.result.number_accuracy import output_scales

RESOLVED = 1e-10
"""True error that the reference can tell from its own, which is some steps of its tolerance of 1e-12."""


def compared(folder, chain, seed):
    """Bound and true error of every output of a random chain at a random tolerance, both relative."""
    generator = np.random.default_rng([seed, chain is open_chain])
    tolerance = 10.0 ** generator.uniform(-10.0, -3.0)
    asked = scenario(folder, chain(generator), tolerance, generator)
    result = asked.solve()
    bounds = estimate_errors(asked, result).errors
    q, v = reference(result.trajectory)
    exact = result.trajectory.mechanism.at(q, v, tau=np.zeros_like(v))
    true = {name: np.abs(result[name].values - exact[name].values).max() / scale
            for name, scale in output_scales(result).items()}  # fmt: skip
    return [(bounds[name], true[name]) for name in true]


def honest(pairs):
    """At least 99 % of true errors are below their bounds, which are close to twice the errors in the median."""
    bounds, true = np.array(pairs).T
    seen = true > RESOLVED
    below, ratio = (true[seen] <= bounds[seen]).mean(), bounds[seen] / true[seen]
    low, middle, high = np.quantile(ratio, (0.05, 0.5, 0.95))
    print(f"{seen.sum()} of {len(true)} outputs: {100 * below:.1f} % below the bound; bound/true: median {middle:.3f}, "
          f"5 % {low:.3f}, 95 % {high:.3f}")  # fmt: skip
    assert seen.sum() > len(true) / 2
    assert below >= 0.99
    assert 1.8 < middle < 2.2


def test_the_error_of_open_chains_is_told(tmp_path):
    honest([pair for seed in range(12) for pair in compared(tmp_path, open_chain, seed)])


def test_the_error_of_closed_chains_is_told(tmp_path):
    honest([pair for seed in range(2) for pair in compared(tmp_path, closed_chain, seed)])


@pytest.mark.slow
@pytest.mark.parametrize(("chain", "count"), [(open_chain, 60), (closed_chain, 20)])
def test_the_errors_of_many_chains_are_told(chain, count, tmp_path):
    honest([pair for seed in range(count) for pair in compared(tmp_path, chain, seed)])
