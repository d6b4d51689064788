"""What tells mechanisms and controllers apart that were given in Python, and stand in no file that is read again."""

from __future__ import annotations

import hashlib
import io
import pickle
import secrets
import sys
from pathlib import Path
from types import FunctionType
from typing import TYPE_CHECKING, Any

import msgspec

from pinarm.input.yaml.schema import plain

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.use.scenario.scenario import ScenarioSource

VERSIONED = {*sys.stdlib_module_names, "pinarm", "numpy", "scipy", "pinocchio", "msgspec"}
"""Packages whose code is known by their versions."""


def identity(source: ScenarioSource) -> list[object]:
    """Return plain data that differ where the mechanism or the controllers that a scenario was given in Python do.

    Of controllers these are what they hold, and the texts of all files of Python in the folders of their modules. What
    has no such text, such as a function of a notebook, is never the same again.
    """
    given = [] if source.given is None else _of_mechanism(source.given)
    return [source.seed, given, [_content(each) for each in source.functions]]


def _of_mechanism(mechanism: Mechanism) -> list[object]:
    """Return those of a mechanism: what its file says, and what was made of that, numbers of tables included."""
    described = msgspec.to_builtins(mechanism.description, enc_hook=plain)
    _, (_, fields) = mechanism.__reduce__()
    return [described, *(_content(value) for name, value in fields.items() if name not in ("description", "locate"))]


def _content(thing: object) -> list[str]:
    """Return digests of what an object holds, and of the code that it needs."""
    stream = io.BytesIO()
    pickler = _Content(stream)
    try:
        pickler.dump(thing)
        code = [_code_beside(name) for name in sorted(pickler.modules)]
    except Exception:  # whatever an object of the user's raises there
        return [secrets.token_hex()]
    return [hashlib.sha256(stream.getvalue()).hexdigest(), *code]


class _Content(pickle.Pickler):
    """Writes the same for the same content in every process, and notes the modules of the user's functions and classes.

    Pickle writes only the names of these.
    """

    def __init__(self, stream: io.BytesIO) -> None:
        super().__init__(stream, protocol=5)
        self.modules: set[str] = set()

    def persistent_id(self, thing: Any) -> Any:
        """Return sets in an order of their own; all else is written as it would be."""
        if isinstance(thing, type | FunctionType) and thing.__module__.partition(".")[0] not in VERSIONED:
            self.modules.add(thing.__module__)
        return sorted(map(repr, thing)) if isinstance(thing, set | frozenset) else None


def _code_beside(module: str) -> str:
    """Return a digest of the files of Python in the folder of a module.

    Raises:
        AttributeError: It has no file.
        OSError: One cannot be read.
    """
    content, folder = hashlib.sha256(), Path(str(sys.modules[module].__file__)).parent
    for path in sorted(folder.glob("*.py")):
        content.update(f"{path.name}\0".encode() + hashlib.sha256(path.read_bytes()).digest())
    return content.hexdigest()
