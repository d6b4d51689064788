"""Slips with several components, by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from pinarm.mechanics.friction.slip_vectors import sizes, unit_vectors

CONTACTS = [SimpleNamespace(name=name) for name in ("loop.a", "joint.b", "loop.a", "joint.c")]
SLIPS = np.array([[3.0, -2.0, 4.0, 0.0], [0.0, 5.0, -7.0, 1.0], [0.0, 0.0, 0.0, -1e-9]])


def test_length_and_direction_are_those_of_the_whole_slip():
    lengths = np.array([[5.0, 2.0, 5.0, 0.0], [7.0, 5.0, 7.0, 1.0], [0.0, 0.0, 0.0, 1e-9]])
    assert sizes(CONTACTS, SLIPS) == pytest.approx(lengths)
    expected = np.array([[0.6, -1.0, 0.8, 0.0], [0.0, 1.0, -1.0, 1.0], [0.0, 0.0, 0.0, -1.0]])
    assert unit_vectors(CONTACTS, SLIPS) == pytest.approx(expected)
    assert unit_vectors(CONTACTS[1:2], SLIPS[:, 1:2]).tolist() == [[-1.0], [1.0], [0.0]]
