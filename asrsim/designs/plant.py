"""The robot in an experiment. From the motion of its references, computes the used fractions of its limits, and the Fisher
information.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from asrsim.designs.limits import DesignLimits, interval
from asrsim.designs.motion import Piece, joined
from asrsim.errors import InputError, Problem, did_you_mean
from asrsim.identification.door import Door, Start, SteppedJoint, comparable
from asrsim.identification.parameters import Layout, numbers_of, parameters_of
from asrsim.quantities import each_motor
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.signals.sampled import Sampled

POSITION_NOISE = 1e-3
"""Noise of measured positions if the limits file states no noise, rad (m)."""
GROWTH = 20.0
"""A robot is near chaos if the sensitivity of a sensor to a relative change of a parameter exceeds this multiple of the motion
that the sensor records.
"""


@dataclass(frozen=True)
class Reference:
    """A reference that the experiment may move."""

    joint: str
    name: str
    slot: int
    unit: str
    home: float
    low: float
    high: float

    @property
    def heading(self) -> str:
        """Heading of the reference's column in a CSV file."""
        return f"{self.joint}.reference_{self.slot + 1} [{self.unit}]"

    def values(self, share: Array) -> Array:
        """Values in the reference's unit. share: fractions of the reference's range, from -1 (low end) to 1 (high end)."""
        return self.home + np.where(share > 0.0, share * (self.high - self.home), share * (self.home - self.low))


@dataclass(frozen=True)
class LimitBound:
    """Low and high limit of a quantity of a joint."""

    joint: str
    quantity: str
    low: float
    high: float


@dataclass(frozen=True)
class DesignChannel:
    """A sensor of a joint. Its recording gives information about the parameters."""

    joint: str
    quantity: str
    noise: float
    sensor: str
    """Name of the additional sensor; empty if the sensor is always recorded."""


@dataclass(frozen=True, eq=False)
class MotionOutcome:
    """Results of a motion: used fractions of the limits, and Fisher information."""

    use: Array
    """Used fraction of each limit, (bounds, windows), the largest of all robots. Above 1 the limit is exceeded."""
    information: Array | None
    """Fisher matrices (robots, n, n). None if they were not computed, or if a robot is near chaos."""


