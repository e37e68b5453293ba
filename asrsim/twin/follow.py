"""Lets a twin follow a recording, and writes the estimated external torques on the robot as a CSV file and a picture."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import RecordingError
from asrsim.metrics.lag import estimate_lag
from asrsim.outfile import csv_text, make_folder, write_text
from asrsim.plots import style
from asrsim.plots.chart import Chart, Line, Shade
from asrsim.plots.charts import save_charts
from asrsim.progress import Progress, Stop, Tell, never, tell_nobody
from asrsim.quantities import linear_unit
from asrsim.recordings import read_recording, resample
from asrsim.samples import Array
from asrsim.scenario.overrides import override_texts
from asrsim.scenario.recording_plan import RecordingPlan, make_plan
from asrsim.signals.base import Signal
from asrsim.signals.sampled import Sampled
from asrsim.simulation.prepare import prepare_worlds
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.worlds import Worlds
from asrsim.twin.twin import Twin, TwinStep

MARK = "# asrsim twin: external torques on the robot"
APART = 0.02
"""The user gets a note if the clocks of the positions and of the commands differ by more than this time, s."""
LONGEST = 60.0
"""Duration of the first part of a recording, in which these two clocks are compared, s."""
FIELDS = ("external_torque", "stiffness", "residual", "threshold", "alarm")
"""Fields of `TwinStep` that are stored for every step."""
UNITS = {"external_torque": "N m", "stiffness": "N m/rad", "residual": "rad"}
"""Units of these fields for a revolute joint."""


@dataclass(frozen=True, kw_only=True)
class Followed:
    """Estimates of a twin over a recording. The arrays without a docstring are (n, joints); see `asrsim.twin.TwinStep`."""

    name: str
    """Name of the scenario."""
    joints: tuple[str, ...]
    units: Mapping[str, tuple[str, ...]]
    """Units of each field in `UNITS`, one for each joint."""
    time: Array
    """Times (n,) on the clock of the commands, s."""
    positions: Array
    """Measured positions (n, joints) of the links, rad (m); NaN if a position is not recorded."""
    external_torque: Array
    stiffness: Array
    residual: Array
    threshold: Array
    alarm: NDArray[np.bool_]
    notes: tuple[str, ...]
    """Messages for the user about faults of the recording, and notes of the twin from its steps."""
    interrupted: bool = False

    def alarms(self, joint: int) -> list[tuple[float, float]]:
        """Start and end of each alarm of a joint, s."""
        edges = np.flatnonzero(np.diff(self.alarm[:, joint], prepend=False, append=False))
        return list(zip(self.time[edges[::2]].tolist(), self.time[edges[1::2] - 1].tolist(), strict=True))

    def rows(self) -> list[dict[str, Any]]:
        """Results of each joint with recorded positions, as plain data for JSON."""
        found = []
        for j, name in enumerate(self.joints):
            torque, residual, stiffness = self.external_torque[:, j], self.residual[:, j], self.stiffness[:, j]
            if not np.isfinite(torque).any():
                continue
            largest, known = int(np.nanargmax(np.abs(torque))), np.isfinite(stiffness)
            found.append(
                {
                    "joint": name,
                    "alarms": self.alarms(j),
                    "external_torque_rms": float(np.sqrt(np.nanmean(torque**2))),
                    "largest": float(torque[largest]),
                    "largest_at": float(self.time[largest]),
                    "residual_rms": float(np.sqrt(np.nanmean(residual**2))),
                    "stiffness": [float(stiffness[known].min()), float(stiffness[known].max())] if known.any() else None,
                }
            )
        return found


def follow_recording(
    scenario: Path,
    recording: Path,
    *,
    bandwidth: float | None = None,
    mapping: Any = None,
    rate: float | None = None,
    clock_offset: float = 0.0,
    variant: str | None = None,
    overrides: Sequence[str] | Mapping[str, Any] = (),
    progress: Tell = tell_nobody,
    stop: Stop = never,
    watch: Callable[[float, Array, TwinStep], None] = lambda time, positions, found: None,
) -> Followed:
    """Estimates of a twin that follows recorded positions and commands.

    Args:
        scenario: Scenario of the robot. If the sampling interval of the recording is clearly longer than the scenario's step,
            it replaces the step.
        recording: Any file that `asrsim.recordings.read_recording` reads.
        bandwidth: Bandwidth of the observer, Hz; None: 8 Hz, but at most a twentieth of the number of steps per second.
        mapping, rate: As for `read_recording`.
        clock_offset: Time by which the clock of the positions is ahead of the clock of the commands, s. It is subtracted from
        the times of the positions.
        variant, overrides: As for `asrsim.run`.
        progress: Function that is called with the finished fraction of the recording.
        stop: Function that is called often. If it returns True, the twin ends early.
        watch: Function that is called after each step with the time in s, the measured positions (n,) and the twin's estimates.

    Raises:
        RecordingError: The recording has no link position of a joint of the robot, or has wrong units.
        InputError: The bandwidth is out of range.
        AsrsimError: Errors of `asrsim.prepare`.
    """
    texts = tuple(override_texts(overrides))
    ready = prepare_worlds(scenario, variant=variant, overrides=texts)
    names = [drive.name for drive in ready.drives]
    read = read_recording(recording, mapping=mapping, joints=names, rate=rate)
    plan = make_plan(ready.robot, read, step=ready.scenario.step, idle=())
    positions = {joint: column for joint, column in plan.compared if column.quantity == "link_position"}
    if not positions:
        message, hint = "has no position of a link: a twin needs link_position", ", ".join(list(read.channels)[:30])
        raise RecordingError(message, file=recording, hint=f"Columns: {hint}", code="twin-positions")
    stamps = next(iter(positions.values())).time - clock_offset
    step = round(float(np.median(np.diff(stamps))), 6)
    changes = [f"modes.{joint}={mode}" for joint, mode in plan.modes.items()]
    if step > 1.5 * ready.scenario.step:
        changes += [f"step={step}", f"duration={100 * step:.9g}"]
    if changes:
        ready = prepare_worlds(scenario, variant=variant, overrides=(*texts, *changes))
    time = np.arange(stamps[0], stamps[-1] + 1e-9, ready.scenario.step)
    measured = np.full((len(time), len(names)), np.nan)
    for joint, column in positions.items():
        measured[:, names.index(joint)] = resample(column.time - clock_offset, column.values, time)
    notes = [*read.doubts, *plan.remarks, *map(str, plan.exceeded)]
    notes += [
        (f"{joint}: no position is recorded, so the twin of this joint is not corrected")
        for joint in names
        if joint not in positions
    ]
    ready = ready.with_references(_commands(ready, plan, time, notes))
    if any(one.slot == 0 for one in plan.played):
        notes += _clocks(ready, measured, time)
    rows: list[Array] = []
    with Twin(ready, bandwidth=min(8.0, 0.05 / ready.scenario.step) if bandwidth is None else bandwidth) as twin:
        for row, at in zip(measured, time.tolist(), strict=True):
            if len(rows) % 200 == 0:
                progress(Progress(task="twin", fraction=len(rows) / len(time)))
                # Ignore `stop` before the first step, since files without a step cannot be written.
                if rows and stop():
                    break
            found = twin.step(row, {})
            rows.append(np.array([getattr(found, name) for name in FIELDS]))
            watch(at, row, found)
            notes += [f"{at:.3f} s: {note}" for note in found.notes]
    table = dict(zip(FIELDS, np.array(rows).swapaxes(0, 1), strict=True))
    slides = [drive.joint.kind == "prismatic" for drive in ready.drives]
    units = {field: tuple(linear_unit(unit) if sliding else unit for sliding in slides) for field, unit in UNITS.items()}
    return Followed(
        name=ready.scenario.name,
        joints=tuple(names),
        units=units,
        time=time[: len(rows)],
        positions=measured[: len(rows)],
        notes=tuple(dict.fromkeys(notes)),
        interrupted=len(rows) < len(time),
        **{**table, "alarm": table["alarm"] == 1.0},
    )


def _commands(ready: Prepared, plan: RecordingPlan, time: Array, notes: list[str]) -> dict[str, dict[str, Signal]]:
    """Recorded commands as signals, by joint and by name of the reference. Time 0 of the signals is the time of the first
    step.
    """
    played = {(one.joint, one.slot): one for one in plan.played}
    found: dict[str, dict[str, Signal]] = {drive.name: {} for drive in ready.drives}
    for drive in ready.drives:
        for slot, reference in enumerate(drive.acting_references):
            if (one := played.get((drive.name, slot))) is None:
                notes.append(f"{drive.name}: no command {reference} is recorded, so this reference follows the scenario")
                continue
            good = np.isfinite(one.column.values)
            stamps, values = one.column.time[good], one.column.values[good]
            if stamps[0] > time[-1] or stamps[-1] < time[0]:
                text = f"{stamps[0]:g} to {stamps[-1]:g} s, does not overlap the positions, {time[0]:g} to {time[-1]:g} s"
                notes.append(f"{drive.name}: its command {reference}, {text}, so this reference follows the scenario")
                continue
            if one.hold:
                # A held command jumps at each sample, so give each sample time two values, before and after the jump.
                stamps, values = np.repeat(stamps, 2)[1:], np.repeat(values, 2)[:-1]
            found[drive.name][reference] = Sampled(times=stamps - time[0], samples=values)
    return found


def _clocks(ready: Prepared, measured: Array, time: Array) -> Iterator[str]:
    """Notes on joints whose measured positions lag behind the commands by more or less time than the model's positions."""
    count = min(len(time), round(LONGEST / ready.scenario.step))
    time = time[:count] - time[0]
    with Worlds(ready, 1, watched=False) as worlds:
        moved = worlds.rollout(["link_position"], steps=count - 1)["link_position"][0]
    for j, drive in enumerate(ready.drives if np.isfinite(moved).all() else ()):
        found = estimate_lag(time, moved[:, j], time, measured[:count, j], limit=min(1.0, 0.25 * float(time[-1])))
        if found is not None and abs(found.seconds) > APART:
            when = "later" if found.seconds > 0.0 else "earlier"
            text = f"its positions follow the commands {abs(found.seconds):.3g} s {when} than in the model"
            yield f"{drive.name}: {text}: do their clocks differ? --clock-offset {found.seconds:.3g} aligns them"


