"""Frequency responses of runs and recordings; by default from the position reference to the link position."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from asrsim.actuators import MODES
from asrsim.errors import InputError, Problem, RecordingError
from asrsim.log import open_log
from asrsim.metrics import MetricRow
from asrsim.metrics.frequency import FrequencyResponse, frequency_response
from asrsim.plots import style
from asrsim.plots.curves import EXTRA, REFERENCE, drawable_quantities, require_names, stored, table
from asrsim.recordings import Column, Recording, resample
from asrsim.samples import JointInfo

OUTPUT = "link_position"
_RUN = "the run"
"""Source of a column that comes from the run's log and not from a recording."""
LEAST = 64
"""Smallest number of samples that input and output must have in common."""


@dataclass(frozen=True, kw_only=True)
class Response:
    """Frequency response of a joint, with its label, units and style for the picture."""

    joint: JointInfo
    label: str
    """Label of the run."""
    variant: int
    """Number of the run, which determines the line style of the response."""
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
        """Recorded quantity of a joint of the run; None if the quantity is not recorded."""
        channels = self.recording.channels.values()
        return next((c for c in channels if c.quantity == quantity and self.joints.get(c.joint or "") == joint), None)

    def require(self, quantity: str, joint: str) -> Column:
        """Recorded quantity of a joint of the run. Raises RecordingError if the quantity is not recorded."""
        column = self.column(quantity, joint)
        if column is None:
            raise RecordingError(
                f"the recording has no {quantity} of {joint}",
                code="no-quantity",
                hint=f"Name its column with --map COLUMN={joint}.{quantity}",
            )
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
    (first_joint, first), (last_joint, last) = _signal(given or REFERENCE), _signal(output or OUTPUT)
    named = [name for name, text in ((first, given), (last, output)) if text is not None]
    require_names(reader, "quantity", named, (*drawable_quantities(reader), *EXTRA))
    members = reader.info.joints
    infos = {joint.name: joint for joint in members}
    require_names(reader, "joint", [name for name in (first_joint, last_joint) if name], tuple(infos))
    names = [name for name in (first, last, "reference_1") if stored([name], members)]
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
        if (joints is not None and info.name not in joints) or last_joint not in ("", info.name):
            continue
        u, y = logged(first, infos[first_joint or info.name]), logged(last, info)
        if u is None and given is None:
            u = logged("reference_1", info)
        if u is None or y is None or not np.nanmax(u.values) - np.nanmin(u.values) > 1e-9 * np.nanmax(np.abs(u.values)):
            continue
        with _collected(problems, info.name, path):
            found.append(_response(info, label, variant, u, y, band))
        for one in experiments:
            with _collected(problems, info.name, one.recording.path):
                # If the user chooses an input, it must be recorded. Otherwise the run's reference replaces a missing input.
                if given is not None:
                    pair = one.require(first, first_joint or info.name), one.require(last, info.name)
                elif recorded := one.column(last, info.name):
                    pair = _recorded_input(one, info) or replace(u, time=u.time + one.lag), recorded
                else:
                    continue
                found.append(_response(info, label, variant, *pair, band, recording=one.recording))
    if not found and not problems:
        message = (
            f"no joint has a moving {'reference' if given is None else first}; a frequency response needs an input that moves"
        )
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
    """Responses of a recording without a run, for every joint with a column of the reference and a column of the output, and
    problems of the other joints.

    given, output: as in `responses`; None: the recorded reference and the link position.
    """
    (first_joint, first), (last_joint, last) = _signal(given or "reference_1"), _signal(output or OUTPUT)
    one = ResponseExperiment(recording=recording, joints={joint: joint for joint in recording.joints})
    found: list[Response] = []
    problems: list[Problem] = []
    for name in [last_joint] if last_joint else joints or recording.joints:
        with _collected(problems, name, recording.path):
            u, y = one.require(first, first_joint or name), one.require(last, name)
            info = JointInfo(name=name, actuator="", mode=None, prismatic=y.unit == "m")
            found.append(_response(info, recording.path.name, variant, u, y, band, recording=recording))
    return found, problems


def _signal(text: str) -> tuple[str, str]:
    """Joint and quantity of `joint.quantity`; the joint is empty if the text names the quantity of every joint."""
    joint, _, quantity = text.rpartition(".")
    return joint, quantity


@contextmanager
def _collected(problems: list[Problem], joint: str, file: Path) -> Iterator[None]:
    """Context manager that adds the problems of an InputError to a list, with their joint and file."""
    try:
        yield
    except InputError as error:
        problems += [replace(problem, key=joint, file=file) for problem in error.problems]


def _recorded_input(one: ResponseExperiment, info: JointInfo) -> Column | None:
    """Recorded reference of a joint's link; None if no reference is recorded, or if reference 1 belongs to a motor in the
    joint's mode."""
    mode = MODES.get(info.mode) if info.mode is not None else None
    return one.column("reference_1", info.name) if mode is not None and (mode.mapped or not mode.spring) else None


def _response(
    joint: JointInfo,
    label: str,
    variant: int,
    u: Column,
    y: Column,
    band: tuple[float, float] | None,
    recording: Recording | None = None,
) -> Response:
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
        findings = (
            Problem(
                "has no recorded reference; the reference in the simulation is taken as the input",
                file=recording.path,
                key=joint.name,
                code="reference-of-simulation",
            ),
            *findings,
        )
    return Response(
        joint=joint,
        label=label,
        variant=variant,
        source=label if recording is None else recording.path.name,
        experiment=recording is not None,
        unit=_ratio(y.unit, u.unit),
        output=y.quantity or "",
        response=found,
        findings=findings,
    )


def _ratio(above: str, below: str) -> str:
    """Unit of a gain; empty if numerator and denominator have the same unit."""
    above, below = above.replace(" ", "·"), below.replace(" ", "·")
    divisor = f"({below})" if "/" in below or "·" in below else below or "1"
    return "" if above == below else f"{above or '1'}/{divisor}"
