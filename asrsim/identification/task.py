"""What `asrsim identify` is asked: scenario, recordings, free parameters, ties; from a file or from the command line."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from asrsim.actuators.user import check_named
from asrsim.document.block import Block, block_of, declare
from asrsim.document.composite import Either, ListOf, MapOf, is_mapping
from asrsim.document.file import read_document, read_file
from asrsim.document.kinds import NUMBER, Boolean, Choice, File, Integer, Number, Optional, Text
from asrsim.document.mistaken import kind_of
from asrsim.document.node import node_from_data
from asrsim.document.reading import Reading, Rejected
from asrsim.errors import InputError
from asrsim.plain import one_or_more
from asrsim.scenario.overrides import override_texts

LOSSES = ("huber", "linear")
_TIE = re.compile(r"(?:(?P<factor>[-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*\*\s*)?(?P<key>\S.*)")


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """A recording and how it is read."""

    file: Path = declare(File(noun="recording", attach=False, folder=True, exists=False), doc="the recording")
    mapping: tuple[str, ...] = declare(
        ListOf(of=Text()), key="map", default=(), doc="what columns are, as `--map` says it: `COLUMN=JOINT.QUANTITY [unit]`"
    )
    rate: float | None = declare(Optional(Number(above=0.0)), default=None, unit="Hz", doc="of a recording without time")
    lag: float | None = declare(
        Optional(NUMBER), default=None, unit="s", shown="found",
        doc="by which its clock is ahead of the scenario's, where the commands are the scenario's",
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Wish:
    """A key, or a pattern of keys, that is to be free."""

    start: float | None = declare(Optional(NUMBER), default=None, shown="the robot's", doc="where the search begins")
    low: float | None = declare(Optional(NUMBER), default=None, shown="what is physical", doc="least value")
    high: float | None = declare(Optional(NUMBER), default=None, shown="what is physical", doc="largest value")
    own: bool | None = declare(
        Optional(Boolean()), default=None, shown="of clocks and starts", doc="each recording has its own value"
    )


@dataclass(frozen=True, kw_only=True)
class Tie:
    """A key that is a multiple of another; patterns with `*` stand for several of each."""

    key: str
    to: str
    factor: float = 1.0


_EXPERIMENT: Block[Experiment] = block_of(Experiment, "recording", main="file")
_WISH = Either(((is_mapping, block_of(Wish, "free parameter")), (lambda _: True, Optional(NUMBER))))
_FREE = MapOf(of=_WISH, noun="key", star=False)


@dataclass(frozen=True, kw_only=True)
class Task:
    """A fit as data. Keys are `joint_1.spring_k_1`, `link_1.izz`, `joint_1.link_position.offset`, `clock`, ..."""

    scenario: Path = declare(File(noun="scenario", attach=False), doc="plays the commands that no recording has")
    variant: str | None = declare(Optional(Text(noun="name of a variant")), default=None, doc="of the scenario")
    overrides: tuple[str, ...] = ()
    experiments: tuple[Experiment, ...] = declare(ListOf(of=_EXPERIMENT, minimum=1), doc="recordings that are fitted")
    validate: tuple[Experiment, ...] = declare(
        ListOf(of=_EXPERIMENT), default=(), shown="the last part of each recording", doc="recordings that are only predicted"
    )
    free: Mapping[str, Wish] = declare(
        _FREE, default={},
        doc="key or pattern -> nothing, a start, or `start`, `low`, `high`, `own`",
    )  # fmt: skip
    ties: tuple[Tie, ...] = declare(
        MapOf(of=Text(), noun="key", star=False), default=(), doc="key -> `other key`, or `0.5 * other key`"
    )
    compare: tuple[str, ...] = declare(
        ListOf(of=Text()), default=(), shown="all that simulation and recording have", doc="`joint.quantity` to compare"
    )
    noise: Mapping[str, float] = declare(
        MapOf(of=Number(above=0.0), noun="joint.quantity", star=False), default={}, shown="estimated",
        doc="standard deviation of a channel's noise, in its unit",
    )  # fmt: skip
    hold_out: float = declare(
        Number(minimum=0.0, maximum=0.9), default=0.25, doc="share of each recording, at its end, that is only predicted"
    )
    loss: str = declare(Choice(LOSSES), default="huber", doc="huber: outliers count little; linear: least squares")
    starts: int = declare(Integer(minimum=1), default=6, doc="starts that are tried, at most, until one fits")
    spread: float = declare(Number(above=1.0), default=3.0, doc="factor by which starts are scattered")
    seed: int = declare(Integer(minimum=0), default=0, doc="of the starts")
    plugins: tuple[Path, ...] = declare(
        ListOf(of=File(noun="plugin", attach=False)),
        default=(),
        doc="files with your own actuators; each runs only where --plugin names it too",
    )
    name: str = ""


_KEYS: Block[Any] = block_of(Task, "fit")
TASK: Block[dict[str, Any]] = replace(_KEYS, build=dict)


def is_task(path: Path) -> bool:
    """Whether a file is a fit, not a scenario."""
    return kind_of(path) == "fit"


def task_of(path: Path, experiments: Sequence[str | Path], *, plugins: Sequence[Path | str] = (), **options: Any) -> Task:
    """That of a scenario and options, as :func:`make_task`, or of a fit file and what is to be otherwise: free parameters, ties
    and recordings to validate are added to the file's, the rest stands in place of it. Raises InputError.
    """
    if not is_task(path):
        return make_task(path, experiments, plugins=plugins, **options)
    given = {"experiments": experiments, "mapping": options.pop("mapping", ()), "rate": options.pop("rate", None)}
    if said := [name for name, value in given.items() if value]:
        message = f"a fit file names its recordings itself, and how they are read; without it: {', '.join(said)}"
        raise InputError(message, file=path, hint="Write them into it, under `experiments`", code="fit-file")
    task, free, own = read_task(path, plugins), options.pop("free", ()), options.pop("own", ())
    ties, more = _ties(options.pop("ties", ())), tuple(map(_experiment, options.pop("validate", ())))
    _check_loss(options)
    options["overrides"] = override_texts(options.get("overrides", ()))
    return replace(
        task, **options, free=_wishes(free, own, task.free), validate=(*task.validate, *more),
        ties=(*(one for one in task.ties if one.key not in {tie.key for tie in ties}), *ties),
    )  # fmt: skip


def read_task(path: str | Path, plugins: Sequence[Path | str] = ()) -> Task:
    """A fit file; plugins: files of users' actuators that it may run. Raises InputError with every problem."""
    path = Path(path)
    found = read_file(TASK, path)
    check_named(found["plugins"], plugins, file=path)
    free = {key: wish if isinstance(wish, Wish) else Wish(start=wish) for key, wish in found.pop("free").items()}
    ties = found.pop("ties")
    try:
        made = tuple(tie_of(key, text) for key, text in (ties.items() if ties else ()))
    except InputError as error:
        raise InputError([replace(problem, file=path) for problem in error.problems]) from None
    return Task(**found, free=free, ties=made, name=path.stem)


