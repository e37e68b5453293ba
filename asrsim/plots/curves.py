"""Thinned curves of a log by joint and quantity, read in bounded memory."""

from __future__ import annotations

import os
from collections import ChainMap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, takewhile
from pathlib import Path

import numpy as np

from asrsim.errors import LogError, Problem
from asrsim.log import LogReader, open_log
from asrsim.log.derived import DERIVED_FUNCTIONS, recorded_sources
from asrsim.plots.decimate import BINS, Curve, Envelope
from asrsim.quantities import DERIVED, QUANTITIES, Quantity
from asrsim.samples import TIP, TIP_GOAL, Array, JointInfo, RunInfo, Samples

REFERENCE = "reference_position"
EXTRA: dict[str, Quantity] = {
    REFERENCE: Quantity(REFERENCE, "rad", "reference", "link position that the references demand"),
}
"""Quantities that only pictures use. The position reference has the same name in all operation modes."""
OBJECT, TASK_TIP = ("dx", "dy", "dz", "force"), ("dx", "dy", "dz", "reference_x", "reference_y", "reference_z", "error")
"""OBJECT: quantities of an object of the world (displacement from its first sample; magnitude of its contact forces except the
contact forces of the ground); TASK_TIP: quantities of the tip of a Cartesian task (displacement, goal, and distance from the
goal).
"""
BODIES: dict[str, Quantity] = {
    name: Quantity(name, "N" if name == "force" else "m", name, "") for name in dict.fromkeys((*OBJECT, *TASK_TIP))
}
KNOWN: Mapping[str, Quantity] = ChainMap(QUANTITIES, DERIVED, EXTRA, BODIES)
"""Every quantity that pictures may show, including the quantities of stages that are registered later."""


@dataclass(frozen=True, kw_only=True)
class RunCurves:
    """Curves of one run, as the pictures draw them."""

    path: Path
    info: RunInfo
    label: str
    """Short name of the run: the name of its variant, or of its file."""
    joints: tuple[JointInfo, ...]
    """Joints that were selected from the log."""
    curves: Mapping[tuple[str, str], Curve]
    """Curve of each (joint or body, quantity) that the run has."""
    bodies: tuple[JointInfo, ...] = ()
    """Objects of the world and the tip of a task, described as joints are."""
    status: str = "complete"
    samples: int

    def get(self, joint: str, quantity: str) -> Curve | None:
        """Curve of a joint's quantity, None if the run does not have it."""
        return self.curves.get((joint, quantity))


def joint_info(runs: Sequence[RunCurves], joint: str) -> JointInfo:
    """Description of a joint or body, from the first run that has it."""
    return next(info for run in runs for info in (*run.joints, *run.bodies) if info.name == joint)


class CurveSource:
    """Stored and derived quantities of a log's joints and bodies, read chunk by chunk.

    joints, quantities: names; None: all. bodies: whether the bodies are also read; start, end: limits of the part of the log to
    read, s. Raises LogError for unknown names and for files that are not logs.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        joints: Sequence[str] | None = None,
        quantities: Sequence[str] | None = None,
        bodies: bool = False,
        start: float | None = None,
        end: float | None = None,
    ) -> None:
        self._start, self._end = start, end
        self.reader = open_log(path)
        self.joints = _members(self.reader, joints)
        self._names = _names(self.reader, self.joints, quantities)
        self._stored = stored(self._names, self.reader.info.joints)
        first = next(self.reader.iter_samples(quantities=(), joints=(), start=start, end=end), None) if bodies else None
        found = {} if first is None else first.bodies
        self._origins = {name: poses[0, :3] for name, poses in found.items() if name != TIP_GOAL or TIP not in found}
        taken = {joint.name for joint in self.reader.info.joints}
        self.bodies = tuple(
            JointInfo(
                name=f"{name} (body)" if name in taken else name,
                actuator="",
                mode=None,
                quantities=TASK_TIP if name == TIP else OBJECT,
            )
            for name in self._origins
        )
        self.columns = [(joint.name, name) for name in self._names for joint in self.joints]
        """Joint or body, and quantity, of each column of the matrix."""
        self.columns += [(body.name, name) for body in self.bodies for name in body.quantities]

    def run(self, curves: Mapping[tuple[str, str], Curve], samples: int) -> RunCurves:
        """Description of this log's run together with the given curves."""
        reader = self.reader
        return RunCurves(
            path=reader.path,
            info=reader.info,
            label=reader.info.variant or reader.path.stem,
            joints=self.joints,
            curves=curves,
            bodies=self.bodies,
            status=reader.status,
            samples=samples,
        )

    def span(self, first: float) -> tuple[float, float]:
        """Start and end of the part of the log to read, s. first: time of the first sample of this part."""
        # A log begins at 0, unless its run repeats a recording with another start time.
        last = (first if self._start is None else 0.0) + self.reader.duration
        return first, max(first, last if self._end is None else min(self._end, last))

    def chunks(self) -> Iterator[tuple[Samples, Array]]:
        """Chunks of the log: samples, and the selected columns as a matrix (n, columns). Raises LogError if the log contains no
        samples."""
        empty = True
        samples = self.reader.iter_samples(
            quantities=self._stored, joints=[joint.name for joint in self.joints], start=self._start, end=self._end
        )
        for part in _ordered(samples, self.reader.path):
            empty = False
            columns = table(part, self._names, self.reader.info.joints)
            moved = [self._moved(name, part) for name in self._origins]
            yield part, np.concatenate([np.empty((len(part.time), 0)), *columns.values(), *moved], axis=1)
        if empty:
            window = self._start is not None or self._end is not None
            ended = "The run ended before its first chunk was written" if self.reader.truncated else None
            raise LogError(
                "the log contains no samples" + (" in that time" if window else ""),
                file=self.reader.path,
                code="empty-log",
                hint=f"It lasts {self.reader.duration:g} s" if window and not ended else ended,
            )

    def _moved(self, name: str, part: Samples) -> Array:
        """Values (n, quantities) of a body; NaN where the log lacks the body."""
        lacking = np.full((len(part.time), 3), np.nan)
        moved = part.bodies[name][:, :3] - self._origins[name] if name in part.bodies else lacking
        if name == TIP:
            goal = part.bodies[TIP_GOAL][:, :3] - self._origins[name] if TIP_GOAL in part.bodies else lacking
            return np.concatenate([moved, goal, np.linalg.norm(moved - goal, axis=1)[:, None]], axis=1)
        forces = (force for other, force in part.forces_on(name).items() if other != "ground")
        push = sum(forces, np.zeros((len(part.time), 3)))
        return np.concatenate([moved, np.linalg.norm(push, axis=1)[:, None]], axis=1)


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
    """Thinned curves of a log. The log is read chunk by chunk, so that the required memory depends on `bins` and not on the
    duration.

    joints, quantities: names; None: all, including derived quantities. start, end: limits of the part of the log to read, s.
    Raises LogError for unknown names, files that are not logs, and a part without samples.
    """
    source = CurveSource(path, joints=joints, quantities=quantities, bodies=bodies, start=start, end=end)
    chunks = source.chunks()
    head = next(chunks)
    first, last = source.span(float(head[0].time[0]))
    envelope = Envelope(start=first, end=last, bins=bins)
    for part, matrix in chain([head], chunks):
        envelope.add(part.time, matrix)
    curves = {}
    for index, column in enumerate(source.columns):
        time, values = envelope.column(index)
        if np.isfinite(values).any():
            curves[column] = Curve(time=time, values=values)
    return source.run(curves, envelope.samples)


