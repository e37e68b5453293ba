"""Compares a simulation with a recording: puts common quantities on a common clock, and computes their differences and
metrics.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from asrsim.errors import Problem, RecordingError
from asrsim.joint_units import unit_at
from asrsim.log.derived import own_reference
from asrsim.metrics.asked import AskedMeasure, asked_measures
from asrsim.metrics.measures import MEASURES, PAIR_MEASURES, STEP_MEASURES, measure
from asrsim.metrics.output import MetricRow
from asrsim.quantities import unit_of
from asrsim.recordings.align import (
    Alignment,
    LagChoice,
    align_recording,
    matched_columns,
    naming,
    require_overlap,
    resample,
    simulated,
)
from asrsim.recordings.data import Column, Recording
from asrsim.recordings.matching import match_joints
from asrsim.recordings.suspicions import beside, condense, interchanged
from asrsim.samples import Array, JointInfo, Samples


@dataclass(frozen=True, kw_only=True)
class Series:
    """Simulated and recorded series of one quantity of one joint."""

    joint: str
    """Name of the joint in the simulation."""
    quantity: str
    unit: str
    time: Array
    """Times (m,) on the simulation's clock, s. They are the sample times of the coarser record within the overlap."""
    simulation: Array
    """Simulated values (m,); NaN in gaps."""
    recording: Array
    """Recorded values (m,); NaN in gaps."""
    reading: str
    """Description of how the column was read."""
    metrics: Mapping[str, float]
    """Measures of the difference between simulation and recording, by name; NaN if a measure is undefined."""
    each: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Measures of single series, such as measures of a step response, by name. Each is a pair of values, for the simulation and
    for the recording. Each value is computed from the samples of the series' own record within the overlap.
    """
    findings: tuple[Problem, ...] = ()

    @property
    def difference(self) -> Array:
        """Simulated minus recorded values (m,)."""
        return self.simulation - self.recording


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Result of comparing a simulation with a recording."""

    recording: Path
    series: tuple[Series, ...]
    alignment: Alignment
    findings: tuple[Problem, ...] = ()
    """Problems of the comparison. The problems of the file are in the recording's `findings`."""

    def find(self, joint: str, quantity: str) -> Series | None:
        """Series of a joint's quantity; None if one of the records does not contain it."""
        return next((s for s in self.series if (s.joint, s.quantity) == (joint, quantity)), None)

    def rows(self, source: str = "") -> list[MetricRow]:
        """All metrics, as rows for tables, JSON and CSV. source: name of the simulation."""
        name = self.recording.name
        pair = f"{source} - {name}" if source else name
        rows: list[MetricRow] = []
        for s in self.series:
            values = [(pair, what, value) for what, value in s.metrics.items()]
            for what, (ours, recorded) in s.each.items():
                values += [(source or "simulation", what, ours), (name, what, recorded)]
            rows += [
                MetricRow(
                    source=of,
                    joint=s.joint,
                    quantity=s.quantity,
                    measure=what,
                    value=value,
                    unit=MEASURES.get(what.partition(":")[0]).unit_of(s.unit),
                )
                for of, what, value in values
            ]
        return rows


