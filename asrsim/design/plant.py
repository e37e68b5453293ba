"""The robot as an experiment meets it: motions in; whether they keep the limits, and what sensors would tell, out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from asrsim.design.limits import Limits, interval
from asrsim.design.motion import Segment, joined
from asrsim.errors import InputError, Problem, did_you_mean
from asrsim.identification.door import COMPARABLE, Door, Start, Substeps
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
"""Times a channel's own motion per relative change of a number: beyond it a motion is near-chaotic, and nothing is believed."""
FULL = 0.97
"""Share of a limit that a motion may use."""
PROBE = 0.2
"""s in which the robot must stay within its limits at the references of the start."""


@dataclass(frozen=True)
class Reference:
    """What the experiment commands."""

    joint: str
    name: str
    slot: int
    unit: str
    home: float
    low: float
    high: float

    @property
    def column(self) -> str:
        """Its heading."""
        return f"{self.joint}.reference_{self.slot + 1}"

    def values(self, share: Array) -> Array:
        """In its unit, of -1 (low) to 1 (high)."""
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
    """What is recorded, or could be."""

    joint: str
    quantity: str
    noise: float
    group: int
    """0: it is recorded; others: numbers of the sensors that could be, from 1 on."""


@dataclass(frozen=True, eq=False)
class Told:
    """What a motion tells and uses."""

    use: Array
    """(joints,) largest share of a limit of each joint, over the draws; above 1: exceeded."""
    when: float
    """s at which it is largest."""
    information: Array | None
    """(draws, groups, n, n) Fisher matrices; None: not asked for, or not to be believed."""


