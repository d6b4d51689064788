"""Versions of the programs, and contents of the files, that determine the numbers of a process."""

from __future__ import annotations

import hashlib
import os
import platform
import stat
from collections.abc import Mapping
from functools import cache
from pathlib import Path

EXAMPLES = "example_files"
"""Folder of the package that a wheel has, and a checkout has elsewhere."""

MOST_BYTES, BLOCK = 2_000_000_000, 1 << 20
"""Size of a file whose content is read, and of the parts in which it is read [bytes]."""

Versions = Mapping[str, str]
"""Program -> its version."""


@cache
def versions() -> dict[str, str]:
    """Return the versions of the programs that this process computes with."""
    import numpy
    import pinocchio
    import scipy

    import pinarm
    from pinarm.engine.kernel.library import absence

    return {
        "python": platform.python_version(),
        "pinarm": pinarm.__version__,
        "the code of pinarm": code_digest(),
        "the compiled kernel of pinarm": "not used" if absence() else "used",
        "pinocchio": pinocchio.__version__,
        "numpy": numpy.__version__,
        "scipy": scipy.__version__,
    }


@cache
def code_digest() -> str:
    """Return a digest of the package's files of Python and C, which tells states of the code of one version apart."""
    import pinarm

    package, content = Path(pinarm.__file__).parent, hashlib.sha256()
    code = {path for ending in ("py", "c", "h") for path in package.rglob(f"*.{ending}")}
    for path in sorted(code - {*package.joinpath(EXAMPLES).rglob("*")}):
        content.update(f"{path.relative_to(package)}\0".encode() + hashlib.sha256(path.read_bytes()).digest())
    return content.hexdigest()[:12]


def differences(here: Versions, there: Versions) -> str:
    """Return which versions differ between this process and another, in words; empty where none does."""
    names = [name for name in {**here, **there} if here.get(name) != there.get(name)]
    pairs = ((name, here.get(name, "absent"), there.get(name, "absent")) for name in names)
    return ", ".join(f"{name} is {own} here and {other} there" for name, own, other in pairs)


def file_digest(file: str) -> str:
    """Return the digest of a regular file of ordinary size; empty for a device, a pipe, or what cannot be read."""
    try:
        with open(os.open(file, os.O_RDONLY | os.O_NONBLOCK), "rb", buffering=0) as stream:
            state = os.fstat(stream.fileno())
            if not stat.S_ISREG(state.st_mode) or state.st_size > MOST_BYTES:
                return ""
            content = hashlib.sha256()
            for _ in range(0, state.st_size, BLOCK):  # and no more: files of /proc have no end
                content.update(stream.read(BLOCK) or b"")
            return content.hexdigest()
    except (OSError, ValueError):
        return ""