def compare(
    samples: Samples,
    recording: Recording,
    *,
    infos: Sequence[JointInfo] = (),
    quantities: Sequence[str] | None = None,
    lag: LagChoice = "auto",
    measures: Sequence[str] = (),
) -> Comparison:
    """Comparison of all quantities that the simulation and the recording share.

    Args:
        samples: Samples of the simulation, for example of a log.
        recording: The experiment.
        infos: The simulated joints (`RunInfo.joints`). Derived quantities (deflection, equilibrium, position error) need them.
        quantities: Quantities to compare; None: all shared quantities except energies.
        lag: See `LagChoice`: auto, off, start, or the delay of the recording in s.
        measures: Further measures, NAME or NAME:OPTION=VALUE,... Measures that need a reference compare the link position of
        the run with the reference of the run, and the link position of the recording with the reference of the recording.

    Raises:
        RecordingError: The simulation and the recording have no common joint, no common quantity, or no overlap in time.
        InputError: A measure is unknown, lacks a required option, or is a measure of bodies.
    """
    further = [one for one in asked_measures(measures) if one.text not in (*PAIR_MEASURES, *STEP_MEASURES)]
    pairing = match_joints(samples.joints, recording)
    columns, findings = matched_columns(recording, pairing, infos, quantities)
    found = {key: own for key in columns if (own := simulated(samples, *key, infos)) is not None}
    if findings and not found:
        raise RecordingError(condense(findings))
    if not found:
        recorded = sorted({c.meaning for c in recording.channels.values() if c.joint in pairing and c.quantity})
        asked = f" of {', '.join(quantities)}" if quantities else ""
        raise RecordingError(
            f"no common quantity{asked}: the recording has {', '.join(recorded)}; the simulation has "
            f"{', '.join(samples.values)} of {', '.join(samples.joints)}",
            file=recording.path,
            code="no-common-quantity",
        )

    by_name = {info.name: info for info in infos}
    alignment = align_recording(recording, pairing, lambda *_: samples, lag=lag, infos=infos)
    with naming(recording.path):
        series = tuple(
            _series(joint, name, samples.time, own, columns[joint, name], alignment.lag, by_name.get(joint))
            for (joint, name), own in found.items()
        )
    every, _ = matched_columns(recording, pairing, infos)
    records = [_records(one, found[one.joint, one.quantity], samples, every, infos, alignment.lag) for one in series]
    series = tuple(replace(one, each=_each(further, *own)) for one, own in zip(series, records, strict=True))
    findings += alignment.findings
    findings += condense(
        Problem(
            f"is not compared: the simulation has no joint {column.joint}",
            key=column.source,
            file=recording.path,
            code="no-such-joint",
        )
        for column in recording.channels.values()
        if column.quantity and column.joint is not None and column.joint not in pairing
    )
    for one in series:
        findings += [replace(p, file=recording.path, key=f"{one.joint}.{one.quantity}") for p in one.findings]
    for quantity in {one.quantity: None for one in series}:
        alike = [one for one in series if one.quantity == quantity]
        alike = [one for one in alike if np.array_equal(one.time, alike[0].time)]
        expected, measured = {one.joint: one.simulation for one in alike}, {one.joint: one.recording for one in alike}
        swapped = interchanged(expected, measured, {one.joint: columns[one.joint, quantity] for one in alike})
        findings += [replace(one, file=recording.path) for one in swapped]
    return Comparison(recording=recording.path, series=series, alignment=alignment, findings=tuple(findings))


def _series(
    joint: str,
    quantity: str,
    time: Array,
    values: Array,
    column: Column,
    lag: float,
    info: JointInfo | None,
) -> Series:
    shifted = column.time - lag
    start, end = require_overlap(time, column.time, lag)
    # Keep the samples of the coarser record, and interpolate the finer record, since interpolation of the finer record causes
    # the smaller error.
    coarse = np.median(np.diff(shifted)) >= np.median(np.diff(time))
    base = shifted if coarse else time
    slack = _slack(end)
    part = (base >= start - slack) & (base <= end + slack)
    grid = base[part]
    if len(grid) < 2:
        raise RecordingError(f"fewer than two samples of {joint}.{quantity} overlap in time", code="no-overlap")
    a = resample(time, values, grid) if coarse else values[part]
    b = column.values[part] if coarse else resample(shifted, column.values, grid)
    findings = beside(a, b, column, joint)
    both = np.isfinite(a) & np.isfinite(b)
    if both.sum() < 2:
        findings.append(Problem("has fewer than two samples with numbers in both records", code="no-overlap"))
    metrics = {name: measure(name, grid, a, b) if both.sum() > 1 else math.nan for name in PAIR_MEASURES}
    return Series(
        joint=joint,
        quantity=quantity,
        unit=(unit_of(quantity) if info is None else unit_at(quantity, info)) or column.unit,
        time=grid,
        simulation=a,
        recording=b,
        reading=column.reading,
        metrics=metrics,
        findings=tuple(findings),
    )


def _slack(end: float) -> float:
    """Time by which an overlap is widened, s, so that rounding in the last digit of a time stamp does not remove the last
    sample. end: end of the overlap, s.
    """
    return 1e-6 * max(1.0, abs(end))


