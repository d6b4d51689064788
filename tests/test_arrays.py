"""Arrays that a user gives: what is taken for rows of states, and what is refused."""

import numpy as np
import pytest

from pinarm.arrays import as_rows, real
from pinarm.errors import InputError


@pytest.mark.parametrize("given", [[1, 2], np.array([1.0, 2.0], dtype=np.float32)])
def test_numbers_of_any_real_type_become_doubles(given: object) -> None:
    found = real(given, "q")
    assert found.dtype == np.float64
    assert found.tolist() == [1.0, 2.0]


@pytest.mark.parametrize("given", [["a", "b"], [1j, 2.0], None])
def test_what_is_no_real_number_is_refused_by_name(given: object) -> None:
    with pytest.raises(InputError, match="q is no array of real numbers"):
        real(given, "q")


def test_one_state_is_one_row() -> None:
    assert as_rows([1, 2, 3], 3, "q").tolist() == [[1.0, 2.0, 3.0]]
    rows = np.zeros((5, 3))
    assert as_rows(rows, 3, "q") is rows  # hot paths copy nothing
    assert as_rows(np.zeros((0, 3)), 3, "q").shape == (0, 3)


@pytest.mark.parametrize("shape", [(2,), (3, 5), (2, 5, 2)])
def test_another_shape_is_refused_with_the_one_that_is_wanted(shape: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match="v has the shape") as caught:
        as_rows(np.zeros(shape), 3, "v")
    assert "(n, 3)" in str(caught.value)
