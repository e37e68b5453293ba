"""Independent solution of a controller that reads an imperfect sensor: linear equations of motion, integrated by Runge-Kutta.

No code of asrsim is used. The integration ends a step where a measurement jumps: at ticks, at new draws of the noise, and where
the delayed position crosses a border between two multiples of the quantum.
"""

from __future__ import annotations

import bisect
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

ROUNDING = 1e-12
"""Distance from a jump within which a function is not evaluated, s."""
LONGEST = 2e-4
"""Longest step of the integration, s; its error is below 1e-9 rad."""


@dataclass
class Late:
    """A position and velocity in the past, on cubic curves between the steps; before the start, those of the start."""

    times: list[float] = field(default_factory=list)
    rows: list[tuple[float, float, float]] = field(default_factory=list)

    def add(self, time: float, position: float, velocity: float, acceleration: float) -> None:
        self.times.append(time)
        self.rows.append((position, velocity, acceleration))

    def at(self, time: float) -> tuple[float, float]:
        """Position and velocity at a time; beyond the last step, on a parabola."""
        if time <= self.times[0]:
            return self.rows[0][:2]
        place = bisect.bisect_right(self.times, time) - 1
        x, v, a = self.rows[place]
        since = time - self.times[place]
        if place + 1 == len(self.times):
            return x + since * v + 0.5 * since**2 * a, v + since * a
        # Within a step the acceleration changes evenly.
        jerk = (self.rows[place + 1][2] - a) / (self.times[place + 1] - self.times[place])
        return x + since * (v + since * (a / 2.0 + since * jerk / 6.0)), v + since * (a + since * jerk / 2.0)


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """Delay in s, rate in Hz, quantum in rad, and noise: a function of the number of the draw, with its period in s."""

    delay: float = 0.0
    rate: float | None = None
    quantum: float = 0.0
    noise: Callable[[int], float] = lambda number: 0.0
    period: float = 1e9

    def rounded(self, position: float) -> float:
        return self.quantum * np.floor(position / self.quantum + 0.5) if self.quantum else position


@dataclass(frozen=True, kw_only=True)
class Plant:
    """Motor (inertia J, damping) and link (inertia I) on a spring k, or a link alone (no motor); a PID controller with a
    constant goal moves the motor, or the link. The units are those of a rotation."""

    link: float
    motor: float = 0.0
    damping: float = 0.0
    spring: float = 0.0
    goal: float
    proportional: float
    integral: float
    derivative: float


class Reading:
    """What the controller reads, piece by piece: within a piece, measurements do not jump."""

    def __init__(self, sensor: Sensor, past: Late, held: tuple[float, float]) -> None:
        self.sensor, self.past = sensor, past
        self.held: tuple[float, float] | None = held if sensor.rate else None
        self.noise, self.level = 0.0, 0.0

    def measured(self, now: float) -> tuple[float, float]:
        """Measurement at a time, before it is rounded."""
        place, speed = self.past.at(now - self.sensor.delay)
        return place + self.noise, speed

    def until(self, begin: float, end: float) -> float:
        """End of the piece that begins at `begin`: the first border between two multiples of the quantum, or `end`."""
        if self.held is not None or not self.sensor.quantum:
            return end
        self.level = self.sensor.rounded(self.measured(begin)[0])
        if self.sensor.rounded(self.measured(end)[0]) == self.level:
            return end
        for _ in range(50):
            middle = 0.5 * (begin + end)
            same = self.sensor.rounded(self.measured(middle)[0]) == self.level
            begin, end = (middle, end) if same else (begin, middle)
        return end

    def __call__(self, now: float, x: float, v: float) -> tuple[float, float]:
        """Measured position and velocity at a time within the piece; x, v: the present ones."""
        if self.held is not None:
            return self.held
        place, speed = self.measured(now) if self.sensor.delay else (x + self.noise, v)
        return (self.level if self.sensor.quantum else place), speed


def solve(plant: Plant, sensor: Sensor, start: list[float], end: float) -> np.ndarray:
    """State at the end: link position and velocity, motor position and velocity, integral. start: the same at t = 0, without
    the integral. Without a rate, a quantum needs a delay: the border is found in the past."""
    body = 2 if plant.motor else 0
    period = 1.0 / sensor.rate if sensor.rate else sensor.period
    ticks = np.arange(0.0, end, period).tolist()
    past, state = Late(), np.array([*start, 0.0])
    read = Reading(sensor, past, (start[body], start[body + 1]))

    def slope(now: float, y: np.ndarray) -> np.ndarray:
        place, speed = read(now, y[body], y[body + 1])
        error = plant.goal - place
        push = plant.proportional * error + y[4] - plant.derivative * speed
        load = plant.spring * (y[2] - y[0])
        link, motor = push / plant.link, 0.0
        if plant.motor:
            link, motor = load / plant.link, (push - load - plant.damping * y[3]) / plant.motor
        return np.array([y[1], link, y[3], motor, plant.integral * error])

    edges = sorted({end, *ticks, *([sensor.delay] if 0.0 < sensor.delay < end else [])})
    for begin, stop in pairwise(edges):
        read.noise = sensor.noise(int(np.floor(begin / period + 1e-9)))
        time = begin
        while time < stop:
            past.add(time, state[body], state[body + 1], 0.0)
            if sensor.rate and time in ticks:
                place, speed = read.measured(time)
                read.held = sensor.rounded(place), speed
            last = min(time + LONGEST, stop)
            last = read.until(time + ROUNDING, min(last, time + sensor.delay) if sensor.delay else last)
            h, first = last - time, slope(time + ROUNDING, state)
            past.rows[-1] = (state[body], state[body + 1], first[body + 1])
            second = slope(time + h / 2, state + h / 2 * first)
            third = slope(time + h / 2, state + h / 2 * second)
            fourth = slope(last - ROUNDING, state + h * third)
            state = state + h / 6 * (first + 2 * second + 2 * third + fourth)
            time = last if last < stop else stop
    return state
