"""Starts from regression: numbers with which the recorded motion itself balances its torques; nothing is simulated.

Recorded places, smoothed, give velocities and accelerations; motors, links and springs each have a balance of torques
(equation error). Noise of what is measured biases the result, so that it is a start and no estimate.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from asrsim.errors import RobotError
from asrsim.identification.door import Drive, electric_of, link_motion, over_arrays
from asrsim.identification.layout import Layout
from asrsim.identification.noise import smoothed
from asrsim.identification.problem import Problem
from asrsim.identification.track import Track, numbers_of
from asrsim.robot.model import Link, Robot
from asrsim.samples import Array

ROWS = 200
"""Of a recording, at most."""
LOUD = 30.0
"""Times its noise that a spectrum must be for motion to show in it."""
EDGE = 0.05
"""Share at both ends that the filter spoils."""
WEAK = 1e-3
"""Weight of the start, which holds what no balance tells."""
BALANCED = 0.3
"""Share of the torques that may be left over near the start."""
STRAIGHT = 1e-6
"""Share of its effect that a number in which torques are linear may have otherwise."""
STEPS, INSIDE = 60, 1e-6
"""Evaluations of the refinement, at most, and the relative distance from bounds at which it begins."""
NONE = 0.1
"""Share of the start that is left of a loss of which the balance shows none."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Something that moves, smoothed: place, velocity, its rate and its sign, (n,) each."""

    place: Array
    velocity: Array
    rate: Array
    sign: Array


def regressed(problem: Problem, x: Array) -> Array | None:
    """Where torques balance; None where nothing that was recorded shows it."""
    layout = problem.layout
    balances = [
        (number, _Balance(problem.tracks[number])) for number in problem.fitted if type(problem.tracks[number]) is Track
    ]
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
            far = np.clip(_solved(left, begin, layout), low + INSIDE, high - INSIDE)
            found = min(found, _near(left, far, low, high), key=lambda there: float(np.mean(left(there) ** 2)))
    except RobotError:
        return None
    # Losses that seem to be none may be small: without them nothing would tell how they act.
    losses = [not entry.parameter.logarithmic and entry.parameter.low == 0.0 for entry in layout.entries]
    some = [entry.place(NONE * entry.start) if loss else -np.inf for entry, loss in zip(layout.entries, losses, strict=True)]
    return np.maximum(found, some)


def _near(left: Callable[[Array], Array], start: Array, low: Array, high: Array) -> Array:
    """Where torques balance, by steps from a start, which holds what no balance tells."""
    from scipy.optimize import least_squares

    found = least_squares(
        lambda there: np.append(left(there), WEAK * (there - start)), start, bounds=(low, high), loss="soft_l1", x_scale=0.3,
        max_nfev=STEPS, ftol=1e-3, xtol=1e-3,
    )  # fmt: skip
    return np.asarray(found.x, dtype=np.float64)


def _solved(left: Callable[[Array], Array], x: Array, layout: Layout) -> Array:
    """The same by one regression over the numbers in which torques are linear, however far off these are."""
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
    # Its steps to bounds that are infinitely far may be nan, which it passes over.
    with np.errstate(invalid="ignore"):
        found = lsq_linear(np.column_stack(columns), -base, bounds=(np.minimum(least, -1e-12), np.inf))
    for (i, unit), move in zip(linear, found.x.tolist(), strict=True):
        there[i] = layout.entries[i].place(max(float(plain[i]) + unit * move, INSIDE * float(sizes[i])))
    return there


