"""Joints that a recorded torque drives. In a simulation of such a joint, errors of the torque accumulate. Therefore the torque
that the recorded motion needs is compared with the recorded torque (equation error).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import RobotError
from asrsim.identification.data import Channel, Data
from asrsim.identification.door import EXTERNAL, Door, Drive
from asrsim.identification.noise import fine_noise, smoothed
from asrsim.identification.track import Playing, Track, numbers_of
from asrsim.robot.model import Link, Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario

KEPT = 16
"""Number of mass distributions whose torques are cached."""
LOUD = 30.0
"""Ratio of the motion's spectrum to the noise's spectrum above which a frequency belongs to the motion."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Filtered motion: position, velocity, acceleration and sign of the velocity at the compared rows; velocity on the grid."""

    place: Array
    velocity: Array
    rate: Array
    sign: Array
    speed: Array


@dataclass(frozen=True, eq=False)
class Grid:
    """Times of a recording, a low-pass filter, and the rows that are compared."""

    time: Array
    cutoff: float
    """Fraction of half the sampling rate."""
    rows: slice | NDArray[np.intp]

    def smooth(self, values: Array) -> Array:
        """Filtered series (rows,) at the compared rows, from a series on the grid."""
        return smoothed(values, self.cutoff)[self.rows]

    def motion(self, values: Array) -> Motion:
        """Filtered motion for positions on the grid."""
        place = smoothed(values, self.cutoff)
        speed = np.gradient(place, self.time)
        rate = np.gradient(speed, self.time)
        return Motion(place[self.rows], speed[self.rows], rate[self.rows], self.smooth(np.sign(speed)), speed)


class Links:
    """Motions of all moving links, and the torques that they need."""

    def __init__(self, door: Door, grid: Grid, motions: Sequence[Motion]) -> None:
        self._door, self._grid, self._motions = door, grid, motions
        self.place, self.velocity, self.rate = (
            np.column_stack([getattr(one, name) for one in motions]) for name in ("place", "velocity", "rate")
        )
        self._known: list[tuple[tuple[Link, ...], Array]] = []

    def inertial(self, robot: Robot) -> Array:
        """(rows, joints) torques of inertia, gravity and Coriolis forces; cached, since losses and springs do not change
        them.
        """
        for links, torques in self._known:
            if links == robot.links:
                return torques
        torques = self._door.inverse_dynamics(robot, self.place, self.velocity, self.rate)
        self._known = [*self._known[1 - KEPT :], (robot.links, torques)]
        return torques

    def needed(self, drive: Drive, robot: Robot, j: int, load: Array) -> Array:
        """(rows,) torque on joint j: inertia, damping, friction and its own spring. load: torque on the grid."""
        joint, motion = robot.joint(drive.name), self._motions[j]
        friction = joint.friction * motion.sign
        if joint.friction_varies:
            static = joint.stribeck_friction * np.exp(-((motion.speed / joint.stribeck_velocity) ** 2))
            level = joint.friction + joint.load_friction * np.abs(load) + static
            friction = self._grid.smooth(level * np.sign(motion.speed))
        spring = joint.spring_stiffness * (motion.place - joint.spring_reference)
        return np.asarray(self.inertial(robot)[:, j] + (joint.damping + drive.link_brake) * motion.velocity + friction + spring)


def bandwidth(time: Array, channel: Channel) -> float:
    """Highest frequency at which a recorded position exceeds its noise, Hz; time: an even grid."""
    speed = np.diff(np.interp(time, channel.time, channel.values))
    n, step = len(speed), time[1] - time[0]
    power, frequency = np.abs(np.fft.rfft(speed * np.hanning(n))) ** 2, np.fft.rfftfreq(n, step)
    # Differences of white noise have this spectrum, under this window.
    level = max(channel.noise, channel.quantum) ** 2 * n * 0.375 * 4.0 * np.sin(np.pi * frequency * step) ** 2
    loud = np.flatnonzero(power > LOUD * level + 1e-300)
    return 1.5 * float(frequency[loud[-1]]) if len(loud) else 1.0


