"""Memory that is kept: pages that the system has to clear, as the system counts them."""

import platform
import subprocess
import sys

import pytest

FAULTS = """
import resource
import numpy as np
from pinarm.use.cases.memory import keep_freed_memory

def faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(5):
        kept = [np.ones(1_000_000) for _ in range(4)]
        del kept
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

first = faults()
keep_freed_memory()
faults()
print(first, faults())
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="another allocator")
def test_arrays_that_follow_others_take_the_memory_of_these() -> None:
    """Five times four arrays of 8 MB in pages of 4 kB, or in huge ones; kept, they are cleared once."""
    ran = subprocess.run([sys.executable, "-c", FAULTS], capture_output=True, text=True, check=True)
    before, after = map(int, ran.stdout.split())
    assert after < 0.1 * before
