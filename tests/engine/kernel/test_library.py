"""Whether there is a library, and that it is the one of these sources."""

import ctypes
import os
import shutil
import subprocess
import sys

import pytest

from pinarm.engine.kernel import library as kernel
from pinarm.engine.kernel.library import SIZES


def in_child(code, **environment):
    """Return what a program prints in another process."""
    run = [sys.executable, "-c", code]
    return subprocess.run(run, env={**os.environ, **environment}, capture_output=True, text=True, check=True).stdout


def test_the_switch_leaves_it_out():
    code = "from pinarm.engine.kernel.library import absence, library; print(library(), absence())"
    assert in_child(code, PINARM_KERNEL="off") == "None switched off by PINARM_KERNEL=off\n"


@pytest.fixture
def fresh():
    """What is known of the library is forgotten, before and after."""
    kernel.library.cache_clear()
    yield
    kernel.library.cache_clear()


@pytest.mark.usefixtures("fresh")
class TestFile:
    @pytest.fixture(autouse=True)
    def _on(self, monkeypatch):
        monkeypatch.delenv(kernel.SWITCH, raising=False)

    def test_that_is_no_library(self, tmp_path, monkeypatch):
        path = tmp_path / "kernel.so"
        path.write_bytes(b"nothing")
        monkeypatch.setattr(kernel, "PATH", path)
        assert kernel.library() is None
        assert kernel.absence() == "kernel.so is of another version or system"

    @pytest.mark.skipif(not shutil.which("cc"), reason="there is no C compiler")
    @pytest.mark.parametrize("numbers", [[0], [len(SIZES), *len(SIZES) * [8]]])
    def test_of_another_version_is_not_used(self, tmp_path, monkeypatch, numbers):
        source, path = tmp_path / "other.c", tmp_path / "kernel.so"
        source.write_text(f"const int kernel_sizes[] = {{{', '.join(map(str, numbers))}}};\n")
        subprocess.run(["cc", "-shared", "-fPIC", "-o", str(path), str(source)], check=True)
        monkeypatch.setattr(kernel, "PATH", path)
        assert kernel.library() is None
        assert kernel.absence() == "kernel.so is of another version or system"


@pytest.mark.usefixtures("compiled")
def test_structures_are_those_of_the_headers():
    sizes = (ctypes.c_int * (1 + len(SIZES))).in_dll(kernel.library(), "kernel_sizes")
    assert list(sizes) == [len(SIZES), *SIZES]
