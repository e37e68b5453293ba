"""Loads scenarios from files, plain data or keywords: reads the keys, and checks conditions between several keys."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.document.file import read_document
from asrsim.document.kinds import Integer, attempt
from asrsim.document.node import Node, node_from_data
from asrsim.document.reading import DocumentReading
from asrsim.errors import Problem, ScenarioError
from asrsim.plain import mapped, one_or_more
from asrsim.plugins import load_plugin_files
from asrsim.registry.engines import default_engine
from asrsim.renamed import KEYS, new_key, with_new_keys
from asrsim.samples import TIP
from asrsim.scenario.data import SCENARIO, Scenario
from asrsim.scenario.kinds import names_a_folder, prescribes_motion
from asrsim.scenario.overrides import Overrides, apply_overrides

PLUGINS = "plugins/"
"""Prefix of users' plugin files among the attachments of a scenario and of a log."""
DEFAULT = "default"
"""Name of the variant of a scenario without variants."""


def several_variants(loaded: Sequence[Scenario]) -> Problem:
    """Problem of a scenario with several variants, where one variant is needed."""
    names = tuple(one.variant for one in loaded)
    hint = "Choose one with variant=... (--variant), or run all with asrsim.run_variants (asrsim run)"
    return Problem("the scenario has several variants", file=loaded[0].path, choices=names, hint=hint, code="variant")


def load_scenario(
    path: str | Path,
    *,
    variant: str | None = None,
    overrides: Overrides = (),
    robot: str | Path | None = None,
    plugins: Sequence[str | Path] = (),
) -> tuple[Scenario, ...]:
    """All variants of a scenario file in file order, or the chosen variant.

    A file without variants has one variant, `default`. `overrides`, applied after the variant, are `key=value` texts (dotted
    key, YAML value) or a mapping from dotted keys to values; `robot` replaces the file's robot; `plugins` are Python files with
    users' actuators, signals and so on, which are loaded first. Raises ScenarioError with every problem of the file.
    """
    scenarios, problems = read_scenarios(path, variant=variant, overrides=overrides, robot=robot, plugins=plugins)
    if problems:
        raise ScenarioError(problems)
    return scenarios


def read_scenarios(
    scenario: str | Path | Scenario,
    *,
    variant: str | None = None,
    overrides: Overrides = (),
    robot: str | Path | None = None,
    plugins: Sequence[str | Path] = (),
) -> tuple[tuple[Scenario, ...], list[Problem]]:
    """Variants as from `load_scenario`, but without the invalid keys, and all problems of the file. A scenario object counts as
    its only variant; values that code has set are checked like the values of a file. The plugin files become attachments, so
    that the log of a run contains them.

    Raises ScenarioError if the file is not a mapping, or lacks the variant; also if a scenario object comes with overrides,
    another variant or another robot file.
    """
    load_plugin_files(plugins)
    if not isinstance(scenario, Scenario):
        found, problems = _variants(scenario, variant, overrides, robot)
    elif overrides or robot is not None or variant not in (None, scenario.variant):
        message = "overrides, variant and robot file are valid with a scenario file only"
        raise ScenarioError(message, hint="Pass them to asrsim.load_scenario", code="usage")
    else:
        valid, problems = without_invalid(scenario)
        found = (valid,)
    files = {f"{PLUGINS}{number}/{Path(file).name}": Path(file) for number, file in enumerate(one_or_more(plugins))}
    return tuple(replace(one, attachments={**one.attachments, **files}) if files else one for one in found), problems


