"""A simulation beside a recording: the same quantities on one time, their difference, and metrics."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from asrsim.errors import Problem, RecordingError
from asrsim.metrics.measures import MEASURES, PAIR_MEASURES, STEP_MEASURES, measure
from asrsim.metrics.output import MetricRow
from asrsim.quantities import is_comparable, unit_of
from asrsim.recordings.align import Alignment, LagChoice, align_recording, require_overlap, resample, simulated
from asrsim.recordings.data import Column, Recording
from asrsim.recordings.matching import match_joints, wrong_unit
from asrsim.recordings.suspicions import beside, condense
from asrsim.samples import Array, JointInfo, Samples


@dataclass(frozen=True, kw_only=True)
class Series:
    """One quantity of one joint, in both."""

    joint: str
    """Name in the simulation."""
    quantity: str
    unit: str
    time: Array
    """(m,) s on the simulation's clock: the samples of the coarser of both, where they overlap."""
    simulation: Array
    """(m,); NaN in gaps."""
    recording: Array
    """(m,); NaN in gaps."""
    source: str
    """Column of the recording."""
    reading: str
    """How that was read, in words."""
    metrics: Mapping[str, float]
    """Measures of the difference (simulation against recording); NaN where undefined."""
    steps: Mapping[str, tuple[float, float]]
    """Measures of a step response: (simulation, recording)."""
    findings: tuple[Problem, ...] = ()

    @property
    def difference(self) -> Array:
        """(m,) simulation minus recording."""
        return self.simulation - self.recording


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """A simulation and a recording, compared."""

    recording: Path
    series: tuple[Series, ...]
    alignment: Alignment
    joints: Mapping[str, str] = field(default_factory=dict)
    """Joint of the recording -> joint of the simulation."""
    findings: tuple[Problem, ...] = ()
    """Of the comparison; those of the file are in the recording."""

    def find(self, joint: str, quantity: str) -> Series | None:
        """The series of a joint's quantity, None if it is not in both."""
        return next((s for s in self.series if (s.joint, s.quantity) == (joint, quantity)), None)

    def rows(self, source: str = "") -> list[MetricRow]:
        """All metrics as rows for table, JSON and CSV. source: name of the simulation."""
        name = self.recording.name
        pair = f"{source} - {name}" if source else name
        rows: list[MetricRow] = []
        for s in self.series:
            rows += [_row(pair, s, what, value) for what, value in s.metrics.items()]
            for what, (ours, recorded) in s.steps.items():
                rows.append(_row(source or "simulation", s, what, ours))
                rows.append(_row(name, s, what, recorded))
        return rows


def compare(
    samples: Samples,
    recording: Recording,
    *,
    infos: Sequence[JointInfo] = (),
    joints: Mapping[str, str] | None = None,
    quantities: Sequence[str] | None = None,
    lag: LagChoice = "auto",
    lag_limit: float | None = None,
) -> Comparison:
    """Compares all quantities that the simulation and the recording have in common.

    Args:
        samples: Of the simulation (a log's).
        recording: The experiment.
        infos: The log's joints (:attr:`RunInfo.joints`), for derived quantities (deflection, equilibrium, position error).
        joints: Joint of the recording -> joint of the simulation; None: by name, or by order for guessed names.
        quantities: Only these; None: all in common but energies.
        lag: auto, off, start, or s by which the recording is late.
        lag_limit: s, largest lag that auto may find.

    Raises:
        RecordingError: No common joint or quantity, no overlap in time; with what was found and expected.
    """
    pairing, findings = match_joints(samples.joints, recording, joints)
    found: dict[tuple[str, str], tuple[Array, Column]] = {}
    known = {info.name: info for info in infos}
    wrong: list[Problem] = []
    for column in recording.channels.values():
        joint = pairing.get(column.joint or "")
        if joint is None or column.quantity is None or not is_comparable(column.quantity, quantities):
            continue
        values = simulated(samples, joint, column.quantity, infos)
        if values is None:
            continue
        info = known.get(joint)
        problem = None if info is None else wrong_unit(column, joint, prismatic=info.prismatic, mode=info.mode)
        if problem is not None:
            wrong.append(replace(problem, file=recording.path))
        else:
            found[joint, column.quantity] = (values, column)
    if wrong and not found:
        raise RecordingError(condense(wrong))
    findings += [replace(problem, message=f"{problem.message}; it is not compared") for problem in wrong]
    if not found:
        recorded = sorted({c.meaning for c in recording.channels.values() if c.joint in pairing and c.quantity})
        asked = f" of {', '.join(quantities)}" if quantities else ""
        raise RecordingError(
            f"no common quantity{asked}: the recording has {', '.join(recorded)}; the simulation has "
            f"{', '.join(samples.values)} of {', '.join(samples.joints)}", file=recording.path, code="no-common-quantity",
        )  # fmt: skip

    def series_of(joint: str, quantity: str) -> tuple[Array, Array] | None:
        values = simulated(samples, joint, quantity, infos)
        return None if values is None else (samples.time, values)

    prismatic = {info.name for info in infos if info.prismatic}
    alignment = align_recording(recording, pairing, series_of, lag=lag, limit=lag_limit, infos=infos)
    series = tuple(
        _series(joint, quantity, samples.time, values, column, alignment.lag, prismatic=joint in prismatic)
        for (joint, quantity), (values, column) in found.items()
    )
    findings += alignment.findings
    for one in series:
        findings += [replace(p, file=recording.path, key=f"{one.joint}.{one.quantity}") for p in one.findings]
    return Comparison(recording=recording.path, series=series, alignment=alignment, joints=pairing, findings=tuple(findings))


