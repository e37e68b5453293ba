"""Events in a log to which the user can jump on a page: limits and stops that a joint reached, and claims that do not hold."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import AsrsimError
from asrsim.log import open_log
from asrsim.plots.claims import judge
from asrsim.plots.limits import largest_deflection
from asrsim.quantities import MOST_MOTORS
from asrsim.robot.model import Robot
from asrsim.samples import Array, JointInfo, Samples
from asrsim.viewer.history import values_of

NEAR = 1e-3
"""Distance from a limit, as a fraction of the limit, within which the limit counts as reached."""
APART = 0.05
"""Time for which a joint must be away from a limit before reaching it again counts as a new event, s."""
EXTREMES = {"maximum": np.positive, "minimum": np.negative, "peak": np.abs, "overshoot": np.abs}
"""Measures that belong to one instant, each with a function. At this instant, the function of the series is largest."""


@dataclass(frozen=True, order=True)
class Event:
    """Event at a time in s, with its description."""

    time: float
    text: str


def events_of(path: Path, samples: Samples, joints: Sequence[JointInfo], robot: Robot) -> list[Event]:
    """Events of a log in the order of time: limits that the samples reach, and claims that do not hold."""
    reader = open_log(path)
    parameters = reader.info.resolved.get("parameters", {})
    found = [*limit_events(samples, joints, robot, parameters if isinstance(parameters, Mapping) else {})]
    end = float(samples.time[-1])
    try:
        claims = judge(reader)
    except AsrsimError as error:
        claims = ()
        found.append(Event(end, f"claims cannot be read: {error}"))
    found += [Event(_time_of(claim.expectation, samples), claim.text) for claim in claims if not claim.holds]
    if reader.status == "diverged":
        found.append(Event(end, reader.metadata.get("message", "diverged")))
    return sorted(found)


def limit_events(samples: Samples, joints: Sequence[JointInfo], robot: Robot, parameters: Mapping[str, Any]) -> Iterator[Event]:
    """Events: a link reaches a stop or its effort limit, a motor reaches its torque limit, or a spring reaches its largest
    deflection. parameters: parameter values of the actuators, by joint.
    """
    known = {joint.name: joint for joint in robot.joints}
    for column, name in enumerate(samples.joints):
        joint, own = known.get(name), parameters.get(name, {})
        position = samples.values["link_position"][:, column]
        if joint is not None and joint.moves:
            low, high = joint.stops
            yield from _begins(samples.time, position >= high - NEAR * abs(high), f"{name} at its upper stop")
            yield from _begins(samples.time, position <= low + NEAR * abs(low), f"{name} at its lower stop")
            torque = samples.values.get("link_torque")
            if torque is not None:
                most = joint.most_effort
                yield from _begins(samples.time, np.abs(torque[:, column]) >= (1 - NEAR) * most, f"{name} at its effort limit")
        limits = [("deflection", "max_deflection", "deflection limit")]
        limits += [
            (f"motor_{i}_torque", f"motor_{i}_max_torque", f"motor {i} at its torque limit") for i in range(1, MOST_MOTORS + 1)
        ]
        for quantity, parameter, text in limits:
            values, limit = values_of(samples, quantity, joints), own.get(parameter) if isinstance(own, Mapping) else None
            if values is None or not isinstance(limit, float | int):
                continue
            largest: Array | None = np.asarray(limit)
            if quantity == "deflection":
                motors = (samples.values.get(f"motor_{i}_position") for i in (1, 2))
                info = next(one for one in joints if one.name == name)
                largest = largest_deflection(info, limit, *(None if one is None else one[:, column] for one in motors))
            if largest is not None:
                yield from _begins(samples.time, np.abs(values[:, column]) >= (1 - NEAR) * largest, f"{name}: {text}")


def _begins(time: Array, reached: NDArray[np.bool_], text: str) -> Iterator[Event]:
    """An event at the beginning of each interval in which a condition holds. An interval continues over breaks up to `APART`.

    reached: whether the condition holds at each time (n,); text: description of the event.
    """
    rows = np.flatnonzero(reached)
    if len(rows):
        fresh = np.diff(time[rows], prepend=-np.inf) > APART
        yield from (Event(float(at), text) for at in time[rows[fresh]])


def _time_of(claim: Any, samples: Samples) -> float:
    """Time of the event for a claim that does not hold, s. It is the instant to which the claim's measure belongs, or the end
    of the run if there is no such instant."""
    values, size = samples.values.get(claim.quantity), EXTREMES.get(claim.measure)
    if claim.joint in samples.joints and values is not None and size is not None:
        column = size(values[:, samples.joints.index(claim.joint)])
        if np.isfinite(column).any():
            return float(samples.time[np.nanargmax(column)])
    return float(samples.time[-1])
