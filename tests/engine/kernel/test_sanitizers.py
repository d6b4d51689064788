"""The tests of the compiled kernel with a library that checks every address and every operation."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pinarm.engine.kernel import library as kernel

ROOT = Path(__file__).parents[3]
SOURCES = sorted(kernel.PATH.parent.glob("*.c"))
WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Wmissing-prototypes", "-Werror"]
SANITIZERS = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer", "-g"]

TESTED = [
    "tests/engine/kernel/test_tree.py", "tests/engine/kernel/test_laws.py",
    "tests/loops/test_compiled.py",
    "tests/engine/integration/test_compiled_steps.py",
]  # fmt: skip

LOAD = """
import sys
from pathlib import Path
from pinarm.engine.kernel import library
library.PATH = Path(sys.argv[1])
assert library.library() is not None, library.absence()
"""

TESTS = f"""{LOAD}
import pytest
raise SystemExit(pytest.main(["-v", "-p", "no:cacheprovider", "-p", "no:xdist", *{TESTED!r}]))
"""

BEYOND = f"""{LOAD}
import ctypes
import numpy as np
import pinocchio as pin
from pinarm.engine.kernel.tree import CompiledTree
model = pin.buildSampleModelManipulator()
flow = CompiledTree.of(model).loaded(np.zeros(model.nv), ()).flow()
state, slope = np.zeros(model.nq + model.nv), np.zeros(model.nq + model.nv - 1)
addresses = [ctypes.c_void_p(x.ctypes.data) for x in (state, slope)]
library.library().tree_rates(ctypes.c_void_p(flow.structure.system), ctypes.c_double(0.0), *addresses)
"""

pytestmark = pytest.mark.skipif(not shutil.which("cc"), reason="there is no C compiler")


def build(path, flags):
    """Compile the kernel, or other sources, with strict warnings."""
    command = ["cc", "-std=c11", "-O1", "-fPIC", "-shared", *WARNINGS, *flags, "-o", str(path), *map(str, SOURCES)]
    return subprocess.run([*command, "-lm"], capture_output=True, text=True, check=False)


def preloaded():
    """Return the run-time libraries of the sanitizers, to be loaded before Python."""
    names = ("libasan.so", "libubsan.so")
    commands = [["cc", f"-print-file-name={name}"] for name in names]
    found = [subprocess.run(one, capture_output=True, text=True, check=True).stdout.strip() for one in commands]
    return [path for path in found if os.path.isabs(path)]


def test_the_compiler_warns_of_nothing(tmp_path):
    done = build(tmp_path / "kernel.so", [])
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Return a function that runs a program with the library of the sanitizers."""
    path = tmp_path_factory.mktemp("sanitized") / "kernel.so"
    done = build(path, SANITIZERS)
    if done.returncode or not preloaded():
        pytest.skip(f"the compiler has no sanitizers: {done.stderr}")
    environment = {
        **os.environ, "LD_PRELOAD": ":".join(preloaded()), "ASAN_OPTIONS": "detect_leaks=0", "PYTHONMALLOC": "malloc",
        "PYTHONPATH": str(ROOT),
    }  # fmt: skip
    environment.pop(kernel.SWITCH, None)

    def run(program):
        command = [sys.executable, "-c", program, str(path)]
        return subprocess.run(command, env=environment, capture_output=True, text=True, cwd=ROOT, check=False)

    return run


@pytest.mark.slow
def test_no_address_is_wrong_and_nothing_is_undefined(run):
    found = run(TESTS)
    assert found.returncode == 0, (found.stdout + found.stderr)[-4000:]
    assert "passed" in found.stdout
    assert "skipped" not in found.stdout


@pytest.mark.slow
def test_a_write_beyond_a_buffer_is_seen(run):
    """The test above would see one."""
    found = run(BEYOND)
    assert found.returncode != 0
    assert "heap-buffer-overflow" in found.stderr