def _variants(
    path: str | Path, variant: str | None, overrides: Overrides, robot: str | Path | None
) -> tuple[tuple[Scenario, ...], list[Problem]]:
    """Variants of a file, and all its problems."""
    if not isinstance(path, str | Path):
        hint = "load_scenario returns a scenario for each variant: choose one"
        raise ScenarioError("must be a scenario or the path of a scenario", value=type(path).__name__, hint=hint, code="usage")
    path = Path(path)
    if not str(path.absolute()).isprintable() and "\\udc" in ascii(str(path.absolute())):
        message = "the path of the file must be UTF-8"
        raise ScenarioError(message, file=path, hint="Rename it: logs and summaries name the file", code="encoding")
    faults: list[Problem] = []
    root, text = read_document(path, "scenario", error=ScenarioError, faults=faults)
    if not isinstance(root.value, dict):
        message = "is not a scenario: it must be a mapping with the keys robot, duration, references, ..."
        raise ScenarioError([*faults, Problem(message, file=path, line=root.line, code="type")])
    variants, wrong = _split(with_new_keys(root))
    faults += wrong
    if variant is not None and variant not in variants:
        message = f"there is no variant '{variant}'"
        faults.append(Problem(message, file=path, choices=tuple(variants), meant=str(variant), code="unknown-variant"))
        raise ScenarioError(faults)
    found: list[Scenario] = []
    for name, merged in variants.items():
        if variant in (None, name):
            changed = apply_overrides(merged, overrides, robot)
            reading = DocumentReading(base=path.parent)
            found.append(build_scenario(changed, reading, name=path.stem, variant=name, path=path, text=text))
            faults += reading.problems
    return tuple(found), distinct(faults)


def scenario_from_data(
    data: Mapping[str, Any],
    *,
    base_dir: str | Path | None = None,
    files: Mapping[str, Path] | None = None,
    name: str = "scenario",
    variant: str = DEFAULT,
    overrides: Overrides = (),
    robot: str | Path | None = None,
) -> Scenario:
    """Scenario from plain data: the keys of a scenario file without `variants`, as in `Scenario.resolved`.

    Files are found in `files` (name in the data -> path, as in `Scenario.attachments`), or else in `base_dir` (default: the
    working folder). `robot` replaces the robot of the data. Raises ScenarioError with every problem.
    """
    # Accept former names of keys, since the data may come from an old log.
    known = with_new_keys(node_from_data(dict(data)), told=False)
    root = apply_overrides(known, overrides, robot)
    reading = DocumentReading(base=Path(base_dir) if base_dir is not None else Path(), files=files or {})
    scenario = build_scenario(root, reading, name=name, variant=variant)
    if reading.problems:
        raise ScenarioError(distinct(reading.problems))
    return scenario


def make_scenario(robot: str | Path, *, base_dir: str | Path | None = None, **keys: Any) -> Scenario:
    """Scenario from keywords, which are the keys of a scenario file: `make_scenario("arm.urdf", duration=2.0, ...)`.

    Paths are relative to `base_dir` (default: the working folder). Raises ScenarioError with every problem.
    """
    # If a document contains the old and the new name of a key, the old name counts as an unknown key.
    given = {key if KEYS.get(key) in keys else new_key(key): value for key, value in keys.items()}
    return scenario_from_data({"robot": str(robot), **given}, base_dir=base_dir)


