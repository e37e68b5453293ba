"""Torque balances along the recorded motion, without a simulation. Filtered recorded positions give velocities and
accelerations; each spring, motor and link has a balance.

- `regressed` finds parameters for which the torques balance. Noise of the positions biases them; the search starts from them.
- `TorqueTrack` is for joints that a recorded torque drives. In a simulation of such a joint, errors of the torque accumulate.
  Therefore the torque that the motion needs is compared with the recorded torque (equation error).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import RobotError
from asrsim.identification.data import Channel, Data
from asrsim.identification.door import EXTERNAL, Door, Drive, electric_of, link_motion, over_arrays
from asrsim.identification.layout import Layout
from asrsim.identification.noise import fine_noise, smoothed
from asrsim.identification.problem import Problem
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


def _size(torques: Array) -> float:
    return max(float(np.sqrt(np.mean(torques**2))), 1e-12)


# -- starts from regression --------------------------------------------------------------------------------------------------

ROWS = 200
"""Largest number of rows that are compared in a recording."""
SPOILT = 0.05
"""Fraction of a recording at each end that is left out, since the filter distorts it."""
WEAK = 1e-3
"""Weight of the start values: parameters without influence on a balance keep them."""
BALANCED = 0.3
"""Largest relative imbalance of a solution near the start; above it a linear regression is tried."""
STRAIGHT = 1e-6
"""Largest relative deviation from linearity at which the torques count as linear in a parameter."""
STEPS, INSIDE = 60, 1e-6
"""Largest number of evaluations of the refinement; distance of its start from the bounds."""
NONE = 0.1
"""Fraction of its start value that a loss keeps if the balance estimates it as zero."""


def regressed(problem: Problem, x: Array) -> Array | None:
    """Parameter vector for which the torques balance; None if the recordings have no balance."""
    layout = problem.layout
    tracks = [(number, problem.tracks[number]) for number in problem.fitted]
    balances = [(number, _Balance(track)) for number, track in tracks if not isinstance(track, TorqueTrack)]
    low, high = layout.bounds

    def left(there: Array) -> Array:
        rows = [row for number, one in balances for row in one.rows(layout.table(there, number))]
        return np.concatenate(rows) if rows else np.zeros(0)

    try:
        if not len(left(x)):
            return None
        begin = np.clip(x, low + INSIDE, high - INSIDE)
        found = _near(left, begin, low, high)
        if np.mean(left(found) ** 2) > BALANCED**2:
            far = np.clip(linear_fit(left, begin, layout), low + INSIDE, high - INSIDE)
            found = min(found, _near(left, far, low, high), key=lambda there: float(np.mean(left(there) ** 2)))
    except RobotError:
        return None
    # A loss that is estimated as zero may be small. At zero its derivative would vanish.
    losses = [not entry.parameter.logarithmic and entry.parameter.low == 0.0 for entry in layout.entries]
    some = [entry.place(NONE * entry.start) if loss else -np.inf for entry, loss in zip(layout.entries, losses, strict=True)]
    return np.maximum(found, some)


def _near(left: Callable[[Array], Array], start: Array, low: Array, high: Array) -> Array:
    """Parameter vector for which the torques balance, by nonlinear least squares from a start."""
    from scipy.optimize import least_squares

    found = least_squares(
        lambda there: np.append(left(there), WEAK * (there - start)), start, bounds=(low, high), loss="soft_l1", x_scale=0.3,
        max_nfev=STEPS, ftol=1e-3, xtol=1e-3,
    )  # fmt: skip
    return np.asarray(found.x, dtype=np.float64)


def linear_fit(left: Callable[[Array], Array], x: Array, layout: Layout) -> Array:
    """Parameter vector for which the torques balance, by one linear regression over the parameters in which torques are
    linear.
    """
    from scipy.optimize import lsq_linear

    plain, base, there = layout.values(x), left(x), x.copy()
    sizes = np.array([abs(v) or entry.parameter.size for v, entry in zip(plain.tolist(), layout.entries, strict=True)])
    columns, linear = [], []
    for i, entry in enumerate(layout.entries):
        moved = [x.copy(), x.copy()]
        for count, one in enumerate(moved, start=1):
            one[i] = entry.place(float(plain[i] + count * sizes[i]))
        once, twice = (left(one) - base for one in moved)
        size = float(np.linalg.norm(once))
        if size > 0.0 and float(np.linalg.norm(twice - 2.0 * once)) < STRAIGHT * size:
            columns.append(once / size)
            linear.append((i, float(sizes[i]) / size))
    if not linear:
        return x
    least = [(layout.entries[i].parameter.low - plain[i]) / unit for i, unit in linear]
    # The step to an infinite bound may be nan; lsq_linear ignores it.
    with np.errstate(invalid="ignore"):
        found = lsq_linear(np.column_stack(columns), -base, bounds=(np.minimum(least, -1e-12), np.inf))
    for (i, unit), move in zip(linear, found.x.tolist(), strict=True):
        there[i] = layout.entries[i].place(max(float(plain[i]) + unit * move, INSIDE * float(sizes[i])))
    return there


class _Balance:
    """Torque balances of the springs, motors and links of one recording."""

    def __init__(self, track: Track) -> None:
        self._door, self._scenario = track.door, track.scenario
        self._recorded = {(one.joint, one.quantity): one for one in track.channels}
        step = max(self._scenario.step, float(np.median(np.diff(track.channels[0].time))))
        first, last = (end(float(c.time[i]) for c in track.channels) for end, i in ((max, 0), (min, -1)))
        self._time = np.arange(first, last, step)
        edge = max(int(SPOILT * len(self._time)), 4)
        kept = slice(edge, len(self._time) - edge, max(1, len(self._time) // ROWS))
        loud = [bandwidth(self._time, c) for key, c in self._recorded.items() if key[1].endswith(("position", "deflection"))]
        self._grid = Grid(self._time, min(0.3, 2.0 * step * max(loud, default=1.0)), kept)
        drives = self._door.drives
        self._goals = [self._goals_of(drive) for drive in drives]
        self._motors = [self._motors_of(drive, goals) for drive, goals in zip(drives, self._goals, strict=True)]
        moved = [self._link_of(drive, goals) for drive, goals in zip(drives, self._goals, strict=True)]
        self._links = [None if one is None else self._grid.motion(one) for one in moved]
        known = [link for link in self._links if link is not None]
        whole = len(known) == len(drives) and self._scenario.engine != "bench"
        self._moving = Links(self._door, self._grid, known) if whole else None
        self._commands = [[None if one is None else self._grid.smooth(one) for one in goals] for goals in self._goals]
        torques = [key for key in self._recorded if "elastic_torque" in key[1]]
        self._torques = {key: self._grid.smooth(one) for key in torques if (one := self._sampled(*key)) is not None}

    def _sampled(self, joint: str, quantity: str) -> Array | None:
        one = self._recorded.get((joint, quantity))
        return None if one is None else np.interp(self._time, one.time, one.values)

    def _goals_of(self, drive: Drive) -> list[Array | None]:
        """References of motors 1 and 2 on the grid."""
        if drive.mode is None or drive.actuator is None:
            return [None, None]
        signals = self._scenario.references_of(drive.name)
        given = [signals[name].values(self._time) if name in signals else None for name in drive.mode.references]
        first, second = (*given, None)[:2]
        if not drive.mode.mapped or first is None:
            return [first, second]
        preset = np.zeros_like(self._time) if second is None else second
        pairs = map(drive.actuator.motor_references, first.tolist(), preset.tolist())
        return list(np.array(list(pairs)).T)

    def _places_of(self, drive: Drive, goals: Sequence[Array | None]) -> list[Array | None]:
        """Positions of the motors; a motor without dynamics stands at its reference."""
        found = [self._sampled(drive.name, f"motor_{i}_position") for i in (1, 2)]
        return [goals[i] if one is None and i >= drive.dynamic_motors else one for i, one in enumerate(found)]

    def _motors_of(self, drive: Drive, goals: Sequence[Array | None]) -> list[Motion] | None:
        """Motions of the motors and of the stiffness adjuster; None if one of them is unknown."""
        if drive.actuator is None or drive.mode is None or not drive.mode.spring:
            return None
        count = 2 if drive.actuator.motors > 1 or drive.actuator.adjuster else 1
        found = [self._grid.motion(one) for one in self._places_of(drive, goals)[:count] if one is not None]
        return found if len(found) == count else None

    def _link_of(self, drive: Drive, goals: Sequence[Array | None]) -> Array | None:
        """Positions of a link: recorded, prescribed, or computed from the deflection."""
        values, bend = self._sampled(drive.name, "link_position"), self._sampled(drive.name, "deflection")
        if values is None and self._scenario.engine == "bench":
            return link_motion(self._scenario, drive.name).values(self._time)
        if values is None and bend is not None and drive.actuator is not None:
            both = [np.zeros_like(bend) if one is None else one for one in self._places_of(drive, goals)]
            return np.asarray(over_arrays(drive.actuator.equilibrium_position)(*both) - bend)
        return values

    def rows(self, values: Mapping[str, float]) -> Iterator[Array]:
        """Imbalance of each spring, motor and link, relative to its driving torque. Raises RobotError."""
        varied = self._door.varied(numbers_of(values))
        for j, (drive, motors, link) in enumerate(zip(varied.drives, self._motors, self._links, strict=True)):
            springs = self._springs(drive, motors, link)
            for i, torque in enumerate(springs, start=1):
                if (measured := self._torques.get((drive.name, f"elastic_torque_{i}"))) is not None:
                    yield (torque - measured) / _size(measured)
                goal = self._commands[j][i - 1]
                if i <= drive.dynamic_motors and motors is not None and goal is not None:
                    yield _of_motor(drive, i, motors[i - 1], goal, torque)
            if self._moving is not None and link is not None:
                yield self._of_link(self._moving, varied.robot, drive, j, link, springs)

    def _springs(self, drive: Drive, motors: list[Motion] | None, link: Motion | None) -> list[Array]:
        """Torque of each spring on the link."""
        if motors is None or link is None or drive.actuator is None:
            return []
        second = motors[1].place if len(motors) > 1 else np.zeros_like(link.place)
        found = over_arrays(drive.actuator.elastic_torques)(link.place, motors[0].place, second, drive.elastic)
        return [one + 0.0 * link.place for one in found[: drive.actuator.motors]]

    def _of_link(self, links: Links, robot: Robot, drive: Drive, j: int, link: Motion, springs: Sequence[Array]) -> Array:
        """Torque that a link's motion needs, minus the torque that drives it."""
        inertial, push = links.inertial(robot)[:, j], sum(springs, np.zeros_like(link.place))
        command = self._commands[j][0]
        if command is not None and drive.mode is not None and not drive.mode.spring:
            push = command if drive.mode.number == 0 else drive.values["controller_1_proportional"] * (command - link.place)
        # If all torques scale with free parameters, scaling by one side alone would favour vanishing torques.
        measure = np.sqrt(_size(push) * _size(inertial)) if np.any(push) else _size(inertial)
        return np.asarray((links.needed(drive, robot, j, 0.0 * self._time) - push) / measure)


def _of_motor(drive: Drive, i: int, motor: Motion, command: Array, load: Array) -> Array:
    """Torques of inertia, friction and spring of motor i, minus the torque that drives it, relative to that torque."""
    numbers, lag, mode = drive.values, drive.values[f"motor_{i}_damping"], drive.mode
    assert mode is not None  # motors without one have no dynamics
    if mode.controller:
        push = numbers[f"controller_{i}_proportional"] * (command - motor.place)
        lag += numbers[f"controller_{i}_derivative"]
    else:
        electric = electric_of(numbers, i, mode)
        push, lag = electric.gain * command, lag + electric.lag
    needed = numbers[f"motor_{i}_inertia"] * motor.rate + lag * motor.velocity + load
    needed = needed + numbers[f"motor_{i}_friction_torque"] * motor.sign
    return np.where(np.abs(push) < numbers[f"motor_{i}_max_torque"], needed - push, 0.0) / _size(push)


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
