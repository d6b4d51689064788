"""Files that a file may refer to: under its root, or in packages that the user names.

The root is the nearest folder above that holds ``pyproject.toml`` or ``.pinarm-root``; without such a folder the
working folder for a file under it, else the file's own folder. ``file_root`` sets another root. Symbolic links are
followed before a path is compared with the root; no file is opened here.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import cache
from pathlib import Path

from pinarm.errors import InputError, ModelError, choices

MARKERS = ("pyproject.toml", ".pinarm-root")

Packages = Mapping[str, Path]
"""Name of a package of ROS -> its folder."""

NO_PACKAGES: Packages = {}

Stamp = tuple[int, int, int, int]
"""Times of the last changes of a file's content and of its entry [ns], its size [bytes], and its number."""

Access = tuple[str | None, dict[str, str]]
"""The folder and the packages that ``file_root`` says, as text."""

_given: ContextVar[Path | None] = ContextVar("given", default=None)
_packages: ContextVar[Packages] = ContextVar("packages", default=NO_PACKAGES)
_noted: ContextVar[set[Path] | None] = ContextVar("noted", default=None)


def stamp_of(state: os.stat_result) -> Stamp:
    """Return a stamp of a file's state: both times, as copying keeps that of the content, size and inode."""
    return state.st_mtime_ns, state.st_ctime_ns, state.st_size, state.st_ino


@contextmanager
def file_root(folder: str | Path | None, packages: Mapping[str, str | Path] = NO_PACKAGES) -> Iterator[None]:
    """Let the files that are read in the block refer to those under a folder, and to no others.

    Args:
        folder: The folder; each file's own root where it is ``None``.
        packages: Name of a package of ROS -> its folder, whose files may be referred to as well: by
            ``package://NAME/...``, and in xacro by ``$(find NAME)``. They are added to those of blocks around this one.

    Raises:
        InputError: There is no such folder.
    """
    for named in ([] if folder is None else [folder], packages.values()):
        for path in map(Path, named):
            if not path.is_dir():
                raise InputError(f"there is no folder {_short(path)}", hint=similar_file(path))
    token = _given.set(Path(folder).resolve() if folder is not None else _given.get())
    known = _packages.set({**_packages.get(), **{name: Path(path).resolve() for name, path in packages.items()}})
    try:
        yield
    finally:
        _given.reset(token)
        _packages.reset(known)


def given_access() -> Access:
    """Return the folder and the packages that ``file_root`` says, to hand them on to another process."""
    root = _given.get()
    return None if root is None else str(root), {name: str(path) for name, path in _packages.get().items()}


@contextmanager
def noting_files() -> Iterator[set[Path]]:
    """Collect the files that are referred to in the block, missing ones included; a block around it has them too."""
    files: set[Path] = set()
    token = _noted.set(files)
    try:
        yield files
    finally:
        _noted.reset(token)
        note_files(files)


def note_files(files: Iterable[Path]) -> None:
    """Note files as referred to, where files are collected."""
    if (noted := _noted.get()) is not None:
        noted.update(files)


def root_of(path: Path) -> Path:
    """Return the root of a file or folder: of a marker, the working folder, or the folder itself."""
    if (given := _given.get()) is not None:
        return given
    resolved = os.path.realpath(path)
    folder = nearest = resolved if os.path.isdir(resolved) else os.path.dirname(resolved)
    while not any(os.path.isfile(os.path.join(folder, marker)) for marker in MARKERS):
        folder, below = os.path.dirname(folder), folder
        if folder == below:
            return Path(_working_folder(nearest) or nearest)
    return Path(folder)


def _working_folder(inner: str) -> str:
    """Return the working folder if it holds a folder; empty for the top of the file system and the user's home."""
    try:
        here = os.path.realpath(os.getcwd())
    except OSError:  # it has been removed
        return ""
    wide = here in (os.path.dirname(here), os.path.realpath(os.path.expanduser("~")))
    return "" if wide or not f"{inner}{os.sep}".startswith(os.path.join(here, "")) else here


def packages_around(path: Path, root: Path) -> Packages:
    """Return the packages of ROS in which a file lies, up to the root: folders whose ``package.xml`` has a name."""
    packages = dict[str, Path]()
    for folder in path.parents:
        if not folder.is_relative_to(root):
            break
        file = folder / "package.xml"
        with suppress(OSError):
            if file.is_file():  # a pipe would keep the reader waiting
                with open(file, "rb") as stream:
                    named = re.search(rb"<name>\s*([\w-]+)\s*</name>", stream.read(10_000))
                packages = {named[1].decode(): folder, **packages} if named else packages
    return packages


def contained_file(path: str | Path, root: Path, packages: Packages = NO_PACKAGES) -> Path:
    """Return the regular file of a path, which must lie under the root or a package; see ``contained_path``."""
    resolved = contained_path(path, root, packages)
    if not resolved.is_file():
        if resolved.exists():
            raise InputError(f"the file {str(path)!r} is not a regular file")
        raise InputError(f"the file {str(path)!r} does not exist", hint=similar_file(resolved))
    return resolved


def contained_path(path: str | Path, root: Path, packages: Packages = NO_PACKAGES) -> Path:
    """Return the resolved path, which need not exist.

    Args:
        path: Absolute, relative to ``root``, ``file://...`` or ``package://NAME/...``.
        packages: Packages whose files are allowed too, beside those of ``file_root``.
    """
    packages = {**_packages.get(), **packages}
    allowed = [os.path.realpath(folder) for folder in (root, *packages.values())]
    local = _local(str(path), packages)
    try:
        resolved = os.path.realpath(os.path.join(allowed[0], local))
        with suppress(FileNotFoundError, NotADirectoryError):
            os.stat(resolved)  # raises for loops of links, and for names too long to be asked for
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error.__class__.__name__
        raise InputError(f"{_short(path)} is not a path that can be followed ({reason})") from None
    if not any(f"{resolved}{os.sep}".startswith(os.path.join(folder, "")) for folder in allowed):
        raise InputError(
            f"the path {_short(path)} leads out of the root folder",
            expected=f"a path under {' or '.join(allowed)}",
            hint="copy the file there, work in a folder above both, or say --root DIR; in Python: "
            "with pinarm.file_root(DIR)",
        )
    note_files([file := Path(resolved)])
    return file


