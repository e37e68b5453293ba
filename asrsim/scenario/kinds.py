"""Kinds of values in several parts of a scenario."""

from __future__ import annotations

from typing import Any

from asrsim.document.composite import ListOf, MapOf
from asrsim.document.kinds import NUMBER, Text
from asrsim.document.node import Node
from asrsim.document.reading import KeyPath, Reading
from asrsim.signals.parse import SIGNAL

Vector = tuple[float, float, float]
Keys = dict[str, Any]
"""Value of a block that stays a plain mapping."""

POSITION = ListOf(of=NUMBER, length=3, names=("x", "y", "z"))
RPY = ListOf(of=NUMBER, length=3, names=("roll", "pitch", "yaw"))
SIGNALS_BY_JOINT = MapOf(of=SIGNAL)
ORIGIN = (0.0, 0.0, 0.0)
"""Default of positions (m) and orientations (rad)."""


def names_a_folder(name: str) -> bool:
    """Whether a name is valid for a folder, as scenarios and variants give their names to the folders of results."""
    good = bool(name.strip()) and name not in (".", "..") and len(name.encode(errors="replace")) <= 255
    return good and all(sign.isprintable() and sign not in "/\\" for sign in name)


class FolderName(Text):
    """Kind of value: text that is valid as the name of a folder."""

    def read(self, node: Node, path: KeyPath, reading: Reading) -> str:
        name = super().read(node, path, reading)
        if not names_a_folder(name):
            raise reading.fault(node, path, "must be valid as the name of a folder", code="name")
        return name
