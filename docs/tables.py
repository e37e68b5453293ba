"""Tables of the documentation, from the declarations of keys, signals and measures."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Sequence
from typing import Any

from asrsim.actuators import MODES
from asrsim.document.block import Block, Key
from asrsim.document.kinds import Kind
from asrsim.metrics.measures import MEASURES
from asrsim.recordings.reading import READING, TIME
from asrsim.scenario.keys import KEYS, VARIANTS
from asrsim.signals import SIGNALS
from asrsim.signals.parse import block_of


def markdown_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table; pipes in cells are escaped."""
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    lines += ["| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in row) + " |" for row in rows]
    return "\n".join(lines)


def key_table(keys: Iterable[Key]) -> str:
    """Key, value, unit, default and meaning, a row a key."""
    rows = [(f"`{key.name}`", key.kind.text, key.unit, key.default_text.strip(), key.doc) for key in keys]
    return markdown_table(("key", "value", "unit", "default", "meaning"), rows)


def _blocks() -> dict[str, Block[Any]]:
    """Every block within the scenario's keys, by the places where it may stand."""
    places: dict[int, tuple[list[str], Block[Any]]] = {}

    def walk(kind: Kind[Any], place: str) -> None:
        if isinstance(kind, Block):
            places.setdefault(id(kind), ([], kind))[0].append(place)
        for added, inner in kind.parts:
            walk(inner, place + added)

    for key in KEYS:
        walk(key.kind, key.name)
    return {", ".join(names): block for names, block in places.values()}


def scenario_tables() -> dict[str, str]:
    """Name of a generated part -> its Markdown."""
    return {
        "scenario-keys": key_table((*KEYS, VARIANTS)),
        "reading-keys": key_table(READING.keys),
        "reading-time": key_table(TIME.keys),
        "scenario-blocks": "\n\n".join(f"### `{name}`\n\n{key_table(block.keys)}" for name, block in _blocks().items()),
        "references": _reference_table(),
        "signals": _signal_list(),
        "signal-keys": "\n\n".join(_signal_section(name) for name in SIGNALS),
    }


def _reference_table() -> str:
    rows = [
        (str(mode.number), mode.name, *(f"`{name}` ({unit})" for name, unit in zip(mode.references, mode.units, strict=True)))
        for mode in MODES.values()
    ]
    return markdown_table(("mode", "name", "first reference", "second reference"), [(*row, "")[:4] for row in rows])


def _signal_list() -> str:
    rows = [(f"[`{name}`](#{name})", block_of(SIGNALS.get(name)).doc) for name in SIGNALS]
    return markdown_table(("signal", "what"), rows)


def _signal_section(name: str) -> str:
    cls = SIGNALS.get(name)
    block = block_of(cls)
    short = f"\n\n`{name}: ...` without keys means `{block.main}`." if block.main else ""
    return f"### {name}\n\n{block.doc}{short}\n\n{key_table(block.keys)}"


NEEDS = {"series": "one series", "pair": "two series", "either": "two series, or a target", "poses": "a body's poses"}


def measure_table() -> str:
    """Every measure with what it is taken of, its unit, definition and options."""
    rows = []
    for name in MEASURES:
        found = MEASURES.get(name)
        options = (
            f"`{key}`" + ("" if default in (None, inspect.Parameter.empty) else f" = {default}")
            for key, default in found.options.items()
        )
        unit = {"series": "of the series", "1": "-"}.get(found.unit, found.unit)
        rows.append((f"`{name}`", NEEDS[found.needs], unit, found.doc, ", ".join(options)))
    return markdown_table(("measure", "of", "unit", "definition", "options"), rows)
