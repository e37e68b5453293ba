"""Kinds of values in several parts of a scenario: vectors, names of folders, the toolbox's manager file, engines, steppings."""

from __future__ import annotations

from typing import Any

from asrsim.document.kinds import NUMBER, File, ListOf, MapOf, Text
from asrsim.document.node import Node
from asrsim.document.reading import DocumentReading, KeyPath, Rejected
from asrsim.document.yaml_reader import read_yaml
from asrsim.errors import InputError
from asrsim.signals.parse import SIGNAL

Vector = tuple[float, float, float]
Keys = dict[str, Any]
"""Value of a block from which no object is built: a plain mapping of its keys."""

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

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> str:
        name = super().read(node, path, reading)
        if not names_a_folder(name):
            raise reading.fault(node, path, "must be valid as the name of a folder", code="name")
        return name


MAX_DEPTH = 4
"""Deepest level of a manager file that is searched for the list of joints."""


class ManagerFile(File):
    """Kind of value: a manager file, from which order of joints and namespace are read. Other keys have no effect.

    The parameters may be under the name of a node (`/**: ros__parameters:`).
    """

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> Any:
        try:
            root, _ = read_yaml(super().read(node, path, reading))
        except InputError as error:
            reading.problems.extend(error.problems)
            raise Rejected from None
        table = _find(root, MAX_DEPTH)
        names = table["joints_name"] if table else root
        joints = tuple(str(item.value).strip() for item in names.value) if isinstance(names.value, list) else ()
        if not table or not joints:
            raise reading.fault(names, path, "the manager file has no list 'joints_name'", code="manager", show=False)
        twice = [joint for joint in joints if joints.count(joint) > 1]
        if twice:
            message = f"'joints_name' lists joint '{twice[0]}' twice"
            raise reading.fault(names, path, message, code="manager", show=False)
        space = table["namespace"].value if "namespace" in table else None
        return {"joint_order": joints, "namespace": str(space or "").strip().strip("/") or None}


def _find(node: Node, depth: int) -> dict[str, Node] | None:
    """Mapping that contains the list of joints; None if it is missing."""
    if not isinstance(node.value, dict) or depth == 0:
        return None
    if "joints_name" in node.value:
        return node.value
    return next((found for item in node.value.values() if (found := _find(item, depth - 1)) is not None), None)


def engines() -> tuple[str, ...]:
    """Names of the registered engines, including engines of other packages."""
    from asrsim.engines import ENGINES

    return ENGINES.names()


def steppings() -> tuple[str, ...]:
    """Names of the registered steppings, including steppings of other packages."""
    from asrsim.simulation.steppings import STEPPINGS

    return STEPPINGS.names()


def default_engine() -> str:
    """Engine of a scenario without the key `engine`."""
    from asrsim import engines

    return engines.default_engine()


def prescribes_motion(engine: str) -> bool:
    """Whether the engine prescribes the motion of the links by the key `motion`."""
    from asrsim.engines import ENGINES

    return ENGINES.get(engine).prescribed


def released_order(stepping: str) -> bool:
    """Whether the stepping is that of the released toolbox, with its motors and its order of updates."""
    from asrsim.simulation.steppings import STEPPINGS

    return STEPPINGS.get(stepping).released