class _Balance:
    """Torques of a recording's springs, motors and links."""

    def __init__(self, track: Track) -> None:
        self._track, self._scenario = track, track.scenario
        self._recorded = {(one.joint, one.quantity): one for one in track.channels}
        drives = track.door.drives
        step = max(self._scenario.step, float(np.median(np.diff(track.channels[0].time))))
        first, last = (end(float(c.time[i]) for c in track.channels) for end, i in ((max, 0), (min, -1)))
        self._time = np.arange(first, last, step)
        edge = max(int(EDGE * len(self._time)), 4)
        self._kept = slice(edge, len(self._time) - edge, max(1, len(self._time) // ROWS))
        loud = [self._loud(key) for key in self._recorded if key[1].endswith(("position", "deflection"))]
        self._filter = min(0.3, 2.0 * step * max(loud, default=1.0))
        self._motors = [self._motors_of(drive) for drive in drives]
        self._links = [self._link_of(drive, motors) for drive, motors in zip(drives, self._motors, strict=True)]
        self._goals = [[self._smooth(goal) for goal in self._goals_of(drive)] for drive in drives]
        self._torques = {key: self._smooth(self._sampled(*key)) for key in self._recorded if "elastic_torque" in key[1]}
        self._inertial: list[tuple[tuple[Link, ...], Array]] = []

    # -- what is known of the motion ---------------------------------------------------------------------------------

    def _sampled(self, joint: str, quantity: str) -> Array | None:
        one = self._recorded.get((joint, quantity))
        return None if one is None else np.interp(self._time, one.time, one.values)

    def _loud(self, key: tuple[str, str]) -> float:
        """Hz up to which a place's motion stands out of its noise."""
        speed = np.diff(np.interp(self._time, self._recorded[key].time, self._recorded[key].values))
        n, step = len(speed), self._time[1] - self._time[0]
        power, frequency = np.abs(np.fft.rfft(speed * np.hanning(n))) ** 2, np.fft.rfftfreq(n, step)
        # Differences of white noise have this spectrum, under this window.
        noise = max(self._recorded[key].noise, self._recorded[key].quantum)
        level = noise**2 * n * 0.375 * 4.0 * np.sin(np.pi * frequency * step) ** 2
        loud = np.flatnonzero(power > LOUD * level + 1e-300)
        return 1.5 * float(frequency[loud[-1]]) if len(loud) else 1.0

    def _smooth(self, values: Array | None) -> Array | None:
        """(n,) where it counts."""
        return None if values is None else smoothed(values, self._filter)[self._kept]

    def _motion(self, values: Array | None) -> Motion | None:
        if values is None:
            return None
        velocity = np.gradient(values, self._time)
        parts = (self._smooth(one) for one in (values, velocity, np.gradient(velocity, self._time)))
        place, speed, rate = (np.zeros(0) if one is None else one for one in parts)
        return Motion(place, speed, rate, np.tanh(speed / max(0.05 * float(np.std(speed)), 1e-12)))

    def _motors_of(self, drive: Drive) -> list[Motion] | None:
        """Of motors, and of an adjuster; None where one is not known."""
        if drive.actuator is None or drive.mode is None or not drive.mode.spring:
            return None
        count = 2 if drive.actuator.motors > 1 or drive.actuator.adjuster else 1
        places = [self._sampled(drive.name, f"motor_{i}_position") for i in range(1, count + 1)]
        # Those that have no dynamics stand at their references.
        goals = self._goals_of(drive)
        still = range(drive.dynamic_motors, count)
        places = [goals[i] if i in still and places[i] is None else places[i] for i in range(count)]
        found = [motion for motion in map(self._motion, places) if motion is not None]
        return found if len(found) == count else None

    def _link_of(self, drive: Drive, motors: list[Motion] | None) -> Motion | None:
        values, bend = self._sampled(drive.name, "link_position"), self._sampled(drive.name, "deflection")
        if values is None and self._scenario.engine == "bench":
            values = link_motion(self._scenario, drive.name).values(self._time)
        if values is None and bend is not None and drive.actuator is not None and motors is not None:
            places = [self._sampled(drive.name, f"motor_{i}_position") for i in (1, 2)]
            known = [goal if place is None else place for place, goal in zip(places, self._goals_of(drive), strict=True)]
            both = [np.zeros_like(bend) if one is None else one for one in known]
            values = over_arrays(drive.actuator.equilibrium_position)(*both) - bend
        return self._motion(values)

    def _goals_of(self, drive: Drive) -> list[Array | None]:
        """What motors 1 and 2 are told, (n,)."""
        if drive.mode is None or drive.actuator is None:
            return [None, None]
        signals = self._scenario.references_of(drive.name)
        told = [signals[name].values(self._time) if name in signals else None for name in drive.mode.references]
        first, second = (*told, None)[:2]
        if not drive.mode.mapped or first is None:
            return [first, second]
        preset = np.zeros_like(self._time) if second is None else second
        pairs = map(drive.actuator.motor_references, first.tolist(), preset.tolist())
        return list(np.array(list(pairs)).T)

    # -- what does not balance ---------------------------------------------------------------------------------------

    def rows(self, values: Mapping[str, float]) -> Iterator[Array]:
        """Torques that are left over, in shares of what drives each. Raises RobotError."""
        varied = self._track.door.varied(numbers_of(values))
        springs = [self._springs(*one) for one in zip(varied.drives, self._motors, self._links, strict=True)]
        for drive, motors, goals, torques in zip(varied.drives, self._motors, self._goals, springs, strict=True):
            for i, torque in enumerate(torques, start=1):
                measured = self._torques.get((drive.name, f"elastic_torque_{i}"))
                if measured is not None:
                    yield (torque - measured) / _size(measured)
                goal = goals[i - 1]
                if i <= drive.dynamic_motors and motors is not None and goal is not None:
                    yield _of_motor(drive, i, motors[i - 1], goal, torque)
        links = [link for link in self._links if link is not None]
        if len(links) == len(self._links) and self._scenario.engine != "bench":
            inertial = self._inertial_torques(varied.robot, links)
            for j, (drive, link) in enumerate(zip(varied.drives, links, strict=True)):
                yield _of_link(drive, link, self._goals[j][0], springs[j], inertial[:, j])

    def _springs(self, drive: Drive, motors: list[Motion] | None, link: Motion | None) -> list[Array]:
        """Torque of each spring on the link."""
        if motors is None or link is None or drive.actuator is None:
            return []
        second = motors[1].place if len(motors) > 1 else np.zeros_like(link.place)
        found = over_arrays(drive.actuator.elastic_torques)(link.place, motors[0].place, second, drive.elastic)
        return [one + 0.0 * link.place for one in found[: drive.actuator.motors]]

    def _inertial_torques(self, robot: Robot, links: Sequence[Motion]) -> Array:
        """(n, joints) of inertia, gravity and Coriolis; what only losses or springs change is known from before."""
        for known, torques in self._inertial:
            if known == robot.links:
                return torques
        q, v, a = (np.column_stack(part) for part in zip(*((m.place, m.velocity, m.rate) for m in links), strict=True))
        torques = self._track.door.inverse_dynamics(robot, q, v, a)
        # Differences go to and fro between a place and those beside it.
        self._inertial = [(robot.links, torques), *self._inertial[:1]]
        return torques


def _of_motor(drive: Drive, i: int, motor: Motion, command: Array, load: Array) -> Array:
    """Inertia, friction and spring of motor i, less what drives it."""
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


def _of_link(drive: Drive, link: Motion, command: Array | None, springs: Sequence[Array], inertial: Array) -> Array:
    """Inertia, gravity and losses of a link, less what drives it."""
    joint, push = drive.joint, sum(springs, np.zeros_like(inertial))
    if command is not None and drive.mode is not None and not drive.mode.spring:
        push = command if drive.mode.number == 0 else drive.values["controller_1_proportional"] * (command - link.place)
    needed = inertial + (joint.damping + drive.link_brake) * link.velocity + joint.friction * link.sign
    needed = needed + joint.spring_stiffness * (link.place - joint.spring_reference)
    # Where all torques scale with what is free, neither side alone may be the measure: the other would go.
    measure = np.sqrt(_size(push) * _size(inertial)) if np.any(push) else _size(inertial)
    return np.asarray((needed - push) / measure)


def _size(torques: Array) -> float:
    return max(float(np.sqrt(np.mean(torques**2))), 1e-12)
