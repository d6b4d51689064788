"""JSON Schemas of the files, for editors."""

from __future__ import annotations

from typing import Any, Literal

import msgspec

from pinarm.errors import InputError
from pinarm.input.yaml.schema import json_schema
from pinarm.mechanics.description import MechanismDescription
from pinarm.problems import any_problem
from pinarm.use.assessments import KINDS, assessment_class
from pinarm.use.scenario.scenario import ScenarioFile


def schema(of: Literal["scenario", "mechanism"] = "scenario") -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of scenario files or of mechanism files, as plain data.

    Args:
        of: ``scenario`` or ``mechanism``.

    Raises:
        InputError: There are no files of that kind.
    """
    if of not in ("scenario", "mechanism"):
        raise InputError(f"there is no schema of '{of}'", expected="scenario or mechanism")
    keys = [*KINDS] if of == "scenario" else []
    models: list[Any] = [MechanismDescription]
    if of == "scenario":
        models = [ScenarioFile, any_problem(), *(assessment_class(key) for key in keys)]
    roots, definitions = msgspec.json.schema_components(models, schema_hook=json_schema, ref_template="#/$defs/{name}")
    if of == "scenario":
        properties = definitions["ScenarioFile"]["properties"]
        properties |= dict(zip(["problem", *keys], roots[1:], strict=True))
    own = definitions.pop(models[0].__name__)
    return {**own, "$defs": definitions, "$schema": "https://json-schema.org/draft/2020-12/schema"}
