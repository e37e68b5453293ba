"""A recording followed by a twin: what acted on the robot while it was recorded, as table, CSV and picture."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import InputError, RecordingError
from asrsim.metrics.lag import estimate_lag
from asrsim.outfile import csv_text, make_folder, write_text
from asrsim.plots.output import save_figure, styled
from asrsim.recordings import Column, read_recording, resample
from asrsim.recordings.matching import match_joints
from asrsim.samples import Array
from asrsim.scenario.overrides import override_texts
from asrsim.simulation.drives import references_of
from asrsim.simulation.prepare import prepare
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.simulation import Simulation
from asrsim.twin.twin import Twin

MARK = "# asrsim twin: what acted on the robot"
APART = 0.02
"""s between the clocks of positions and commands that are told."""


@dataclass(frozen=True, kw_only=True)
class Followed:
    """What a twin found in a recording; arrays are (n, joints)."""

    joints: tuple[str, ...]
    time: Array
    """(n,) s on the recording's clock."""
    external_torque: Array
    stiffness: Array
    residual: Array
    threshold: Array
    alarm: NDArray[np.bool_]
    notes: tuple[str, ...]
    """What was wrong with the recording, or went wrong on the way."""
    interrupted: bool = False

    def alarms(self, joint: int) -> list[tuple[float, float]]:
        """(start, end) in s of each alarm of a joint."""
        edges = np.flatnonzero(np.diff(np.concatenate([[False], self.alarm[:, joint], [False]]).astype(int)))
        return [(float(self.time[a]), float(self.time[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)]

    def rows(self) -> list[dict[str, Any]]:
        """Plain values of each joint; None where there is none."""
        found = []
        for j, name in enumerate(self.joints):
            torque, known = self.external_torque[:, j], self.stiffness[:, j][np.isfinite(self.stiffness[:, j])]
            seen = np.isfinite(torque)
            most = int(np.nanargmax(np.abs(torque))) if seen.any() else None
            found.append({
                "joint": name,
                "external_torque_rms": None if most is None else float(np.sqrt(np.nanmean(torque**2))),
                "largest": None if most is None else float(torque[most]),
                "largest_at": None if most is None else float(self.time[most]),
                "residual_rms": float(np.sqrt(np.nanmean(self.residual[:, j] ** 2))) if seen.any() else None,
                "alarms": self.alarms(j),
                "stiffness": [float(known.min()), float(known.max())] if len(known) else None,
            })  # fmt: skip
        return found


def follow(
    scenario: Path, recording: Path, *, bandwidth: float | None = None, mapping: Any = None, rate: float | None = None,
    lag: float = 0.0, variant: str | None = None, overrides: Sequence[str] | Mapping[str, Any] = (),
    progress: Callable[[float], None] = lambda share: None, stop: Callable[[], bool] = lambda: False,
) -> Followed:  # fmt: skip
    """Let a twin follow a recording of positions and commands.

    Args:
        scenario: Of the robot; its step is made that of the recording, where that is longer.
        recording: Any file that :func:`asrsim.recordings.read_recording` takes; mapping, rate: as it takes them.
        bandwidth: Hz, of the observer; None: 8, or a twentieth of the rate where that is less.
        lag: s by which the clock of the positions is ahead of that of the commands.
        variant, overrides: Of the scenario. progress: told the share that is done. stop: asked; True ends it.

    Raises:
        RecordingError: No position of any joint of the robot is recorded. InputError: bandwidth. What prepare raises.
    """
    texts = tuple(override_texts(overrides))
    ready = prepare(scenario, variant=variant, overrides=texts)
    names = [drive.name for drive in ready.drives]
    read = read_recording(recording, mapping=mapping, joints=names, rate=rate)
    pairing, findings = match_joints(names, read)
    columns = {
        (pairing[str(column.joint)], str(column.quantity)): column
        for column in read.channels.values()
        if column.joint in pairing
    }
    notes = [str(one) for one in findings]
    positions = {joint: columns[joint, "link_position"] for joint in names if (joint, "link_position") in columns}
    if not positions:
        message = "has no position of any link: a twin needs link_position"
        raise RecordingError(
            message, file=recording, hint=f"Columns: {', '.join(list(read.channels)[:30])}", code="twin-positions"
        )
    first = next(iter(positions.values())).time - lag
    step = round(float(np.median(np.diff(first))), 6)
    if step > 1.5 * ready.scenario.step:
        ready = prepare(scenario, variant=variant, overrides=(*texts, f"step={step}", f"duration={100 * step:.9g}"))
    time = np.arange(first[0], first[-1] + 1e-9, ready.scenario.step)
    measured = np.full((len(time), len(names)), np.nan)
    for joint, column in positions.items():
        measured[:, names.index(joint)] = resample(column.time - lag, column.values, time)
    notes += [f"{joint}: no position is recorded: its twin runs free" for joint in names if joint not in positions]
    commands = dict(_commands(ready, columns, time, notes))
    notes += _clocks(ready, commands, measured, time)
    bandwidth = min(8.0, 0.05 / ready.scenario.step) if bandwidth is None else bandwidth
    return _run(ready, names, measured, commands, time, bandwidth, notes, progress, stop)


def _commands(
    ready: Prepared, columns: Mapping[tuple[str, str], Column], time: Array, notes: list[str]
) -> Iterator[tuple[tuple[str, str], Array]]:
    """(joint, reference) -> (n,) values, each held until the next."""
    for drive in ready.drives:
        # An SEA has one reference in every mode.
        count = drive.actuator.motors + drive.actuator.adjuster if drive.actuator else 0
        for i, reference in enumerate(references_of(drive)[:count], start=1):
            column = columns.get((drive.name, f"reference_{i}"))
            if column is None:
                notes.append(f"{drive.name}: no command {reference} is recorded: it follows the scenario")
                continue
            keep = np.isfinite(column.values)
            stamps, values = column.time[keep], column.values[keep]
            if not len(stamps) or stamps[0] > time[-1] or stamps[-1] < time[0]:
                ends = "" if not len(stamps) else f", {stamps[0]:g} to {stamps[-1]:g} s,"
                text = f"its command {reference}{ends} is not of the time of the positions, {time[0]:g} to {time[-1]:g} s"
                notes.append(f"{drive.name}: {text}: it follows the scenario")
                continue
            at = np.searchsorted(stamps, time + 1e-9, side="right") - 1
            yield (drive.name, reference), values[np.maximum(at, 0)]


def _clocks(ready: Prepared, commands: Mapping[tuple[str, str], Array], measured: Array, time: Array) -> Iterator[str]:
    """Whether the positions come later, or earlier, after the commands than the model says."""
    if not commands:
        return
    with Simulation(ready, expected_substeps=10**6, duration=1e7) as simulation:
        moved = np.full_like(measured, np.nan)
        try:
            for k in range(len(time)):
                for (joint, reference), values in commands.items():
                    simulation.set_reference(joint, reference, float(values[k]))
                moved[k] = simulation.observe().link_position
                simulation.advance()
        except InputError:
            raise
        except Exception:  # a robot whose model runs away shows nothing
            return
    for j, joint in enumerate(simulation.joints):
        found = estimate_lag(time, moved[:, j], time, measured[:, j], limit=min(1.0, 0.25 * float(time[-1] - time[0])))
        if found is not None and found.is_trusted and abs(found.seconds) > APART:
            when = "later" if found.seconds > 0.0 else "earlier"
            text = f"its positions come {abs(found.seconds):.3g} s {when} after the commands than the model says"
            yield f"{joint}: {text}: are their clocks apart? --lag {found.seconds:.3g} moves them"


def _run(
    ready: Prepared, names: Sequence[str], measured: Array, commands: Mapping[tuple[str, str], Array], time: Array,
    bandwidth: float, notes: list[str], progress: Callable[[float], None], stop: Callable[[], bool],
) -> Followed:  # fmt: skip
    found: dict[str, Array] = {
        name: np.full(measured.shape, np.nan) for name in ("external_torque", "stiffness", "residual", "threshold", "alarm")
    }
    done = len(time)
    with Twin(ready, bandwidth=bandwidth) as twin:
        for k in range(len(time)):
            if k % 200 == 0:
                progress(k / len(time))
                if stop():
                    done = k
                    break
            orders: dict[str, dict[str, float]] = {}
            for (joint, reference), values in commands.items():
                orders.setdefault(joint, {})[reference] = float(values[k])
            step = twin.step(measured[k], orders)
            for name, table in found.items():
                table[k] = getattr(step, name)
            notes += [f"{time[k]:.3f} s: {note}" for note in step.notes]
    kept = {name: table[:done] for name, table in found.items() if name != "alarm"}
    return Followed(
        joints=tuple(names), time=time[:done], alarm=found["alarm"][:done] == 1.0, notes=tuple(dict.fromkeys(notes)),
        interrupted=done < len(time), **kept,
    )  # fmt: skip


def write(found: Followed, folder: Path, *, plot: bool = True) -> list[Path]:
    """twin.csv and twin.png. Raises OutputError."""
    headings, columns = ["time [s]"], [found.time]
    for j, name in enumerate(found.joints):
        headings += [f"{name}.external_torque [N m]", f"{name}.stiffness [N m/rad]", f"{name}.residual [rad]", f"{name}.alarm"]
        columns += [found.external_torque[:, j], found.stiffness[:, j], found.residual[:, j], found.alarm[:, j].astype(float)]
    path = make_folder(folder) / "twin.csv"
    write_text(path, f"{MARK}\n{csv_text(headings, np.column_stack(columns))}", "twin")
    return [path, *(_draw(found, folder) if plot else [])]


def _draw(found: Followed, folder: Path) -> list[Path]:
    with styled(mathematics=False):
        from matplotlib.figure import Figure

        count = len(found.joints)
        figure = Figure(figsize=(10.0, 1.2 + 1.8 * count), layout="constrained")
        for (left, right), j in zip(figure.subplots(count, 2, squeeze=False, sharex=True), range(count), strict=True):
            torque, limit = found.external_torque[:, j], found.threshold[:, j]
            left.fill_between(found.time, -limit, limit, color="0.92", linewidth=0.0, label="no alarm")
            left.plot(found.time, torque, linewidth=0.9)
            for number, (start, end) in enumerate(found.alarms(j)):
                left.axvspan(start, end, color="#d55e00", alpha=0.3, linewidth=0.0, label="" if number else "alarm")
            most = np.nanmax(np.abs(torque)) if np.isfinite(torque).any() else 1.0
            left.set_ylim(*(sign * 1.1 * max(most, float(np.median(limit))) for sign in (-1.0, 1.0)))
            left.set_ylabel(f"{found.joints[j]}\nexternal torque [N m]", fontsize="small")
            left.legend(fontsize="x-small", loc="upper right")
            right.plot(found.time, found.stiffness[:, j], linewidth=0.9)
            right.set_ylabel("stiffness [N m/rad]", fontsize="small")
            right.set_ylim(bottom=0.0)
            if not np.isfinite(found.stiffness[:, j]).any():
                right.text(0.5, 0.5, "the motion does not show it", ha="center", va="center", transform=right.transAxes)
            for axis in (left, right) if j == count - 1 else ():
                axis.set_xlabel("time [s]")
        return save_figure(figure, folder, "twin", ("png",))