def tie_of(key: str, text: str) -> Tie:
    """`other` or `0.5 * other`. Raises InputError."""
    match = _TIE.fullmatch(text.strip())
    if match is None or (number := _number(match["factor"] or "1")) is None:
        raise InputError("is no tie", key=key, value=text, hint="Write KEY=OTHER or KEY=0.5*OTHER", code="tie")
    return Tie(key=key.strip(), to=match["key"].strip(), factor=number)


def wish_of(text: str) -> tuple[str, Wish]:
    """`KEY`, `KEY=START`, `KEY=LOW:HIGH` or `KEY=LOW:START:HIGH`. Raises InputError."""
    key, equals, value = text.partition("=")
    parts = value.split(":") if equals else []
    numbers = [_number(part) for part in parts]
    if not key.strip() or None in numbers or len(numbers) > 3 or (equals and not numbers):
        hint = "Write KEY, KEY=START, KEY=LOW:HIGH or KEY=LOW:START:HIGH"
        raise InputError("is no free parameter", key="free", value=text, hint=hint, code="free")
    start = numbers[0] if len(numbers) == 1 else numbers[1] if len(numbers) == 3 else None
    low, high = (numbers[0], numbers[-1]) if len(numbers) > 1 else (None, None)
    return key.strip(), Wish(start=start, low=low, high=high)


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def make_task(
    scenario: str | Path,
    experiments: Sequence[str | Path | Experiment],
    *,
    free: Iterable[str] | Mapping[str, Any] = (),
    ties: Iterable[str] | Mapping[str, str] = (),
    validate: Sequence[str | Path | Experiment] = (),
    own: Sequence[str] = (),
    mapping: Sequence[str] = (),
    rate: float | None = None,
    overrides: Sequence[str] | Mapping[str, Any] = (),
    plugins: Sequence[str | Path] = (),
    **options: Any,
) -> Task:
    """A task from plain data: free as `KEY[=...]` texts or key -> start, Wish, or its keys; ties as `KEY=[FACTOR*]KEY`; own:
    keys of which each recording has its own value. Raises InputError.
    """
    read_document(Path(scenario), "scenario")
    if not experiments:
        raise InputError("no recording is named", key="experiments", hint="Name one: --experiment FILE", code="no-recording")
    _check_loss(options)

    def read_as(several: Sequence[str | Path | Experiment]) -> tuple[Experiment, ...]:
        return tuple(_experiment(one, one_or_more(mapping), rate) for one in one_or_more(several))

    return Task(
        scenario=Path(scenario), experiments=read_as(experiments), validate=read_as(validate),
        free=_wishes(free, own), ties=_ties(ties), overrides=override_texts(overrides),
        plugins=tuple(map(Path, one_or_more(plugins))), name=options.pop("name", None) or Path(scenario).stem, **options,
    )  # fmt: skip


