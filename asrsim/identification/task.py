"""Task of `asrsim identify`: scenario, recordings, free parameters and ties. The task is from a fit file or from the command
line.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from asrsim.document.block import Block, block_of, declare
from asrsim.document.file import kind_of, read_document
from asrsim.document.kinds import NUMBER, Boolean, File, ListOf, MapOf, Number, Text
from asrsim.document.node import node_from_data
from asrsim.document.reading import DocumentReading, Rejected
from asrsim.errors import InputError, Problem
from asrsim.plain import one_or_more
from asrsim.plugins import check_named
from asrsim.robot.model import INERTIAS, Inertia
from asrsim.scenario.overrides import override_texts

_TIE = re.compile(r"(?:(?P<factor>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*\*\s*)?(?P<key>\S.*)")
_WISHES = ((), ("start",), ("low", "high"), ("low", "start", "high"))
"""Meanings of the numbers in a text `KEY=NUMBER:NUMBER:NUMBER`, by the count of these numbers (0 to 3)."""


@dataclass(frozen=True, kw_only=True)
class Payload:
    """A known body that is fixed to a link during a recording."""

    link: str = declare(Text(text="name of a link"), doc="link that carries the payload")
    mass: float = declare(Number(above=0.0), unit="kg", doc="mass of the payload")
    centre: tuple[float, float, float] = declare(
        ListOf(of=NUMBER, names=("x", "y", "z")),
        default=(0.0, 0.0, 0.0),
        unit="m",
        doc="centre of mass of the payload in the frame of the link",
    )
    inertia: Inertia = declare(
        ListOf(of=NUMBER, names=INERTIAS),
        default=(0.0,) * 6,
        shown="a point mass",
        unit="kg m^2",
        doc="ixx, ixy, ixz, iyy, iyz, izz of the payload about its centre of mass, along the axes of the link",
    )


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """A recording, with the mapping of its columns to quantities."""

    file: Path = declare(File(noun="recording", attach=False, folder=True, exists=False), doc="the recording")
    mapping: tuple[str, ...] = declare(
        ListOf(of=Text()),
        key="map",
        default=(),
        doc="joint and quantity of columns, as in `--map`: `COLUMN=JOINT.QUANTITY [unit]`",
    )
    rate: float | None = declare(Number(above=0.0), default=None, unit="Hz", doc="sampling rate of a recording without time")
    payload: Payload | None = declare(
        block_of(Payload, "payload"), default=None, shown="none", doc="known body that the robot carries in this recording"
    )


@dataclass(frozen=True, kw_only=True)
class Wish:
    """Start value and bounds of a free parameter, and whether each recording has a separate value. The wish may apply to all
    parameters that match a pattern.
    """

    start: float | None = declare(NUMBER, default=None, shown="the robot's value", doc="where the search begins")
    low: float | None = declare(NUMBER, default=None, shown="what is physically possible", doc="least value")
    high: float | None = declare(NUMBER, default=None, shown="what is physically possible", doc="largest value")
    own: bool | None = declare(
        Boolean(), default=None, shown="true for `clock` and `initial_...`", doc="whether each recording has a separate value"
    )


@dataclass(frozen=True, kw_only=True)
class Tie:
    """A parameter that is a multiple of another parameter: key = factor * to. If the key contains `*`, the tie holds for all
    matching keys.
    """

    key: str
    to: str
    factor: float = 1.0


_EXPERIMENT: Block[Experiment] = block_of(Experiment, "recording", main="file")
_FREE = MapOf(of=block_of(Wish, "free parameter", main="start"), noun="key", star=False)


@dataclass(frozen=True, kw_only=True)
class Task:
    """The contents of a fit file. Examples of parameter keys are `joint_1.spring_k_1`, `link_1.izz`,
    `joint_1.link_position.offset` and `clock`.
    """

    scenario: Path = declare(
        File(noun="scenario", attach=False), doc="scenario of the robot, with the commands that are not recorded"
    )
    variant: str | None = declare(Text(text="name of a variant"), default=None, doc="variant of the scenario")
    overrides: tuple[str, ...] = ()
    experiments: tuple[Experiment, ...] = declare(ListOf(of=_EXPERIMENT, minimum=1), doc="recordings that are fitted")
    validate: tuple[Experiment, ...] = declare(
        ListOf(of=_EXPERIMENT),
        default=(),
        shown="the last part of each recording",
        doc="recordings that are predicted but not fitted",
    )
    free: Mapping[str, Wish] = declare(
        _FREE, default={}, doc="key or pattern -> nothing, a start, or `start`, `low`, `high`, `own`"
    )
    ties: tuple[Tie, ...] = declare(
        MapOf(of=Text(), noun="key", star=False), default=(), doc="key -> `other key`, or `0.5 * other key`"
    )
    noise: Mapping[str, float] = declare(
        MapOf(of=Number(above=0.0), noun="joint.quantity", star=False),
        default={},
        shown="estimated",
        doc="standard deviation of a channel's noise, in the channel's unit",
    )
    hold_out: float = declare(
        Number(minimum=0.0, maximum=0.9),
        default=0.25,
        doc="fraction at the end of each recording that is predicted but not fitted",
    )
    plugins: tuple[Path, ...] = declare(
        ListOf(of=File(noun="plugin", attach=False)),
        default=(),
        doc="files with your own actuators, readers and causes that the fit needs; a file runs only if --plugin also names it",
    )
    name: str = ""
    file: Path | None = None
    """Path of the fit file; None if the task was made from a scenario."""


def _task(*, ties: Any, **keys: Any) -> Task:
    return Task(**keys, ties=tuple(_tie(key, text) for key, text in dict(ties).items()))


TASK: Block[Task] = replace(block_of(Task, "fit"), build=_task)


def task_of(
    scenario: str | Path,
    experiments: Sequence[str | Path] = (),
    *,
    free: Iterable[str] | Mapping[str, Any] = (),
    ties: Iterable[str] | Mapping[str, str] = (),
    validate: Sequence[str | Path] = (),
    own: Sequence[str] = (),
    mapping: Sequence[str] = (),
    rate: float | None = None,
    overrides: Sequence[str] | Mapping[str, Any] = (),
    plugins: Sequence[str | Path] = (),
    **options: Any,
) -> Task:
    """Task from a scenario or a fit file. Free parameters and ties are added to the free parameters and ties of the fit file.
    Other arguments replace values of the fit file. Raises InputError with all problems.

    free: texts `KEY[=...]`, or values by key as in a fit file; ties: texts `KEY=[FACTOR*]KEY`, or texts by key; own: keys of
    parameters with a separate value for each recording; mapping, rate: mapping of columns and sampling rate in Hz of all
    recordings, with precedence over the fit file; plugins: plugin files that the fit file may load.
    """
    path, faults, reading = Path(scenario), list[Problem](), DocumentReading()
    fit = kind_of(path) == "fit"
    if fit:
        if experiments:
            message = "a fit file names its recordings, so the option `experiments` is not allowed with it"
            raise InputError(message, file=path, hint="Write them into the fit file, under `experiments`", code="fit-file")
        root, reading = read_document(path, "fit", faults=faults)[0], DocumentReading(base=path.parent)
    else:
        read_document(path, "scenario")
        if not experiments:
            raise InputError(
                "no recording is named", key="experiments", hint="Name a recording: --experiment FILE", code="no-recording"
            )
        options |= {"experiments": _recordings(experiments), "plugins": one_or_more(plugins)}
        root = node_from_data({"scenario": path})
    wishes = free if isinstance(free, Mapping) else dict(map(_wish, one_or_more(free)))
    given = {
        "free": {key: {} if wish is None else wish for key, wish in wishes.items()},
        "ties": ties if isinstance(ties, Mapping) else dict(text.partition("=")[::2] for text in one_or_more(ties)),
        "validate": _recordings([Path(one).absolute() for one in one_or_more(validate)]),
    }
    separate, found = {"free": {key: {"own": True} for key in one_or_more(own)}}, None
    for over in (options, {key: value for key, value in given.items() if value}, separate if own else {}):
        root = TASK.merge(root, node_from_data(over))
    with suppress(Rejected):
        found = TASK.read(root, (), reading)
    if faults or reading.problems or found is None:
        raise InputError([*faults, *reading.problems])
    check_named(found.plugins, one_or_more(plugins), file=path)
    # If a column has two meanings, the last one counts. Therefore place the meanings of the fit file first.
    trials, tests = (
        tuple(
            replace(one, mapping=(*one.mapping, *one_or_more(mapping)), rate=one.rate if rate is None else rate)
            for one in group
        )
        for group in (found.experiments, found.validate)
    )
    return replace(
        found,
        experiments=trials,
        validate=tests,
        overrides=override_texts(overrides),
        name=path.stem,
        file=path if fit else None,
    )


def _recordings(files: Sequence[str | Path]) -> list[dict[str, Any]]:
    """List of recordings in the format of a fit file."""
    return [{"file": str(one)} for one in one_or_more(files)]


def _tie(key: str, text: str) -> Tie:
    """Tie of a parameter, from a text such as `other` or `0.5 * other`. Raises InputError."""
    match = _TIE.fullmatch(text.strip())
    if match is None:
        raise InputError("is not a tie", key=f"ties.{key}", value=text, hint="Write KEY=OTHER or KEY=0.5*OTHER", code="tie")
    return Tie(key=key.strip(), to=match["key"].strip(), factor=float(match["factor"] or 1.0))


def _wish(text: str) -> tuple[str, dict[str, float]]:
    """Key, start and bounds of a parameter, from a text `KEY`, `KEY=START`, `KEY=LOW:HIGH` or `KEY=LOW:START:HIGH`. Raises
    InputError.
    """
    key, equals, value = text.partition("=")
    with suppress(ValueError):
        numbers = [float(part) for part in value.split(":")] if equals else []
        if key.strip() and len(numbers) < len(_WISHES):
            return key.strip(), dict(zip(_WISHES[len(numbers)], numbers, strict=True))
    hint = "Write KEY, KEY=START, KEY=LOW:HIGH or KEY=LOW:START:HIGH"
    raise InputError("is not a free parameter", key="free", value=text, hint=hint, code="free")
