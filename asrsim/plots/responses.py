"""Frequency responses of runs and recordings; by default from the position reference to the link position."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from asrsim.actuators import MODES
from asrsim.errors import InputError, Problem, RecordingError
from asrsim.log import open_log
from asrsim.metrics import MetricRow
from asrsim.metrics.frequency import FrequencyResponse, frequency_response
from asrsim.plots import style
from asrsim.plots.curves import EXTRA, REFERENCE, available, require_names, stored, table
from asrsim.recordings import Column, Recording, resample
from asrsim.samples import JointInfo

OUTPUT = "link_position"
_RUN = "the run"
"""Source of a column that comes from the run's log and not from a recording."""
LEAST = 64
"""Smallest number of samples that input and output must have in common."""


@dataclass(frozen=True, kw_only=True)
class ResponseSignal:
    """Input or output of a frequency response."""

    quantity: str
    joint: str | None = None
    """Joint of the signal; None: the joint whose response is computed."""

    @classmethod
    def parse(cls, text: str | None, default: str) -> ResponseSignal:
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
    """Path of the log or recording."""
    experiment: bool
    unit: str
    """Unit of the gain; empty if input and output have the same unit."""
    output: str
    """Name of the quantity at the output."""
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
class ResponseExperiment:
    """Recording with its joints and lag, for a Bode plot."""

    recording: Recording
    joints: Mapping[str, str] = field(default_factory=dict)
    """Joint of the run that corresponds to each joint of the recording."""
    lag: float = 0.0
    """Delay of the recording against the run, s."""

    def column(self, quantity: str, joint: str) -> Column | None:
        """Recorded quantity of a joint of the run, None if not recorded."""
        channels = self.recording.channels.values()
        return next((c for c in channels if c.quantity == quantity and self.joints.get(c.joint or "") == joint), None)

    def require(self, quantity: str, joint: str) -> Column:
        """Recorded quantity of a joint of the run. Raises RecordingError if not recorded."""
        column = self.column(quantity, joint)
        if column is None:
            raise RecordingError(
                f"the recording has no {quantity} of {joint}", code="no-quantity",
                hint=f"Say which column it is with --map COLUMN={joint}.{quantity}",
            )  # fmt: skip
        return column


def responses(
    path: Path,
    *,
    label: str,
    variant: int = 0,
    joints: Sequence[str] | None = None,
    experiments: Sequence[ResponseExperiment] = (),
    band: tuple[float, float] | None = None,
    given: str | None = None,
    output: str | None = None,
) -> tuple[list[Response], list[Problem]]:
    """Responses of the run and its experiments for every joint with a moving input, and problems of the other joints.

    given, output: input and output as `quantity` or `joint.quantity`; by default the position reference (torque modes: the
    torque reference) and the link position. An experiment without a recorded reference uses the run's reference as input,
    at the times of the recording. Raises LogError for a joint or quantity that the log does not have.
    """
    reader = open_log(path)
    first, last = ResponseSignal.parse(given, REFERENCE), ResponseSignal.parse(output, OUTPUT)
    named = [signal for signal, text in ((first, given), (last, output)) if text is not None]
    require_names(reader, "quantity", [signal.quantity for signal in named], (*available(reader), *EXTRA))
    members = reader.info.joints
    infos = {joint.name: joint for joint in members}
    require_names(reader, "joint", [signal.joint for signal in named if signal.joint is not None], tuple(infos))
    names = [name for name in (first.quantity, last.quantity, "reference_1") if stored([name], members)]
    samples = reader.read(quantities=stored(names, members)).samples
    columns = table(samples, names, members)

    def logged(quantity: str, info: JointInfo) -> Column | None:
        """Quantity of a joint in the log, stored or derived; None if the log does not contain the quantity."""
        values = columns[quantity][:, samples.joints.index(info.name)] if quantity in columns else np.empty(0)
        if not np.isfinite(values).any():
            return None
        unit = style.unit(quantity, info)
        return Column(
            time=samples.time, values=values, unit=unit, joint=info.name, quantity=quantity, source=_RUN, conversion=""
        )

    found: list[Response] = []
    problems: list[Problem] = []
    for info in members:
        if (joints is not None and info.name not in joints) or (last.joint not in (None, info.name)):
            continue
        u, y = logged(first.quantity, infos[first.joint or info.name]), logged(last.quantity, info)
        if u is None and given is None:
            u = logged("reference_1", info)
        if u is None or y is None or not np.nanmax(u.values) - np.nanmin(u.values) > 1e-9 * np.nanmax(np.abs(u.values)):
            continue
        try:
            found.append(_response(info, label, variant, u, y, band))
        except InputError as error:
            problems += [replace(problem, key=info.name, file=path) for problem in error.problems]
            continue
        for one in experiments:
            try:
                pair = _recorded_pair(one, info, first, last, u, chosen=given is not None)
                if pair is not None:
                    found.append(_response(info, label, variant, *pair, band, recording=one.recording))
            except InputError as error:
                problems += [replace(problem, key=info.name, file=one.recording.path) for problem in error.problems]
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
    first, last = ResponseSignal.parse(given, "reference_1"), ResponseSignal.parse(output, OUTPUT)
    one = ResponseExperiment(recording=recording, joints={joint: joint for joint in recording.joints})
    found: list[Response] = []
    problems: list[Problem] = []
    for name in [last.joint] if last.joint is not None else joints or recording.joints:
        try:
            u, y = one.require(first.quantity, first.joint or name), one.require(last.quantity, name)
            info = JointInfo(name=name, actuator="", mode=None, prismatic=y.unit == "m")
            found.append(_response(info, recording.path.name, variant, u, y, band, recording=recording))
        except InputError as error:
            problems += [replace(problem, key=name, file=recording.path) for problem in error.problems]
    return found, problems