def _split(root: Node) -> tuple[dict[str, Node], list[Problem]]:
    """Variants merged with the common keys, and problems of the variants and of the claims about variants."""
    assert isinstance(root.value, dict)
    items = dict(root.value)
    node = items.pop("variants", Node(None))
    common = Node(items, root.line, root.key_lines, root.file)
    problems: list[Problem] = []
    merged: dict[str, Node] = {}

    def fault(message: str, at: Node, key: str, choices: tuple[str, ...] = ()) -> None:
        problems.append(Problem(message, file=at.file, line=at.line, key=key, choices=choices, code="variants"))

    if not isinstance(node.value, dict) or not node.value:
        if node.value is not None:
            fault("must be a mapping from names to the keys that differ", node, "variants")
        only = items.get("variant")
        merged[str(only.value) if only is not None and only.value is not None else DEFAULT] = common
    elif "variant" in items:
        fault("is not allowed in a file with the key 'variants'", items["variant"], "variant")
    for name, changes in node.value.items() if isinstance(node.value, dict) else ():
        keys = dict(changes.value) if isinstance(changes.value, dict) else {}
        for key in ("variants", "variant", "name"):
            if key in keys:
                fault("is not allowed in a variant", keys.pop(key), f"variants.{name}.{key}")
        if not names_a_folder(name):
            fault("must be valid as the name of a folder", changes, f"variants.{name}")
        if changes.value is not None and not isinstance(changes.value, dict):
            fault("must be a mapping of the keys that differ", changes, f"variants.{name}")
        merged[name] = SCENARIO.merge(common, replace(changes, value=keys)) if keys else common
    claims = items.get("expect")
    for index, claim in enumerate(claims.value if claims is not None and isinstance(claims.value, list) else ()):
        named = claim.value.get("variant") if isinstance(claim.value, dict) else None
        if named is not None and named.value is not None and str(named.value) not in merged:
            fault(f"there is no variant '{named.value}'", named, f"expect.{index}.variant", tuple(merged))
    return merged, problems


def distinct(problems: Iterable[Problem]) -> list[Problem]:
    """Problems without repetitions, as variants share most problems."""
    return list({str(problem): problem for problem in problems}.values())


# -- building ----------------------------------------------------------------------------------------------------------

MAX_STEPS = 10**10
"""Largest number of steps in a run, counting substeps. With steps of 1 ms, this is 115 days."""
PLAIN_FIELDS = (
    "base_position", "base_rpy", "fixed_base", "gravity", "duration", "step", "log_every", "log_layout", "tf_rate", "seed",
    "engine", "stepping", "substeps", "motor_substeps", "max_substeps", "compiled", "velocity_cutoff",
)  # fmt: skip
"""Fields of the scenario with the values of the file's keys, unchanged: numbers, vectors and choices."""
_ROUNDING = 1e-9
"""Largest relative error of a ratio that counts as a whole number, since decimal numbers are rounded."""


def whole(ratio: float) -> int | None:
    """Whole number that equals the ratio up to rounding; None if the ratio is not a whole number."""
    nearest = round(ratio) if math.isfinite(ratio) else 0
    return nearest if nearest >= 1 and abs(ratio - nearest) <= _ROUNDING * nearest else None


def build_scenario(
    root: Node, reading: DocumentReading, *, name: str, variant: str, path: Path | None = None, text: str = ""
) -> Scenario:
    """Scenario built from a mapping. If `reading` has problems, the scenario lacks the invalid keys, listed in `unread`.
    A required key without a default is then None."""
    # Without its required keys, a scenario is still built, so that the check of its other keys can go on.
    required = {one.name: None for one in fields(Scenario) if one.default is MISSING and one.default_factory is MISSING}
    keys = {**required, "robot": Path(), "duration": 1.0, **SCENARIO.read(root, (), reading)}
    stated = keys["engine"] is not None
    keys["engine"] = keys["engine"] or default_engine()
    wrong = list(contradictions(keys, {key for key, *_ in reading.unread}))
    keys["log_every"] = whole(1.0 / (keys["step"] * keys["log_every"])) or 1 if keys["log_every"] else 1
    name, variant = keys["name"] or name, keys["variant"] or variant
    lines = dict(root.lines(path))
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
    scenario = Scenario(
        **{**keys, **changes},
        path=path,
        text=text,
        attachments=dict(reading.attachments),
        unread=tuple(reading.unread),
        named=tuple(reading.named),
        lines=lines,
        states_engine=stated,
    )
    reading.problems += map(scenario.placed, wrong)
    return replace(scenario, as_read=scenario)


