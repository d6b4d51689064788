"""Fields of input files whose types are imported when a file has the field.

A file uses few of the keys that it may have. A struct names the types of the others in ``deferred``, as module and
class, and annotates them as ``Any`` at run time: a run then imports what its files use, and nothing else.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache
from importlib import import_module
from types import UnionType
from typing import Any, TypeVar, Union, get_args, get_origin

import msgspec

StructT = TypeVar("StructT", bound=msgspec.Struct)

Deferred = Mapping[str, tuple[str, str]]
"""Field -> module and name of the type in place of ``Any`` in its annotation."""


def with_types(struct: type[StructT], keys: Iterable[str]) -> type[StructT]:
    """Return a struct with the types of those of its ``deferred`` fields that are among the keys of a file."""
    deferred: Deferred = getattr(struct, "deferred", {})
    wanted = deferred.keys() & keys if deferred else ()
    return _with_types(struct, frozenset(wanted)) if wanted else struct


@cache
def _with_types(struct: type[Any], wanted: frozenset[str]) -> type[Any]:
    fields = []
    for field in msgspec.structs.fields(struct):
        if field.encode_name in wanted:
            module, name = struct.deferred[field.encode_name]
            kind = _filled(field.type, getattr(import_module(module), name))
            default: Any = {"default": field.default, "default_factory": field.default_factory}
            fields.append((field.name, kind, msgspec.field(name=field.encode_name, **default)))

    def reduced(self: msgspec.Struct) -> tuple[Any, ...]:
        return _made_again, (struct, wanted, {name: getattr(self, name) for name in self.__struct_fields__})

    namespace = {"__doc__": struct.__doc__, "__reduce__": reduced}
    return msgspec.defstruct(
        struct.__name__, fields, bases=(struct,), module=struct.__module__, namespace=namespace, frozen=True,
        kw_only=True,
    )  # fmt: skip


def _made_again(struct: type[StructT], wanted: frozenset[str], values: dict[str, Any]) -> StructT:
    """Make a struct in another process, which cannot look up its class by name."""
    return with_types(struct, wanted)(**values)


def _filled(annotation: Any, kind: Any) -> Any:
    """Return an annotation with a type in place of ``Any``."""
    if annotation is Any:
        return kind
    origin, inside = get_origin(annotation), tuple(_filled(argument, kind) for argument in get_args(annotation))
    if not inside:
        return annotation
    return Union[inside] if origin in (Union, UnionType) else origin[inside]  # noqa: UP007