@dataclass(frozen=True, kw_only=True)
class _Record:
    """Series of a record, at the sample times of this record."""

    time: Array
    """Times (n,) on the simulation's clock, s."""
    values: Array
    """Values (n,); NaN in gaps."""
    reference: Array | None
    """Reference (n,) of this record; None if it is unknown."""

    def within(self, start: float, end: float) -> _Record:
        """Part of the record between two times, s."""
        part = (self.time >= start) & (self.time <= end)
        reference = None if self.reference is None else self.reference[part]
        return _Record(time=self.time[part], values=self.values[part], reference=reference)


def _each(asked: Sequence[AskedMeasure], *records: _Record) -> dict[str, tuple[float, float]]:
    """Measures of run and recording, by name. Each value is computed with the samples and the reference of its own record. If
    neither record has a reference, measures that compare two series are left out.
    """
    ours, theirs = records
    steps = {name: (measure(name, ours.time, ours.values), measure(name, theirs.time, theirs.values)) for name in STEP_MEASURES}
    referred = any(one.reference is not None for one in records)
    return steps | {
        one.text: (one.of(ours.time, ours.values, ours.reference), one.of(theirs.time, theirs.values, theirs.reference))
        for one in asked
        if one.measure.needs != "pair" or referred
    }


def _records(
    series: Series,
    simulation: Array,
    samples: Samples,
    columns: Mapping[tuple[str, str], Column],
    infos: Sequence[JointInfo],
    lag: float,
) -> tuple[_Record, _Record]:
    """Run and recording of a series within their overlap. simulation: simulated values (n,) at the times of the samples;
    columns: columns of all quantities of the recording, since the measures of a link position need the references.
    """
    column = columns[series.joint, series.quantity]
    shifted = column.time - lag
    info = next((info for info in infos if info.name == series.joint), None)
    ours, theirs = None, None
    if info is not None and series.quantity == "link_position":
        values = {
            quantity: resample(other.time - lag, other.values, shifted)[:, None]
            for (joint, quantity), other in columns.items()
            if joint == info.name and quantity.startswith("reference")
        }
        ours = own_reference(samples, info)
        theirs = own_reference(Samples(time=shifted, joints=(info.name,), values=values), info)
    start, end = require_overlap(samples.time, column.time, lag)
    slack = _slack(end)
    runs = _Record(time=samples.time, values=simulation, reference=ours)
    recorded = _Record(time=shifted, values=column.values, reference=theirs)
    return runs.within(start - slack, end + slack), recorded.within(start - slack, end + slack)


@dataclass(frozen=True, kw_only=True)
class Band:
    """Range and mean of several recordings of one experiment, at common times."""

    time: Array
    """Times (m,) on the simulation's clock, s."""
    mean: Array
    """Mean (m,) of the recorded values."""
    low: Array
    """Smallest of the recorded values, (m,)."""
    high: Array
    """Largest of the recorded values, (m,)."""
    count: int
    """Number of recordings."""


def band(comparisons: Sequence[Comparison], joint: str, quantity: str) -> Band | None:
    """Band of several recordings of a joint's quantity, at the times of the first recording; None if no recording has the
    quantity.

    The band is NaN at times at which not all recordings are running, so that it does not jump when a recording begins or ends.
    In a gap of one recording, the band covers the other recordings.
    """
    found = [s for s in (c.find(joint, quantity) for c in comparisons) if s is not None]
    if not found:
        return None
    time = found[0].time
    runs = np.stack([s.recording if s.time is time else resample(s.time, s.recording, time) for s in found])
    known = np.isfinite(runs)
    within = np.maximum.accumulate(known, axis=1) & np.maximum.accumulate(known[:, ::-1], axis=1)[:, ::-1]
    runs[:, ~within.all(axis=0)] = np.nan
    with np.errstate(invalid="ignore"):  # at some times no recording has a value
        mean = np.nansum(runs, axis=0) / np.isfinite(runs).sum(axis=0)
    return Band(time=time, mean=mean, low=np.fmin.reduce(runs), high=np.fmax.reduce(runs), count=len(found))
