"""Tables of the documentation, generated from the declarations; `docs/generate.py` puts them into the pages."""

from __future__ import annotations

from typing import Any

from asrsim.actuators import MODES
from asrsim.document.block import Block
from asrsim.document.tables import key_table, markdown_table
from asrsim.scenario.keys import ALL_EFFECTS, BASE, EFFECTS, KEYS, LINK_DAMPING, ROBOT, VARIANTS
from asrsim.scenario.learning_keys import FILTER, LEARNING, PLANTS, SPREAD
from asrsim.scenario.task_keys import EXPECTATION, POSE, TASK
from asrsim.scenario.world_keys import GROUND, OBJECT, WORLD, WRENCH
from asrsim.signals import SIGNALS
from asrsim.signals.parse import block_of, main_field

_BLOCKS: dict[str, Block[Any]] = {
    "robot": ROBOT,
    "base": BASE,
    "effects": ALL_EFFECTS,
    "effects.commands.<joint>": EFFECTS,
    "link_damping.<joint>": LINK_DAMPING,
    "wrenches[]": WRENCH,
    "world": WORLD,
    "world.ground": GROUND,
    "world.objects.<name>": OBJECT,
    "task": TASK,
    "task.poses[]": POSE,
    "expect[]": EXPECTATION,
    "ilc": LEARNING,
    "ilc.filter": FILTER,
    "ilc.plants, ilc.transfer": PLANTS,
    "ilc.transfer.spread": SPREAD,
}


def tables() -> dict[str, str]:
    """Name of a generated part -> its Markdown."""
    return {
        "scenario-keys": key_table((*KEYS, VARIANTS)),
        "scenario-blocks": "\n\n".join(f"### `{name}`\n\n{key_table(block.keys)}" for name, block in _BLOCKS.items()),
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
    main = main_field(cls)
    short = f"\n\n`{name}: ...` without keys means `{main}`." if main else ""
    return f"### {name}\n\n{block.doc}{short}\n\n{key_table(block.keys)}"