def similar_file(path: Path) -> str:
    """Return the existing file in the same folder with the most similar name; empty where none is similar."""
    try:
        names = [entry.name for entry in path.parent.iterdir()]
    except OSError:
        return ""
    close = choices(path.name, names)[1]
    return str(path.parent / close) if close else ""


def _local(text: str, packages: Packages) -> Path:
    scheme, separator, rest = text.removeprefix("file://" if "package://" in text else "").partition("://")
    if not separator:
        return Path(text)
    if scheme == "file":
        return Path(rest)
    if scheme != "package":
        raise InputError(
            f"{_short(text)} is not the URI of a file", expected="a path, file://... or package://NAME/..."
        )
    name, _, inner = rest.partition("/")
    if name not in packages:
        expected, hint = choices(name, packages)
        if not packages:
            expected = "a package whose folder is known"
            hint = f"--package {name[:60]}=DIR, or packages: {{{name[:60]}: DIR}} in the mechanism file"
        raise InputError(f"unknown package {_short(name)}", expected=expected, hint=hint)
    return packages[name] / inner.lstrip("/")


def _short(path: str | Path) -> str:
    text = repr(str(path))
    return text if len(text) <= 200 else f"{text[:190]}...'"


@cache
def example_robot_data() -> Path:
    """Return the folder of the robots of ``example-robot-data``, beside Pinocchio or under the interpreter."""
    from importlib.util import find_spec

    pinocchio = find_spec("pinocchio")  # prefix/lib/pythonX/site-packages/pinocchio/__init__.py
    beside = Path(pinocchio.origin).parents[3:6] if pinocchio and pinocchio.origin else ()
    for prefix in (*beside, Path(sys.prefix)):
        folder = prefix / "share" / "example-robot-data"
        if os.path.isdir(folder / "robots"):  # not of pathlib, which raises where a folder is closed to the user
            return folder
    raise ModelError("example-robot-data is not installed", hint="pip install example-robot-data")


NAMES = {
    "alexander": "alexander_v1.lowerBodyOnly", "asr_twodof": "TwoDofs", "anymal_kinova": "anymal-kinova",
    "b1_z1": "b1-z1", "cassie": "cassie_v2", "borinot": "borinot_flying_arm_2", "g1": "g1_29dof_rev_1_0",
    "g1_with_hands": "g1_29dof_with_hand_rev_1_0", "hector": "quadrotor_base", "hextilt": "hextilt_flying_arm_5",
    "hyq": "hyq_no_sensors", "iris": "iris_simple", "solo8": "solo", "talos": "talos_reduced",
    "talos_arm": "talos_left_arm", "talos_box": "talos_reduced_box", "talos_full": "talos_full_v2",
    "talos_full_box": "talos_full_v2_box", "ur3_limited": "ur3_joint_limited_robot", "ur3": "ur3_robot",
    "ur5_limited": "ur5_joint_limited_robot", "ur10_limited": "ur10_joint_limited_robot",
}  # fmt: skip
"""Names in the package's own loaders -> file names, where these differ."""

FLOATING = frozenset({
    "a1", "alexander", "anymal_b_simple", "anymal_c_simple", "b1", "bolt", "borinot", "cassie", "centauro", "g1", "go1",
    "go2", "hector", "hextilt", "human", "hyq", "icub", "iris", "laikago", "pr2", "quadruped", "romeo",
    "simple_humanoid", "so_arm", "solo", "talos_data",
})  # fmt: skip
"""Folders, without ``_description``, whose robots have a free-flyer in the package's own loaders."""

ENDINGS = (".urdf", ".xacro", ".xml", ".mjcf", ".sdf")
"""Endings of model files; what has none of them is the name of a robot."""

HELD = frozenset({"talos_left_arm"})
"""Files in such folders whose robots are fixed to the ground."""


@cache
def robots() -> dict[str, Path]:
    """Return the model files by name: the file's, with and without ``_robot`` at its end, and the loader's."""
    folder = example_robot_data() / "robots"
    files: dict[str, Path] = {}
    places = sorted(folder.glob("*/*/*.*"))
    for file in (file for file in places if file.suffix == ".urdf"):
        files.setdefault(file.stem, file)
        files.setdefault(file.stem.removesuffix("_robot"), file)
    for file in (file for file in places if file.suffix == ".sdf"):
        files.setdefault(file.stem, file)
    files.update({name: files[stem] for name, stem in NAMES.items() if stem in files})
    if (other := folder / "anymal_c_simple_description" / "urdf" / "anymal.urdf").is_file():
        files["anymal_c"] = other  # its file has the same name as that of the older robot
    return files


def robot(name: str) -> Path:
    """Return the model file of a robot."""
    files = robots()
    if name in files:
        return files[name]
    expected, hint = choices(name, files, most=100)
    raise ModelError(
        f"there is no robot '{name}'", expected=f"a file that ends in {', '.join(ENDINGS)}, or {expected}", hint=hint
    )


def is_floating(file: Path) -> bool:
    """Return whether the robot of a model file of the package has a floating base: a legged or flying robot."""
    folder = file.parents[1].name.removesuffix("_description")
    return folder in FLOATING and file.stem not in HELD