def _series(
    joint: str, quantity: str, time: Array, values: Array, column: Column, lag: float, *, prismatic: bool
) -> Series:  # fmt: skip
    shifted = column.time - lag
    start, end = require_overlap(time, column.time, lag)
    # The coarser one's samples are kept as they are; only the finer one is interpolated, where that costs least.
    coarse = np.median(np.diff(shifted)) >= np.median(np.diff(time))
    base = shifted if coarse else time
    # The last digit of a stamp must not cut off an end.
    slack = 1e-6 * max(1.0, abs(end))
    part = (base >= start - slack) & (base <= end + slack)
    grid = base[part]
    if len(grid) < 2:
        raise RecordingError(f"of {joint}.{quantity} less than two samples overlap in time", code="no-overlap")
    a = resample(time, values, grid) if coarse else values[part]
    b = column.values[part] if coarse else resample(shifted, column.values, grid)
    findings = beside(a, b, column, joint)
    unit = unit_of(quantity, prismatic=prismatic) or column.unit
    both = np.isfinite(a) & np.isfinite(b)
    if both.sum() < 2:
        findings.append(Problem("has no two samples with numbers in both", code="no-overlap"))
    metrics = {name: measure(name, grid, a, b) if both.sum() > 1 else math.nan for name in PAIR_MEASURES}
    steps = {name: (measure(name, grid, a), measure(name, grid, b)) for name in STEP_MEASURES}
    return Series(
        joint=joint, quantity=quantity, unit=unit, time=grid, simulation=a, recording=b, source=column.source,
        reading=column.reading, metrics=metrics, steps=steps, findings=tuple(findings),
    )  # fmt: skip


def _row(source: str, s: Series, name: str, value: float) -> MetricRow:
    unit = MEASURES.get(name).unit_of(s.unit)
    return MetricRow(source=source, joint=s.joint, quantity=s.quantity, measure=name, value=value, unit=unit)


@dataclass(frozen=True, kw_only=True)
class Band:
    """Several runs of one experiment, on one time."""

    time: Array
    """(m,) s on the simulation's clock."""
    mean: Array
    """(m,)."""
    low: Array
    """(m,) smallest of the runs."""
    high: Array
    """(m,) largest of the runs."""
    count: int
    """Runs."""


def band(comparisons: Sequence[Comparison], joint: str, quantity: str) -> Band | None:
    """The recordings of several comparisons with one simulation as a band, on the first's time; None if none has it.

    NaN before the last run begins and after the first one ends, so that the band never jumps there; in a run's gap inside, the
    band is that of the others.
    """
    found = [s for s in (c.find(joint, quantity) for c in comparisons) if s is not None]
    if not found:
        return None
    time = found[0].time
    runs = np.stack([s.recording if s.time is time else resample(s.time, s.recording, time) for s in found])
    known = np.isfinite(runs)
    within = np.maximum.accumulate(known, axis=1) & np.maximum.accumulate(known[:, ::-1], axis=1)[:, ::-1]
    there = within.all(axis=0) & known.any(axis=0)
    low, high, mean = (np.full(len(time), np.nan) for _ in range(3))
    low[there], high[there] = np.nanmin(runs[:, there], axis=0), np.nanmax(runs[:, there], axis=0)
    mean[there] = np.nanmean(runs[:, there], axis=0)
    return Band(time=time, mean=mean, low=low, high=high, count=len(found))
