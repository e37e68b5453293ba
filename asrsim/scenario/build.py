"""From one variant's nodes to a :class:`Scenario`: keys read, and what several keys must agree on."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from asrsim.document.node import Node
from asrsim.document.reading import Reading, Rejected
from asrsim.plain import mapped
from asrsim.samples import TIP
from asrsim.scenario.choices import default_engine, prescribes_motion
from asrsim.scenario.data import Scenario
from asrsim.scenario.joint_keys import LOCKED
from asrsim.scenario.keys import SCENARIO
from asrsim.signals.constant import Constant

MAX_STEPS = 10**10
"""Of a run: 115 days at 1 ms."""
_ROUNDING = 1e-9
"""Relative error that a ratio of decimal numbers may have and still count as whole."""


def whole(ratio: float) -> int | None:
    """The whole number that a ratio is but for rounding, or None."""
    nearest = round(ratio) if math.isfinite(ratio) else 0
    return nearest if nearest >= 1 and abs(ratio - nearest) <= _ROUNDING * nearest else None


def build_scenario(
    root: Node, reading: Reading, *, name: str, variant: str, path: Path | None = None, text: str = ""
) -> Scenario | None:
    """The scenario, or None with its problems in `reading`."""
    try:
        keys = SCENARIO.read(root, (), reading)
    except Rejected:
        _check_times(root, _readable(root), reading)
        return None
    keys["log_every"] = _check_times(root, keys, reading)
    keys["engine"] = keys["engine"] or default_engine()
    _check_motion(root, keys, reading)
    _check_objects(keys, root, reading)
    if reading.problems:
        return None
    name, variant = keys["name"] or name, keys["variant"] or variant
    changes = {
        "name": name,
        "variant": variant,
        "motion": _motion(keys["motion"], keys.get("initial_positions", {})),
        "expect": tuple(claim for claim in keys["expect"] if claim.variant in (None, variant)),
        "resolved": {**mapped(root.plain(reading.renamed), _plain), "name": name, "variant": variant, "engine": keys["engine"]},
    }
    attachments = dict(reading.attachments)
    return Scenario(**{**keys, **changes}, path=path, text=text, attachments=attachments, lines=_lines(root, path))


def _plain(data: Any) -> Any:
    """JSON has no infinity: it is written as text, which the reader takes back."""
    if isinstance(data, float) and math.isinf(data):
        return "inf" if data > 0 else "-inf"
    return data


def _lines(root: Node, path: Path | None) -> dict[str, int]:
    found: dict[str, int] = {}

    def walk(node: Node, key: str) -> None:
        items: list[tuple[str, Node, int | None]] = []
        if isinstance(node.value, dict):
            items = [(name, item, node.key_line(name)) for name, item in node.value.items()]
        elif isinstance(node.value, list):
            items = [(str(index), item, item.line) for index, item in enumerate(node.value)]
        for name, item, line in items:
            inner = f"{key}.{name}" if key else name
            if item.file == path and line is not None:
                found[inner] = line
            walk(item, inner)

    walk(root, "")
    return found


def _readable(root: Node) -> dict[str, Any]:
    """What can be read of the times, so that their faults are reported beside the others."""
    quiet = Reading()
    keys: dict[str, Any] = {"step": 1e-3, "duration": 1e-3, "log_every": None}
    for key in SCENARIO.keys:
        if key.argument in keys and isinstance(root.value, dict) and key.name in root.value:
            try:
                keys[key.argument] = key.kind.read(root.value[key.name], (), quiet)
            except Rejected:
                return {}
    return keys


def _node(root: Node, *path: str) -> Node:
    for key in path:
        if not isinstance(root.value, dict) or key not in root.value:
            break
        root = root.value[key]
    return root


def _check_times(root: Node, keys: Mapping[str, Any], reading: Reading) -> int | None:
    if not keys:
        return None
    step, duration, rate = keys["step"], keys["duration"], keys["log_every"]
    count = whole(duration / step)
    if count is None:
        message = f"must be a whole number of steps, but {duration:g} s / {step:g} s = {duration / step:.9g}"
        reading.fault(_node(root, "duration"), ("duration",), message, code="duration", show=False)
    elif count > MAX_STEPS:
        reading.fault(
            _node(root, "duration"), ("duration",), f"makes {count} steps; at most {MAX_STEPS} are possible", code="range"
        )
    if rate is None:
        return 1
    every = whole(1.0 / (step * rate))
    if every is None:
        message = f"must divide the step rate, but {1.0 / step:.9g} Hz / {rate:.9g} Hz = {1.0 / (step * rate):.9g}"
        reading.fault(_node(root, "log_rate"), ("log_rate",), message, code="log-rate", show=False)
    return every


def _check_motion(root: Node, keys: Mapping[str, Any], reading: Reading) -> None:
    if keys["motion"] and not prescribes_motion(keys["engine"]):
        message = f"prescribed motion needs 'engine: bench', but the engine is {keys['engine']}"
        reading.fault(_node(root, "motion"), ("motion",), message, code="motion", show=False)


def _motion(motion: str | Mapping[str, Any], initial: Mapping[str, float]) -> dict[str, Any]:
    if isinstance(motion, str):
        return {}
    start = initial.get("*", 0.0)
    return {
        joint: Constant(value=initial.get(joint, start)) if signal == LOCKED else signal
        for joint, signal in motion.items()
        if not (joint == "*" and signal == LOCKED)
    }


def _check_objects(keys: Mapping[str, Any], root: Node, reading: Reading) -> None:
    names = (*(item.name for item in keys["world"].objects), *((TIP,) if keys["task"] is not None else ()))
    for index, claim in enumerate(keys["expect"]):
        if claim.body is not None and claim.body not in names:
            expect = _node(root, "expect")
            node = expect.value[index] if isinstance(expect.value, list) else expect
            message = f"the world has no object '{claim.body}'"
            reading.fault(node, ("expect", str(index), "body"), message, choices=names, code="unknown-object", show=False)
