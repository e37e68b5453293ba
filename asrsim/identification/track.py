"""A recording with its simulation. The simulation plays the recorded commands with given parameters, and predicts the recorded
channels.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import inf
from typing import ClassVar

import numpy as np

from asrsim.identification.data import Channel, Data, PlayedCommand, RecordedSignal
from asrsim.identification.door import EXTERNAL, Door, Observer, Start, SteppedJoint, Substeps
from asrsim.identification.flexible import with_elastic_link
from asrsim.identification.noise import MOVES, motion_band
from asrsim.identification.observed import Measured, is_reversed, link_channel
from asrsim.identification.parameters import CLOCK, JUMP, motor_start, numbers_of
from asrsim.identification.payload import carrying
from asrsim.metrics.values import root_mean_square
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.scenario.recording_plan import SOON
from asrsim.signals.base import Signal
from asrsim.signals.common import between


@dataclass(frozen=True, kw_only=True, eq=False)
class Played(Signal):
    """A recorded command, averaged over each step. Averaging makes results depend smoothly on the delay.

    Large jumps are not averaged, since a motor at its torque limit responds nonlinearly. The simulation splits its steps at
    these jumps.
    """

    kind: ClassVar[str] = "played"

    command: PlayedCommand
    step: float
    """Duration of the averaging window, s."""
    gain: float = 1.0
    offset: float = 0.0
    delay: float = 0.0
    early: tuple[tuple[float, float], ...] = ()
    """Pairs of two times for each jump: time of the first sample after the jump, s, and time from the jump until this sample,
    s.
    """
    _known: dict[bytes, Array] = field(default_factory=dict, init=False, repr=False)

    def values(self, time: Array) -> Array:
        """Values gain * (recorded - offset), delayed by `delay` s. They are cached, since simulations ask repeatedly for the
        same times.
        """
        key = time.tobytes()
        if key not in self._known:
            self._known[key] = self._means(time - self.delay)
        return self._known[key].copy()

    def _means(self, at: Array) -> Array:
        curve = self.command.curve
        ends = curve.integral(np.stack([at - 0.5 * self.step, at + 0.5 * self.step]))
        means = (ends[1] - ends[0]) / self.step
        times = self._jumps
        for late, jump, size in zip(curve.jumps, times, curve.sizes, strict=True):
            # Part of each averaging window that lies between the jump and the first sample after it.
            low, high = (np.clip(at + side * self.step, jump, late) for side in (-0.5, 0.5))
            means += size / self.step * (high - low)
        for jump, size in zip(times, curve.sizes, strict=True):
            # Near a jump, average only the samples on the same side of the jump.
            near = np.abs(at - jump) < 0.5 * self.step
            share = (at[near] - jump) / self.step + 0.5
            means[near] += size * np.where(at[near] >= jump - 1e-9, 1.0 - share, -share)
        return np.asarray(self.gain * (means - self.offset), dtype=np.float64)

    def jumps(self, start: float, end: float) -> Array:
        """Times of large jumps."""
        return between(np.sort(self._jumps) + self.delay, start, end)

    @property
    def _jumps(self) -> Array:
        early, jumps = dict(self.early), self.command.curve.jumps
        return np.array([jump - early.get(jump, 0.0) for jump in jumps.tolist()]) if early else jumps


DIGITS = 3
"""Number of decimals of initial positions (rad, m) that people write by hand."""
STILL, DOUBTFUL = 4.5, 2.0
"""STILL: a recording's initial position counts as the scenario's initial position if they differ by at most this number of
standard errors, and its initial velocity counts as 0 within this number of standard errors.
DOUBTFUL: number of standard errors for the initial velocity if the scenario's initial position was copied from the recording.
"""
FARTHEST = 10.0
"""Number of standard errors by which a fit may change a measured initial position. Larger changes would hide errors of the
model.
"""
RESTED = 0.1
"""A motor's initial position is fixed if its standard error is at most this fraction of the sensor noise. The mean of 100
samples at rest has this standard error.
"""
BENT = 0.4
"""Assumed error of an initial slope due to the curvature, as a fraction of the change of the slope over the first samples."""
FIRST, LONG = 15, 10
"""FIRST: largest number of samples by which an initial state is first determined. More samples are used if they determine it
better.
LONG: smallest number of samples at rest that are averaged.
"""
LONGEST = 4.0
"""Longest time over which a parabola is fitted for the initial state, times the bandwidth of the motion in rad/s. A parabola
cannot follow a whole period.
"""
KEPT = 6
"""Largest number of predictions that a track caches. It also limits the cached sets of played commands, and the cached sets of
sampling times of each channel.
"""


TrackSettings = tuple[tuple[str, float], ...]
"""Values of parameters, as pairs (key, value)."""


@dataclass(frozen=True)
class Playing:
    """Settings with which a recording is simulated: substeps, way of playing the commands, and observer."""

    substeps: Substeps
    staircases: frozenset[str] = frozenset()
    """Keys of commands that are played as staircases. The value of each sample is held until the next sample."""
    bandwidth: float = 0.0
    """Bandwidth of the observer that corrects the simulation towards the recorded positions, rad/s; 0: no observer."""
    draw: int | None = None
    """Random seed of the noise that is added to the recorded commands; None: no noise."""
    finer: int = 1
    """Factor by which the number of substeps exceeds the number that the stiffest spring needs."""


class Track:
    """A recording, with the simulation that is fitted to it. It is immutable."""

    def __init__(
        self, scenario: Scenario, robot: Robot, data: Data, freed: Collection[str] = (), *, stated: bool = False
    ) -> None:
        """freed: keys of the parameters that the user frees; stated: whether the initial state is the scenario's instead of the
        recording's.
        """
        self.data, self.channels = data, data.channels
        self._made_from, self._elastic = (scenario, robot, frozenset(freed)), dict[str, Track | None]()
        self.scenario, robot = _scenario(scenario, data), carrying(robot, data.payload)
        self.door = Door(self.scenario, robot)
        self.wanted = [(self.door.joints.index(one.joint), one.quantity) for one in self.channels]
        self.measured = Measured((*data.commands, *self.channels), self.door.drives, self.scenario.step)
        self.motion = max((motion_of(c) for c in self.channels if c.quantity.endswith(("position", "deflection"))), default=0.0)
        """Bandwidth of the motion, the largest of all recorded positions, rad/s; see `motion_band`. 0: no position is recorded.
        """
        self._references = lru_cache(KEPT)(self._play)
        self._predicted = lru_cache(KEPT)(self._predict)
        self._places = lru_cache(KEPT * len(self.channels))(self._places_of)
        self.initial: dict[str, float] = {}
        """Positions and velocities of links at time 0, by key. Motors are included if they do not start as the scenario states.
        """
        self.uncertain: list[str] = []
        """Keys of initial positions and velocities that differ from the scenario, except keys that the user frees."""
        self.within: dict[str, float] = {}
        """Largest errors of the initial positions of links and motors at rest, by key. They are known if neither the zero
        offset nor the scale of the sensor is free; a delay of the sensor has no effect on them.
        """
        self._following: dict[str, float] = {}
        """Mean initial position of the motors in the scenario, by joint. Only joints are included whose link is not recorded,
        so that the link's initial position changes with the motors' initial positions.
        """
        for drive, position, velocity in zip(self.door.drives, self.door.positions, self.door.velocities, strict=True):
            keys = f"{drive.name}.initial_position", f"{drive.name}.initial_velocity"
            self.initial |= dict(zip(keys, (position, velocity), strict=True))
            if not stated:
                self._begin_motors(drive, freed, seen=self._begin_link(drive, position, freed))
        self.onset = min(float(c.time[min(onset(c, MOVES), len(c.time) - 1)]) for c in self.channels)
        """Time of the first motion, s."""
        self.jumps = sorted({time for command in data.commands for time in command.curve.jumps.tolist() if time > 0.0})
        """Times of the first samples after jumps of commands, s. Commands that jump at the same time share an entry."""
        self.sampling = max((float(np.median(np.diff(one.time))) for one in data.commands if len(one.time) > 1), default=0.0)
        """Largest of the commands' usual sampling intervals, s."""

    # -- initial state -------------------------------------------------------------------------------------------------

    def _begin_link(self, drive: SteppedJoint, position: float, freed: Collection[str]) -> bool:
        """Set the initial state of a link. It is the scenario's state, or the recorded state if the recording contradicts the
        scenario. If the zero offset of the sensor is free, the link starts at the scenario's position; this position is free if
        it was copied from the sensor. Return whether the link is recorded. position: the scenario's initial position, rad or m.
        """
        keys = f"{drive.name}.initial_position", f"{drive.name}.initial_velocity"
        series = self._series
        if (recorded := link_channel(drive, series)) is None:
            return False
        channel, sources = recorded
        # An initial position that is not a round number was probably copied from a noisy recording. Since coarse sensors give
        # round numbers, also compare it with the first sample of a coarse sensor.
        copied = any(_is_copied(position, series[key]) for key in sources) or position != round(position, DIGITS)
        measured = copied and not self.scenario.initial_equilibrium
        found = _beginning(channel, self.motion, measured=measured)
        if found is not None and (measured or found.contradicts(position)):
            zero = any(f"{key}.offset" in freed for key in sources)
            # A position that was copied from a sensor with an unknown zero offset is unknown, too.
            place = position if zero else found.position
            self._free(keys, replace(found, position=place), freed, fixed=zero and not measured)
            if any(f"{key}.{what}" in freed for key in sources for what in ("offset", "gain")):
                self.within.pop(keys[0], None)
        return True

    def _begin_motors(self, drive: SteppedJoint, freed: Collection[str], *, seen: bool) -> None:
        """Set the initial states of a joint's motors, if all of them are recorded. seen: whether the joint's link is
        recorded.
        """
        sensors, motors = {one.key: one for one in self.channels}, range(1, drive.dynamic_motors + 1)
        names = [f"{drive.name}.motor_{i}_position" for i in motors]
        link, speed = f"{drive.name}.initial_position", f"{drive.name}.initial_velocity"
        keys, place = [motor_start(drive.name, i) for i in motors], self.initial[link]
        if drive.motor_positions and any(f"{name}.offset" in freed for name in names if name in sensors):
            # Start the motors at the position of their link, since the scenario's motor positions were copied from sensors with
            # unknown zero offsets.
            self.initial |= {key: place for key, _ in keys}
            return
        known = [sensors[name] for name in names if name in sensors and f"{name}.offset" not in freed]
        channels = [channel for channel in known if channel.time[0] <= SOON]
        if not names or len(channels) < len(names):
            return
        rest, moves = (drive.motor_positions or (place,) * len(names))[: len(names)], bool(self.initial[speed])
        # Motors whose initial position the scenario does not state start at the position of their link.
        unknown = moves or (link in self.uncertain and not drive.motor_positions)
        unknown |= any(one != round(one, DIGITS) for one in drive.motor_positions)
        starts = [found for one in channels if (found := _beginning(one, self.motion, measured=unknown))]
        pairs = zip(starts, rest, strict=False)
        if len(starts) < len(names) or not (unknown or any(start.contradicts(stated) for start, stated in pairs)):
            return
        for key, channel, start in zip(keys, channels, starts, strict=True):
            if not moves and not start.moves and start.error <= RESTED * channel.noise:
                self.initial[key[0]] = start.position
                continue
            self._free(key, replace(start, moves=start.moves or moves), freed)
            if f"{channel.key}.gain" in freed:
                self.within.pop(key[0], None)
        if not seen:
            self._following[drive.name] = float(np.mean(rest))

    def _free(self, keys: tuple[str, str], found: _Beginning, freed: Collection[str], *, fixed: bool = False) -> None:
        """Start at a recorded position and velocity, and free both. keys: keys of the position and of the velocity; fixed:
        whether the position is not changed and not freed.
        """
        shown = {} if fixed else {keys[0]: found.position}
        shown |= {keys[1]: found.velocity} if found.moves else {}
        self.initial |= shown
        self.uncertain += [key for key in shown if key not in freed]
        if not found.moves:
            self.within[keys[0]] = FARTHEST * found.error

    @property
    def _series(self) -> dict[str, RecordedSignal]:
        """Commands and channels by key."""
        return {one.key: one for one in (*self.data.commands, *self.channels)}

    def is_reversed(self, channel: Channel) -> bool:
        """Whether a recorded deflection has the wrong sign."""
        drive = next(drive for drive in self.door.drives if drive.name == channel.joint)
        return channel.quantity == "deflection" and is_reversed(drive, self._series, self.motion)

    def elastic(self, joint: str, frequency: float) -> Track | None:
        """The recording with the simulation of a robot whose link behind the joint is elastic. None if this link cannot be
        elastic. frequency: natural frequency of the link's second body, rad/s.
        """
        if joint not in self._elastic:
            scenario, robot, freed = self._made_from
            changed = with_elastic_link(robot, joint, frequency)
            self._elastic[joint] = None if changed is None else Track(scenario, changed, self.data, freed)
        return self._elastic[joint]

    def close(self) -> None:
        """Release the engines."""
        for one in (self, *filter(None, self._elastic.values())):
            one.door.close()

    # -- prediction ----------------------------------------------------------------------------------------------------

    def predict(self, values: Mapping[str, float], playing: Playing, until: float) -> list[Array]:
        """Prediction of each channel at its recorded times up to `until` s; NaN if the simulation diverges."""
        return self._predicted(tuple(sorted(values.items())), playing, until)

    def _predict(self, values: TrackSettings, playing: Playing, until: float) -> list[Array]:
        return next(self.predictions([dict(values)], playing, until))

    def predictions(self, tables: Sequence[Mapping[str, float]], playing: Playing, until: float) -> Iterator[list[Array]]:
        """Predictions as in `predict` for any number of parameter sets, which are simulated in one rollout."""
        if not tables:
            return
        steps = min(max(4, int(np.ceil((until + 0.3) / self.scenario.step))), self.scenario.steps)
        worlds = [self._world(values, playing) for values in tables]
        observer = self._observer(tables, playing, steps) if playing.bandwidth else None
        found = self.door.rollout(self.wanted, worlds, steps=steps, substeps=playing.substeps, observer=observer)
        for values, series in zip(tables, found, strict=True):
            yield self._sensed(values, series, until)

    @property
    def observes(self) -> bool:
        """Whether an observer can correct the simulation towards recorded positions."""
        return bool(self.measured.places) and self.motion > 0.0 and self.door.observes

    def _observer(self, tables: Sequence[Mapping[str, float]], playing: Playing, steps: int) -> Observer:
        every, gains = self.measured.gains(playing.bandwidth, 1.0 / self.motion)
        shown = [self.measured.at(values, values.get(CLOCK, 0.0), every, steps) for values in tables]
        return Observer(measured=np.stack(shown), gains=gains)

    def series(self, values: Mapping[str, float], playing: Playing, names: Sequence[tuple[int, str]]) -> Array | None:
        """Simulated quantities (names, rows) at whole steps; None if the simulation diverges. names: pairs of the index of a
        joint and the name of a quantity.
        """
        return next(self.door.rollout(names, [self._world(values, playing)], substeps=playing.substeps))

    def _sensed(self, values: Mapping[str, float], series: Array | None, until: float) -> list[Array]:
        """Channels as the sensors measure them, from simulated series at whole steps; NaN if the simulation diverges."""
        if series is None or not np.isfinite(series).all():
            return [np.full(channel.until(until), np.nan) for channel in self.channels]
        clock, predicted = values.get(CLOCK, 0.0), []
        for channel, exact in zip(self.channels, series, strict=True):
            key = channel.key
            sensed = interpolate(exact, self._places(channel, until, clock + values.get(f"{key}.delay", 0.0), len(exact)))
            predicted.append(sensed / values.get(f"{key}.gain", 1.0) + values.get(f"{key}.offset", 0.0))
        return predicted

    def _places_of(self, channel: Channel, until: float, shift: float, rows: int) -> Array:
        """Positions of a channel's samples up to `until` s in a series of `rows` whole steps, in steps; whole numbers if all
        samples lie at whole steps. shift: delay of the channel, s.
        """
        place = np.clip((channel.time[: channel.until(until)] - shift) / self.scenario.step, 0.0, rows - 1)
        nearest = np.round(place)
        return nearest.astype(np.intp) if np.abs(place - nearest).max(initial=0.0) < 1e-6 else place

    def _world(self, values: Mapping[str, float], playing: Playing) -> Start:
        starts = {drive.name: self.start(drive.name, values) for drive in self.door.drives}
        positions, velocities = ({joint: start[i] for joint, start in starts.items()} for i in range(2))
        if self.scenario.initial_equilibrium:
            # Links start at the equilibrium of their parameter set, so state only positions that the recording or the fit
            # determines.
            shown = {*self.within, *self.uncertain, *values}
            positions = {joint: place for joint, place in positions.items() if f"{joint}.initial_position" in shown}
        motors = {drive.name: self.motor_starts(drive, values) for drive in self.door.drives}
        commands = {command.key for command in self.data.commands}
        own = tuple((k, value) for k, value in values.items() if k.rpartition(".")[0] in commands or k.startswith(JUMP))
        return Start(
            parameters=numbers_of(values), references=self._references(own, playing), positions=positions,
            velocities=velocities, motors={joint: own[0] for joint, own in motors.items() if own[0]},
            motor_velocities={joint: own[1] for joint, own in motors.items() if own[1]},
        )  # fmt: skip

    def start(self, joint: str, values: Mapping[str, float]) -> tuple[float, float]:
        """Position and velocity of a link at time 0, rad and rad/s."""
        initial = {**self.initial, **values}
        drive = next(drive for drive in self.door.drives if drive.name == joint)
        position = initial[f"{joint}.initial_position"]
        if joint in self._following:
            # The link is at rest, so its position changes with the initial positions of its motors.
            motors = [initial[motor_start(joint, i)[0]] for i in range(1, drive.dynamic_motors + 1)]
            position += float(np.mean(motors)) - self._following[joint]
        # Start within the joint's stops. A noisy recording may begin slightly beyond a stop.
        return float(np.clip(position, *drive.joint.stops)), initial[f"{joint}.initial_velocity"]

    def motor_starts(self, drive: SteppedJoint, values: Mapping[str, float]) -> tuple[list[float], list[float]]:
        """Positions and velocities of a joint's motors at time 0, rad and rad/s. Each list is empty if the motors start as the
        scenario states. If a link moves at the start of the recording, motors that are not recorded start with the link's
        velocity.
        """
        initial, count = {**self.initial, **values}, drive.dynamic_motors
        place, speed = self.start(drive.name, values)
        positions, velocities = (
            zip(*(motor_start(drive.name, i) for i in range(1, count + 1)), strict=True) if count else ((), ())
        )
        at = (*drive.motor_positions, *[place] * count)
        found = [initial.get(key, one) for key, one in zip(positions, at, strict=False)]
        moving = (*drive.motor_velocities, *[0.0 if drive.motor_velocities else speed] * count)
        speeds = [initial.get(key, one) for key, one in zip(velocities, moving, strict=False)]
        moves = any(key in initial for key in velocities) or (speed and not drive.motor_velocities)
        return found if any(key in initial for key in positions) else [], speeds if moves else []

    def _play(self, values: TrackSettings, playing: Playing) -> Mapping[str, Mapping[str, Played]]:
        """Commands with their gains, offsets and delays, by joint and by name. They are cached, so that equal commands are the
        same object.
        """
        table: dict[str, dict[str, Played]] = {}
        early = tuple((self.jumps[int(key.removeprefix(JUMP)) - 1], value) for key, value in values if key.startswith(JUMP))
        generator = None if playing.draw is None else np.random.default_rng(playing.draw)
        for command in self.data.commands:
            one = replace(command, hold=True) if command.key in playing.staircases else command
            if generator is not None:
                noise = command.noise * generator.normal(size=len(command.values))
                one = replace(one, values=command.values + noise)
            own = {key.rpartition(".")[2]: value for key, value in values if key.rpartition(".")[0] == command.key}
            step = self.scenario.step / playing.substeps[0]
            table.setdefault(command.joint, {})[command.name] = Played(command=one, step=step, early=early, **own)
        return table


