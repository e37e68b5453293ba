"""Trial from a recording of the robot: link positions at the times of the motion, and findings about the recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from asrsim.errors import InputError, Problem, RecordingError
from asrsim.identification.noise import fine_noise
from asrsim.learning.plant import Plant
from asrsim.recordings.align import LagChoice, align, resample
from asrsim.recordings.data import Column, Recording
from asrsim.recordings.matching import match_joints, wrong_unit
from asrsim.recordings.suspicions import beside, interchanged
from asrsim.samples import Array

MISSING = 0.02
"""Largest fraction of the motion that may be missing at each of its ends. The nearest value is repeated in the missing part."""
BRIDGED = 0.1
"""Longest gap within the motion that is interpolated, s."""
DANGEROUS = ("suspected-marker", "suspected-lost", "suspected-turns")
"""Codes of suspicions with which a recording is refused, since its wrong numbers would change the robot's next input."""
OFF, BETTER = 0.05, 0.5
"""Conditions for a note about the clock of a recording. OFF: the offset of the clock must exceed this time, which is longer
than the delay of any robot, s. BETTER: after the clock is shifted, less than this fraction of the error must remain.
"""


@dataclass(frozen=True, kw_only=True)
class RecordedTrial:
    """Recorded trial of the robot."""

    outputs: Array = field(repr=False)
    """Link positions (n, joints) at the plant's times, rad or m."""
    clock: str
    """Method by which the recording's clock was aligned with the motion, as text."""
    findings: tuple[Problem, ...]
    """Findings about the file, its clock, its gaps and implausible columns."""
    noise: float
    """Standard deviation of the position noise, rad or m, the largest of all joints."""
    interval: float
    """Sampling interval, s."""


def recorded(recording: Recording, plant: Plant, lag: LagChoice) -> RecordedTrial:
    """Trial of the robot from a recording. lag: alignment of the recording's clock with the motion. Raises InputError if the
    recording is too short or lacks a joint. Also raises InputError if numbers, unit, sign or joint of a column are implausible,
    unless the user stated the meaning of the column.
    """
    pairing = match_joints(plant.joints, recording)
    named = {joint: name for name, joint in pairing.items()}
    columns = [recording.column(named.get(joint, joint), "link_position") for joint in plant.joints]
    moving = int(np.argmax(np.ptp(plant.reference, axis=0)))
    motion, measured = (plant.time, plant.reference[:, moving]), (columns[moving].time, columns[moving].values)
    name = f"{plant.joints[moving]}.link_position"
    chosen = align(*motion, *measured, choice=lag, name=name)
    outputs = np.column_stack([resample(column.time - chosen.lag, column.values, plant.time) for column in columns])
    findings = [*recording.findings, *chosen.findings, *_bridge(outputs, plant, recording, columns, chosen.lag)]
    wrong: list[Problem] = []
    for joint, column, wanted, values in zip(plant.joints, columns, plant.reference.T, outputs.T, strict=True):
        unit = wrong_unit(column, joint, prismatic=plant.unit(joint) == "m")
        wrong += [] if unit is None else [unit]
        odd = [replace(one, key=column.source) for one in beside(wanted, values, column, joint, than="the desired motion")]
        odd += [one for one in recording.findings if one.code in DANGEROUS and one.key == column.source]
        (findings if column.given else wrong).extend(odd)
    desired, seen, sources = (dict(zip(plant.joints, of, strict=True)) for of in (plant.reference.T, outputs.T, columns))
    swapped = [*interchanged(desired, seen, sources, than="the desired motion")]
    (findings if all(column.given for column in columns) else wrong).extend(swapped)
    if wrong:
        raise RecordingError(replace(problem, file=recording.path) for problem in wrong)
    if lag in ("off", "start"):
        better = align(*motion, *measured, choice="auto", name=name)
        there = resample(columns[moving].time - better.lag, columns[moving].values, plant.time)
        left, before = (np.sqrt(np.nanmean((motion[1] - values) ** 2)) for values in (there, outputs[:, moving]))
        if abs(better.lag - chosen.lag) > OFF and left < BETTER * before:
            message = f"would fit the desired motion {before / left:.2g} times better if its clock were {better.said}"
            hint = f"If the recording did not start with the motion, give it again with --align {better.lag:.3g}"
            findings.append(Problem(message, file=recording.path, hint=hint, code="lag"))
    noise = max(fine_noise(column.values[np.isfinite(column.values)]) for column in columns)
    interval = float(np.median(np.diff(measured[0])))
    return RecordedTrial(outputs=outputs, clock=chosen.how, findings=tuple(findings), noise=noise, interval=interval)


def _bridge(outputs: Array, plant: Plant, recording: Recording, columns: Sequence[Column], lag: float) -> list[Problem]:
    """Fill gaps of outputs (n, joints) in place, and return a finding about the gaps. Raises InputError if the gaps are too
    long.
    """
    missing = ~np.isfinite(outputs)
    if not missing.any():
        return []
    step = float(plant.time[1] - plant.time[0])
    longest = 0.0
    for column, gap in zip(outputs.T, missing.T, strict=True):
        known = np.flatnonzero(~gap)
        ends = len(gap) if not len(known) else max(known[0], len(gap) - 1 - known[-1])
        inside = 0.0 if len(known) < 2 else step * float(np.diff(known).max() - 1)
        if ends > MISSING * len(gap) or inside > BRIDGED:
            where = f"{columns[0].time[0] - lag:.3g} to {columns[0].time[-1] - lag:.3g} s"
            message = (
                f"must contain the link positions of the whole motion, 0 to {plant.time[-1]:.4g} s; it covers {where} on "
                f"the motion's clock, and {int(missing.any(axis=1).sum())} of {len(plant.time)} samples are missing"
            )
            hint = f"Record the whole motion without gaps longer than {BRIDGED:g} s; --align states the offset of its clock"
            raise InputError(message, file=recording.path, hint=hint, code="recording-too-short")
        column[gap] = np.interp(plant.time[gap], plant.time[known], column[known])
        longest = max(longest, inside)
    if longest == 0.0:
        return []
    message = f"has gaps of up to {longest:.2g} s, which are interpolated linearly"
    return [Problem(message, file=recording.path, code="gaps")]
