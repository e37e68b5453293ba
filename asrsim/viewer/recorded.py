"""Shows a recording beside the subject of a page: the recorded robot as a ghost, and the recorded curves in the plots. The
recording's clock is aligned with the run's clock, as in `asrsim plot`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from asrsim.plots.claims import claimed_clocks, claimed_recording
from asrsim.recordings.align import LagChoice, SampleReader, align_recording, matched_columns, resample
from asrsim.recordings.matching import match_joints
from asrsim.samples import Array, RunInfo, Samples
from asrsim.viewer.history import History
from asrsim.viewer.subject import Companion


def recorded(
    path: Path,
    info: RunInfo,
    read: SampleReader,
    *,
    lag: LagChoice = "auto",
    mapping: Sequence[str] | Path | None = None,
    rate: float | None = None,
) -> Companion:
    """Recording as a companion of a run.

    Args:
        path: Path of the recording.
        info: Description of the run.
        read: Function (quantities, joints) that returns samples of the run.
        lag: As for `asrsim plot --align`; `auto` uses the lag that a claim of the run states, if there is such a claim.
        mapping, rate: As for `asrsim.recordings.read_recording`; if neither is given, the values that a claim of the run
            states.

    Raises:
        RecordingError: The recording and the run have no common joint or quantity, or do not overlap in time.
    """
    names = [joint.name for joint in info.joints]
    recording = claimed_recording(path, [info], mapping=mapping, rate=rate)
    pairing = match_joints(names, recording)
    claimed = claimed_clocks([info], [recording]) if lag == "auto" else {}
    alignment = align_recording(recording, pairing, read, lag=claimed.get(str(recording.path), lag), infos=info.joints)
    columns, _ = matched_columns(recording, pairing, info.joints)
    shift = alignment.lag
    moved = {joint: columns[joint, "link_position"] for joint in names if (joint, "link_position") in columns}
    history = None
    if moved:
        time = next(iter(moved.values())).time
        unknown = np.full(len(time), np.nan)
        positions = [resample(moved[joint].time, moved[joint].values, time) if joint in moved else unknown for joint in names]
        samples = Samples(time=time - shift, joints=tuple(names), values={"link_position": np.transpose(positions)})
        history = History(info.joints, samples)

    def curve(joint: str, quantity: str, start: float, end: float) -> tuple[Array, Array]:
        column = columns.get((joint, quantity))
        if column is None:
            return np.empty(0), np.empty(0)
        rows = slice(*np.searchsorted(column.time - shift, (start, end)).tolist())
        return column.time[rows] - shift, column.values[rows]

    notes = (f"{path.name}: lag {shift:.4g} s ({alignment.how})", *recording.doubts, *(p.message for p in alignment.findings))
    return Companion(label=path.name, curve=curve, history=history, notes=notes)
