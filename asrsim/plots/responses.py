"""Frequency responses of runs and recordings: of a quantity of a joint to another, by default of the link to its reference."""

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


@dataclass(frozen=True, kw_only=True)
class Signal:
    """What a response leads from or to."""

    quantity: str
    joint: str | None = None
    """None: of the joint that is looked at."""

    @classmethod
    def parse(cls, text: str | None, default: str) -> Signal:
        """`joint.quantity`, or `quantity` of every joint."""
        joint, _, quantity = (text or default).rpartition(".")
        return cls(quantity=quantity, joint=joint or None)


@dataclass(frozen=True, kw_only=True)
class Response:
    """A frequency response with its place in the picture."""

    joint: JointInfo
    label: str
    """Of the run."""
    variant: int
    """Number of the run, for its line style."""
    source: str
    """The log or the recording."""
    experiment: bool
    unit: str
    """Of the gain; empty where input and output have the same."""
    output: str
    """The output's quantity."""
    response: FrequencyResponse
    findings: tuple[Problem, ...] = ()

    def rows(self) -> list[MetricRow]:
        """Resonance, its gain in dB, and bandwidth, as metrics."""
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
    """A recording as a Bode plot needs it."""

    recording: Recording
    joints: Mapping[str, str] = field(default_factory=dict)
    """Its joints -> the run's."""
    lag: float = 0.0
    """s that it is late."""


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
    """Responses of every joint whose input moves, of the run and of its experiments; and what could not be found out.

    given, output: `quantity` or `joint.quantity`, input and output of the response; by default the position that the references
    ask for (in the torque modes: the torque) and the link's position. By default an experiment without recorded reference is
    related to the run's, at the times of the recording. Raises LogError for a joint or quantity that the log has not.
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
        try:
            result = frequency_response(time, excitation, response, band=band)
        except InputError as error:
            problems += [replace(problem, key=info.name, file=path) for problem in error.problems]
            continue
        entry = partial(Response, joint=info, label=label, variant=variant, unit=unit, output=last.quantity)
        found.append(entry(source=label, experiment=False, response=result, findings=result.findings))
        for one in experiments:
            try:
                if given is None:
                    recorded = _recorded(one, info, time, excitation, band, last.quantity)
                else:
                    recorded = _of_pair(*_pair(one, info.name, source, last), band), ()
            except InputError as error:
                problems += [replace(problem, key=info.name, file=one.recording.path) for problem in error.problems]
                continue
            if recorded is not None:
                measured, findings = recorded
                found.append(
                    entry(
                        source=one.recording.path.name, experiment=True, response=measured,
                        findings=(*findings, *measured.findings),
                    )
                )  # fmt: skip
    if not found and not problems:
        name = "reference" if given is None else first.quantity
        what = f"has {'an' if name[0] in 'aeiou' else 'a'} {name} that moves"
        message = f"no joint {what}; a frequency response needs one that does"
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
    """Responses of a recording by itself, of every joint that has both columns; and what could not be found out.

    given, output: as of :func:`responses`; None: the recorded reference and the link's position.
    """
    first, last = Signal.parse(given, "reference_1"), Signal.parse(output, OUTPUT)
    one = Experiment(recording=recording, joints={joint: joint for joint in recording.joints})
    label = recording.path.name
    found: list[Response] = []
    problems: list[Problem] = []
    for name in [last.joint] if last.joint is not None else joints or recording.joints:
        try:
            u, y = _pair(one, name, replace(first, joint=first.joint or name), last)
            result = _of_pair(u, y, band)
        except InputError as error:
            problems += [replace(problem, key=name, file=recording.path) for problem in error.problems]
            continue
        info = JointInfo(name=name, actuator="", mode=None, prismatic=y.unit == "m")
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
    """Time, input, output and the gain's unit; None where the run does not have them."""
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
    """The unit of a gain; empty where both are the same."""
    above, below = above.replace(" ", "·"), below.replace(" ", "·")
    divisor = f"({below})" if "/" in below or "·" in below else below or "1"
    return "" if above == below else f"{above or '1'}/{divisor}"


def _pair(one: Experiment, name: str, first: Signal, last: Signal) -> tuple[Column, Column]:
    """The recording's columns of input and output. Raises RecordingError where it has not both."""
    found = []
    for quantity, joint in ((first.quantity, first.joint), (last.quantity, name)):
        column = next(
            (c for c in one.recording.channels.values() if c.quantity == quantity and one.joints.get(c.joint or "") == joint),
            None,
        )
        if column is None:
            raise RecordingError(
                f"the recording has no {quantity} of {joint}", code="no-quantity",
                hint=f"Say which column it is with --map COLUMN={joint}.{quantity}",
            )  # fmt: skip
        found.append(column)
    return found[0], found[1]


def _of_pair(u: Column, y: Column, band: tuple[float, float] | None) -> FrequencyResponse:
    """The response of one column to another."""
    same = u.time is y.time or np.array_equal(u.time, y.time)
    excitation = u.values if same else resample(u.time, u.values, y.time)
    return frequency_response(y.time, excitation, y.values, band=band)


def _recorded(
    one: Experiment, info: JointInfo, time: Array, excitation: Array, band: tuple[float, float] | None, name: str
) -> tuple[FrequencyResponse, tuple[Problem, ...]] | None:
    columns = {
        column.quantity: column
        for column in one.recording.channels.values()
        if column.quantity is not None and column.joint is not None and one.joints.get(column.joint) == info.name
    }
    output = columns.get(name)
    if output is None:
        return None
    mode = MODES.get(info.mode) if info.mode is not None else None
    # In the modes without reference map, reference 1 is a motor's, not the link's.
    meaning = mode is not None and (mode.mapped or not mode.spring)
    reference = columns.get("reference_1") if meaning else None
    if reference is not None:
        return _of_pair(reference, output, band), ()
    said = Problem("has no recorded reference; related to the simulation's", file=one.recording.path, key=info.name,
                   code="reference-of-simulation")  # fmt: skip
    u = resample(time + one.lag, excitation, output.time)
    both = np.isfinite(u)
    if both.sum() < 64:
        raise RecordingError("does not overlap with the simulation's reference", code="no-overlap")
    return frequency_response(output.time[both], u[both], output.values[both], band=band), (said,)
