"""The robot in an experiment: a motion of its references goes in; the use of limits, and Fisher information, come out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from asrsim.design.limits import Limits, interval
from asrsim.design.motion import Segment, joined
from asrsim.errors import InputError, Problem, did_you_mean
from asrsim.identification.door import COMPARABLE, Door, Drive, Start, Substeps
from asrsim.identification.layout import Layout
from asrsim.identification.problem import STEP
from asrsim.identification.track import numbers_of
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.signals.sampled import Sampled

POSITION_NOISE = 1e-3
"""rad (m), where no noise is given."""
GROWTH = 20.0
"""Largest sensitivity of a channel to a relative change, as a multiple of its own motion; beyond it a motion is near chaos."""


@dataclass(frozen=True)
class Reference:
    """A reference that the experiment commands."""

    joint: str
    name: str
    slot: int
    unit: str
    home: float
    low: float
    high: float

    @property
    def heading(self) -> str:
        """Of its column in a CSV file."""
        return f"{self.joint}.reference_{self.slot + 1} [{self.unit}]"

    def values(self, share: Array) -> Array:
        """In its unit, for shares of its range from -1 (low) to 1 (high)."""
        return self.home + np.where(share > 0.0, share * (self.high - self.home), share * (self.home - self.low))


@dataclass(frozen=True)
class Bound:
    """A limit of a quantity."""

    joint: str
    quantity: str
    low: float
    high: float


@dataclass(frozen=True)
class Channel:
    """A sensor of a joint."""

    joint: str
    quantity: str
    noise: float
    group: int
    """0: it is recorded; from 1 on: number of the sensor that could be added."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a motion uses and shows."""

    use: Array
    """(bounds,) largest share of each limit over the robots; above 1: exceeded."""
    when: float
    """s at which the largest share is reached."""
    information: Array | None
    """(robots, groups, n, n) Fisher matrices; None: not computed, or a robot is near chaos."""