def without_invalid(scenario: Scenario) -> tuple[Scenario, list[Problem]]:
    """The scenario without the invalid values that code has set by `dataclasses.replace`, and the problems of these values.
    Values that code has not changed were checked when the file was read.
    """
    reading, before, kept = DocumentReading(), scenario.as_read, dict[str, Any]()
    for field in fields(Scenario):
        value = getattr(scenario, field.name)
        if field.name in PLAIN_FIELDS and (before is None or value is not getattr(before, field.name)):
            key = field.metadata["key"]
            kind = Integer(minimum=1) if field.name == "log_every" else key.kind
            if attempt(kind, node_from_data(value), (key.name or field.name,), reading) is None:
                default = 1.0 if key.required else key.default
                kept[field.name] = default if before is None else getattr(before, field.name)
    parameters = {joint: dict(own) for joint, own in scenario.parameters.items()}
    for joint, own in scenario.parameters.items():
        for name, value in own.items():
            if not isinstance(value, int | float | np.number):
                reading.problems.append(Problem("must be a number", key=f"parameters.{joint}.{name}", value=value, code="type"))
                reading.unread.append(("parameters", joint, name))
                del parameters[joint][name]
    problems = reading.problems
    if reading.unread:
        scenario = replace(scenario, **kept, parameters=parameters, unread=(*scenario.unread, *reading.unread))
    problems += contradictions({**vars(scenario), "log_every": None}, {key for key, *_ in scenario.unread})
    return scenario, list(map(scenario.placed, problems))


def _plain(data: Any) -> Any:
    """Plain data for JSON, in which infinity becomes text; the reader accepts this text as a number."""
    if isinstance(data, float) and math.isinf(data):
        return "inf" if data > 0 else "-inf"
    return data


def contradictions(keys: Mapping[str, Any], unread: Collection[str] = ()) -> Iterator[Problem]:
    """Errors about conditions between several keys. unread: invalid keys, on which no check may depend."""
    for needed, check in CROSS_CHECKS:
        if not set(needed).intersection(unread):
            yield from check(keys)


def _check_times(keys: Mapping[str, Any]) -> Iterator[Problem]:
    step, duration, rate = keys["step"], keys["duration"], keys["log_every"]
    count = whole(duration / step)
    if count is None:
        message = f"must be a whole number of steps, but {duration:g} s / {step:g} s = {duration / step:.9g}"
        yield Problem(message, key="duration", code="duration")
    else:
        substeps = count * (keys["substeps"] or 1) * (keys["motor_substeps"] or 1)
        if substeps > MAX_STEPS:
            message = f"makes {float(substeps):.6g} steps, counting substeps; at most {MAX_STEPS:g} are possible"
            yield Problem(message, key="duration", value=duration, code="range")
    if rate is not None and whole(1.0 / (step * rate)) is None:
        message = f"must divide the step rate, but {1.0 / step:.9g} Hz / {rate:.9g} Hz = {1.0 / (step * rate):.9g}"
        yield Problem(message, key="log_rate", code="log-rate")


def _check_motion(keys: Mapping[str, Any]) -> Iterator[Problem]:
    if keys["motion"] and not prescribes_motion(keys["engine"]):
        message = f"prescribed motion needs 'engine: bench', but the engine is {keys['engine']}"
        yield Problem(message, key="motion", code="motion")


def _check_objects(keys: Mapping[str, Any]) -> Iterator[Problem]:
    names = (*(item.name for item in keys["world"].objects), *((TIP,) if keys["task"] is not None else ()))
    for index, claim in enumerate(keys["expect"]):
        if claim.body is not None and claim.body not in names:
            message = f"the world has no object '{claim.body}'"
            yield Problem(message, key=f"expect.{index}.body", choices=names, code="unknown-object")


CROSS_CHECKS: tuple[tuple[tuple[str, ...], Callable[[Mapping[str, Any]], Iterator[Problem]]], ...] = (
    (("step", "duration", "log_rate"), _check_times),
    (("engine", "motion"), _check_motion),
    (("world", "task", "expect"), _check_objects),
)
"""Pairs (keys, check of a condition between these keys). A check is skipped if one of its keys is invalid."""
