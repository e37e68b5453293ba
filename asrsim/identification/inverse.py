"""Joints driven by a known torque: what the recorded motion needs is compared with the torque that was recorded.

A joint that is pushed by its torque alone holds no position: in a simulation small errors of the torque add up without end, and
fits to the position follow these. The balance of torques has no memory (equation error, as in rigid-robot identification).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import RobotError
from asrsim.identification.data import Channel, Command, Data
from asrsim.identification.door import EXTERNAL
from asrsim.identification.noise import fine_noise
from asrsim.identification.played import Draw
from asrsim.identification.static import StaticTrack, is_static
from asrsim.identification.track import Playing, Track, numbers_of
from asrsim.robot.model import Joint, Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario

CUTOFF = 50.0
"""Hz of the low-pass filter, forwards and backwards, on motion and torque alike; less where the sampling is slow."""
ORDER = 4
"""Of the Butterworth filter."""
STANDS = 5.0
"""Deviations of a place's noise below which a joint that has not moved further may stand."""
NEAR, THROUGH = 1.0, 0.5
"""Periods of the filter's cutoff: as near to a joint that stands its filtered friction tells nothing; time in which it may turn
back without.
"""
EDGE = 0.1
"""s at both ends that the filter spoils."""
BLIND = 0.3
"""Share of the deviation of a joint's accelerations, by their noise, from which on a balance of torques is none."""


def is_driven_by_torque(data: Data, robot: Robot, free: Collection[str]) -> bool:
    """Whether all moving joints have a recorded torque, in mode 0, and a recorded place, and no spring, which may be free."""
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


@dataclass(frozen=True, eq=False)
class _Motion:
    """Motion of the joints as places show it, filtered."""

    recorded: Sequence[Array]
    """Places of each joint on the grid, not filtered."""
    q: Array
    """(rows, joints) places, velocities, accelerations that are compared."""
    v: Array
    a: Array
    speeds: Sequence[Array]
    """Velocities of each joint on the whole grid."""
    signs: Array
    """(rows, joints) of the velocities, filtered as the torque is: its jumps at reversals are."""
    bases: dict[tuple[tuple[str, str, float], ...], Array] = field(default_factory=dict)
    """Torques of inertia, gravity and Coriolis for the links' numbers so far."""


