"""Studies from files, from `--over` texts, and from Python."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from asrsim.actuators.user import check_named
from asrsim.document.block import block_of, declare
from asrsim.document.composite import ListOf, MapOf
from asrsim.document.file import read_document, read_file
from asrsim.document.kinds import Choice, File, Integer, Kind, Number, Optional, Schema, Text
from asrsim.document.mistaken import kind_of
from asrsim.document.node import Node
from asrsim.document.reading import KeyPath, Reading
from asrsim.errors import InputError, Problem
from asrsim.plain import one_or_more
from asrsim.scenario.claim_keys import AnyData
from asrsim.scenario.overrides import override_texts
from asrsim.sweeps.fitted import Joint, read_fit
from asrsim.sweeps.laws import FORMS, Distribution, law_of
from asrsim.sweeps.study import DESIGNS, MOST_RUNS, Axis, Study, axis_of

SAMPLES = 100
"""Draws where a study with distributions names no number."""


class AnyValue(AnyData):
    """A plain value, its meaning settled later."""

    @property
    def text(self) -> str:
        return "value"


class Law(Kind[Any]):
    """What a key takes; see :mod:`asrsim.sweeps.laws`."""

    def read(self, node: Node, path: KeyPath, reading: Reading) -> Any:
        try:
            return law_of(node.plain(), path[-1])
        except InputError as error:
            problem = error.problems[0]
            raise reading.fault(node, path, problem.message, choices=problem.choices, hint=problem.hint) from None

    def schema(self) -> Schema:
        return {}

    @property
    def text(self) -> str:
        return ", ".join(f"`{form}`" for form in FORMS)


@dataclass(frozen=True, kw_only=True)
class StudyFile:
    """Keys of a study file."""

    scenario: Path = declare(File(noun="scenario"), doc="scenario file that is varied")
    over: Mapping[str, Any] = declare(
        MapOf(of=Law(), noun="key", star=False), default={}, doc="key (`a & b`: tied) -> what it takes"
    )
    variants: tuple[str, ...] = declare(ListOf(of=Text()), default=(), shown="all", doc="of the scenario")
    overrides: Mapping[str, Any] = declare(
        MapOf(of=AnyValue(), noun="key", star=False), key="set", default={}, doc="keys that are the same in every run"
    )
    design: str = declare(Choice(DESIGNS), default="random", doc="how draws are placed")
    samples: int | None = declare(Optional(Integer(minimum=1)), default=None, shown=str(SAMPLES), doc="draws")
    seed: int = declare(Integer(minimum=0), default=0, doc="of the draws")
    fit: Path | None = declare(
        Optional(File(noun="fit")), default=None,
        doc="JSON or YAML with `keys`, `mean` and `covariance` (and `logarithmic`, `bounds`, `ties`): drawn together, normally",
    )  # fmt: skip
    signals: tuple[str, ...] = declare(ListOf(of=Text()), default=(), doc="joint.quantity that are kept of every run")
    rate: float = declare(Number(above=0.0), default=100.0, unit="Hz", doc="of the kept signals")
    plugins: tuple[Path, ...] = declare(
        ListOf(of=File(noun="plugin")),
        default=(),
        doc="files with your own actuators; each runs only where --plugin names it too",
    )


STUDY = block_of(StudyFile, "study")


def is_study(path: Path) -> bool:
    """Whether a file is a study, not a scenario."""
    return kind_of(path) == "study"


def read_study(path: Path, plugins: Sequence[Path | str] = ()) -> Study:
    """A study file; plugins: files of users' actuators that it may run. Raises InputError with every problem."""
    found = read_file(STUDY, path)
    check_named(found.plugins, plugins, file=path)
    try:
        given = {field.name: getattr(found, field.name) for field in fields(found)}
        return make_study(**{**given, "plugins": plugins or found.plugins, "name": path.stem})
    except InputError as error:
        raise InputError([replace(problem, file=problem.file or path) for problem in error.problems]) from None


