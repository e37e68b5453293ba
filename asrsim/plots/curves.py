"""Thinned curves of a log by joint and quantity, read in bounded memory."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, takewhile
from pathlib import Path

import numpy as np

from asrsim.errors import LogError, Problem
from asrsim.log import LogReader, open_log
from asrsim.log.derived import DERIVED_FUNCTIONS, DERIVED_SOURCES
from asrsim.plots.decimate import BINS, Envelope
from asrsim.plots.world import Curve, WorldEnvelope
from asrsim.quantities import DERIVED, QUANTITIES, Quantity
from asrsim.samples import Array, JointInfo, RunInfo, Samples

REFERENCE = "reference_position"
EXTRA: dict[str, Quantity] = {
    REFERENCE: Quantity(REFERENCE, "rad", "reference", "link position that the references ask for"),
}
"""Quantities that only pictures use: the position reference, which has the same name in all operation modes."""
KNOWN: dict[str, Quantity] = QUANTITIES | DERIVED | EXTRA


@dataclass(frozen=True, kw_only=True)
class RunCurves:
    """Curves of one run, as the pictures draw them."""

    path: Path
    info: RunInfo
    label: str
    """Short name of the run: the variant, or the file's name."""
    joints: tuple[JointInfo, ...]
    """Joints that were selected from the log."""
    curves: Mapping[tuple[str, str], Curve]
    """Curve of each (joint, quantity) that the run has."""
    bodies: Mapping[str, Mapping[str, Curve]] = field(default_factory=dict)
    """Curves of each world object: dx, dy, dz (displacement from the first sample, m) and force (magnitude of the contact
    forces, N).
    """
    status: str = "complete"
    samples: int

    def get(self, joint: str, quantity: str) -> Curve | None:
        """Curve of a joint's quantity, None if the run does not have it."""
        return self.curves.get((joint, quantity))


def joint_info(runs: Sequence[RunCurves], joint: str) -> JointInfo:
    """Description of a joint, from the first run that has it."""
    return next(info for run in runs for info in run.joints if info.name == joint)


class CurveSource:
    """Stored and derived quantities of a log's joints, read chunk by chunk.

    joints, quantities: all by default; start, end: limits of the part to read, s. Raises LogError for unknown names and
    for files that are not logs.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        joints: Sequence[str] | None = None,
        quantities: Sequence[str] | None = None,
        start: float | None = None,
        end: float | None = None,
    ) -> None:
        self._start, self._end = start, end
        self.reader = open_log(path)
        self.joints = _members(self.reader, joints)
        self._names = _names(self.reader, self.joints, quantities)
        self.columns = [(joint.name, name) for name in self._names for joint in self.joints]
        """Joint and quantity of each column of the matrix."""
        self._stored = stored(self._names, self.reader.info.joints)

    def run(
        self, curves: Mapping[tuple[str, str], Curve], samples: int, *, bodies: Mapping[str, Mapping[str, Curve]] | None = None
    ) -> RunCurves:
        """Description of this log's run together with the given curves."""
        reader = self.reader
        return RunCurves(
            path=reader.path, info=reader.info, label=reader.info.variant or reader.path.stem, joints=self.joints,
            curves=curves, bodies=bodies or {}, status=reader.status, samples=samples,
        )  # fmt: skip

    def span(self, first: float) -> tuple[float, float]:
        """Start and end of the part to read, s; `first` is the time of its first sample."""
        # A log begins at 0, except when the run repeats a recording.
        last = (first if self._start is None else 0.0) + self.reader.duration
        return first, max(first, last if self._end is None else min(self._end, last))

    def chunks(self) -> Iterator[tuple[Samples, Array]]:
        """Chunks of the log: samples, and the selected columns as a matrix (n, columns). Raises LogError if there are none."""
        empty = True
        samples = self.reader.iter_samples(
            quantities=self._stored, joints=[joint.name for joint in self.joints], start=self._start, end=self._end
        )
        for part in _ordered(samples, self.reader.path):
            empty = False
            columns = table(part, self._names, self.reader.info.joints)
            yield part, np.concatenate([columns[name] for name in self._names], axis=1) if self._names else np.empty((0, 0))
        if empty:
            window = self._start is not None or self._end is not None
            ended = "The run ended before its first chunk was written" if self.reader.truncated else None
            raise LogError(
                "the log contains no samples" + (" in that time" if window else ""), file=self.reader.path, code="empty-log",
                hint=f"It lasts {self.reader.duration:g} s" if window and not ended else ended,
            )  # fmt: skip


