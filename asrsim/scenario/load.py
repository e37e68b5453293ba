"""Loads scenarios from files, plain data or keywords."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from asrsim.document.file import read_document
from asrsim.document.node import Node, node_from_data
from asrsim.document.reading import DocumentReading
from asrsim.errors import Problem, ScenarioError
from asrsim.scenario.build import build_scenario
from asrsim.scenario.data import SCENARIO, Scenario
from asrsim.scenario.kinds import names_a_folder
from asrsim.scenario.overrides import Overrides, apply_overrides

DEFAULT = "default"
"""Name of the variant of a scenario without variants."""


def only_variant(loaded: Sequence[Scenario]) -> Scenario:
    """The single variant of a scenario. Raises ScenarioError if there are several."""
    if len(loaded) != 1:
        names = tuple(one.variant for one in loaded)
        hint = "Choose one with variant=... (--variant), or run all with asrsim.run_variants (asrsim run)"
        message = "the scenario has several variants"
        raise ScenarioError(message, file=loaded[0].path, choices=names, hint=hint, code="variant")
    return loaded[0]


def load_scenario(
    path: str | Path, *, variant: str | None = None, overrides: Overrides = (), robot: str | Path | None = None
) -> tuple[Scenario, ...]:
    """All variants of a scenario file in file order, or the chosen variant.

    A file without variants has one variant, `default`. `overrides`, applied after the variant, are `key=value` texts (dotted
    key, YAML value) or a mapping from dotted keys to values; `robot` replaces the file's robot. Raises ScenarioError with
    every problem of the file.
    """
    scenarios, problems = read_scenarios(path, variant=variant, overrides=overrides, robot=robot)
    if problems:
        raise ScenarioError(problems)
    return scenarios


def read_scenarios(
    path: str | Path, *, variant: str | None = None, overrides: Overrides = (), robot: str | Path | None = None
) -> tuple[tuple[Scenario, ...], list[Problem]]:
    """Variants as from `load_scenario`, but without the invalid keys, and all problems of the file.

    Raises ScenarioError where the file is not a mapping, or lacks the variant.
    """
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
        message = "is no scenario: it must be a mapping with the keys robot, duration, references, ..."
        raise ScenarioError([*faults, Problem(message, file=path, line=root.line, code="type")])
    variants, wrong = _split(root)
    faults += wrong
    if variant is not None and variant not in variants:
        message = f"there is no variant '{variant}'"
        faults.append(Problem(message, file=path, choices=tuple(variants), meant=str(variant), code="unknown-variant"))
        raise ScenarioError(faults)
    found: list[Scenario] = []
    for name, merged in variants.items():
        if variant in (None, name):
            changed = _with_robot(apply_overrides(merged, overrides), robot)
            reading = DocumentReading(base=path.parent)
            found.append(build_scenario(changed, reading, name=path.stem, variant=name, path=path, text=text))
            faults += reading.problems
    return tuple(found), distinct(faults)


def _with_robot(root: Node, robot: str | Path | None) -> Node:
    """Document whose robot is replaced by this file, if one is given."""
    return root if robot is None else apply_overrides(root, {"robot": str(Path(robot).absolute())})


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
    root = _with_robot(apply_overrides(node_from_data(dict(data)), overrides), robot)
    reading = DocumentReading(base=Path(base_dir) if base_dir is not None else Path(), files=files or {})
    scenario = build_scenario(root, reading, name=name, variant=variant)
    if reading.problems:
        raise ScenarioError(distinct(reading.problems))
    return scenario


def make_scenario(robot: str | Path, *, base_dir: str | Path | None = None, **keys: Any) -> Scenario:
    """Scenario from keywords, which are the keys of a scenario file: `make_scenario("arm.urdf", duration=2.0, ...)`.

    Paths are relative to `base_dir` (default: the working folder). Raises ScenarioError with every problem.
    """
    return scenario_from_data({"robot": str(robot), **keys}, base_dir=base_dir)


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
        keys = changes.value if isinstance(changes.value, dict) else {}
        for key in ("variants", "variant", "name"):
            if key in keys:
                fault("is not allowed in a variant", keys[key], f"variants.{name}.{key}")
        if not names_a_folder(name):
            fault("must be valid as the name of a folder", changes, f"variants.{name}")
        if changes.value is not None and not isinstance(changes.value, dict):
            fault("must be a mapping of the keys that differ", changes, f"variants.{name}")
        merged[name] = SCENARIO.merge(common, changes) if keys else common
    claims = items.get("expect")
    for index, claim in enumerate(claims.value if claims is not None and isinstance(claims.value, list) else ()):
        named = claim.value.get("variant") if isinstance(claim.value, dict) else None
        if named is not None and named.value is not None and str(named.value) not in merged:
            fault(f"there is no variant '{named.value}'", named, f"expect.{index}.variant", tuple(merged))
    return merged, problems


def distinct(problems: Iterable[Problem]) -> list[Problem]:
    """Problems without repetitions, as variants share most problems."""
    return list({str(problem): problem for problem in problems}.values())
