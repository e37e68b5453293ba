"""Frequency responses of runs and recordings: the link's position to its reference."""

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
from asrsim.log.derived import DERIVED_SOURCES, position_error
from asrsim.metrics import MetricRow
from asrsim.metrics.frequency import FrequencyResponse, frequency_response
from asrsim.recordings import Recording, resample
from asrsim.samples import Array, JointInfo

OUTPUT = "link_position"


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
    response: FrequencyResponse
    findings: tuple[Problem, ...] = ()

    def rows(self) -> list[MetricRow]:
        """Resonance, its gain, and bandwidth, as metrics."""
        found = self.response
        values = {
            "resonance": (found.resonance[0] if found.resonance else math.nan, "Hz"),
            "resonance_gain": (found.resonance[1] if found.resonance else math.nan, self.unit),
            "bandwidth": (found.bandwidth if found.bandwidth is not None else math.nan, "Hz"),
            "median_coherence": (float(np.median(found.coherence)), ""),
        }
        return [
            MetricRow(source=self.source, joint=self.joint.name, quantity=OUTPUT, measure=name, value=value, unit=unit)
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
) -> tuple[list[Response], list[Problem]]:
    """Responses of every joint whose reference moves, of the run and of its experiments; and what could not be found out.

    The input is the position that the references ask for (in the torque modes: the torque), the output the link's position.
    An experiment without recorded reference is related to the run's, at the times of the recording.
    """
    reader = open_log(path)
    found: list[Response] = []
    problems: list[Problem] = []
    for info in reader.info.joints:
        if joints is not None and info.name not in joints:
            continue
        series = _run_series(reader, info)
        if series is None:
            continue
        time, excitation, output, unit = series
        if not len(time) or not np.nanmax(excitation) - np.nanmin(excitation) > 1e-9:
            continue
        try:
            result = frequency_response(time, excitation, output, band=band)
        except InputError as error:
            problems += [replace(problem, key=info.name, file=path) for problem in error.problems]
            continue
        entry = partial(Response, joint=info, label=label, variant=variant, unit=unit)
        found.append(entry(source=label, experiment=False, response=result, findings=result.findings))
        for one in experiments:
            try:
                recorded = _recorded(one, info, time, excitation, band)
            except InputError as error:
                problems += [replace(problem, key=info.name, file=one.recording.path) for problem in error.problems]
                continue
            if recorded is not None:
                response, findings = recorded
                found.append(
                    entry(
                        source=one.recording.path.name,
                        experiment=True,
                        response=response,
                        findings=(*findings, *response.findings),
                    )
                )
    if not found and not problems:
        message = "no joint has a reference that moves; a frequency response needs one that does"
        hint = "Expected a chirp, multisine or noise in the scenario's references"
        problems.append(Problem(message=message, file=path, hint=hint, code="no-excitation"))
    return found, problems


def _run_series(reader: LogReader, info: JointInfo) -> tuple[Array, Array, Array, str] | None:
    names = [name for name in (*DERIVED_SOURCES["position_error"], OUTPUT) if name in info.quantities]
    if OUTPUT not in names or "reference_1" not in names:
        return None
    try:
        samples = reader.read(quantities=list(dict.fromkeys(names)), joints=[info.name]).samples
    except LogError:
        return None
    output = samples.values[OUTPUT][:, 0]
    reference = position_error(samples, [info])[:, 0] + output
    if np.isfinite(reference).any():
        return samples.time, reference, output, ""
    return samples.time, samples.values["reference_1"][:, 0], output, "rad/(N·m)" if not info.prismatic else "m/N"


def _recorded(
    one: Experiment, info: JointInfo, time: Array, excitation: Array, band: tuple[float, float] | None
) -> tuple[FrequencyResponse, tuple[Problem, ...]] | None:
    columns = {
        column.quantity: column
        for column in one.recording.channels.values()
        if column.quantity is not None and column.joint is not None and one.joints.get(column.joint) == info.name
    }
    output = columns.get(OUTPUT)
    if output is None:
        return None
    mode = MODES.get(info.mode) if info.mode is not None else None
    # In the modes without reference map, reference 1 is a motor's, not the link's.
    meaning = mode is not None and (mode.mapped or not mode.spring)
    reference = columns.get("reference_1") if meaning else None
    if reference is not None:
        same = reference.time is output.time or np.array_equal(reference.time, output.time)
        u = reference.values if same else resample(reference.time, reference.values, output.time)
        return frequency_response(output.time, u, output.values, band=band), ()
    said = Problem(message="has no recorded reference; related to the simulation's", file=one.recording.path, key=info.name,
                   code="reference-of-simulation")  # fmt: skip
    u = resample(time + one.lag, excitation, output.time)
    both = np.isfinite(u)
    if both.sum() < 64:
        raise RecordingError(Problem(message="does not overlap with the simulation's reference", code="no-overlap"))
    return frequency_response(output.time[both], u[both], output.values[both], band=band), (said,)