# -- joints that a recorded torque drives ------------------------------------------------------------------------------------

CUTOFF = 50.0
"""Largest cutoff of the low-pass filter on motion and torque, Hz; lower if the sampling or the motion is slow."""
STANDS = 5.0
"""Displacement, in standard deviations of the position's noise, below which a joint may stand still."""
NEAR, THROUGH = 1.0, 0.5
"""Periods of the cutoff frequency: left out beside a standstill, where filtered friction is unknown; longest reversal that is
no standstill.
"""
EDGE, SETTLED = 0.1, 3.0
"""Time (s), and number of periods of the cutoff frequency, left out at each end, since the filter distorts them."""
BLIND = 0.3
"""Largest ratio of noise to signal in a joint's accelerations."""


def is_driven_by_torque(data: Data, robot: Robot, free: Collection[str]) -> bool:
    """Whether each moving joint is in mode 0, has a recorded torque and position, and has no spring."""
    modes = {block.joint: data.modes.get(block.joint, block.mode) for block in robot.actuators}
    torques = {command.joint for command in data.commands if command.quantity == "reference_1"}
    places = {channel.joint for channel in data.channels if channel.quantity == "link_position"}
    return bool(robot.moving_joints) and all(
        modes.get(joint.name) == 0
        and joint.name in torques & places
        and joint.spring_stiffness == 0.0
        and f"{joint.name}.passive_stiffness" not in free
        for joint in robot.moving_joints
    )