def write(found: Followed, folder: Path, *, plot: bool = True) -> list[Path]:
    """Write twin.csv and twin.png, and return their paths. Raises OutputError."""
    headings, columns = ["time [s]"], [found.time]
    for j, joint in enumerate(found.joints):
        headings += [*(f"{joint}.{field} [{units[j]}]" for field, units in found.units.items()), f"{joint}.alarm"]
        columns += [getattr(found, field)[:, j] for field in (*UNITS, "alarm")]
    path = make_folder(folder) / "twin.csv"
    write_text(path, f"{MARK}\n{csv_text(headings, np.column_stack(columns))}", "twin")

    title = f"{found.name} · external torques found by the twin"
    return [path, *(save_charts(folder / "twin.png", charts(found), title=title) if plot else [])]


def charts(found: Followed) -> list[list[Chart]]:
    """Charts in rows, one row for each joint: external torque with its threshold and alarms, and stiffness while it is
    known.
    """
    rows = []
    for j, joint in enumerate(found.joints):
        torque, limit, alarm = found.external_torque[:, j], found.threshold[:, j], found.alarm[:, j]
        unit, stiff = (found.units[field][j] for field in ("external_torque", "stiffness"))
        bands = [
            Shade(label="no alarm", x=found.time, low=-limit, high=limit, colour=style.LIGHT, opacity=0.3),
            Shade(label="alarm", x=found.time, low=-limit, high=limit, colour=style.VERMILION, opacity=0.35, where=alarm),
        ]
        line = Line(label="external torque", x=found.time, y=torque, colour=style.SKY)
        known = np.abs(torque[np.isfinite(torque)])
        most = 1.1 * float(max(known.max(initial=0.0), np.nanmedian(limit))) or 1.0
        stiffness = found.stiffness[:, j]
        above = float(np.nanmax(stiffness, initial=0.0))
        rows.append(
            [
                Chart(head=joint, words="external torque", unit=unit, lines=[line], bands=bands, span=(-most, most)),
                Chart(
                    words="stiffness",
                    unit=stiff,
                    span=(0.0, 1.1 * above or 1.0),
                    lines=[Line(label="", x=found.time, y=stiffness, colour=style.colour("stiffness"))],
                ),
            ]
        )
    return rows