def _scenario(scenario: Scenario, data: Data) -> Scenario:
    """Scenario with the recording's duration, operation modes and commands."""
    # The scenario's references do not fit a replaced operation mode. The recorded commands replace them.
    references = {joint: dict(signals) for joint, signals in scenario.references.items() if joint not in data.modes}
    for command in data.commands:
        if command.name != EXTERNAL:
            references.setdefault(command.joint, {})[command.name] = Played(command=command, step=scenario.step)
    return replace(
        scenario, duration=data.duration, modes={**scenario.modes, **data.modes}, references=references,
        expect=(), desired={}, log_every=1,
    )  # fmt: skip


def interpolate(series: Array, place: Array) -> Array:
    """Values (m,) of a series (n,) between its samples, by a cubic spline; whole numbers select samples. place: positions (m,)
    in the series, in samples.
    """
    from scipy.interpolate import CubicSpline

    return np.asarray(series[place] if place.dtype == np.intp else CubicSpline(np.arange(len(series)), series)(place))


def motion_of(channel: Channel) -> float:
    """Bandwidth of the motion of a channel, rad/s; see `motion_band`."""
    step = float(np.median(np.diff(channel.time)))
    values = np.interp(np.arange(channel.time[0], channel.time[-1], step), channel.time, channel.values)
    return motion_band(step, values, channel.floor)