def make_study(
    scenario: str | Path,
    over: Mapping[str, Any] | Sequence[str] = (),
    *,
    variants: Sequence[str] = (),
    overrides: Sequence[str] | Mapping[str, Any] = (),
    design: str = "random",
    samples: int | None = None,
    seed: int = 0,
    fit: str | Path | Mapping[str, Any] | None = None,
    signals: Sequence[str] = (),
    rate: float = 100.0,
    plugins: Sequence[str | Path] = (),
    name: str | None = None,
) -> Study:
    """A study from plain data: `over` maps dotted keys to lists, texts as `10:200:20`, or distributions, or lists
    `key=law` texts. Raises InputError with every problem.
    """
    read_document(Path(scenario), "scenario")
    axes, problems = _axes(over)
    joint, faults = _joint(fit)
    problems += faults
    drawn = joint is not None or any(isinstance(axis.law, Distribution) for axis in axes)
    # A key that could not be read may well have been meant to be drawn.
    drawable = drawn or bool(problems)
    if design not in DESIGNS:
        problems.append(Problem(f"there is no design '{design}'", key="design", choices=DESIGNS, code="choice"))
    groups = [*(axis.keys for axis in axes), *(joint.groups if joint else ())]
    problems += _twice([key for group in groups for key in group])
    if not over and fit is None:
        hint = "Give --over KEY=VALUES, or `over:` in a study file"
        problems.append(Problem("nothing is varied", key="over", hint=hint, code="sweep-empty"))
    if samples is not None and (samples < 1 or not drawable):
        message = "must be at least 1" if samples < 1 else "has a number, but no key is drawn from a distribution"
        problems.append(Problem(message, key="samples", value=samples, code="sweep-samples"))
    if design == "saltelli" and joint:
        message = "Sobol indices are of independent numbers: the design saltelli goes without a fit"
        problems.append(Problem(message, key="design", code="sweep-correlation"))
    if problems:
        raise InputError(problems)
    if samples and samples > MOST_RUNS:
        raise InputError(f"must be at most {MOST_RUNS}", key="samples", value=samples, code="range")
    study = Study(
        scenario=Path(scenario),
        axes=axes,
        joint=joint,
        variants=one_or_more(variants),
        overrides=override_texts(overrides),
        design=design,
        samples=_draws(samples or SAMPLES, design) if drawn else 0,
        seed=seed,
        signals=one_or_more(signals),
        rate=rate,
        plugins=tuple(Path(path) for path in one_or_more(plugins)),
        name=name or Path(scenario).stem,
    )
    if len(study) > MOST_RUNS:
        raise InputError(f"the study has {len(study)} runs; at most {MOST_RUNS} are possible", code="range")
    return study


def _axes(over: Mapping[str, Any] | Sequence[str]) -> tuple[tuple[Axis, ...], list[Problem]]:
    """What is varied, and what is wrong with it."""
    axes: list[Axis] = []
    problems: list[Problem] = []
    for item in over.items() if isinstance(over, Mapping) else map(_split, one_or_more(over)):
        try:
            axes.append(axis_of(*item))
        except InputError as error:
            problems += error.problems
    return tuple(axes), problems


def _joint(fit: str | Path | Mapping[str, Any] | None) -> tuple[Joint | None, Sequence[Problem]]:
    """The fit whose parameters are drawn together, or what is wrong with it."""
    try:
        return None if fit is None else read_fit(fit), ()
    except InputError as error:
        return None, error.problems


def _draws(samples: int, design: str) -> int:
    """How often a study draws; Sobol's sequence is balanced at powers of two only, and the indices of saltelli need that."""
    return 1 << max(1, (samples - 1).bit_length()) if design == "saltelli" else samples


def _split(text: str) -> tuple[str, str]:
    key, equals, value = text.partition("=")
    if not equals or not key.strip() or not value.strip():
        hint = "Write KEY=VALUES, such as references.joint_1.stiffness_preset=[0.2, 0.6]"
        raise InputError("is no KEY=VALUES", key="over", value=text, hint=hint, code="override")
    return key.strip(), value.strip()


def _twice(keys: Sequence[str]) -> list[Problem]:
    seen: set[str] = set()
    again = [key for key in keys if key in seen or seen.add(key)]  # type: ignore[func-returns-value]
    return [Problem("is varied twice", key=key, code="sweep-twice") for key in dict.fromkeys(again)]
