"""The toolbox's manager file: order of the joints, and namespace."""

from __future__ import annotations

from typing import Any

from asrsim.document.kinds import (
    File,
)
from asrsim.document.node import Node
from asrsim.document.reading import DocumentReading, KeyPath, Rejected
from asrsim.document.yaml_reader import read_yaml
from asrsim.errors import InputError

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
