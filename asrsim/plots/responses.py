"""Frequency responses of runs and recordings; by default from the position reference to the link position."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from asrsim.actuators import MODES
from asrsim.errors import InputError, LogError, Problem, RecordingError
from asrsim.log import LogReader, open_log
from asrsim.metrics import MetricRow
from asrsim.metrics.frequency import FrequencyResponse, frequency_response
from asrsim.plots import style
from asrsim.plots.curves import EXTRA, REFERENCE, available, stored, table
from asrsim.recordings import Column, Recording, resample
from asrsim.samples import Array, JointInfo

OUTPUT = "link_position"
LEAST = 64
"""Smallest number of samples that input and output must have in common."""


@dataclass(frozen=True, kw_only=True)
class Signal:
    """Input or output of a frequency response."""

    quantity: str
    joint: str | None = None
    """Joint of the signal; None: the joint whose response is computed."""

    @classmethod
    def parse(cls, text: str | None, default: str) -> Signal:
        """Signal named by `joint.quantity`, or by `quantity` for every joint."""
        joint, _, quantity = (text or default).rpartition(".")
        return cls(quantity=quantity, joint=joint or None)


@dataclass(frozen=True, kw_only=True)
class Response:
    """Frequency response of a joint, with its label, units and style for the picture."""

    joint: JointInfo
    label: str
    """Label of the run."""
    variant: int
    """Number of the run, which selects its line style."""
    source: str
    """File of the log or recording."""
    experiment: bool
    unit: str
    """Unit of the gain; empty if input and output have the same unit."""
    output: str
    """Quantity at the output."""
    response: FrequencyResponse
    findings: tuple[Problem, ...] = ()

    def rows(self) -> list[MetricRow]:
        """Resonance frequency, resonance gain in dB, and bandwidth as metrics."""
        found = self.response
        decibel = f"dB re {self.unit}" if self.unit else "dB"
        values = {
            "resonance": (found.resonance[0] if found.resonance else math.nan, "Hz"),
            "resonance_gain": (20 * math.log10(found.resonance[1]) if found.resonance else math.nan, decibel),
            "bandwidth": (found.bandwidth if found.bandwidth is not None else math.nan, "Hz"),
            "median_coherence": (float(np.median(found.coherence)), ""),
        }
        return [
            MetricRow(source=self.source, joint=self.joint.name, quantity=self.output, measure=name, value=value, unit=unit)
            for name, (value, unit) in values.items()
        ]


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """Recording with its joints and lag, for a Bode plot."""

    recording: Recording
    joints: Mapping[str, str] = field(default_factory=dict)
    """Joint in the recording -> joint of the run."""
    lag: float = 0.0
    """Delay of the recording against the run, s."""

    def column(self, quantity: str, joint: str) -> Column | None:
        """Recorded quantity of a joint of the run, None if not recorded."""
        channels = self.recording.channels.values()
        return next((c for c in channels if c.quantity == quantity and self.joints.get(c.joint or "") == joint), None)


def responses(
    path: Path,
    *,
    label: str,
    variant: int = 0,
    joints: Sequence[str] | None = None,
    experiments: Sequence[Experiment] = (),
    band: tuple[float, float] | None = None,
    given: str | None = None,
    output: str | None = None,
) -> tuple[list[Response], list[Problem]]:
    """Responses of the run and its experiments for every joint with a moving input, and problems of the others.

    given, output: input and output as `quantity` or `joint.quantity`; by default the position reference (torque modes: the
    torque reference) and the link position. An experiment without a recorded reference uses the run's reference as input,
    at the times of the recording. Raises LogError for a joint or quantity that the log does not have.
    """
    reader = open_log(path)
    first, last = Signal.parse(given, REFERENCE), Signal.parse(output, OUTPUT)
    _check(reader, [signal for signal, text in ((first, given), (last, output)) if text is not None])
    found: list[Response] = []
    problems: list[Problem] = []
    for info in reader.info.joints:
        if (joints is not None and info.name not in joints) or (last.joint not in (None, info.name)):
            continue
        source = replace(first, joint=first.joint or info.name)
        series = _run_series(reader, info, source, last, chosen=given is not None)
        if series is None:
            continue
        time, excitation, response, unit = series
        if not len(time) or not np.nanmax(excitation) - np.nanmin(excitation) > 1e-9 * np.nanmax(np.abs(excitation)):
            continue
        entry = partial(Response, joint=info, label=label, variant=variant, unit=unit, output=last.quantity)
        try:
            result = frequency_response(time, excitation, response, band=band)
        except InputError as error:
            problems += [replace(problem, key=info.name, file=path) for problem in error.problems]
            continue
        found.append(entry(source=label, experiment=False, response=result, findings=result.findings))
        for one in experiments:
            said: tuple[Problem, ...] = ()
            try:
                if given is not None:
                    result = _of_columns(*_pair(one, info.name, source, last), band)
                elif (recorded := one.column(last.quantity, info.name)) is None:
                    continue
                elif (reference := _recorded_reference(one, info)) is not None:
                    result = _of_columns(reference, recorded, band)
                else:
                    result = _related(time + one.lag, excitation, recorded, band)
                    said = (Problem("has no recorded reference; the input is the simulation's", file=one.recording.path,
                                    key=info.name, code="reference-of-simulation"),)  # fmt: skip
            except InputError as error:
                problems += [replace(problem, key=info.name, file=one.recording.path) for problem in error.problems]
                continue
            source_name = one.recording.path.name
            found.append(entry(source=source_name, experiment=True, response=result, findings=(*said, *result.findings)))
    if not found and not problems:
        name = "reference" if given is None else first.quantity
        message = f"no joint has a moving {name}; a frequency response needs one"
        hint = "Expected a chirp, multisine or noise in the scenario's references"
        problems.append(Problem(message, file=path, hint=hint, code="no-excitation"))
    return found, problems


def recorded_responses(
    recording: Recording,
    *,
    variant: int,
    joints: Sequence[str] | None,
    band: tuple[float, float] | None,
    given: str | None,
    output: str | None,
) -> tuple[list[Response], list[Problem]]:
    """Responses of a recording without a run, for every joint that has both columns, and problems of the other joints.

    given, output: as in `responses`; None: the recorded reference and the link position.
    """
    first, last = Signal.parse(given, "reference_1"), Signal.parse(output, OUTPUT)
    one = Experiment(recording=recording, joints={joint: joint for joint in recording.joints})
    found: list[Response] = []
    problems: list[Problem] = []
    for name in [last.joint] if last.joint is not None else joints or recording.joints:
        try:
            u, y = _pair(one, name, replace(first, joint=first.joint or name), last)
            result = _of_columns(u, y, band)
        except InputError as error:
            problems += [replace(problem, key=name, file=recording.path) for problem in error.problems]
            continue
        info = JointInfo(name=name, actuator="", mode=None, prismatic=y.unit == "m")
        label = recording.path.name
        found.append(
            Response(joint=info, label=label, variant=variant, source=label, experiment=True, unit=_ratio(y.unit, u.unit),
                     output=last.quantity, response=result, findings=result.findings)
        )  # fmt: skip
    return found, problems


def _check(reader: LogReader, signals: Sequence[Signal]) -> None:
    names, joints = (*available(reader), *EXTRA), tuple(joint.name for joint in reader.info.joints)
    problems = []
    for signal in signals:
        for kind, value, choices in (("quantity", signal.quantity, names), ("joint", signal.joint, joints)):
            if value is not None and value not in choices:
                problems.append(
                    Problem(f"the log has no {kind} '{value}'", file=reader.path, key=kind, choices=choices,
                            meant=value, code=f"unknown-{kind}")
                )  # fmt: skip
    if problems:
        raise LogError(problems)


def _run_series(
    reader: LogReader, info: JointInfo, first: Signal, last: Signal, *, chosen: bool
) -> tuple[Array, Array, Array, str] | None:
    """Time, input, output and unit of the gain; None if the run lacks one of the signals."""
    members = list(dict.fromkeys((info.name, first.joint or info.name)))
    recorded = {name for joint in reader.info.joints if joint.name in members for name in joint.quantities}
    names = [name for name in stored([first.quantity, last.quantity, "reference_1"]) if name in recorded]
    if OUTPUT not in recorded:
        return None
    try:
        samples = reader.read(quantities=list(dict.fromkeys([OUTPUT, *names])), joints=members).samples
        columns = table(samples, [first.quantity, last.quantity], reader.info.joints)
    except (LogError, KeyError):
        return None
    excitation = columns[first.quantity][:, samples.joints.index(first.joint or info.name)]
    response = columns[last.quantity][:, samples.joints.index(info.name)]
    source = first.quantity
    if not np.isfinite(excitation).any() and not chosen and "reference_1" in samples.values:
        source, excitation = "reference_1", samples.values["reference_1"][:, samples.joints.index(info.name)]
    if not np.isfinite(excitation).any() or not np.isfinite(response).any():
        return None
    infos = {joint.name: joint for joint in reader.info.joints}
    units = style.unit(last.quantity, info), style.unit(source, infos[first.joint or info.name])
    return samples.time, excitation, response, _ratio(*units)


def _ratio(above: str, below: str) -> str:
    """Unit of a gain; empty if numerator and denominator have the same unit."""
    above, below = above.replace(" ", "·"), below.replace(" ", "·")
    divisor = f"({below})" if "/" in below or "·" in below else below or "1"
    return "" if above == below else f"{above or '1'}/{divisor}"


def _pair(one: Experiment, name: str, first: Signal, last: Signal) -> tuple[Column, Column]:
    """Columns of input and output in the recording. Raises RecordingError if one is missing."""
    found = []
    for quantity, joint in ((first.quantity, first.joint or name), (last.quantity, name)):
        column = one.column(quantity, joint)
        if column is None:
            raise RecordingError(
                f"the recording has no {quantity} of {joint}", code="no-quantity",
                hint=f"Say which column it is with --map COLUMN={joint}.{quantity}",
            )  # fmt: skip
        found.append(column)
    return found[0], found[1]


def _of_columns(u: Column, y: Column, band: tuple[float, float] | None) -> FrequencyResponse:
    return _related(u.time, u.values, y, band)


def _related(time: Array, excitation: Array, y: Column, band: tuple[float, float] | None) -> FrequencyResponse:
    """Response of a recorded column to an input (n,) at the times (n,), resampled at the column's times."""
    if time is not y.time and not np.array_equal(time, y.time):
        excitation = resample(time, excitation, y.time)
        if np.isfinite(excitation).sum() < LEAST:
            raise RecordingError("input and output do not overlap in time", code="no-overlap")
    both = np.isfinite(excitation)
    return frequency_response(y.time[both], excitation[both], y.values[both], band=band)


def _recorded_reference(one: Experiment, info: JointInfo) -> Column | None:
    """Recorded reference of the link. In modes without a reference map, reference 1 belongs to a motor: None."""
    mode = MODES.get(info.mode) if info.mode is not None else None
    return one.column("reference_1", info.name) if mode is not None and (mode.mapped or not mode.spring) else None
