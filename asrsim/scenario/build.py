"""Builds a `Scenario` from the nodes of one variant: reads the keys, and checks conditions between several keys."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from asrsim.document.node import Node
from asrsim.document.reading import DocumentReading
from asrsim.plain import mapped
from asrsim.samples import TIP
from asrsim.scenario.data import SCENARIO, Scenario
from asrsim.scenario.kinds import default_engine, prescribes_motion

MAX_STEPS = 10**10
"""Largest number of steps in a run, with its substeps: 115 days at 1 ms."""
_ROUNDING = 1e-9
"""Largest relative error of a ratio that counts as a whole number, as decimal numbers are rounded."""


def whole(ratio: float) -> int | None:
    """Whole number that equals the ratio up to rounding; None if the ratio is not a whole number."""
    nearest = round(ratio) if math.isfinite(ratio) else 0
    return nearest if nearest >= 1 and abs(ratio - nearest) <= _ROUNDING * nearest else None


def build_scenario(
    root: Node, reading: DocumentReading, *, name: str, variant: str, path: Path | None = None, text: str = ""
) -> Scenario:
    """Scenario built from a mapping. If `reading` has problems, the scenario lacks the invalid keys, listed in `unread`."""
    keys = {"robot": Path(), "duration": 1.0, **SCENARIO.read(root, (), reading)}
    keys["engine"] = keys["engine"] or default_engine()
    unread = {key for key, *_ in reading.unread}
    for needed, check in CROSS_CHECKS:
        if not unread.intersection(needed):
            check(root, keys, reading)
    keys["log_every"] = whole(1.0 / (keys["step"] * keys["log_every"])) or 1 if keys["log_every"] else 1
    name, variant = keys["name"] or name, keys["variant"] or variant
    lines = dict(_lines(root, path))
    changes = {
        "name": name,
        "variant": variant,
        "expect": tuple(
            replace(claim, line=lines.get(f"expect.{index}"))
            for index, claim in enumerate(keys["expect"])
            if claim.variant in (None, variant) and claim.engine in (None, keys["engine"])
        ),
        "resolved": {**mapped(root.plain(reading.renamed), _plain), "name": name, "variant": variant, "engine": keys["engine"]},
    }
    return Scenario(
        **{**keys, **changes}, path=path, text=text, attachments=dict(reading.attachments), unread=tuple(reading.unread),
        lines=lines,
    )  # fmt: skip


def _plain(data: Any) -> Any:
    """Plain data for JSON, in which infinity becomes text; the reader accepts this text as a number."""
    if isinstance(data, float) and math.isinf(data):
        return "inf" if data > 0 else "-inf"
    return data


def _lines(node: Node, path: Path | None, key: str = "") -> Iterator[tuple[str, int]]:
    """Pairs (dotted key, line) for all values in the file."""
    for name, item in node.items():
        line = node.key_line(name) if isinstance(node.value, dict) else item.line
        if item.file == path and line is not None:
            yield f"{key}{name}", line
        yield from _lines(item, path, f"{key}{name}.")


def _fault(root: Node, reading: DocumentReading, key: str, message: str, *, code: str, show: bool = False) -> None:
    """Add an error about a key of the scenario."""
    node = root.value.get(key, root) if isinstance(root.value, dict) else root
    reading.fault(node, (key,), message, code=code, show=show)


def _check_times(root: Node, keys: Mapping[str, Any], reading: DocumentReading) -> None:
    step, duration, rate = keys["step"], keys["duration"], keys["log_every"]
    count = whole(duration / step)
    if count is None:
        message = f"must be a whole number of steps, but {duration:g} s / {step:g} s = {duration / step:.9g}"
        _fault(root, reading, "duration", message, code="duration")
    else:
        substeps = count * (keys["substeps"] or 1) * (keys["motor_substeps"] or 1)
        if substeps > MAX_STEPS:
            message = f"makes {float(substeps):.6g} steps, counting substeps; at most {MAX_STEPS:g} are possible"
            _fault(root, reading, "duration", message, code="range", show=True)
    if rate is not None and whole(1.0 / (step * rate)) is None:
        message = f"must divide the step rate, but {1.0 / step:.9g} Hz / {rate:.9g} Hz = {1.0 / (step * rate):.9g}"
        _fault(root, reading, "log_rate", message, code="log-rate")


def _check_motion(root: Node, keys: Mapping[str, Any], reading: DocumentReading) -> None:
    if keys["motion"] and not prescribes_motion(keys["engine"]):
        message = f"prescribed motion needs 'engine: bench', but the engine is {keys['engine']}"
        _fault(root, reading, "motion", message, code="motion")


def _check_objects(root: Node, keys: Mapping[str, Any], reading: DocumentReading) -> None:
    names = (*(item.name for item in keys["world"].objects), *((TIP,) if keys["task"] is not None else ()))
    for index, claim in enumerate(keys["expect"]):
        if claim.body is not None and claim.body not in names:
            expect = root.value.get("expect", root) if isinstance(root.value, dict) else root
            node = expect.value[index] if isinstance(expect.value, list) else expect
            message = f"the world has no object '{claim.body}'"
            reading.fault(node, ("expect", str(index), "body"), message, choices=names, code="unknown-object", show=False)


CROSS_CHECKS: tuple[tuple[tuple[str, ...], Callable[[Node, Mapping[str, Any], DocumentReading], None]], ...] = (
    (("step", "duration", "log_rate"), _check_times),
    (("engine", "motion"), _check_motion),
    (("world", "task", "expect"), _check_objects),
)
"""Pairs (keys, check of a condition between these keys). A check is skipped if one of its keys is invalid."""
