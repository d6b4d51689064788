"""The mass matrix by its other routes against Pinocchio's ``crba``."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from pinarm.engine.constraints.nullspace import MANY
from pinarm.engine.dynamics.mass_matrix import (
    MassProducts,
    mass_diagonals,
    mass_matrices,
    mass_matrix,
    masses,
    sparse_mass_matrix,
)

ROUNDING = 1e-14
"""Relative to the largest entry: sums of a few dozen terms."""


def tree(count: int) -> pin.Model:
    """Return two branches at every third link, joints of all kinds, depth first, with armatures."""
    kinds = (
        pin.JointModelRX, pin.JointModelPY, pin.JointModelFreeFlyer, pin.JointModelSpherical,
        lambda: pin.JointModelHY(0.3),
    )  # fmt: skip
    model, generator = pin.Model(), np.random.default_rng(7)
    for k in range(count):
        parent = max(0, k - 2) if k % 3 == 2 else k
        model.addJoint(parent, kinds[k % 5](), pin.SE3.Random(), f"j{k}")
        model.appendBodyToJoint(k + 1, pin.Inertia.Random(), pin.SE3.Identity())
    model.armature[:] = generator.uniform(0.0, 1.0, model.nv)
    return model


@pytest.mark.parametrize("count", [1, 5, 20])
def test_the_sparse_mass_matrix_is_that_of_crba(count: int) -> None:
    model = tree(count)
    q = pin.integrate(model, pin.neutral(model), np.sin(np.arange(model.nv)))
    sparse, mass = sparse_mass_matrix(model, q), mass_matrix(model, q)
    assert np.abs(sparse.toarray() - mass).max() <= ROUNDING * np.abs(mass).max()
    np.testing.assert_allclose(mass_diagonals(model, np.array([q, q]))[1], np.diag(mass), rtol=ROUNDING)
    unrelated = sum(1 for j in range(1, model.njoints) for i in range(1, j) if i not in model.supports[j].tolist())
    assert not unrelated or sparse.nnz < model.nv**2


def test_masses_of_many_joints_are_products() -> None:
    model = tree(MANY // 2)
    q = np.array([pin.integrate(model, pin.neutral(model), np.sin(k + np.arange(model.nv))) for k in range(3)])
    x, whole = np.cos(np.arange(3 * model.nv * 2.0)).reshape(3, -1, 2), mass_matrices(model, q)
    products = masses(model, q)
    assert isinstance(products, MassProducts)
    scale = ROUNDING * np.abs(whole @ x).max()
    assert np.abs(products @ x - whole @ x).max() <= 10.0 * scale
    assert np.abs(products[np.array([2])] @ x[2:] - (whole @ x)[2:]).max() <= 10.0 * scale
    assert np.abs(masses(model, q[1]) @ x[1] - (whole @ x)[1]).max() <= 10.0 * scale
