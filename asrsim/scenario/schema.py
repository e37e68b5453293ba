"""JSON Schema of scenarios, made of the declarations that validate scenarios. Editors use it to complete keys."""

from __future__ import annotations

from typing import Any

from asrsim.scenario.data import KEYS, SCENARIO, VARIANTS
from asrsim.signals.parse import signal_schema

URL = "https://json-schema.org/draft/2020-12/schema"
FILE_NAME = "scenario.schema.json"


def json_schema() -> dict[str, Any]:
    """Schema as plain data (draft 2020-12). Only `robot` is required, as `duration` may be in every variant instead."""
    schema = SCENARIO.schema()
    properties = {key.name: key.schema() for key in KEYS}
    variants = {**VARIANTS.schema(), "additionalProperties": {"anyOf": [change_schema(SCENARIO.schema()), {"type": "null"}]}}
    signal = signal_schema()
    changes = {"anyOf": [change_schema(shape, keep_required=True) for shape in signal["anyOf"]]}
    return {
        "$schema": URL,
        "title": "asrsim scenario",
        "description": "A simulation run of an articulated soft robot, in one or several variants.",
        **schema,
        "properties": {**properties, "variants": variants},
        "required": ["robot"],
        "$defs": {"signal": signal, "signal_change": changes},
    }


def change_schema(schema: dict[str, Any], *, keep_required: bool = False) -> dict[str, Any]:
    """Schema of the changes in a variant: mappings may be incomplete, null removes a key, and lists must be complete."""
    if "$ref" in schema:
        return {**schema, "$ref": "#/$defs/signal_change"}
    changed = {key: value for key, value in schema.items() if key != "required" or keep_required}
    if "properties" in schema:
        changed["properties"] = {name: _or_null(inner) for name, inner in schema["properties"].items()}
    if isinstance(schema.get("additionalProperties"), dict):
        changed["additionalProperties"] = _or_null(schema["additionalProperties"])
    if "anyOf" in schema:
        changed["anyOf"] = [change_schema(inner) for inner in schema["anyOf"]]
    return changed


def _or_null(schema: dict[str, Any]) -> dict[str, Any]:
    changed = change_schema(schema)
    description = {"description": changed["description"]} if "description" in changed else {}
    return {"anyOf": [changed, {"type": "null"}], **description}


def schema_text() -> str:
    """Text of docs/scenario.schema.json."""
    import json

    return json.dumps(json_schema(), indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    import sys

    sys.stdout.write(schema_text())
