"""Products of G are the same of arrays and of sparse matrices."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from pinarm.engine.constraints.sparse_matrices import first_rows, times, transposed_times


def test_products_of_sparse_matrices_are_those_of_arrays() -> None:
    rng = np.random.default_rng(3)
    dense = np.where(rng.uniform(size=(4, 5, 7)) < 0.4, rng.integers(-9, 9, (4, 5, 7)), 0).astype(float)
    v, lam = rng.integers(-9, 9, (4, 7)).astype(float), rng.integers(-9, 9, (4, 3)).astype(float)
    for matrices in (dense, [csr_array(rows) for rows in dense]):
        np.testing.assert_array_equal(times(matrices, v), np.einsum("nij,nj->ni", dense, v))
        upper = first_rows(matrices, 3)
        np.testing.assert_array_equal(transposed_times(upper, lam), np.einsum("nij,ni->nj", dense[:, :3], lam))