class Plant:
    """A scenario whose references are designed."""

    def __init__(self, scenario: Scenario, robot: Robot, layout: Layout, limits: Limits, seconds: float) -> None:
        self.scenario = replace(scenario, duration=seconds, expect=(), desired={}, log_every=1)
        self.door, self.layout = Door(self.scenario, robot), layout
        self.step, self.rows = scenario.step, round(seconds / scenario.step) + 1
        self.joints = self.door.joints
        problems: list[Problem] = []
        self.bounds = tuple(self._bounds(limits, problems))
        self.references = tuple(self._references(limits, problems))
        self.channels = tuple(self._channels(limits, problems))
        if problems:
            self.close()
            raise InputError(problems)
        self.groups = 1 + len(limits.sensors)
        self.every = max(1, round(1.0 / (limits.rate * self.step)))
        """Steps between samples."""
        self.driven = np.array([self.joints.index(one.joint) for one in self.references])

    def close(self) -> None:
        """Release the engines."""
        self.door.close()

    # -- what the limits file names -------------------------------------------------------------------------------------

    def _bounds(self, limits: Limits, problems: list[Problem]) -> Iterator[Bound]:
        names = [name for drive in self.door.drives for name in (drive.mode.references if drive.mode else ())]
        for joint, ranges in limits.limits.items():
            if joint not in (*self.joints, "*"):
                hint = did_you_mean(joint, self.joints)
                problems.append(Problem("the robot has no such joint", key=f"limits.{joint}", hint=hint, choices=self.joints))
                continue
            for name, given in ranges.items():
                motors = [name.replace("motor_", f"motor_{i}_") for i in (1, 2)]
                quantities = motors if motors[0] in COMPARABLE else [name]
                if not {*quantities} <= {*COMPARABLE, *names}:
                    known = tuple(dict.fromkeys((*names, *COMPARABLE)))
                    hint = did_you_mean(name, known)
                    problems.append(Problem("is no quantity", key=f"limits.{joint}.{name}", hint=hint, choices=known))
                    continue
                for one in self.joints if joint == "*" else (joint,):
                    yield from (Bound(one, quantity, *interval(given)) for quantity in quantities)

    def _references(self, limits: Limits, problems: list[Problem]) -> Iterator[Reference]:
        for drive, position in zip(self.door.drives, self.door.positions, strict=True):
            mode = drive.mode
            own = {bound.quantity: bound for bound in self.bounds if bound.joint == drive.name}
            if mode is None or not own:
                continue
            if mode.direct or not (mode.spring or mode.controller):
                message = (
                    f"a joint in mode {mode.number} ({mode.name}) does not come back to rest by itself: it cannot be designed"
                )
                hint = "Drive it by a controller: modes 1, 5 and 6"
                problems.append(Problem(message, key=f"limits.{drive.name}", hint=hint, code="mode"))
                continue
            signals = self.scenario.references_of(drive.name)
            for slot, name in enumerate(mode.references):
                preset = mode.mapped and slot == 1
                bound = own.get(name) or (None if preset else own.get("link_position"))
                if slot and drive.actuator is not None and drive.actuator.motors + drive.actuator.adjuster < 2:
                    continue
                signal = signals.get(name)
                home = float(signal.values(np.zeros(1))[0]) if signal is not None else 0.0 if preset else position
                if preset and bound is None:
                    continue
                if bound is None:
                    message = f"the range of {name} is missing: give a limit of it, or of link_position"
                    problems.append(Problem(message, key=f"limits.{drive.name}.{name}", code="limits"))
                elif not bound.low <= home <= bound.high:
                    message = f"the scenario begins beyond it, at {home:g}"
                    problems.append(Problem(message, key=f"limits.{drive.name}.{bound.quantity}", code="start-limit"))
                else:
                    yield Reference(drive.name, name, slot, mode.units[slot], home, bound.low, bound.high)

    def _channels(self, limits: Limits, problems: list[Problem]) -> Iterator[Channel]:
        recorded = {drive.name: drive for drive in self.door.drives}
        noise = limits.noise or dict.fromkeys(("link_position", "motor_1_position", "motor_2_position"), POSITION_NOISE)
        for name, size in noise.items():
            owner, _, quantity = name.rpartition(".")
            quantities = [f"{quantity}_1", f"{quantity}_2"] if f"{quantity}_1" in COMPARABLE else [quantity]
            if not {*quantities} <= {*COMPARABLE} or owner not in ("", *self.joints):
                hint = did_you_mean(name, COMPARABLE)
                problems.append(
                    Problem("is nothing that a sensor measures", key=f"noise.{name}", hint=hint, choices=COMPARABLE)
                )
                continue
            group = limits.sensors.index(name) + 1 if name in limits.sensors else 0
            for joint, drive in recorded.items():
                if owner in ("", joint) and not (quantity.startswith("motor") and (drive.mode is None or not drive.mode.motor)):
                    yield from (Channel(joint, one, size, group) for one in quantities)

    # -- runs -----------------------------------------------------------------------------------------------------------

    def substeps_of(self, gains: Mapping[str, float], draws: Sequence[Array]) -> Substeps:
        """Those that the stiffest of these robots needs."""
        found = [self.door.substeps_of(self._numbers(gains, x)) for x in draws]
        return max(one[0] for one in found), max(one[1] for one in found)

    def _numbers(self, gains: Mapping[str, float], x: Array) -> Mapping[str, Mapping[str, float]]:
        return numbers_of({**self.layout.table(x, 0), **gains})

    def motion(self, segments: list[Segment], rows: int) -> Array:
        """(references, rows) in the references' units."""
        shares = joined(segments, self.step, rows)
        return np.array([one.values(share) for one, share in zip(self.references, shares, strict=True)])

    def tell(
        self,
        motion: Array,
        gains: Mapping[str, float],
        draws: Sequence[Array],
        substeps: Substeps,
        *,
        information: bool = False,
    ) -> Told | None:
        """Of references (n, rows) in their units; None where the motion is not sane on every draw."""
        time = np.asarray(self.step * np.arange(motion.shape[1]), dtype=np.float64)
        signals: dict[str, dict[str, Sampled]] = {}
        for one, values in zip(self.references, motion, strict=True):
            signals.setdefault(one.joint, {})[one.name] = Sampled(times=time, samples=values)
        bounds = [bound for bound in self.bounds if bound.quantity in COMPARABLE]
        names = [(self.joints.index(one.joint), one.quantity) for one in bounds]
        names += [(self.joints.index(one.joint), one.quantity) for one in self.channels]
        moved = [x + move for x in draws for move in self._moves(x)] if information else draws
        starts = [Start(parameters=self._numbers(gains, x), references=signals) for x in moved]
        found = list(self.door.rollout(names, starts, steps=motion.shape[1] - 1, substeps=substeps))
        each = len(found) // len(draws)
        bases = found[::each]
        if any(one is None for one in bases):
            return None
        use, when = self._use(bounds, [one[: len(bounds)] for one in bases if one is not None])
        fishers = [
            self._fisher(found[i : i + each], len(bounds), x) for i, x in zip(range(0, len(found), each), draws, strict=True)
        ]
        believed = [one for one in fishers if one is not None] if information else []
        return Told(use, when, np.array(believed) if len(believed) == len(draws) else None)

    def _moves(self, x: Array) -> Array:
        """(n + 1, n): none, and a small one of each number, to the side that the bounds allow."""
        sign = np.where(x + STEP > self.layout.bounds[1], -1.0, 1.0)
        return np.vstack([np.zeros(len(x)), np.diag(STEP * sign)])

    def _use(self, bounds: Sequence[Bound], series: Sequence[Array]) -> tuple[Array, float]:
        use, when, most = np.zeros(len(self.joints)), 0.0, 0.0
        for i, bound in enumerate(bounds):
            middle, half = 0.5 * (bound.low + bound.high), 0.5 * (bound.high - bound.low)
            values = np.nan_to_num(np.abs(np.array([one[i] for one in series]) - middle) / half).max(axis=0)
            j, peak = self.joints.index(bound.joint), float(values.max())
            use[j] = max(use[j], peak)
            if peak > most:
                most, when = peak, float(self.step * np.argmax(values))
        return use, when

    def _fisher(self, series: Sequence[Array | None], first: int, x: Array) -> Array | None:
        """(groups, n, n); None where a sensitivity is not to be believed."""
        base, *others = series
        if base is None or not others or any(one is None for one in others):
            return None
        steps = np.diag(self._moves(x)[1:])
        base, slopes = (
            base[first:],
            np.array([(one - base)[first:] / h for one, h in zip(others, steps, strict=True) if one is not None]),
        )
        own = np.ptp(base, axis=1)
        measured = np.isfinite(base).all(axis=1) & np.isfinite(slopes).all(axis=(0, 2))
        if np.any((np.abs(slopes).max(axis=2) > GROWTH * np.maximum(own, 1e-9))[:, measured & (own > 0.0)]):
            return None
        found = np.zeros((self.groups, len(x), len(x)))
        for i in np.flatnonzero(measured):
            rows = slopes[:, i, :: self.every] / self.channels[i].noise
            found[self.channels[i].group] += rows @ rows.T
        return found
