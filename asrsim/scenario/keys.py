"""Keys of a scenario file: those that `Scenario` declares, and `variants`."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from asrsim.document.block import Block, Key, declared_keys
from asrsim.document.composite import MapOf
from asrsim.scenario.data import Scenario
from asrsim.scenario.kinds import Keys


def _group(name: str, doc: str, main: str = "", **options: Any) -> Key:
    """Key with a mapping whose keys are fields of the scenario."""
    block: Block[Keys] = Block(keys=(), build=dict, noun=f"mapping of {name}", main=main, partial=True)
    return Key(name=name, kind=block, doc=doc, spread=True, **options)


KEYS: tuple[Key, ...] = declared_keys(
    Scenario,
    groups=(
        _group("robot", "URDF or xacro file, or a mapping with `file`, `arguments` and `packages`", main="file"),
        _group("base", "pose of the robot's root", default={}),
        _group("effects", "delay, hold, quantisation and noise of commands and sensors", default={}),
    ),
)
"""All keys of a variant, in the order of the documentation."""

SCENARIO: Block[Keys] = Block(
    keys=KEYS, build=dict, noun="scenario", may_be_empty=False, partial=True, read_before=("variants",)
)
"""Block of one variant."""

VARIANT: Block[Keys] = Block(
    keys=tuple(
        replace(key, default=None if key.required else key.default) for key in KEYS if key.name not in ("name", "variant")
    ),
    build=dict,
    noun="keys that differ",
)

VARIANTS = Key(
    name="variants",
    kind=MapOf(of=VARIANT, noun="name", star=False),
    default={},
    doc="named variants: what each changes, merged into the rest; `null` takes a key away",
)
