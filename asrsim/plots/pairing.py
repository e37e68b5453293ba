"""Assignment of recordings to runs, and comparison of runs with their recordings."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from asrsim import __version__
from asrsim.errors import InputError, Problem, RecordingError
from asrsim.log import LogReader, open_log
from asrsim.metrics import MetricRow
from asrsim.outfile import write_text
from asrsim.plots.curves import drawable_quantities
from asrsim.plots.decimate import BINS, Curve, decimate
from asrsim.quantities import is_comparable
from asrsim.recordings import Comparison, Recording, band, compare
from asrsim.recordings.align import Alignment, LagChoice, align_recording, simulated_sources
from asrsim.recordings.matching import match_joints
from asrsim.samples import Array, Samples

RECORDED = "recorded.json"
"""Name of the file with the recorded curves of a comparison, which a report draws."""


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Quantity of a joint in a run and in its recordings, thinned for a picture."""

    joint: str
    quantity: str
    simulation: Curve
    recording: Curve
    """Curve of the recording, or the mean curve of several recordings."""
    difference: Curve
    """Simulation minus recording, or minus the mean of several recordings."""
    low: Curve | None = None
    """Smallest value of several recordings, at the times of `high`."""
    high: Curve | None = None
    count: int = 1
    """Number of recordings."""
    rmse: float
    """Root mean square of the difference, in the unit of the quantity; for several recordings the mean of their root mean
    squares.
    """
    nrmse: float
    """`rmse` divided by the range of the recording."""


@dataclass(frozen=True, kw_only=True)
class RunComparison:
    """Comparison of a run with its recordings."""

    label: str
    recordings: tuple[Path, ...]
    pairs: Mapping[tuple[str, str], Pair]
    """Curves of run and recordings for each (joint, quantity)."""
    alignments: Mapping[str, Alignment]
    """Shift of each recording's clock, by the name of the recording."""
    joints: Mapping[str, Mapping[str, str]]
    """For each recording (by name): the joint of the run that corresponds to each joint of the recording."""
    rows: tuple[MetricRow, ...]
    findings: tuple[Problem, ...] = ()


def assign(labels: Sequence[str], files: Sequence[str]) -> list[tuple[Path, int | None]]:
    """Recordings with the index of their run, parsed from `VARIANT=FILE`; None: the recording belongs to all runs.

    Raises InputError for a variant that no run has.
    """
    chosen: list[tuple[Path, int | None]] = []
    for text in files:
        variant, equals, name = text.partition("=")
        if not equals or not variant or Path(text).exists():
            chosen.append((Path(text), None))
        elif variant in labels:
            chosen.append((Path(name), labels.index(variant)))
        else:
            message = f"no log is labelled '{variant}'"
            raise InputError(Problem(message, key="experiment", choices=tuple(labels), meant=variant, code="unknown-variant"))
    return chosen


def compare_run(
    path: Path,
    recordings: Sequence[Recording],
    *,
    label: str,
    joints: Sequence[str] | None = None,
    quantities: Sequence[str] | None = None,
    lags: Mapping[str, LagChoice],
    measures: Sequence[str] = (),
) -> RunComparison:
    """Comparison of a log with recordings of one experiment.

    joints, quantities: names; None: all. lags: lag of each recording, by its path. measures: further
    measures, NAME or NAME:OPTION=VALUE,... Raises RecordingError if log and recordings have no common joint or quantity, or do
    not overlap in time; and LogError.
    """
    reader = open_log(path)
    infos = reader.info.joints
    pairings = [match_joints([joint.name for joint in infos], recording) for recording in recordings]
    paired, common = _in_both(reader, recordings, pairings, joints, quantities)

    def read(quantities: Sequence[str], joints: Sequence[str]) -> Samples:
        return reader.read(quantities=quantities, joints=joints).samples

    alignments: dict[str, Alignment] = {}
    for recording, pairing in zip(recordings, pairings, strict=True):
        name = str(recording.path)
        alignments[name] = align_recording(recording, pairing, read, lag=lags[name], infos=infos)
    # For further measures, also read the position error, since measures of a link position may need the joint's reference.
    stored = simulated_sources([*common, *(["position_error"] if measures else [])], infos)
    samples = reader.read(quantities=stored, joints=paired).samples
    compared = []
    for recording, pairing in zip(recordings, pairings, strict=True):
        if {*pairing.values()} & {*paired}:
            lag = alignments[str(recording.path)].lag
            compared.append(compare(samples, recording, infos=infos, quantities=common, lag=lag, measures=measures))
    findings = [problem for alignment in alignments.values() for problem in alignment.findings]
    findings += [problem for one in compared for problem in one.findings]
    return RunComparison(
        label=label,
        recordings=tuple(recording.path for recording in recordings),
        pairs=_pairs(compared),
        alignments=alignments,
        joints={str(recording.path): pairing for recording, pairing in zip(recordings, pairings, strict=True)},
        rows=tuple(row for one in compared for row in one.rows(label)),
        findings=tuple(findings),
    )


