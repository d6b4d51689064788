"""A private copy of xacro, without the functions that read files or run code."""

from __future__ import annotations

import importlib.util
import os
import re
import sys
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from types import ModuleType
from typing import Any

from pinarm.errors import ModelError

_MACRO_PARAMETER = re.compile(
    r"^\s*([^\s:=]+?)\s*:?=\s*(\^\|?)?(\$\{.*?\}|\$\(.*?\)|(?:'.*?'|\".*?\"|[^\s'\"]++)++|)(?:\s+|$)(.*)"
)
"""xacro's own, with possessive repetitions: as it stands there, an unbalanced quote takes exponential time."""
_DISARMED = ("open", "eval", "compile", "os", "glob", "load_yaml", "safe_eval", "eval_extension", "process_file")
"""Names of xacro that are set to ``None``: the replacements do not need them, and any other use fails."""
OURS = (
    "check_attrs", "eval_all", "eval_text", "get_include_files", "handle_macro_call", "is_valid_name", "parse",
    "print_location", "remove_previous_comments", "replace_node", "reqd_attrs", "warning",
)  # fmt: skip
_NEEDED = (
    *OURS, "LEXER", "NameSpace", "Table", "XacroException", "_global_symbols", "all_includes", "filestack",
    "init_stacks", "macrostack", "process_doc", "process_include", "re_macro_arg", "root_dir",
    "substitution_args_context",
)  # fmt: skip


def _version(site: Path) -> str:
    """Return the version of the xacro installed in a folder; its name says it (importlib.metadata takes 20 ms)."""
    names = [name for name in os.listdir(site) if name.startswith("xacro-") and name.endswith(".dist-info")]
    return names[0].removeprefix("xacro-").removesuffix(".dist-info") if len(names) == 1 else "of unknown version"


def _literal(plain: Callable[[Any], Any], value: Any) -> Any:
    """Turn text into the number that it is, as xacro does; but digits of other scripts are text."""
    return value if isinstance(value, str) and not value.isascii() and value[0] != "'" else plain(value)


@cache
def private_xacro() -> tuple[ModuleType, dict[str, Any]]:
    """Load a private copy of xacro; return it with those of its functions that are replaced.

    Raises:
        ModelError: It is missing, or not version 2.1, for which the replacements are written.
    """
    from xml.dom import minidom

    spec, hint = importlib.util.find_spec("xacro"), "pip install 'xacro==2.1.*'"
    if spec is None or spec.origin is None:
        raise ModelError("xacro files need the package xacro", hint=hint)
    version = _version(Path(spec.origin).parents[1])
    if not version.startswith("2.1."):
        raise ModelError(f"xacro {version} is not known to be contained", expected="version 2.1", hint=hint)
    folders = spec.submodule_search_locations
    spec = importlib.util.spec_from_file_location("_pinarm_xacro", spec.origin, submodule_search_locations=folders)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    command_line: Any = ModuleType(f"{spec.name}.cli")  # which nobody needs, and which imports much
    command_line.process_args = None
    sys.modules[command_line.__name__] = command_line
    writexml = minidom.Element.writexml
    try:
        spec.loader.exec_module(module)
    finally:
        minidom.Element.writexml = writexml  # type: ignore[method-assign]  # which xacro replaces for everyone
    if missing := [name for name in _NEEDED if not hasattr(module, name)]:
        raise ModelError(f"this xacro {version} has no {missing[0]}: it is not known to be contained", hint=hint)
    module.Table._eval_literal = staticmethod(partial(_literal, module.Table._eval_literal))
    vars(module).update(dict.fromkeys(_DISARMED), re_macro_arg=_MACRO_PARAMETER, _global_symbols={})
    return module, {name: getattr(module, name) for name in OURS}
