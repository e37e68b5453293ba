"""JSON Schema of scenarios, from the declarations that also validate them. Editors complete scenarios by it."""

from __future__ import annotations

from typing import Any

from asrsim.scenario.keys import KEYS, SCENARIO, VARIANTS
from asrsim.signals.parse import signal_schema

URL = "https://json-schema.org/draft/2020-12/schema"
FILE_NAME = "scenario.schema.json"


def json_schema() -> dict[str, Any]:
    """The schema as plain data (draft 2020-12). Required keys may also stand in every variant, so only `robot` is asked for."""
    schema = SCENARIO.schema()
    properties = {key.name: key.schema() for key in (*KEYS, VARIANTS)}
    return {
        "$schema": URL,
        "title": "asrsim scenario",
        "description": "A simulation run of an articulated soft robot, in one or several variants.",
        **schema,
        "properties": properties,
        "required": ["robot"],
        "$defs": {"signal": signal_schema()},
    }


def schema_text() -> str:
    """The schema as it stands in docs/scenario.schema.json."""
    import json

    return json.dumps(json_schema(), indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    import sys

    sys.stdout.write(schema_text())