def _in_both(
    reader: LogReader,
    recordings: Sequence[Recording],
    pairings: Sequence[Mapping[str, str]],
    joints: Sequence[str] | None,
    quantities: Sequence[str] | None,
) -> tuple[list[str], list[str]]:
    """Joints and quantities that the log and at least one recording have. Raises RecordingError if there are none."""
    wanted = [joint.name for joint in reader.info.joints if joints is None or joint.name in joints]
    paired = [name for name in wanted if any(name in pairing.values() for pairing in pairings)]
    recorded = {column.quantity for recording in recordings for column in recording.channels.values()}
    common = [name for name in drawable_quantities(reader) if is_comparable(name, quantities) and name in recorded]
    if not paired or not common:
        # The only purpose of this call is its error, which is more precise than the error below.
        if (first := next(reader.iter_samples(joints=sorted(wanted)), None)) is not None:
            compare(first, recordings[0], infos=reader.info.joints)
        message = "log and recording share none of the selected joints and quantities"
        raise RecordingError(message, file=recordings[0].path, code="nothing-shared")
    return paired, common


def _pairs(compared: Sequence[Comparison]) -> dict[tuple[str, str], Pair]:
    pairs: dict[tuple[str, str], Pair] = {}
    for key in dict.fromkeys((s.joint, s.quantity) for one in compared for s in one.series):
        found = [s for s in (one.find(*key) for one in compared) if s is not None]
        runs = band(compared, *key) if len(found) > 1 else None
        time, simulated, recorded = found[0].time, found[0].simulation, found[0].recording if runs is None else runs.mean
        low, high = (None, None) if runs is None else _hull(runs.time, runs.low, runs.high)
        pairs[key] = Pair(
            joint=key[0],
            quantity=key[1],
            simulation=_thin(time, simulated),
            recording=_thin(time, recorded),
            difference=_thin(time, simulated - recorded),
            low=low,
            high=high,
            count=len(found),
            **{name: float(np.mean([one.metrics[name] for one in found])) for name in ("rmse", "nrmse")},
        )
    return pairs


def _thin(time: Array, values: Array) -> Curve:
    moments, kept = decimate(time, values)
    return Curve(time=moments, values=kept)


def _hull(time: Array, low: Array, high: Array) -> tuple[Curve, Curve]:
    """Curves of the smallest and largest values over short intervals, at common times."""
    if len(time) > 2 * BINS:
        edges = np.unique(np.linspace(0, len(time), BINS + 1).astype(int)[:-1])
        time, low, high = time[edges], np.fmin.reduceat(low, edges), np.fmax.reduceat(high, edges)
    return Curve(time=time, values=low), Curve(time=time, values=high)


def write_recorded(path: Path, compared: Iterable[RunComparison]) -> Path:
    """Write the recorded curves, thinned and on the run's clock, for a report and return the file. Raises OutputError."""
    curves = [
        {
            "run": one.label,
            "joint": pair.joint,
            "quantity": pair.quantity,
            "time": [round(t, 6) for t in pair.recording.time.tolist()],
            "values": [float(f"{v:.6g}") if math.isfinite(v) else None for v in pair.recording.values.tolist()],
        }
        for one in compared
        for pair in one.pairs.values()
    ]
    data = {"generator": f"asrsim {__version__}", "curves": curves}
    write_text(path, json.dumps(data, separators=(",", ":"), allow_nan=False), "json")
    return path
