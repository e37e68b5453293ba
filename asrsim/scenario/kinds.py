"""Kinds of values that several parts of a scenario share."""

from __future__ import annotations

from typing import Any

from asrsim.document.composite import ListOf, MapOf
from asrsim.document.kinds import NUMBER, Text
from asrsim.document.node import Node
from asrsim.document.reading import KeyPath, Reading
from asrsim.signals.parse import SIGNAL

Vector = tuple[float, float, float]
Keys = dict[str, Any]
"""A block that is kept as a plain mapping."""

POSITION = ListOf(of=NUMBER, length=3, names=("x", "y", "z"))
RPY = ListOf(of=NUMBER, length=3, names=("roll", "pitch", "yaw"))
SIGNALS_BY_JOINT = MapOf(of=SIGNAL)
ORIGIN = (0.0, 0.0, 0.0)
"""m or rad, where nothing is said."""


def names_a_folder(name: str) -> bool:
    """Whether a name can be that of a folder: scenarios and variants name the folders of their results."""
    good = bool(name.strip()) and name not in (".", "..") and len(name.encode(errors="replace")) <= 255
    return good and all(sign.isprintable() and sign not in "/\\" for sign in name)


class FolderName(Text):
    """Text that names a folder too."""

    def read(self, node: Node, path: KeyPath, reading: Reading) -> str:
        name = super().read(node, path, reading)
        if not names_a_folder(name):
            raise reading.fault(node, path, "is no name: it names a folder too", code="name")
        return name
