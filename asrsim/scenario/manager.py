"""The toolbox's manager file: order of the joints, and namespace."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from asrsim.document.kinds import File
from asrsim.document.node import Node
from asrsim.document.reading import KeyPath, Reading, Rejected
from asrsim.document.yaml_reader import read_yaml
from asrsim.errors import InputError, Problem, ScenarioError

MAX_DEPTH = 4
"""Levels of a manager file at which its joints are looked for."""


@dataclass(frozen=True, kw_only=True)
class Manager:
    """What a manager file says that matters here; topic names and sample time do not change a simulation."""

    joints: tuple[str, ...]
    namespace: str | None
    warnings: tuple[Problem, ...] = ()


class ManagerFile(File):
    """A manager file, read into the scenario's order of joints and namespace."""

    def read(self, node: Node, path: KeyPath, reading: Reading) -> Any:
        try:
            manager = read_manager(super().read(node, path, reading))
        except InputError as error:
            reading.problems.extend(error.problems)
            raise Rejected from None
        reading.warnings.extend(manager.warnings)
        return {"joint_order": manager.joints, "namespace": manager.namespace}


def read_manager(path: Path) -> Manager:
    """Read a manager file, also one whose parameters stand under a node's name (`/**: ros__parameters:`).

    Raises ScenarioError if it is no YAML or names no joints.
    """
    root, _ = read_yaml(path, error=ScenarioError)
    node = _find(root, MAX_DEPTH)
    if node is None or not isinstance(node.value, dict):
        raise ScenarioError("has no list 'joints_name'", file=path, line=root.line, code="manager")
    names = node.value["joints_name"]
    if not isinstance(names.value, list) or not names.value:
        raise ScenarioError("must be a list of joints", file=path, line=names.line, key="joints_name", code="manager")
    joints = tuple(str(item.value).strip() for item in names.value)
    problems = [
        Problem(f"joint '{joint}' stands there twice", file=path, line=names.line, key="joints_name", code="manager")
        for joint in dict.fromkeys(joints)
        if joints.count(joint) > 1
    ]
    if problems:
        raise ScenarioError(problems)
    warnings = []
    number = node.value.get("joints_number")
    if number is not None and number.value != len(joints):
        message = f"joints_number is {number.value}, but joints_name has {len(joints)}: the list counts"
        warnings.append(Problem(message, file=path, line=number.line, key="joints_number", code="manager-number"))
    space = node.value.get("namespace")
    namespace = str(space.value).strip().strip("/") if space is not None and space.value is not None else None
    return Manager(joints=joints, namespace=namespace or None, warnings=tuple(warnings))


def _find(node: Node, depth: int) -> Node | None:
    if not isinstance(node.value, dict) or depth == 0:
        return None
    if "joints_name" in node.value:
        return node
    return next((found for item in node.value.values() if (found := _find(item, depth - 1)) is not None), None)