def _recorded_pair(
    one: ResponseExperiment, info: JointInfo, first: ResponseSignal, last: ResponseSignal, excitation: Column, *, chosen: bool
) -> tuple[Column, Column] | None:
    """Input and output of a joint's response in a recording; None if the output is not recorded.

    chosen: the user chose the input, so it must be recorded. Otherwise the run's `excitation` replaces a missing reference.
    """
    if chosen:
        return one.require(first.quantity, first.joint or info.name), one.require(last.quantity, info.name)
    output, mode = one.column(last.quantity, info.name), MODES.get(info.mode) if info.mode is not None else None
    if output is None:
        return None
    # In modes without a reference map, reference 1 belongs to a motor and not to the link.
    of_link = mode is not None and (mode.mapped or not mode.spring)
    reference = one.column("reference_1", info.name) if of_link else None
    return reference or replace(excitation, time=excitation.time + one.lag), output


def _response(
    joint: JointInfo, label: str, variant: int, u: Column, y: Column, band: tuple[float, float] | None,
    recording: Recording | None = None,
) -> Response:  # fmt: skip
    """Frequency response of the output column y to the input column u, resampled at the times of y. recording: None for a run.
    Raises RecordingError.
    """
    excitation = u.values
    if not np.array_equal(u.time, y.time):
        excitation = resample(u.time, excitation, y.time)
        if np.isfinite(excitation).sum() < LEAST:
            raise RecordingError("input and output do not overlap in time", code="no-overlap")
    both = np.isfinite(excitation)
    found = frequency_response(y.time[both], excitation[both], y.values[both], band=band)
    findings = found.findings
    if recording is not None and u.source == _RUN:
        findings = (Problem("has no recorded reference; the input is the simulation's", file=recording.path, key=joint.name,
                            code="reference-of-simulation"), *findings)  # fmt: skip
    return Response(
        joint=joint, label=label, variant=variant, source=label if recording is None else recording.path.name,
        experiment=recording is not None, unit=_ratio(y.unit, u.unit), output=y.quantity or "", response=found,
        findings=findings,
    )  # fmt: skip


def _ratio(above: str, below: str) -> str:
    """Unit of a gain; empty if numerator and denominator have the same unit."""
    above, below = above.replace(" ", "·"), below.replace(" ", "·")
    divisor = f"({below})" if "/" in below or "·" in below else below or "1"
    return "" if above == below else f"{above or '1'}/{divisor}"
