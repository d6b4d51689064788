"""JSON Schemas of the files, for editors."""

from __future__ import annotations

from typing import Any, Literal, Union

import msgspec

from pinarm.errors import InputError
from pinarm.input.yaml.deferred import with_types
from pinarm.input.yaml.schema import InputStruct, json_schema
from pinarm.mechanics.description import MechanismDescription
from pinarm.problems import KINDS, problem_class
from pinarm.use.scenario.scenario_file import ScenarioFile


def schema(of: Literal["scenario", "mechanism"] = "scenario") -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of scenario files or of mechanism files, as plain data.

    Args:
        of: ``scenario`` or ``mechanism``.

    Raises:
        InputError: There are no files of that kind.
    """
    if of not in ("scenario", "mechanism"):
        raise InputError(f"there is no schema of '{of}'", expected="scenario or mechanism")
    file: type[InputStruct] = ScenarioFile if of == "scenario" else MechanismDescription
    kinds = [problem_class(kind) for kind in KINDS] if of == "scenario" else []
    structs = [with_types(struct, struct.deferred) for struct in (file, *kinds)]
    roots, definitions = msgspec.json.schema_components(
        [structs[0], Union[tuple(structs[1:])]] if kinds else structs,  # noqa: UP007
        schema_hook=json_schema, ref_template="#/$defs/{name}",
    )  # fmt: skip
    if kinds:
        definitions["ScenarioFile"]["properties"]["problem"] = roots[1]
    own = definitions.pop(file.__name__)
    return {**own, "$defs": definitions, "$schema": "https://json-schema.org/draft/2020-12/schema"}