class TorqueTrack(Track):
    """A recording of joints that torques drive. Its channels are the torques, filtered like the motion."""

    has_noisy_inputs = True
    """The compared torques have noise, and so have the accelerations, which magnify the noise of the positions."""

    def __init__(self, scenario: Scenario, robot: Robot, data: Data) -> None:
        super().__init__(scenario, robot, data)
        self.uncertain = ()
        places = {channel.joint: channel for channel in data.channels if channel.quantity == "link_position"}
        self._places = [places[joint] for joint in self.door.joints]
        step = float(np.median(np.diff(self._places[0].time)))
        last = min(float(channel.time[-1]) for channel in self._places)
        time = np.arange(float(max(c.time[0] for c in self._places)), last, step)
        widest = min(CUTOFF, 0.15 / step)
        # Above the bandwidth of the motion, accelerations are noise.
        cutoff = min(widest, max(bandwidth(time, place) for place in self._places))
        # Samples are so far apart that the filter does not correlate them.
        every = max(1, round(0.5 / (cutoff * step)))
        edge = max(EDGE, SETTLED / cutoff)
        inside = (time > time[0] + edge) & (time < time[-1] - edge)
        self._grid = Grid(time, 2.0 * cutoff * step, np.flatnonzero(inside)[::every])
        self._wide = replace(self._grid, cutoff=2.0 * widest * step)
        rows = time[self._grid.rows]
        self._links: dict[int | None, Links] = {None: self._moved(None, self._grid)}
        self._torques = {command.key: np.interp(time, command.time, command.values) for command in data.commands}
        self._moving = [self._surely_moves(place, 1.0 / (cutoff * step))[self._grid.rows] for place in self._places]
        channels = []
        for joint, moving in zip(self.door.joints, self._moving, strict=True):
            values = self._grid.smooth(self._torques[f"{joint}.reference_1"])[moving]
            unit = "N" if self.door.robot.joint(joint).kind == "prismatic" else "N m"
            channels.append(
                Channel(
                    joint=joint, quantity="link_torque", unit=unit, time=rows[moving], values=values,
                    noise=fine_noise(values), quantum=0.0,
                )
            )  # fmt: skip
        names = ", ".join(self.door.joints)
        remark = f"{names}: driven by the recorded torque; torques are compared, filtered at {cutoff:.3g} Hz"
        self.data = replace(data, channels=tuple(channels), remarks=(*data.remarks, remark))
        self.onset = float(rows[0])

    def _moved(self, draw: int | None, grid: Grid) -> Links:
        """Motion of the joints from their recorded positions, with a draw of noise added; None: without noise."""
        generator, motions = np.random.default_rng(draw), []
        for place in self._places:
            values = place.values
            if draw is not None:
                values = values + place.noise * generator.normal(size=len(values))
            motions.append(grid.motion(np.interp(grid.time, place.time, values)))
        return Links(self.door, grid, motions)

    def _surely_moves(self, place: Channel, period: float) -> NDArray[np.bool_]:
        """Mask (n,) on the grid: false around a standstill, where static friction may have any value up to its limit."""
        near, beside = round(NEAR * period), max(1, round(0.25 * period))
        recorded = np.interp(self._grid.time, place.time, place.values)
        moved = np.zeros(len(recorded))
        moved[beside:-beside] = recorded[2 * beside :] - recorded[: -2 * beside]
        still = np.abs(moved) <= STANDS * np.sqrt(2.0) * place.floor
        surely: NDArray[np.bool_] = ~still
        edges = np.flatnonzero(np.diff(still, prepend=False, append=False))
        for first, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            turns = first > 0 and end < len(moved) and moved[first - 1] * moved[end] < 0.0
            if not (turns and end - first < THROUGH * period):
                surely[max(first - near, 0) : end + near] = False
        return surely

    @property
    def is_blind(self) -> bool:
        """Whether the noise of a joint's positions dominates its accelerations or hides all of its motion."""
        if not all(len(channel.values) for channel in self.channels):
            return True
        known, noisy = (self._moved(draw, self._wide).rate for draw in (None, 0))
        return bool(np.any(np.std(noisy - known, axis=0) > BLIND * np.std(known, axis=0)))

    def predictions(
        self, tables: Sequence[Mapping[str, float]], playing: Playing, until: float | None = None
    ) -> Iterator[list[Array] | None]:
        """Torque that each joint's motion needs, minus all torques other than the command, at the recorded times."""
        if playing.draw not in self._links:
            self._links = {None: self._links[None], playing.draw: self._moved(playing.draw, self._grid)}
        for values in tables:
            try:
                yield self._needed(values, self._links[playing.draw], until)
            except RobotError:
                yield None

    def _needed(self, values: Mapping[str, float], links: Links, until: float | None) -> list[Array]:
        varied, predicted = self.door.varied(numbers_of(values)), []
        for j, (drive, channel, moving) in enumerate(zip(varied.drives, self.channels, self._moving, strict=True)):
            key, time = f"{channel.joint}.reference_1", self._grid.time
            needed = links.needed(drive, varied.robot, j, self._torques[key])
            if (pushed := self._torques.get(f"{channel.joint}.{EXTERNAL}")) is not None:
                needed -= self._grid.smooth(pushed)
            expected = needed[moving] / values.get(f"{key}.gain", 1.0) + values.get(f"{key}.offset", 0.0)
            if delay := values.get(f"{key}.delay", 0.0):
                # The recorded torque acts later: what is compared is shifted, not the motion.
                late = self._grid.smooth(np.interp(time - delay, time, self._torques[key]))
                expected = expected - (late[moving] - channel.values)
            predicted.append(expected if until is None else expected[channel.time <= until + 1e-9])
        return predicted


def track_of(scenario: Scenario, robot: Robot, data: Data, applied: Robot, free: Collection[str]) -> Track:
    """A recording made ready. applied: the robot with the scenario's modes and parameters; free: keys."""
    if is_driven_by_torque(data, applied, free):
        balance = TorqueTrack(scenario, robot, data)
        if not balance.is_blind:
            return balance
        balance.close()
        why = "encoders are too coarse for accelerations: motion under the recorded torques is simulated, where errors add up"
        data = replace(data, remarks=(*data.remarks, why))
    return Track(scenario, robot, data, [key.removesuffix(".offset") for key in free if key.endswith("_position.offset")])