def read_curves(
    path: str | os.PathLike[str],
    *,
    joints: Sequence[str] | None = None,
    quantities: Sequence[str] | None = None,
    bodies: bool = True,
    start: float | None = None,
    end: float | None = None,
    bins: int = BINS,
) -> RunCurves:
    """Thinned curves of a log. The log is read chunk by chunk; memory depends on `bins`, not on the duration.

    joints, quantities: all by default, derived quantities included; start, end: limits of the part to read, s. Raises
    LogError for unknown names, files that are not logs, and a part without samples.
    """
    source = CurveSource(path, joints=joints, quantities=quantities, start=start, end=end)
    chunks = source.chunks()
    head = next(chunks)
    first, last = source.span(float(head[0].time[0]))
    envelope = Envelope(start=first, end=last, bins=bins)
    world = WorldEnvelope(head[0], start=first, end=last, bins=bins) if bodies else None
    for part, matrix in chain([head], chunks):
        envelope.add(part.time, matrix)
        if world is not None:
            world.add(part)
    curves = {}
    for index, column in enumerate(source.columns):
        time, values = envelope.column(index)
        if np.isfinite(values).any():
            curves[column] = Curve(time=time, values=values)
    return source.run(curves, envelope.samples, bodies=world.curves() if world is not None else {})


def distinct_labels(runs: Sequence[RunCurves]) -> list[RunCurves]:
    """The runs with distinct labels: the variant, else the part of the path in which the runs differ, else a number."""
    for labels in (
        [run.label for run in runs],
        _differing([run.path.resolve().with_suffix("").parts for run in runs]),
    ):
        if all(labels) and len(set(labels)) == len(labels):
            return [replace(run, label=label) for run, label in zip(runs, labels, strict=True)]
    return [replace(run, label=f"{run.label} {number}") for number, run in enumerate(runs, 1)]


def _differing(paths: Sequence[tuple[str, ...]]) -> list[str]:
    """Each path without the leading and trailing parts that all paths have in common."""
    ends = []
    for sign in (1, -1):
        parts = zip(*(path[::sign] for path in paths), strict=False)
        ends.append(sum(1 for _ in takewhile(lambda same: len(set(same)) == 1, parts)))
    return ["/".join(path[ends[0] : len(path) - ends[1]]) for path in paths]


def available(reader: LogReader) -> tuple[str, ...]:
    """Every quantity that can be drawn from a log, derived quantities last."""
    stored = dict.fromkeys(name for joint in reader.info.joints for name in joint.quantities)
    derived = [name for name in DERIVED if "link_position" in stored or name == "equilibrium_position"]
    return (*(name for name in QUANTITIES if name in stored), *(name for name in stored if name not in QUANTITIES), *derived)


def require_names(reader: LogReader, kind: str, names: Sequence[str], choices: Sequence[str]) -> None:
    """Raise LogError for names that are not among the choices. kind: `joint` or `quantity`."""
    unknown = [name for name in names if name not in choices]
    if unknown:
        raise LogError(
            Problem(f"the log has no {kind} '{name}'", file=reader.path, key=kind, choices=tuple(choices),
                    meant=name, code=f"unknown-{kind}")
            for name in unknown
        )  # fmt: skip


def _members(reader: LogReader, names: Sequence[str] | None) -> tuple[JointInfo, ...]:
    by_name = {joint.name: joint for joint in reader.info.joints}
    require_names(reader, "joint", names or (), tuple(by_name))
    return reader.info.joints if names is None else tuple(by_name[name] for name in dict.fromkeys(names))


def _names(reader: LogReader, members: Sequence[JointInfo], names: Sequence[str] | None) -> tuple[str, ...]:
    choices = available(reader)
    if names is None:
        mine = {name for joint in members for name in joint.quantities} | set(DERIVED)
        return (*(name for name in choices if name in mine), *([REFERENCE] if "link_position" in choices else []))
    require_names(reader, "quantity", names, (*choices, *EXTRA))
    return tuple(dict.fromkeys(names))


def stored(names: Sequence[str], joints: Sequence[JointInfo]) -> list[str]:
    """Names of the quantities, stored for at least one of the joints, from which the given quantities are computed."""
    recorded = {name for joint in joints for name in joint.quantities}
    needed: dict[str, None] = {}
    for name in names:
        sources = DERIVED_SOURCES["position_error"] if name == REFERENCE else DERIVED_SOURCES.get(name, (name,))
        needed |= dict.fromkeys(sources)
    return [name for name in needed if name in recorded]


def table(part: Samples, names: Sequence[str], joints: Sequence[JointInfo]) -> dict[str, Array]:
    """Values (n, joints) of each quantity, stored or derived."""
    found: dict[str, Array] = {}
    # Infinite values of a diverged run give NaN differences: suppress NumPy's warning.
    with np.errstate(invalid="ignore"):
        for name in names:
            if name == REFERENCE:
                found[name] = DERIVED_FUNCTIONS["position_error"](part, joints) + part.values.get("link_position", np.nan)
            elif name in DERIVED_FUNCTIONS:
                found[name] = DERIVED_FUNCTIONS[name](part, joints)
            else:
                found[name] = part.values[name]
    return found


def _ordered(parts: Iterator[Samples], path: Path) -> Iterator[Samples]:
    """Chunks of the log that contain samples. Raises LogError if times decrease."""
    last = -np.inf
    for part in parts:
        if not len(part.time):
            continue
        if part.time[0] < last:
            raise LogError(f"times run backwards near {last:g} s", file=path, code="corrupt-log")
        last = float(part.time[-1])
        yield part
