"""Kinds of values that several keys of a scenario share, and properties that follow from its engine and its stepping."""

from __future__ import annotations

from typing import Any

from asrsim.document.kinds import (
    NUMBER,
    Kind,
    ListOf,
    MapOf,
    Name,
    Schema,
    Text,
)
from asrsim.document.node import Node
from asrsim.document.reading import DocumentReading, KeyPath
from asrsim.registry.engines import ENGINES
from asrsim.registry.steppings import stepping_called
from asrsim.signals.parse import SIGNAL

Keys = dict[str, Any]
"""Value of a block from which no object is built: a plain mapping of its keys."""

POSITION = ListOf(of=NUMBER, names=("x", "y", "z"))
RPY = ListOf(of=NUMBER, names=("roll", "pitch", "yaw"))
SIGNALS_BY_JOINT = MapOf(of=SIGNAL)
JOINT = Name(text="name of a joint", noun="joint")
LINK = Name(text="name of a link", noun="link")
ORIGIN = (0.0, 0.0, 0.0)
"""Default of positions (m) and orientations (rad)."""


def names_a_folder(name: str) -> bool:
    """Whether a name is valid for a folder, as scenarios and variants give their names to the folders of results."""
    good = bool(name.strip()) and name not in (".", "..") and len(name.encode(errors="replace")) <= 255
    return good and all(sign.isprintable() and sign not in "/\\" for sign in name)


class FolderName(Text):
    """Kind of value: text that is valid as the name of a folder."""

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> str:
        name = super().read(node, path, reading)
        if not names_a_folder(name):
            raise reading.fault(node, path, "must be valid as the name of a folder", code="name")
        return name


class AnyData(Kind[Any]):
    """Kind of value: plain data that another module validates."""

    text = "anything"

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> Any:
        return node.plain()

    def schema(self) -> Schema:
        return {}


def prescribes_motion(engine: str) -> bool:
    """Whether the engine prescribes the motion of the links by the key `motion`."""
    return ENGINES.get(engine).prescribed


RELEASED_MOTORS = 2
"""Number of motors that every actuator of the released toolbox integrates."""


def released_order(stepping: str) -> bool:
    """Whether the stepping is the stepping of the released toolbox, with the toolbox's motors and order of updates."""
    return stepping_called(stepping).released
