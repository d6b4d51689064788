"""Build hook: compiles the C sources of ``pinarm/engine/kernel/c`` into a library that the wheel carries.

``python hatch_build.py`` does it in a checkout. The compiler is ``$CC``, or ``cc``, or that of ``ziglang``, which is
required where there is no other. Without a compiler, or with ``PINARM_KERNEL=off``, the library is left out: pinarm
then computes the same in Python.
"""

from __future__ import annotations

import os
import platform
import shlex
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

try:
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface
except ImportError:  # run as a program, where hatchling need not be
    BuildHookInterface = object

ROOM = Path("pinarm/engine/kernel")
LIBRARY = ROOM / "c" / ("kernel.dylib" if sys.platform == "darwin" else "kernel.so")

FLAGS = ("-std=c11", "-O2", "-ffp-contract=off", "-fPIC", "-shared")
"""No flags for one processor and none that change arithmetic: fused products would give other last digits on some."""

ZIG = {("Linux", "x86_64"), ("Linux", "aarch64"), ("Darwin", "x86_64"), ("Darwin", "arm64")}
"""Systems and machines that ziglang has wheels for."""


def compiler() -> list[str]:
    """Return the command of the C compiler; empty where there is none."""
    if command := shlex.split(os.environ.get("CC", "")):
        return command
    if shutil.which("cc"):
        return ["cc"]
    return [sys.executable, "-m", "ziglang", "cc"] if find_spec("ziglang") else []


def compile_library(root: Path) -> str:
    """Compile the library into the package; return why there is none, or an empty string."""
    (root / LIBRARY).unlink(missing_ok=True)
    if os.environ.get("PINARM_KERNEL") == "off":
        return "PINARM_KERNEL=off"
    if not (command := compiler()):
        return "there is no C compiler"
    sources = sorted(f"c/{path.name}" for path in (root / ROOM / "c").glob("*.c"))
    fresh = LIBRARY.with_suffix(f".{os.getpid()}").name  # a library in use must not be written to
    flags = [*FLAGS, *shlex.split(os.environ.get("CFLAGS", ""))]
    try:
        subprocess.run([*command, *flags, "-o", fresh, *sources, "-lm"], cwd=root / ROOM, check=True,
                       capture_output=True, text=True)  # fmt: skip
        os.replace(root / ROOM / fresh, root / LIBRARY)
    except OSError as error:
        return f"{command[0]} cannot be run: {error}"
    except subprocess.CalledProcessError as error:
        return f"{shlex.join(command)} failed:\n{error.stderr}"
    finally:
        (root / ROOM / fresh).unlink(missing_ok=True)
    return ""


class KernelBuildHook(BuildHookInterface):
    """Puts the library into wheels, also editable ones; the source distribution has its sources."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        """Return what the build requires beside hatchling: a compiler, where there is none."""
        wanted = os.environ.get("PINARM_KERNEL") != "off" and not (os.environ.get("CC") or shutil.which("cc"))
        return ["ziglang>=0.13"] if wanted and (platform.system(), platform.machine()) in ZIG else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile the library, and name the platform in the wheel."""
        if reason := compile_library(Path(self.root)):
            self.app.display_warning(f"pinarm is built without its compiled kernel: {reason}")
            return
        from packaging.tags import sys_tags

        platforms = (tag.platform for tag in sys_tags())
        of_system = next(one for one in platforms if not one.startswith(("manylinux", "musllinux")))
        build_data["artifacts"].append(LIBRARY.as_posix())
        build_data["pure_python"], build_data["tag"] = False, f"py3-none-{of_system}"


if __name__ == "__main__":
    if failure := compile_library(Path(__file__).parent):
        raise SystemExit(failure)
    print(Path(__file__).parent / LIBRARY)
