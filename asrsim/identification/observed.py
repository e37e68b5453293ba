"""Measured positions of links and motors. An observer corrects a simulation towards these positions.

At each measured position, with the error e = measured - simulated, the observer adds (1 - a^2) e to the position and (1 - a)^2
e / T to the velocity, with a = exp(-w T), the bandwidth w and the interval T between corrections. Without other forces, both
poles of the error are a. The gains do not depend on parameters of the robot, and the corrected simulation stays close to the
recording.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache

import numpy as np

from asrsim.identification.data import Channel, RecordedSignal
from asrsim.identification.door import SteppedJoint
from asrsim.samples import Array

BETWEEN = 0.2
"""Shortest interval between corrections, in units of 1 / w. If the sampling interval is shorter, some samples cause no
correction, since fewer corrections add less noise. Within this interval an error grows by at most a fifth.
"""
FASTEST = 0.5
"""Largest product of the observer's bandwidth and the sampling interval. At this bandwidth, a sample corrects two thirds of an
error.
"""
REVERSED = 0.7
"""A deflection has the wrong sign if the unexplained acceleration of the link with the opposite sign is below this fraction of
the unexplained acceleration with the recorded sign. The right sign explains more of the acceleration, but noise and friction
hide a part of the difference.
"""
GAP = 3.0
"""Positions between two samples count as not measured if the time between the samples is at least this number of usual sampling
intervals. If only one sample is lost, a spline is still close to the motion.
"""


class Measured:
    """Positions of links and motors, computed from the channels and commands of a recording."""

    def __init__(self, channels: Sequence[RecordedSignal], drives: Sequence[SteppedJoint], step: float) -> None:
        """channels: recorded channels and commands; step: time step of the simulation, s."""
        self._drives, self._step, self._channels = drives, step, {one.key: one for one in channels}
        self.places = list(_places(self._channels, drives))
        """For each measured position: index of the joint, column (0: link, i: motor i), and channels, each with a factor 1 or
        -1. The position is the sum of the channels times their factors.
        """
        used = {one.key: one for *_, terms in self.places for one, _ in terms}
        self._curves = {key: _Curve(one) for key, one in used.items()}
        self.interval = max((curve.interval for curve in self._curves.values()), default=math.inf)
        """Largest of the channels' usual sampling intervals, s."""
        self._coarse = any(isinstance(one, Channel) and one.quantum for one in used.values())
        self.columns = 1 + max((drive.dynamic_motors for drive in drives), default=0)

    def gains(self, bandwidth: float, slowest: float) -> tuple[int, tuple[float, float]]:
        """Number of steps between corrections, and gains of position (1) and velocity (1/s). bandwidth: bandwidth of the
        observer, rad/s; slowest: shortest interval between corrections if a sensor is an encoder, s. After a shorter interval,
        the encoder's steps would act as noise of the velocity.
        """
        least = max(self.interval, BETWEEN / bandwidth, slowest if self._coarse else 0.0)
        every = max(1, round(least / self._step))
        a = math.exp(-bandwidth * every * self._step)
        return every, (1.0 - a * a, (1.0 - a) ** 2 / (every * self._step))

    @property
    def fastest(self) -> float:
        """Largest useful bandwidth of the observer, rad/s."""
        return FASTEST / self.interval

    def shows(self, bandwidth: float) -> bool:
        """Whether the samples resolve a motion of this bandwidth. False if a sensor is an encoder, since its steps would
        dominate. bandwidth: rad/s.
        """
        return not self._coarse and bandwidth <= self.fastest

    def at(self, values: Mapping[str, float], clock: float, every: int, steps: int) -> Array:
        """Measured positions (steps + 1, joints, columns) at whole steps. A value is NaN if the position is not measured or not
        corrected at this step.

        values: parameters of the sensors by key; clock: delay of all channels, s; every: number of steps between corrections.
        """
        found = np.full((steps + 1, len(self._drives), self.columns), np.nan)
        for joint, column, terms in self.places:
            found[::every, joint, column] = 0.0
            for channel, sign in terms:
                key = channel.key
                late = values.get(f"{key}.delay", 0.0)
                # A delayed sensor shows an earlier position; a delayed command acts later than it was recorded.
                late = clock + late if isinstance(channel, Channel) else -late
                shown = self._curves[key].at(late, every * self._step, steps // every + 1)
                true = values.get(f"{key}.gain", 1.0) * (shown - values.get(f"{key}.offset", 0.0))
                found[::every, joint, column] += sign * true
        return found


def link_channel(drive: SteppedJoint, shown: Mapping[str, RecordedSignal]) -> tuple[Channel, tuple[str, ...]] | None:
    """Position of a link, and the keys of the series from which it is computed. The position is the measured link position or,
    if the joint has one motor, the motor position minus the deflection. None if neither is recorded. shown: recorded channels
    and commands by key.
    """
    link, deflection = (shown.get(f"{drive.name}.{what}") for what in ("link_position", "deflection"))
    if isinstance(link, Channel):
        return link, (link.key,)
    motor = shown.get(f"{drive.name}.{'reference_1' if _is_played(drive) else 'motor_1_position'}")
    if motor is None or not isinstance(deflection, Channel) or drive.actuator is None or drive.actuator.motors != 1:
        return None
    inside = (deflection.time >= motor.time[0] - 1e-9) & (deflection.time <= motor.time[-1] + 1e-9)
    time, noises, quanta = deflection.time[inside], [deflection.noise], [deflection.quantum]
    if isinstance(motor, Channel):
        noises, quanta = [*noises, motor.noise], [*quanta, motor.quantum]
    place = Channel(
        joint=drive.name, quantity="link_position", unit=deflection.unit, time=time,
        values=np.interp(time, motor.time, motor.values) - deflection.values[inside],
        noise=math.hypot(*noises), quantum=max(quanta),
    )  # fmt: skip
    return place, (motor.key, deflection.key)


def _is_played(drive: SteppedJoint) -> bool:
    """Whether the drive has a single motor that follows its reference exactly, so that the command is the motor position."""
    single = drive.actuator is not None and drive.actuator.motors == 1
    return single and drive.mode is not None and drive.mode.spring and not drive.mode.motor


def is_reversed(drive: SteppedJoint, shown: Mapping[str, RecordedSignal], band: float) -> bool:
    """Whether a deflection has the wrong sign. With the opposite sign, the torque of a spring then explains the acceleration of
    the link better. False if the link position is not computed from motor position and deflection. band: bandwidth of the
    motion, rad/s.
    """
    deflection, link = shown.get(f"{drive.name}.deflection"), link_channel(drive, shown)
    if deflection is None or link is None or deflection.key not in link[1]:
        return False
    step = float(np.median(np.diff(link[0].time)))
    time = np.arange(link[0].time[0], link[0].time[-1], step)
    place, bent = (np.interp(time, one.time, one.values) for one in (link[0], deflection))
    width = 1.0 / (band * step)
    if len(time) < 10.0 * width:
        return False
    return _unpulled(place + 2.0 * bent, -bent, width) < REVERSED * _unpulled(place, bent, width)


def _unpulled(place: Array, bent: Array, width: float) -> float:
    """Fraction of the variance of a link's acceleration that a spring, a damper and a constant torque do not explain. It is 1
    if the stiffness would be negative. place: positions (n,) of the link; bent: deflections (n,) of the spring; width: standard
    deviation of a Gaussian filter, in samples.
    """
    from scipy.ndimage import gaussian_filter1d

    edge = int(3.0 * width) + 1
    acceleration, speed, turned = (
        gaussian_filter1d(values, width, order=order)[edge:-edge] for values, order in ((place, 2), (place, 1), (bent, 0))
    )
    terms = np.column_stack([turned, speed, np.ones(len(turned))])
    terms /= np.maximum(np.abs(terms).max(axis=0), 1e-300)
    sizes, *_ = np.linalg.lstsq(terms, acceleration)
    left = acceleration - terms @ sizes
    return float(np.var(left) / np.var(acceleration)) if sizes[0] > 0.0 else 1.0


class _Curve:
    """Spline through a channel."""

    def __init__(self, channel: RecordedSignal) -> None:
        from scipy.interpolate import CubicSpline

        self._time, self._spline = channel.time, CubicSpline(channel.time, channel.values)
        self.interval = float(np.median(np.diff(channel.time)))
        self.at = lru_cache(8)(self._at)

    def _at(self, late: float, step: float, count: int) -> Array:
        """Values (count,) of the channel `late` s after the multiples of `step` s; NaN before the first sample, after the last
        sample and in gaps.
        """
        time = np.arange(count) * step + late
        after = np.clip(np.searchsorted(self._time, time - 1e-9), 1, len(self._time) - 1)
        known = (time > self._time[0] - 1e-9) & (time < self._time[-1] + 1e-9)
        known &= self._time[after] - self._time[after - 1] < GAP * self.interval
        return np.where(known, self._spline(time), np.nan)


def _places(
    channels: Mapping[str, RecordedSignal], drives: Sequence[SteppedJoint]
) -> Iterator[tuple[int, int, list[tuple[RecordedSignal, float]]]]:
    for j, drive in enumerate(drives):
        link, deflection = (channels.get(f"{drive.name}.{what}") for what in ("link_position", "deflection"))
        motors = [channels.get(f"{drive.name}.motor_{i}_position") for i in range(1, 1 + drive.dynamic_motors)]
        # With one motor, the deflection is the motor position minus the link position.
        motor = motors[0] if len(motors) == 1 else None
        if _is_played(drive):
            motor = channels.get(f"{drive.name}.reference_1")
        if link is not None:
            yield j, 0, [(link, 1.0)]
        elif motor is not None and deflection is not None:
            yield j, 0, [(motor, 1.0), (deflection, -1.0)]
        for i, one in enumerate(motors, 1):
            if one is not None:
                yield j, i, [(one, 1.0)]
        if len(motors) == 1 and motor is None and link is not None and deflection is not None:
            yield j, 1, [(link, 1.0), (deflection, 1.0)]