def first_samples(channel: Channel, band: float = inf) -> tuple[float, float, float, float] | None:
    """Value and slope at time 0 by a parabola through a channel's first samples, and their standard errors. None if the channel
    begins too late.

    A coarse sensor shows no motion in its first few samples, so parabolas over longer times are tried, too. A longer parabola
    is valid if it begins at the position of the first samples, and if the first half of its samples moves in the same
    direction. Otherwise the link began at rest and was accelerated. The valid parabola with the most accurate slope is used.
    band: bandwidth of the motion of the channel, rad/s.
    """
    if len(channel.time) < 6 or channel.time[0] > SOON:
        return None
    count = max(6, min(FIRST, channel.until(channel.time[0] + 0.03)))
    first = _parabola(channel, count, 2)
    found, most = [first], channel.until(channel.time[0] + LONGEST / max(band, 1e-9))
    while (count := 2 * count) <= most:
        longer, (_, slope, _, error) = _parabola(channel, count, 2), _parabola(channel, count // 2, 1)
        if abs(slope) > STILL * error and slope * longer[1] > 0.0 and abs(longer[0] - first[0]) < DOUBTFUL * first[2]:
            found.append(longer)
    return min(found, key=lambda one: one[3])


def _parabola(channel: Channel, count: int, degree: int) -> tuple[float, float, float, float]:
    """Value and slope at time 0 of a polynomial of degree 1 or 2 through the first `count` samples, and their standard
    errors.
    """
    time, values = channel.time[:count], channel.values[:count]
    terms = np.vander(time, degree + 1, increasing=True)
    inverse = np.linalg.pinv(terms)
    sizes = inverse @ values
    # Deviations of the samples from a polynomial enlarge the errors.
    left = root_mean_square(values - terms @ sizes) if count > FIRST else 0.0
    errors = max(channel.noise, channel.quantum, left) * np.sqrt(np.sum(inverse**2, axis=1))
    place, slope, bend = (*sizes.tolist(), 0.0)[:3]
    # If the force changes shortly after the start, the parabola is biased. Therefore a part of the curvature enlarges the
    # errors.
    off, extent = BENT * abs(bend), float(time[-1])
    return place, slope, float(errors[0]) + 0.1 * off * extent**2, float(errors[1]) + off * extent


@dataclass(frozen=True)
class _Beginning:
    """Initial state of a recorded position."""

    position: float
    velocity: float
    error: float
    """Standard error of the position."""
    moves: bool
    """Whether the recording begins in motion."""

    def contradicts(self, stated: float) -> bool:
        """Whether the recording does not begin at rest at a stated position."""
        return self.moves or abs(self.position - stated) > STILL * self.error


def _beginning(channel: Channel, band: float, *, measured: bool) -> _Beginning | None:
    """Initial state of a channel; None if the channel begins too late. band: bandwidth of the motion, rad/s; measured: whether
    the scenario's initial position was copied from the recording.
    """
    if not (first := first_samples(channel, band)):
        return None
    place, speed, error, speed_error = first
    moves = abs(speed) > (DOUBTFUL if measured else STILL) * speed_error
    if not moves:
        place, error = _start_of(channel, first)
    return _Beginning(place, speed, error, moves)


def _is_copied(position: float, source: RecordedSignal) -> bool:
    """Whether an initial position is equal to the first value of a coarse sensor."""
    return isinstance(source, Channel) and source.quantum > 0.0 and abs(float(source.values[0]) - position) < 1e-9


def onset(channel: Channel, deviations: float) -> int:
    """Number of samples before a channel moves by more than `deviations` standard deviations of its noise."""
    away = np.abs(channel.values - np.median(channel.values[:5])) > deviations * max(channel.noise, channel.quantum)
    return int(np.argmax(away)) if away.any() else len(away)


def _start_of(channel: Channel, first: tuple[float, float, float, float]) -> tuple[float, float]:
    """Value of a channel at time 0, and its standard error. It is either the mean at rest or the value of a polynomial through
    the first samples; the value with the smaller error is used. first: result of `first_samples`.
    """
    resting = at_rest(channel)
    return (first[0], first[2]) if first[2] <= resting[1] else resting


def at_rest(channel: Channel) -> tuple[float, float]:
    """Value of a channel at time 0, and its standard error. The value is the mean of the samples before the channel moves or,
    if they are few, the first sample.
    """
    moved = onset(channel, 4.0)
    still = moved // 2 if moved < len(channel.time) else moved
    count = still if still >= LONG else 1
    return float(np.mean(channel.values[:count])), float(np.hypot(channel.noise / np.sqrt(count), channel.quantum))
