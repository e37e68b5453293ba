"""From one variant's nodes to a :class:`Scenario`: keys read, and what several keys must agree on."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from asrsim.document.node import Node
from asrsim.document.reading import Reading, Rejected
from asrsim.errors import InputError
from asrsim.scenario.data import Scenario
from asrsim.scenario.keys import LOCKED, SCENARIO
from asrsim.scenario.manager import Manager, read_manager
from asrsim.scenario.task_keys import INVERSE_DYNAMICS
from asrsim.signals.constant import Constant

MAX_STEPS = 10**10
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
    log_every = _check_times(root, keys, reading)
    manager = _manager(keys["manager"], reading)
    _check_motion(root, keys, reading)
    _check_objects(keys, root, reading)
    variant = keys["variant"] or variant
    expect = tuple(claim for claim in keys["expect"] if claim.variant in (None, variant))
    if reading.problems or log_every is None:
        return None
    robot = keys["robot"] if isinstance(keys["robot"], dict) else {"file": keys["robot"], "arguments": {}, "packages": {}}
    modes = keys["modes"] if isinstance(keys["modes"], dict) else {"*": keys["modes"]}
    name = keys["name"] or name
    return Scenario(
        name=name,
        robot=robot["file"],
        path=path,
        text=text,
        variant=variant,
        xacro_arguments=robot["arguments"],
        package_paths=robot["packages"],
        base_position=keys["base"]["position"],
        base_rpy=keys["base"]["rpy"],
        fixed_base=keys["base"]["fixed"],
        gravity=keys["gravity"],
        initial_positions=keys["initial"],
        duration=keys["duration"],
        step=keys["step"],
        log_every=log_every,
        seed=keys["seed"],
        stepping=keys["stepping"],
        substeps=keys["substeps"],
        motor_substeps=keys["motor_substeps"],
        substep_cap=keys["substep_cap"],
        engine=keys["engine"],
        motion=_motion(keys["motion"], keys["initial"]),
        compiled=keys["compiled"],
        modes=modes,
        parameters=keys["parameters"],
        joint_order=manager.joints,
        namespace=manager.namespace,
        references={
            joint: {name: signal for name, signal in items.items() if name != INVERSE_DYNAMICS}
            for joint, items in keys["references"].items()
        },
        inverse_dynamics={
            joint: items[INVERSE_DYNAMICS] for joint, items in keys["references"].items() if INVERSE_DYNAMICS in items
        },
        external_torques=keys["external_torques"],
        wrenches=keys["wrenches"],
        command_effects=keys["effects"]["commands"],
        sensor_effects=keys["effects"]["sensors"],
        link_damping=keys["link_damping"],
        world=keys["world"],
        task=keys["task"],
        expect=expect,
        learning=keys["ilc"] or {},
        attachments=dict(reading.attachments),
        resolved={**_plain(root.plain(reading.renamed)), "name": name, "variant": variant},
        lines=_lines(root, path),
    )


def _plain(data: Any) -> Any:
    """JSON has no infinity: it is written as text, which the reader takes back."""
    if isinstance(data, dict):
        return {key: _plain(value) for key, value in data.items()}
    if isinstance(data, list):
        return [_plain(value) for value in data]
    if isinstance(data, float) and math.isinf(data):
        return "inf" if data > 0 else "-inf"
    return data


def _lines(root: Node, path: Path | None) -> dict[str, int]:
    found: dict[str, int] = {}

    def walk(node: Node, key: str) -> None:
        items: Mapping[str, Node] = {}
        if isinstance(node.value, dict):
            items = node.value
        elif isinstance(node.value, list):
            items = {str(index): item for index, item in enumerate(node.value)}
        for name, item in items.items():
            inner = f"{key}.{name}" if key else name
            if item.file == path and item.line is not None:
                line = node.key_line(name) if isinstance(node.value, dict) else item.line
                found[inner] = line if line is not None else item.line
            walk(item, inner)

    walk(root, "")
    return found


def _readable(root: Node) -> dict[str, Any]:
    """What can be read of the times, so that their faults are told beside the others."""
    quiet = Reading()
    keys: dict[str, Any] = {"step": 1e-3, "duration": 1e-3, "log_rate": None}
    for key in SCENARIO.keys:
        if key.name in keys and isinstance(root.value, dict) and key.name in root.value:
            try:
                keys[key.name] = key.kind.read(root.value[key.name], (), quiet)
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
    step, duration, rate = keys["step"], keys["duration"], keys["log_rate"]
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


def _manager(path: Path | None, reading: Reading) -> Manager:
    if path is None:
        return Manager(joints=(), namespace=None)
    try:
        manager = read_manager(path)
    except InputError as error:
        reading.problems.extend(error.problems)
        return Manager(joints=(), namespace=None)
    reading.warnings.extend(manager.warnings)
    return manager


def _check_motion(root: Node, keys: Mapping[str, Any], reading: Reading) -> None:
    if keys["motion"] and keys["engine"] != "bench":
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
    names = tuple(item.name for item in keys["world"].objects)
    for index, claim in enumerate(keys["expect"]):
        if claim.body is not None and claim.body not in names:
            expect = _node(root, "expect")
            node = expect.value[index] if isinstance(expect.value, list) else expect
            message = f"the world has no object '{claim.body}'"
            reading.fault(node, ("expect", str(index), "body"), message, choices=names, code="unknown-object", show=False)