class DesignPlant:
    """A scenario whose references are designed. It is simulated for several robots with different parameters."""

    def __init__(
        self, scenario: Scenario, robot: Robot, layout: Layout, limits: DesignLimits, seconds: float, robots: Sequence[Array]
    ) -> None:
        """robots: parameter vector of each robot."""
        self.scenario = replace(scenario, duration=seconds, expect=(), desired={}, log_every=1)
        self.door, self.layout = Door(self.scenario, robot), layout
        self.step, self.rows = scenario.step, round(seconds / scenario.step) + 1
        self._problems: list[Problem] = []
        bounds = tuple(self._bounds(limits))
        self.bounds = tuple(bound for bound in bounds if bound.quantity in comparable())
        self.references = tuple(one for drive in self.door.drives for one in self._references(drive, bounds))
        self.channels = tuple(self._channels(limits))
        parameters = tuple(parameters_of(self.door.robot, (), {}))
        for key in limits.gains:
            if key not in parameters:
                self._fault(f"choose.{key}", "is not a parameter of the robot", hint=did_you_mean(key, parameters))
        self.presets = np.array([one.slot == 1 for one in self.references])
        if self.presets.all() and not self._problems:
            self._fault("limits", "state limits of at least one joint that has an actuator")
        if self._problems:
            self.close()
            raise InputError(self._problems)
        self.every = max(1, round(1.0 / (limits.rate * self.step)))
        """Number of simulation steps between two samples of the sensors."""
        moved = {one.joint for one in self.references}
        self.own = np.array(
            [[bound.joint == one.joint or bound.joint not in moved for bound in self.bounds] for one in self.references]
        )
        """Mask (references, bounds) of the limits that each reference must keep: the limits of its own joint, and the limits of
        joints without references.
        """
        self.robots, self.gains, self.substeps = robots, dict[str, float](), self.door.substeps

    def under(self, gains: Mapping[str, float]) -> DesignPlant:
        """The same plant with other gains of controllers, and with the number of substeps that all robots then need."""
        found = copy(self)
        found.gains = dict(gains)
        needed = np.array([self.door.substeps_of(found._numbers(x)) for x in self.robots])
        found.substeps = int(needed[:, 0].max()), int(needed[:, 1].max())
        return found

    def close(self) -> None:
        """Release the engines."""
        self.door.close()

    def _fault(self, key: str, message: str, **details: Any) -> None:
        self._problems.append(Problem(message, key=key, code="limits", **details))

    def _bounds(self, limits: DesignLimits) -> Iterator[LimitBound]:
        references = {name: [name] for drive in self.door.drives for name in drive.references}
        for joint, ranges in limits.limits.items():
            if joint not in self.door.joints:
                self._fault(f"limits.{joint}", "the robot has no such joint", meant=joint, choices=self.door.joints)
                continue
            for name, given in ranges.items():
                quantities = references.get(name) or _quantities(name)
                if not quantities:
                    message, choices = "no quantity or reference has this name", (*references, *comparable())
                    self._fault(f"limits.{joint}.{name}", message, meant=name, choices=choices)
                yield from (LimitBound(joint, quantity, *interval(given)) for quantity in quantities)

    def _references(self, drive: SteppedJoint, bounds: Sequence[LimitBound]) -> Iterator[Reference]:
        mode, own = drive.mode, {bound.quantity: bound for bound in bounds if bound.joint == drive.name}
        if mode is None or not own:
            return
        if mode.direct or not (mode.spring or mode.controller):
            message = f"a joint in mode {mode.number} ({mode.name}) does not return to rest by itself"
            self._fault(f"limits.{drive.name}", message, hint="Choose a mode with a controller: 1, 5 or 6")
            return
        alone = drive.actuator is not None and drive.actuator.motors + drive.actuator.adjuster < 2
        for slot, name in enumerate(drive.references[:1] if alone else drive.references):
            preset = mode.mapped and slot == 1
            bound = own.get(name) or (None if preset else own.get("link_position"))
            signal = self.scenario.references_of(drive.name).get(name)
            position = self.door.positions[self.door.joints.index(drive.name)]
            home = 0.0 if preset else position
            if signal is not None:
                home = float(signal.values(np.zeros(1))[0])
            if bound is None:
                # A preset without stated limits stays constant.
                if not preset:
                    message = f"the range of {name} is missing: give a limit of {name}, or of link_position"
                    self._fault(f"limits.{drive.name}.{name}", message)
            elif not bound.low <= home <= bound.high:
                self._fault(f"limits.{drive.name}.{bound.quantity}", f"the scenario begins outside this limit, at {home:g}")
            else:
                yield Reference(drive.name, name, slot, mode.units[min(slot, len(mode.units) - 1)], home, bound.low, bound.high)

    def _channels(self, limits: DesignLimits) -> Iterator[DesignChannel]:
        noise = limits.noise or dict.fromkeys(("link_position", *each_motor("motor_{}_position")), POSITION_NOISE)
        for name, size in noise.items():
            owner, _, quantity = name.rpartition(".")
            quantities = _quantities(quantity)
            if not quantities or owner not in ("", *self.door.joints):
                self._fault(f"noise.{name}", "no sensor measures this quantity", meant=name, choices=comparable())
            sensor = name if name in limits.sensors else ""
            for drive in self.door.drives:
                if owner in ("", drive.name) and (drive.dynamic_motors or not quantity.startswith("motor")):
                    absent = {name for i, name in enumerate(each_motor("motor_{}_position")) if i >= max(drive.placed, 2)}
                    yield from (DesignChannel(drive.name, one, size, sensor) for one in quantities if one not in absent)

    def _numbers(self, x: Array) -> Mapping[str, Mapping[str, float]]:
        return numbers_of({**self.layout.table(x, 0), **self.gains})

    def motion(self, pieces: Sequence[Piece], rows: int) -> Array:
        """Motion (references, rows) of successive pieces, in the references' units."""
        shares = joined(pieces, self.step, rows)
        return np.array([one.values(share) for one, share in zip(self.references, shares, strict=True)])

    def play(
        self, motion: Array, robots: int, *, changes: Sequence[Array | float] = (), windows: int = 1, sensor: str = ""
    ) -> MotionOutcome | None:
        """Outcome of a motion for the first robots of the plant; None if the simulation of a robot diverges.

        Args:
            motion: Motion (references, rows) in the references' units.
            robots: Number of robots.
            changes: Changes of each parameter, in units of the parameter vector. Sensitivities are means over these changes.
                Without changes, no information is computed.
            windows: Number of equal parts of the motion in which the use of limits is measured.
            sensor: Additional sensor whose information is computed. Empty: the information of all sensors that are always
            recorded is computed.
        """
        time = np.asarray(self.step * np.arange(motion.shape[1]), dtype=np.float64)
        signals: dict[str, dict[str, Sampled]] = {}
        for one, values in zip(self.references, motion, strict=True):
            signals.setdefault(one.joint, {})[one.name] = Sampled(times=time, samples=values)
        watched: tuple[LimitBound | DesignChannel, ...] = (*self.bounds, *self.channels)
        names = [(self.door.joints.index(one.joint), one.quantity) for one in watched]
        low, high = self.layout.bounds
        shares, matrices = [], []
        for x in self.robots[:robots]:
            moves = [np.where((x + h > high) | (x + h < low), -h, h) for h in changes]
            worlds = [x, *(x + row for move in moves for row in np.diag(move))]
            starts = [Start(parameters=self._numbers(world), references=signals) for world in worlds]
            runs = list(self.door.rollout(names, starts, steps=len(time) - 1, substeps=self.substeps))
            if runs[0] is None:
                return None
            shares.append(self._use(runs[0][: len(self.bounds), : len(time)], windows))
            matrices.append(self._fisher(runs, moves, sensor) if changes else None)
        known = [one for one in matrices if one is not None]
        return MotionOutcome(np.max(shares, axis=0), np.array(known) if len(known) == robots else None)

    def _use(self, values: Array, windows: int) -> Array:
        """Used fraction of each limit, (bounds, windows). values: values (bounds, rows) of the limited quantities."""
        ends = np.array([(one.low, one.high) for one in self.bounds]).reshape(-1, 2)
        low, high = ends[:, :1], ends[:, 1:]
        shares = np.nan_to_num(np.abs(2.0 * values - high - low) / (high - low))
        edges = np.linspace(0, values.shape[1], windows + 1).round().astype(int)
        return np.asarray(np.maximum.reduceat(shares, edges[:-1], axis=1))

    def _fisher(self, runs: Sequence[Array | None], moves: Sequence[Array], sensor: str) -> Array | None:
        """Fisher matrix (n, n) of a robot, from a run with its parameters and runs with slightly changed parameters. None if a
        run diverges, or if the robot is near chaos.
        """
        rows = [run[len(self.bounds) :] for run in runs if run is not None]
        if len(rows) < len(runs):
            return None
        base, sizes = rows[0], np.array(moves)
        slopes = (np.array(rows[1:]) - base) / sizes.reshape(-1, 1, 1)
        slopes = slopes.reshape(*sizes.shape, *base.shape).mean(axis=0)
        own = np.ptp(base, axis=1)
        measured = np.isfinite(base).all(axis=1) & np.isfinite(slopes).all(axis=(0, 2))
        if np.any((np.abs(slopes).max(axis=2) > GROWTH * np.maximum(own, 1e-9))[:, measured & (own > 0.0)]):
            return None
        noise = np.array([one.noise for one in self.channels])
        used = measured & [one.sensor == sensor for one in self.channels]
        scaled = (slopes / noise[:, None])[:, used, :: self.every].reshape(len(slopes), -1)
        return np.asarray(scaled @ scaled.T)


def _quantities(name: str) -> list[str]:
    """Quantities of a joint that a name in a limits file means; empty if the name is unknown. `motor_torque` means the torques
    of all motors, and `elastic_torque` means the torques of all springs.
    """
    each = ([*each_motor(name.replace("motor_", "motor_{}_"))], [*each_motor(name + "_{}")])
    known = comparable()
    return next((several for several in ([name], *each) if several[0] in known), [])
