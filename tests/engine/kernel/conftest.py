"""Tests of what only the compiled kernel does are skipped where it was not built."""

import pytest

from pinarm.engine.kernel.library import absence


@pytest.fixture
def compiled():
    if reason := absence():
        pytest.skip(f"compiled kernel: {reason}")
