"""Measured torque over deflection, from a recording of a test bench, for a data sheet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from asrsim.actuators.vectorised import over_arrays
from asrsim.datasheet.sources import Source
from asrsim.errors import RecordingError
from asrsim.recordings import read_recording
from asrsim.samples import Array

MOST_POINTS = 1000
"""Largest number of measured points that are drawn."""


@dataclass(frozen=True, kw_only=True)
class MeasuredCurve:
    """Measured points of a curve of torque over deflection."""

    label: str
    deflection: Array
    """Equilibrium position of the motors minus link position (n,), rad."""
    torque: Array
    """Torque on the link (n,), N m."""
    doubts: tuple[str, ...] = ()
    """Sentences about numbers of the recording that are missing or doubtful."""


def measured_curve(
    source: Source, path: Path, mapping: Sequence[str] = (), *, rate: float | None = None, locked: bool = False
) -> MeasuredCurve:
    """Curve of torque over deflection in a recording. The deflection comes from a column `deflection`, or from motor and link
    positions. The torque is `link_torque`, or the sum of the elastic torques.

    mapping: meanings of columns, as items of `--map`; rate: sampling rate of a recording without time, Hz; locked: whether a
    link without recorded positions stands at 0. Raises RecordingError if a column is missing.
    """
    recording = read_recording(path, mapping=list(mapping) or None, joints=[source.drive.joint], rate=rate)
    channels = [one for one in recording.channels.values() if one.quantity and one.joint in (None, source.drive.joint)]
    columns = {str(one.quantity): one for one in channels}
    motors = [f"motor_{i}_position" for i in range(1, source.drive.actuator.motors + 1)]
    springs = [f"elastic_torque_{i}" for i in range(1, len(motors) + 1 - source.drive.actuator.housed)]
    torques = ["link_torque"] if "link_torque" in columns else [name for name in springs if name in columns]
    needed = ["deflection"] if "deflection" in columns else ["link_position", *motors]
    if locked and "link_position" not in columns:
        needed = [name for name in needed if name != "link_position"]
    missing = [name for name in needed if name not in columns] + ([] if torques else ["link_torque"])
    if missing:
        raise RecordingError(
            f"has no column for {', '.join(missing)}",
            file=path,
            code="no-such-quantity",
            choices=tuple(recording.channels),
            hint=f"Map a column with --map COLUMN={source.drive.joint}.{missing[0]}",
        )
    time = columns[torques[0]].time

    def values(name: str) -> Array:
        return np.interp(time, columns[name].time, columns[name].values)

    if needed == ["deflection"]:
        deflection = values("deflection")
    else:
        places = [values(name) for name in motors]
        places += [np.zeros_like(time)] * (source.drive.actuator.positions() - len(places))
        deflection = over_arrays(source.drive.actuator.equilibrium_position)(*places)
        if "link_position" in needed:
            deflection = deflection - values("link_position")
    torque = np.sum([values(name) for name in torques], axis=0)
    kept = slice(None, None, max(1, len(time) // MOST_POINTS))
    doubts = tuple(f"{path.name}: {doubt}" for doubt in recording.doubts)
    return MeasuredCurve(label=f"measured: {path.name}", deflection=deflection[kept], torque=torque[kept], doubts=doubts)
