"""JSON Schema of scenarios, made of the declarations that validate scenarios. Editors use it to complete keys."""

from __future__ import annotations

from typing import Any

from asrsim.scenario.data import SCENARIO, VARIANTS
from asrsim.signals.parse import signal_schema

URL = "https://json-schema.org/draft/2020-12/schema"


def json_schema() -> dict[str, Any]:
    """Schema as plain data (draft 2020-12). Only `robot` is required, since `duration` may be in every variant instead.

    In variants, the schema checks the names of the keys and their values, except inside mappings, which may be incomplete.
    """
    schema = SCENARIO.schema()
    return {
        "$schema": URL,
        "title": "asrsim scenario",
        "description": "A simulation run of an articulated soft robot, in one or several variants.",
        **schema,
        "properties": {**schema["properties"], "variants": VARIANTS.schema()},
        "required": ["robot"],
        "$defs": {"signal": signal_schema()},
    }


def schema_text() -> str:
    """Text of docs/scenario.schema.json."""
    import json

    return json.dumps(json_schema(), indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    import sys

    sys.stdout.write(schema_text())