def require_curves(runs: Sequence[RunCurves], quantities: Sequence[str]) -> None:
    """Raise LogError for quantities of which the selected joints of all runs have neither a curve nor logged values."""
    selected = [(run, joint) for run in runs for joint in run.joints]
    lacking = [
        name for name in quantities if not any(run.get(joint.name, name) or name in joint.quantities for run, joint in selected)
    ]
    if not (runs and lacking):
        return
    others = [read_curves(run.path, quantities=lacking, bodies=False) for run in runs]
    names = [f"'{name}'" for name in dict.fromkeys(joint.name for _, joint in selected)]
    who = f"joint {names[0]} has" if len(names) == 1 else f"joints {', '.join(names)} have"
    problems = []
    for name in lacking:
        owners = dict.fromkeys(joint for run in others for joint, quantity in run.curves if quantity == name)
        rest = f"; {', '.join(owners)} {'has' if len(owners) == 1 else 'have'} it" if owners else ""
        problems.append(
            Problem(f"{who} no quantity '{name}'{rest}", file=runs[0].path, key="quantity", code="unknown-quantity")
        )
    raise LogError(problems)


def distinct_labels(runs: Sequence[RunCurves]) -> list[RunCurves]:
    """The runs with distinct labels. The labels are the present labels if these are distinct, or the parts of the paths in
    which the runs differ, or the present labels with numbers."""
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


def drawable_quantities(reader: LogReader) -> tuple[str, ...]:
    """All quantities that can be drawn from a log: first the stored quantities, then the derived quantities."""
    stored = dict.fromkeys(name for joint in reader.info.joints for name in joint.quantities)
    derived = [name for name in DERIVED if "link_position" in stored or name == "equilibrium_position"]
    return (*(name for name in QUANTITIES if name in stored), *(name for name in stored if name not in QUANTITIES), *derived)


def require_names(reader: LogReader, kind: str, names: Sequence[str], choices: Sequence[str]) -> None:
    """Raise LogError for names that are not among the choices. kind: `joint` or `quantity`."""
    unknown = [name for name in names if name not in choices]
    if unknown:
        raise LogError(
            Problem(
                f"the log has no {kind} '{name}'",
                file=reader.path,
                key=kind,
                choices=tuple(choices),
                meant=name,
                code=f"unknown-{kind}",
            )
            for name in unknown
        )


def _members(reader: LogReader, names: Sequence[str] | None) -> tuple[JointInfo, ...]:
    by_name = {joint.name: joint for joint in reader.info.joints}
    require_names(reader, "joint", names or (), tuple(by_name))
    return reader.info.joints if names is None else tuple(by_name[name] for name in dict.fromkeys(names))


def _names(reader: LogReader, members: Sequence[JointInfo], names: Sequence[str] | None) -> tuple[str, ...]:
    choices = drawable_quantities(reader)
    if names is None:
        mine = {name for joint in members for name in joint.quantities} | set(DERIVED)
        return (*(name for name in choices if name in mine), *([REFERENCE] if "link_position" in choices else []))
    require_names(reader, "quantity", names, (*choices, *EXTRA))
    return tuple(dict.fromkeys(names))


def stored(names: Sequence[str], joints: Sequence[JointInfo]) -> list[str]:
    """Names of the quantities, stored for at least one of the joints, from which the given quantities are computed."""
    return recorded_sources(["position_error" if name == REFERENCE else name for name in names], joints)


def table(part: Samples, names: Sequence[str], joints: Sequence[JointInfo]) -> dict[str, Array]:
    """Values (n, joints) of each quantity, stored or derived."""
    found: dict[str, Array] = {}
    # Suppress NumPy's warning about infinite values of a diverged run, whose differences are NaN.
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