class InverseTrack(Track):
    """A recording of joints driven by torques: its channels are the torques, filtered as the motion is."""

    has_noisy_inputs = True
    """Noise of the torques is what is compared; that of the places counts here, many times in their accelerations."""

    def __init__(self, scenario: Scenario, robot: Robot, data: Data) -> None:
        super().__init__(scenario, robot, data)
        self.uncertain = ()
        joints = self.door.joints
        places = {channel.joint: channel for channel in data.channels if channel.quantity == "link_position"}
        self._places = [places[joint] for joint in joints]
        step = float(np.median(np.diff(self._places[0].time)))
        last = min(float(channel.time[-1]) for channel in places.values())
        self._grid = np.arange(float(max(c.time[0] for c in places.values())), last, step)
        self._cutoff = min(CUTOFF, 0.15 / step)
        # As often as the filter lets differ: its own correlation is not the model's.
        every = max(1, round(0.5 / (self._cutoff * step)))
        inside = (self._grid > self._grid[0] + EDGE) & (self._grid < self._grid[-1] - EDGE)
        self._rows = np.flatnonzero(inside)[::every]
        self._motions: dict[Draw | None, _Motion] = {None: self._motion(None)}
        self._torques = {command.key: self._sampled(command.time, command.values) for command in data.commands}
        self._moving = [self._surely_moves(j)[self._rows] for j in range(len(joints))]
        channels = []
        for joint, moving in zip(joints, self._moving, strict=True):
            values = self._torques[f"{joint}.reference_1"][moving]
            unit = "N" if self.door.robot.joint(joint).kind == "prismatic" else "N m"
            channels.append(
                Channel(
                    joint=joint, quantity="link_torque", unit=unit, time=self._grid[self._rows][moving], values=values,
                    noise=fine_noise(values), given=False, quantum=0.0,
                )
            )  # fmt: skip
        remark = f"{', '.join(joints)}: driven by the recorded torque; torques are compared, filtered at {self._cutoff:.3g} Hz"
        self.data = replace(data, channels=tuple(channels), remarks=(*data.remarks, remark))
        self.onset = float(self._grid[self._rows[0]])

    def _motion(self, draw: Draw | None) -> _Motion:
        """The joints' motion from their recorded places, with noise added."""
        places = [channel.values for channel in self._places]
        if draw is not None:
            generator = np.random.default_rng(draw.seed)
            places = [one.values + draw.size * one.noise * generator.normal(size=len(one.values)) for one in self._places]
        step = float(self._grid[1] - self._grid[0])
        recorded = [np.interp(self._grid, channel.time, one) for channel, one in zip(self._places, places, strict=True)]
        smooth = [self._filtered(one) for one in recorded]
        speeds = [np.gradient(q, step) for q in smooth]
        rates = [np.gradient(v, step) for v in speeds]
        signs = np.column_stack([self._filtered(np.sign(v)) for v in speeds])[self._rows]
        q, v, a = (np.column_stack(part)[self._rows] for part in (smooth, speeds, rates))
        return _Motion(recorded, q, v, a, speeds, signs)

    def _surely_moves(self, j: int) -> NDArray[np.bool_]:
        """(n,) of the grid: false around where joint j stands, held by any friction up to its level."""
        period = 1.0 / (self._cutoff * float(self._grid[1] - self._grid[0]))
        near, beside = round(NEAR * period), max(1, round(0.25 * period))
        moved, recorded = np.zeros(len(self._grid)), self._motions[None].recorded[j]
        moved[beside:-beside] = recorded[2 * beside :] - recorded[: -2 * beside]
        still = np.abs(moved) <= STANDS * np.sqrt(2.0) * self._places[j].floor
        surely: NDArray[np.bool_] = ~still
        edges = np.flatnonzero(np.diff(still, prepend=False, append=False))
        for first, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            turns = first > 0 and end < len(moved) and moved[first - 1] * moved[end] < 0.0
            if not (turns and end - first < THROUGH * period):
                surely[max(first - near, 0) : end + near] = False
        return surely

    @property
    def is_blind(self) -> bool:
        """Whether the noise of a joint's places makes much of its accelerations, or hides all of its motion."""
        if not all(len(channel.values) for channel in self.channels):
            return True
        known = self._motions[None].a
        moved = self._motion(Draw(0)).a - known
        return bool(np.any(np.std(moved, axis=0) > BLIND * np.std(known, axis=0)))

    def _filtered(self, values: Array) -> Array:
        from scipy.signal import butter, sosfiltfilt

        step = self._grid[1] - self._grid[0]
        return np.asarray(sosfiltfilt(butter(ORDER, self._cutoff, fs=1.0 / step, output="sos"), values))

    def _sampled(self, time: Array, values: Array, delay: float = 0.0) -> Array:
        return self._filtered(np.interp(self._grid - delay, time, values))[self._rows]

    def predictions(
        self, tables: Sequence[Mapping[str, float]], playing: Playing, until: float | None = None
    ) -> Iterator[list[Array] | None]:
        """The torque that each joint's motion needs, less what acts beside the command, as the recording would show it."""
        if playing.draw not in self._motions:
            self._motions = {None: self._motions[None], playing.draw: self._motion(playing.draw)}
        for values in tables:
            try:
                yield self._needed(values, self._motions[playing.draw], until)
            except RobotError:
                yield None

    def _needed(self, values: Mapping[str, float], motion: _Motion, until: float | None) -> list[Array]:
        changes, links = numbers_of(values), {link.name for link in self.door.robot.links}
        robot = self.door.varied(changes).robot
        # What only losses change is known from before.
        mark = tuple((owner, name, x) for owner, part in changes.items() if owner in links for name, x in part.items())
        if mark not in motion.bases:
            if len(motion.bases) > 64:
                motion.bases.clear()
            motion.bases[mark] = self.door.inverse_dynamics(robot, motion.q, motion.v, motion.a)
        predicted = []
        for j, (channel, moving) in enumerate(zip(self.channels, self._moving, strict=True)):
            joint, key = robot.joint(channel.joint), f"{channel.joint}.reference_1"
            needed = motion.bases[mark][:, j] + joint.damping * motion.v[:, j] + self._friction(motion, joint, j)
            needed += joint.spring_stiffness * (motion.q[:, j] - joint.spring_reference)
            needed -= self._torques.get(f"{joint.name}.{EXTERNAL}", 0.0)
            expected = needed[moving] / values.get(f"{key}.gain", 1.0) + values.get(f"{key}.offset", 0.0)
            if delay := values.get(f"{key}.delay", 0.0):
                # The recorded torque acts later: what is compared is shifted, not the motion.
                command = self._command(key)
                expected = expected - (self._sampled(command.time, command.values, delay)[moving] - channel.values)
            predicted.append(expected if until is None else expected[channel.time <= until + 1e-9])
        return predicted

    def _command(self, key: str) -> Command:
        return next(one for one in self.data.commands if one.key == key)

    def _friction(self, motion: _Motion, joint: Joint, j: int) -> Array:
        """(n,) torque against the motion of joint j, filtered."""
        if not joint.friction_varies:
            return np.asarray(joint.friction * motion.signs[:, j])
        speed, command = motion.speeds[j], self._command(f"{joint.name}.reference_1")
        load = np.abs(self._filtered(np.interp(self._grid, command.time, command.values)))
        static = joint.stribeck_friction * np.exp(-((speed / joint.stribeck_velocity) ** 2))
        return self._filtered((joint.friction + joint.load_friction * load + static) * np.sign(speed))[self._rows]


def track_of(scenario: Scenario, robot: Robot, data: Data, applied: Robot, free: Collection[str]) -> Track:
    """A recording made ready. applied: the robot with the scenario's modes and parameters; free: keys."""
    if is_driven_by_torque(data, applied, free):
        balance = InverseTrack(scenario, robot, data)
        if not balance.is_blind:
            return balance
        balance.close()
        why = "encoders are too coarse for accelerations: motion under the recorded torques is simulated, where errors add up"
        data = replace(data, remarks=(*data.remarks, why))
    trusted = [key.removesuffix(".offset") for key in free if key.endswith("_position.offset")]
    track = Track(scenario, robot, data, trusted)
    if not is_static(track, free):
        return track
    track.close()
    return StaticTrack(scenario, robot, data, trusted)
