"""Tables for the documentation, made from the registry."""

from __future__ import annotations

import inspect

from asrsim.metrics.measures import MEASURES

_NEEDS = {"series": "one series", "pair": "two series", "either": "two series, or a target", "poses": "a body's poses"}


def tables() -> dict[str, str]:
    """Name of a generated block -> its Markdown."""
    lines = ["| measure | of | unit | definition | options |", "|---|---|---|---|---|"]
    for name in MEASURES:
        found = MEASURES.get(name)
        options = ", ".join(
            f"`{key}`" + ("" if default in (None, inspect.Parameter.empty) else f" = {default}")
            for key, default in found.options.items()
        )
        unit = {"series": "of the series", "1": "-"}.get(found.unit, found.unit)
        lines.append(f"| `{name}` | {_NEEDS[found.needs]} | {unit} | {found.doc} | {options} |")
    return {"measures": "\n".join(lines)}