def _check_loss(options: Mapping[str, Any]) -> None:
    if options.get("loss", LOSSES[0]) not in LOSSES:
        raise InputError("is no loss", key="loss", value=options["loss"], choices=LOSSES, code="loss")


def _experiment(one: str | Path | Experiment, mapping: tuple[str, ...] = (), rate: float | None = None) -> Experiment:
    return one if isinstance(one, Experiment) else Experiment(file=Path(one), mapping=mapping, rate=rate)


def _wishes(
    free: Iterable[str] | Mapping[str, Any], own: Iterable[str], before: Mapping[str, Wish] | None = None
) -> dict[str, Wish]:
    """before: those of the file, which these are added to."""
    wishes = {**(before or {}), **(_read_wishes(free) if isinstance(free, Mapping) else dict(map(wish_of, one_or_more(free))))}
    for key in one_or_more(own):
        wishes[key] = replace(wishes.get(key, Wish()), own=True)
    return wishes


def _read_wishes(free: Mapping[str, Any]) -> dict[str, Wish]:
    """Starts, or what a file may say of them. Raises InputError."""
    reading, found = Reading(), {}
    with suppress(Rejected):
        plain = {key: value for key, value in free.items() if not isinstance(value, Wish)}
        found = _FREE.read(node_from_data(plain), ("free",), reading)
    if reading.problems:
        raise InputError(reading.problems)
    return {key: wish if isinstance(wish, Wish) else Wish(start=wish) for key, wish in {**free, **found}.items()}


def _ties(ties: Iterable[str] | Mapping[str, str]) -> tuple[Tie, ...]:
    pairs = ties.items() if isinstance(ties, Mapping) else [text.partition("=")[::2] for text in one_or_more(ties)]
    return tuple(tie_of(*pair) for pair in pairs)
