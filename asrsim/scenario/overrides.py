"""Applies `key=value` from the command line to the nodes of a scenario."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

from asrsim.document.kinds import key_at
from asrsim.document.node import Node, node_from_data
from asrsim.document.yaml_reader import parse_yaml
from asrsim.errors import InputError, ScenarioError, did_you_mean
from asrsim.renamed import new_key
from asrsim.robot.vary import JOINT_NAMES, LINK_NAMES
from asrsim.scenario.data import SCENARIO

_PART = re.compile(r'"([^"]*)"|([^."]+)')


def split_path(text: str) -> tuple[str, ...]:
    """Parts of a dotted path. Parts with dots are in double quotes. Raises ScenarioError."""
    parts: list[str] = []
    position = 0
    while position <= len(text):
        found = _PART.match(text, position)
        if not found or (found.end() < len(text) and text[found.end()] != "."):
            raise ScenarioError("is not a dotted key", key=text, code="override")
        parts.append(found[1] if found[1] is not None else found[2])
        position = found.end() + 1
    return tuple(parts)


Overrides: TypeAlias = "Sequence[str] | Mapping[str, Any]"
"""Texts `key=value`, or a mapping from dotted keys to plain values."""


def apply_overrides(root: Node, overrides: Overrides, robot: str | Path | None = None) -> Node:
    """Document with all overrides set in order, and with another robot file, if one is given. A null value, or an empty text,
    removes the key. Raises ScenarioError.
    """
    if isinstance(overrides, Mapping):
        values = [(str(key).strip(), node_from_data(value)) for key, value in overrides.items()]
    else:
        values = [_parsed(text) for text in override_texts(overrides)]
    if robot is not None:
        values.append(("robot", node_from_data(str(Path(robot).absolute()))))
    for key, value in ((new_key(key), value) for key, value in values):
        _check_key(key)
        root = _set(root, split_path(key), value, key)
    return root


def override_texts(overrides: Overrides) -> tuple[str, ...]:
    """Overrides as texts `key=value`. Raises ScenarioError if they are neither a mapping nor texts."""
    if isinstance(overrides, Mapping):
        return tuple(f"{key}={json.dumps(value)}" for key, value in overrides.items())
    texts = (overrides,) if isinstance(overrides, str) else overrides
    if not (isinstance(texts, Sequence) and all(isinstance(text, str) for text in texts)):
        hint = "Give {'duration': 2}, or ['duration=2']"
        raise ScenarioError("overrides must be a mapping or key=value texts", value=overrides, hint=hint, code="override")
    return tuple(texts)


def _parsed(override: str) -> tuple[str, Node]:
    key, equals, text = override.partition("=")
    if not equals or not key.strip():
        hint = "Write key=value, such as duration=2 or references.joint1.equilibrium_position=0.5"
        raise ScenarioError("is not key=value", value=override, hint=hint, code="override")
    try:
        return key.strip(), node_from_data(parse_yaml(text, error=ScenarioError).plain())
    except InputError as error:
        message = f"its value {error.problems[0].message}"
        raise ScenarioError(message, key=key, value=text, code="override") from None


def _check_key(key: str) -> None:
    if key.partition(".")[0] == "variants":
        hint = "An override applies to every variant that runs; choose one with --variant"
        raise ScenarioError("cannot be set", key=key, hint=hint, code="override")
    path = split_path(key)
    if len(path) == 2 and key_at(SCENARIO, path[:1]) is None and not did_you_mean(path[0], tuple(SCENARIO.names)):
        # Explain the key of a joint's parameter. Sweeps and fits name it JOINT.PARAMETER, but scenarios do not.
        raise ScenarioError(
            "is not a key of a scenario",
            key=key,
            code="override",
            hint=f"Numbers of the URDF are changed there, by `asrsim sweep --over {key}=...`, or by reset(parameters=...)"
            if path[1] in (*LINK_NAMES, *JOINT_NAMES)
            else f"A joint's parameter is parameters.{key}, and its reference is references.{key}",
        )


def _set(node: Node, path: tuple[str, ...], value: Node, key: str, above: tuple[str, ...] = ()) -> Node:
    if not path:
        return value
    head, rest = path[0], path[1:]
    if node.value is None and head.isdecimal():
        # If the file lacks the list to which the path refers, such as gravity.2, use the default list.
        declared = key_at(SCENARIO, above)
        if declared is not None and isinstance(declared.default, tuple):
            node = node_from_data(list(declared.default))
    if isinstance(node.value, list):
        if not head.isdecimal() or int(head) >= len(node.value):
            message = f"'{head}' is not an index of a list of {len(node.value)} entries (counted from 0)"
            raise ScenarioError(message, key=key, code="override")
        items = list(node.value)
        items[int(head)] = _set(items[int(head)], rest, value, key, (*above, head))
        return Node(items, node.line, None, node.file)
    mapping = dict(node.value) if isinstance(node.value, dict) else {}
    if not isinstance(node.value, dict) and node.value is not None:
        message = f"'{head}' cannot be set inside the value {node.describe()!r}"
        raise ScenarioError(message, key=key, code="override")
    if not rest and value.value is None:
        mapping.pop(head, None)
    else:
        mapping[head] = _set(mapping.get(head, Node(None)), rest, value, key, (*above, head))
    lines = dict(node.key_lines or {})
    lines[head] = None
    return Node(mapping, node.line, lines, node.file)
