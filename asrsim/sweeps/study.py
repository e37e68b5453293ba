"""A study as plain data: its scenario, its varied keys and how their values are drawn. The index of a run determines the values
of the keys in this run.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.document.block import block_of, declare
from asrsim.document.file import kind_of, read_document, read_file
from asrsim.document.kinds import Entry, File, Integer, ListOf, MapOf, Text
from asrsim.document.node import Node
from asrsim.document.reading import DocumentReading, KeyPath
from asrsim.errors import InputError, Problem
from asrsim.plain import one_or_more
from asrsim.plugins import check_named, load_plugin_files, plugin_fault
from asrsim.registry import result_fault
from asrsim.renamed import STUDY_KEYS, new_key, renamed
from asrsim.samples import Array
from asrsim.scenario.kinds import AnyData
from asrsim.scenario.overrides import override_texts
from asrsim.sweeps.fitted import JointDistribution, joint_of, load_fit
from asrsim.sweeps.laws import FORMS, Distribution, Values, law_of
from asrsim.sweeps.samplers import SAMPLERS, block_fault

SAMPLES = 100
"""Default number of draws of a study with distributions."""
MOST_RUNS = 100_000_000


@dataclass(frozen=True)
class Axis:
    """Keys that vary together, and their values."""

    keys: tuple[str, ...]
    """Dotted keys. All keys get the same value; if a value is a list with one entry per key, each key gets its own entry."""
    law: Values | Distribution

    def assign(self, value: Any) -> dict[str, Any]:
        """Value by key of this axis, from one value of the axis."""
        if len(self.keys) > 1 and isinstance(value, list | tuple) and len(value) == len(self.keys):
            return dict(zip(self.keys, value, strict=True))
        return dict.fromkeys(self.keys, value)


def axis_of(name: str, value: Any) -> Axis:
    """Axis with the name `key`, or `key & key` for tied keys; value: as for `law_of`. Raises InputError."""
    return Axis(tuple(part.strip() for part in name.split("&")), law_of(value, name))


def present_name(name: str) -> str:
    """Name of an axis in which earlier names of keys are replaced by their present names, with a warning for each."""
    return " & ".join(new_key(part.strip()) for part in name.split("&"))


class _Law(AnyData):
    """Kind of value of a document: the values of a varied key; see `asrsim.sweeps.laws`."""

    text = ", ".join(f"`{form}`" for form in FORMS)

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> Any:
        try:
            law_of(node.plain(), path[-1])
        except InputError as error:
            problem = error.problems[0]
            raise reading.fault(node, path, problem.message, choices=problem.choices, hint=problem.hint) from None
        return node.plain()


@dataclass(frozen=True, kw_only=True)
class Study:
    """Study; its fields are the keys of a study file."""

    scenario: Path = declare(File(noun="scenario"), doc="scenario file that is varied")
    over: Mapping[str, Any] = declare(
        MapOf(of=_Law(), noun="key", star=False), default={}, doc="key (`a & b`: tied) -> its values"
    )
    variants: tuple[str, ...] = declare(ListOf(of=Text()), default=(), shown="all", doc="variants of the scenario")
    overrides: Mapping[str, Any] | Sequence[str] = declare(
        MapOf(of=AnyData(), noun="key", star=False), key="set", default={}, doc="keys that are the same in every run"
    )
    sampler: str = declare(Entry(SAMPLERS), default="random", doc="sampler that places the draws")
    samples: int | None = declare(Integer(minimum=1), default=None, shown=str(SAMPLES), doc="number of draws")
    seed: int = declare(Integer(minimum=0), default=0, doc="seed of the draws")
    fit: Any = declare(
        File(noun="fit"),
        default=None,
        doc="JSON or YAML with `keys`, `mean` and `covariance` (and `logarithmic`, `bounds`, `ties`) of a joint normal "
        "distribution",
    )
    plugins: tuple[Path, ...] = declare(
        ListOf(of=File(noun="plugin")),
        default=(),
        doc="files with your own actuators, samplers and so on; a file runs only if --plugin also names it",
    )
    name: str = "sweep"

    @cached_property
    def axes(self) -> tuple[Axis, ...]:
        """Axes of the varied keys in `over`."""
        return tuple(axis_of(name, value) for name, value in self.over.items())

    @cached_property
    def joint(self) -> JointDistribution | None:
        """Joint distribution of the keys in the result of the fit; None for a study without a fit."""
        return None if self.fit is None else joint_of(self.fit)

    @cached_property
    def listed(self) -> tuple[tuple[Axis, Values], ...]:
        """Axes with listed values; all combinations of these values form the grid."""
        return tuple((axis, axis.law) for axis in self.axes if isinstance(axis.law, Values))

    @cached_property
    def drawn(self) -> tuple[tuple[Axis, Distribution], ...]:
        """Axes with distributions in `over`; the keys of the fit are not included."""
        return tuple((axis, axis.law) for axis in self.axes if isinstance(axis.law, Distribution))

    @cached_property
    def groups(self) -> tuple[tuple[str, ...], ...]:
        """Groups of drawn keys. One number of a draw determines the values of all keys of a group."""
        return (*(axis.keys for axis, _ in self.drawn), *(self.joint.groups if self.joint else ()))

    @cached_property
    def base_samples(self) -> int:
        """Number of samples that the sampler uses for the number `samples` that the user wants."""
        return SAMPLERS.get(self.sampler).samples(self.samples or SAMPLES)

    @cached_property
    def draws(self) -> int:
        """Number of draws, which are the same at every point of the grid."""
        return SAMPLERS.get(self.sampler).draws(self.base_samples, len(self.groups)) if self.groups else 1

    @cached_property
    def grid(self) -> tuple[int, ...]:
        """Number of values on each axis of the grid."""
        return tuple(len(law) for _, law in self.listed)

    def __len__(self) -> int:
        return max(1, len(self.variants)) * math.prod(self.grid) * self.draws

    @cached_property
    def keys(self) -> tuple[str, ...]:
        """Every key that varies, in the order of the columns."""
        groups = [axis.keys for axis in self.axes] + list(self.joint.groups if self.joint else ())
        return tuple(dict.fromkeys(key for group in groups for key in group))

    def point(self, run: int) -> tuple[str, dict[str, Any]]:
        """Variant of a run, and its values by varied key. Runs are counted from 0: all draws at one point of the grid precede
        the draws at the next point, and all runs of a variant precede the runs of the next variant.
        """
        variant, rest = divmod(run, math.prod(self.grid) * self.draws)
        cell, draw = divmod(rest, self.draws)
        values: dict[str, Any] = {}
        for (axis, law), index in zip(self.listed, np.unravel_index(cell, self.grid) if self.grid else (), strict=True):
            values |= axis.assign(law.values[int(index)])
        if self.groups:
            row = self.table[draw]
            for (axis, _), number in zip(self.drawn, row, strict=False):
                values |= axis.assign(float(number))
            if self.joint:
                values |= self.joint.assign(row[len(self.drawn) :])
        return self.variants[variant] if self.variants else "", {key: values[key] for key in self.keys}

    @cached_property
    def table(self) -> Array:
        """Values of all draws (draws, groups), one column for each group of keys."""
        from scipy.special import ndtri

        unit = self._unit_points()
        # Clip the points, since the first point of a sequence may be 0, at which the quantile of a normal distribution is
        # infinite.
        unit = np.clip(unit, 0.5**53, 1.0 - 0.5**53)
        columns = [law.quantile(column) for (_, law), column in zip(self.drawn, unit.T, strict=False)]
        if self.joint:
            columns += list(self.joint.from_scores(ndtri(unit[:, len(columns) :])).T)
        return np.column_stack(columns)

    def _unit_points(self) -> Array:
        """Points (draws, groups) of the sampler, from 0 to 1. Raises InputError if a user's sampler does not return such
        points."""
        shape = (self.draws, len(self.groups))
        function = SAMPLERS.get(self.sampler).points
        needed = f"the sampler '{self.sampler}' must return an array of numbers from 0 to 1 of shape {shape}"
        try:
            points, again = (
                np.asarray(function(self.base_samples, shape[1], self.seed), dtype=np.float64).copy() for _ in range(2)
            )
        except (TypeError, ValueError) as error:
            if fault := plugin_fault(error):
                raise fault from error
            raise result_fault(function, f"{needed}: {error}") from None
        if points.shape != shape:
            raise result_fault(function, f"{needed}; its shape is {points.shape}")
        outside = points[~((points >= 0.0) & (points <= 1.0))]
        if outside.size:
            raise result_fault(function, f"{needed}; {outside.size} of them lie outside, such as {outside[0]:g}")
        if not np.array_equal(points, again):
            raise result_fault(function, f"the sampler '{self.sampler}' must return the same points for the same seed")
        if SAMPLERS.get(self.sampler).blocks and (wrong := block_fault(points, self.base_samples)):
            raise result_fault(function, f"the sampler '{self.sampler}' states `blocks = True`: {wrong}")
        return points


STUDY = block_of(Study, "study")


def is_study(path: Path) -> bool:
    """Whether a file is a study file, and not a scenario file."""
    return kind_of(path) == "study"


def read_study(path: Path, plugins: Sequence[Path | str] = ()) -> Study:
    """Study from a file; plugins: plugin files that may run. Raises InputError with every problem."""
    load_plugin_files(plugins)
    found = read_file(STUDY, path, renamed=STUDY_KEYS)
    check_named(found.plugins, plugins, file=path)
    try:
        given = {field.name: getattr(found, field.name) for field in fields(found)}
        return make_study(**{**given, "plugins": plugins or found.plugins, "name": path.stem})
    except InputError as error:
        raise InputError([replace(problem, file=problem.file or path) for problem in error.problems]) from None


@renamed(design="sampler")
def make_study(
    scenario: str | Path,
    over: Mapping[str, Any] | Sequence[str] = (),
    *,
    fit: str | Path | Mapping[str, Any] | None = None,
    plugins: Sequence[str | Path] = (),
    name: str | None = None,
    **options: Any,
) -> Study:
    """Study from plain data. Raises InputError with every problem.

    Args:
        scenario: Scenario file.
        over: Values by dotted key: a list, a text such as `10:200:20`, or a distribution; or a list of texts `key=values`.
        fit: Result of a fit, as file or data with `keys`, `mean` and `covariance`; these keys are drawn jointly.
        plugins: Python files with the user's actuators, samplers and so on, which are loaded first.
        options: variants, overrides, sampler, samples, seed: as in `Study`.
    """
    read_document(Path(scenario), "scenario")
    load_plugin_files(plugins)
    given = over.items() if isinstance(over, Mapping) else map(_split, one_or_more(over))
    pairs = [(present_name(key), value) for key, value in given]
    data = load_fit(Path(fit)) if isinstance(fit, str | Path) else json.loads(json.dumps(fit, default=np.ndarray.tolist))
    try:
        study = Study(
            scenario=Path(scenario),
            over=dict(pairs),
            fit=data,
            plugins=tuple(Path(path) for path in one_or_more(plugins)),
            name=name or Path(scenario).stem,
            **{
                **options,
                "variants": one_or_more(options.get("variants", ())),
                "overrides": override_texts(options.get("overrides", ())),
            },
        )
    except TypeError as error:
        raise InputError(f"unknown option of a study: {error}", code="usage") from None
    _check(study, pairs, None if isinstance(fit, Mapping) or fit is None else Path(fit))
    return study


def _check(study: Study, pairs: Sequence[tuple[str, Any]], fit: Path | None) -> None:
    """Raise InputError with every problem of a study."""
    problems: list[Problem] = []
    for name, value in pairs:
        try:
            axis_of(name, value)
        except InputError as error:
            problems += error.problems
    try:
        joint = None if study.fit is None else joint_of(study.fit, fit)
    except InputError as error:
        problems += error.problems
    if problems:
        raise InputError(problems)
    drawn = bool(study.drawn or joint)
    groups = [*(axis_of(*pair).keys for pair in pairs), *(joint.groups if joint else ())]
    keys = [key for group in groups for key in group]
    problems += [Problem("is varied twice", key=key, code="sweep-twice") for key in study.keys if keys.count(key) > 1]
    if not keys:
        hint = "Add --over KEY=VALUES, or `over:` in a study file"
        problems.append(Problem("no key is varied", key="over", hint=hint, code="sweep-empty"))
    if study.samples is not None and not (drawn and 1 <= study.samples <= MOST_RUNS):
        message = f"must be 1 to {MOST_RUNS}" if drawn else "is given, but no key has a distribution"
        problems.append(Problem(message, key="samples", value=study.samples, code="sweep-samples"))
    if study.sampler not in SAMPLERS:
        problems.append(replace(SAMPLERS.unknown(study.sampler), key="sampler"))
    elif SAMPLERS.get(study.sampler).blocks and (joint or study.listed):
        message = f"Sobol indices need independent draws: the sampler {study.sampler} allows neither a fit nor listed values"
        problems.append(Problem(message, key="sampler", code="sweep-correlation"))
    if problems:
        raise InputError(problems)
    if len(study) > MOST_RUNS:
        raise InputError(f"the study has {len(study)} runs; at most {MOST_RUNS} are possible", code="range")


def _split(text: str) -> tuple[str, str]:
    key, equals, value = text.partition("=")
    if not equals or not key.strip() or not value.strip():
        hint = "Write KEY=VALUES, such as references.joint_1.stiffness_preset=[0.2, 0.6]"
        raise InputError("is not of the form KEY=VALUES", key="over", value=text, hint=hint, code="override")
    return key.strip(), value.strip()
