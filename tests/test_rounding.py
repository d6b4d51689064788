"""Roundings of other processors, which the environment chooses as in ``.ci/run``: what should be off is off."""

import os
import platform

import numpy as np
import pytest
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__
from threadpoolctl import threadpool_info

AVX512 = "X86_V4", "AVX512"
WIDER = {"X86_V4": AVX512, "X86_V3": ("X86_V3", "AVX2", "FMA3", *AVX512)}
"""Set of instructions -> how the names begin of all that are no narrower, before numpy 2.4 and since."""


def test_numpy_takes_no_instructions_that_are_switched_off():
    off = os.environ.get("NPY_DISABLE_CPU_FEATURES", "").split()
    beginnings = *off, *(name for instructions in off for name in WIDER.get(instructions, ()))
    taken = [name for name in __cpu_dispatch__ if __cpu_features__[name]]
    assert not [name for name in taken if name.startswith(beginnings)], np.__version__


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="the kernels are those of other processors")
@pytest.mark.skipif("OPENBLAS_CORETYPE" not in os.environ, reason="OpenBLAS chooses its kernel itself")
def test_openblas_takes_the_kernel_that_is_asked_for():
    kernels = {library["architecture"] for library in threadpool_info() if library["internal_api"] == "openblas"}
    assert kernels <= {os.environ["OPENBLAS_CORETYPE"]}