class Plant:
    """A scenario whose references are designed."""

    def __init__(self, scenario: Scenario, robot: Robot, layout: Layout, limits: Limits, seconds: float) -> None:
        self.scenario = replace(scenario, duration=seconds, expect=(), desired={}, log_every=1)
        self.door, self.layout = Door(self.scenario, robot), layout
        self.step, self.rows = scenario.step, round(seconds / scenario.step) + 1
        self.joints = self.door.joints
        self._problems: list[Problem] = []
        given = tuple(self._bounds(limits))
        self.bounds = tuple(bound for bound in given if bound.quantity in COMPARABLE)
        self.references = tuple(one for drive in self.door.drives for one in self._references(drive, given))
        self.channels = tuple(self._channels(limits))
        if not self.references and not self._problems:
            self._fault("limits", "no joint with a reference has limits")
        if self._problems:
            self.close()
            raise InputError(self._problems)
        self.groups = 1 + len(limits.sensors)
        self.every = max(1, round(1.0 / (limits.rate * self.step)))
        """Steps between samples."""
        self.presets = np.array([one.slot == 1 for one in self.references])
        self.own = np.array([[bound.joint == one.joint for bound in self.bounds] for one in self.references])
        """(references, bounds) whether a limit is of the reference's joint."""

    def close(self) -> None:
        """Release the engines."""
        self.door.close()

    def _fault(self, key: str, message: str, hint: str | None = None, choices: tuple[str, ...] = ()) -> None:
        self._problems.append(Problem(message, key=key, hint=hint, choices=choices, code="limits"))

    def _bounds(self, limits: Limits) -> Iterator[Bound]:
        names = [name for drive in self.door.drives for name in (drive.mode.references if drive.mode else ())]
        known = tuple(dict.fromkeys((*names, *COMPARABLE)))
        for joint, ranges in limits.limits.items():
            if joint not in (*self.joints, "*"):
                self._fault(f"limits.{joint}", "the robot has no such joint", did_you_mean(joint, self.joints), self.joints)
                continue
            for name, given in ranges.items():
                quantities = _by_motor(name)
                if not {*quantities} <= {*known}:
                    self._fault(f"limits.{joint}.{name}", "is no quantity", did_you_mean(name, known), known)
                    continue
                for one in self.joints if joint == "*" else (joint,):
                    yield from (Bound(one, quantity, *interval(given)) for quantity in quantities)

    def _references(self, drive: Drive, bounds: Sequence[Bound]) -> Iterator[Reference]:
        mode, own = drive.mode, {bound.quantity: bound for bound in bounds if bound.joint == drive.name}
        if mode is None or not own:
            return
        if mode.direct or not (mode.spring or mode.controller):
            message = f"a joint in mode {mode.number} ({mode.name}) does not return to rest by itself"
            self._fault(f"limits.{drive.name}", message, "Drive it by a controller: modes 1, 5 and 6")
            return
        position = self.door.positions[self.joints.index(drive.name)]
        for slot, name in enumerate(mode.references):
            preset = mode.mapped and slot == 1
            bound = own.get(name) or (None if preset else own.get("link_position"))
            if (slot and drive.actuator is not None and drive.actuator.motors + drive.actuator.adjuster < 2) or (
                preset and bound is None
            ):
                continue
            signal = self.scenario.references_of(drive.name).get(name)
            home = float(signal.values(np.zeros(1))[0]) if signal is not None else 0.0 if preset else position
            if bound is None:
                message = f"the range of {name} is missing: give a limit of it, or of link_position"
                self._fault(f"limits.{drive.name}.{name}", message)
            elif not bound.low <= home <= bound.high:
                self._fault(f"limits.{drive.name}.{bound.quantity}", f"the scenario begins beyond it, at {home:g}")
            else:
                yield Reference(drive.name, name, slot, mode.units[slot], home, bound.low, bound.high)

    def _channels(self, limits: Limits) -> Iterator[Channel]:
        noise = limits.noise or dict.fromkeys(("link_position", "motor_1_position", "motor_2_position"), POSITION_NOISE)
        for name, size in noise.items():
            owner, _, quantity = name.rpartition(".")
            quantities = [f"{quantity}_1", f"{quantity}_2"] if f"{quantity}_1" in COMPARABLE else [quantity]
            if not {*quantities} <= {*COMPARABLE} or owner not in ("", *self.joints):
                self._fault(f"noise.{name}", "is nothing that a sensor measures", did_you_mean(name, COMPARABLE), COMPARABLE)
                continue
            group = limits.sensors.index(name) + 1 if name in limits.sensors else 0
            for drive in self.door.drives:
                if owner in ("", drive.name) and (drive.dynamic_motors or not quantity.startswith("motor")):
                    yield from (Channel(drive.name, one, size, group) for one in quantities)

    def substeps_of(self, gains: Mapping[str, float], robots: Sequence[Array]) -> Substeps:
        """Those that the stiffest of these robots needs."""
        found = [self.door.substeps_of(self._numbers(gains, x)) for x in robots]
        return max(one[0] for one in found), max(one[1] for one in found)

    def _numbers(self, gains: Mapping[str, float], x: Array) -> Mapping[str, Mapping[str, float]]:
        return numbers_of({**self.layout.table(x, 0), **gains})

    def motion(self, segments: Sequence[Segment], rows: int) -> Array:
        """(references, rows) in the references' units."""
        shares = joined(segments, self.step, rows)
        return np.array([one.values(share) for one, share in zip(self.references, shares, strict=True)])

    def play(
        self,
        motion: Array,
        gains: Mapping[str, float],
        robots: Sequence[Array],
        substeps: Substeps,
        *,
        information: bool = False,
        secant: float = 0.0,
    ) -> Outcome | None:
        """Of references (n, rows) in their units; None where a robot's motion is not sane.

        information: with Fisher matrices, by small one-sided differences; secant: by central ones of this relative change.
        """
        time = np.asarray(self.step * np.arange(motion.shape[1]), dtype=np.float64)
        signals: dict[str, dict[str, Sampled]] = {}
        for one, values in zip(self.references, motion, strict=True):
            signals.setdefault(one.joint, {})[one.name] = Sampled(times=time, samples=values)
        names = [(self.joints.index(bound.joint), bound.quantity) for bound in self.bounds]
        names += [(self.joints.index(channel.joint), channel.quantity) for channel in self.channels]
        moves = [self._moves(x, secant) for x in robots] if information or secant else [np.zeros((0, 0))] * len(robots)
        all_x = [there for x, own in zip(robots, moves, strict=True) for there in (x, *(x + move for move in own))]
        starts = [Start(parameters=self._numbers(gains, x), references=signals) for x in all_x]
        runs = list(self.door.rollout(names, starts, steps=motion.shape[1] - 1, substeps=substeps))
        each = len(runs) // len(robots)
        known = [run for run in runs[::each] if run is not None]
        if len(known) < len(robots):
            return None
        shares = np.zeros((len(self.bounds), motion.shape[1]))
        for share, bound, *rows in zip(shares, self.bounds, *known, strict=False):
            middle, half = 0.5 * (bound.low + bound.high), 0.5 * (bound.high - bound.low)
            share[:] = np.nan_to_num(np.abs(np.array(rows) - middle) / half).max(axis=0)[: len(share)]
        when = self.step * float(np.argmax(shares.max(axis=0, initial=0.0)))
        found = [self._fisher(runs[each * i : each * (i + 1)], own) for i, own in enumerate(moves) if len(own)]
        fishers = [one for one in found if one is not None]
        whole = np.array(fishers) if len(fishers) == len(robots) else None
        return Outcome(shares.max(axis=1, initial=0.0), when, whole)

    def _moves(self, x: Array, secant: float) -> Array:
        """(n, n) a small change of each number, where bounds allow it; with a secant (2 n, n): all up, then all down."""
        low, high = self.layout.bounds
        if not secant:
            return np.diag(np.where(x + STEP > high, -STEP, STEP))
        middle = np.clip(x, low + secant, high - secant) - x
        return np.vstack([np.diag(middle + secant), np.diag(middle - secant)])

    def _fisher(self, runs: Sequence[Array | None], moves: Array) -> Array | None:
        """(groups, n, n) of runs of a robot, and of it with each number moved; None where sensitivities grow too much."""
        rows = [run[len(self.bounds) :] for run in runs if run is not None]
        if len(rows) < len(runs):
            return None
        base, count = rows[0], moves.shape[1]
        ends = rows[1 + count :] or [base] * count
        steps = np.diag(moves) - (np.diag(moves[count:]) if len(moves) > count else 0.0)
        slopes = np.array([(one - end) / h for one, end, h in zip(rows[1 : 1 + count], ends, steps, strict=True)])
        own = np.ptp(base, axis=1)
        measured = np.isfinite(base).all(axis=1) & np.isfinite(slopes).all(axis=(0, 2))
        if np.any((np.abs(slopes).max(axis=2) > GROWTH * np.maximum(own, 1e-9))[:, measured & (own > 0.0)]):
            return None
        found = np.zeros((self.groups, len(steps), len(steps)))
        for i in np.flatnonzero(measured):
            slope = slopes[:, i, :: self.every] / self.channels[i].noise
            found[self.channels[i].group] += slope @ slope.T
        return found


def _by_motor(name: str) -> list[str]:
    """Quantities that a limit is about: `motor_torque` is that of each motor."""
    motors = [name.replace("motor_", f"motor_{i}_") for i in (1, 2)]
    return motors if name.startswith("motor_") and motors[0] in COMPARABLE else [name]
