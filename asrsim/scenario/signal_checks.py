"""Checks the signals of a scenario, and evaluates them over the run."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from asrsim.errors import Problem
from asrsim.robot import ActuatorBlock
from asrsim.robot.findings import LARGEST_NUMBER
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.signals.base import Signal

POINTS = 2000
"""Number of times during the run at which a signal is evaluated."""
FARTHEST = 1e6
"""Largest desired position, rad or m; rounding of larger values hides motions."""
ROUNDING = 1e-9
"""Largest relative rounding error of a signal's values."""
GOLDEN_RATIO = 0.5 * (1.0 + math.sqrt(5.0))
"""Golden ratio, whose multiples modulo 1 fill the interval from 0 to 1 evenly."""
SLACK = 2e-9
"""Largest distance in s, due to rounding, between a jump time that a signal states and the jump of its values."""
MOST_JUMPS = 100
"""Largest number of jumps per step."""


def signals_of(scenario: Scenario) -> Iterator[tuple[str, Signal]]:
    """Pairs (key, signal) for all signals of the scenario."""
    tables: dict[str, Mapping[str, Signal]] = {f"references.{joint}": own for joint, own in scenario.references.items()}
    tables |= {"external_torques": scenario.external_torques, **wanted_positions(scenario)}
    for section, table in tables.items():
        yield from ((f"{section}.{name}", signal) for name, signal in table.items())
    for index, wrench in enumerate(scenario.wrenches):
        for kind, axes in (("force", wrench.force), ("torque", wrench.torque)):
            for axis, signal in enumerate(axes):
                if signal is not None:
                    yield f"wrenches.{index}.{kind}.{axis}", signal


def wanted_positions(scenario: Scenario) -> dict[str, Mapping[str, Signal]]:
    """Desired and prescribed link positions: key of the scenario -> joint -> signal."""
    return {"desired": scenario.desired, "motion": scenario.motion, **scenario.trajectories}


def over_run(scenario: Scenario, signal: Signal) -> tuple[Array, Array]:
    """Ascending times of the run, including the signal's jumps, and the signal's values at these times."""
    end = scenario.duration
    time = np.sort(np.append(np.linspace(0.0, end, POINTS + 1), signal.jumps(0.0, end)))
    return time, signal.values(time)


def extremes(scenario: Scenario, signal: Signal) -> tuple[float, float]:
    """Smallest and largest value of a signal during the run."""
    _, values = over_run(scenario, signal)
    return float(values.min()), float(values.max())


def reference_key(scenario: Scenario, block: ActuatorBlock, name: str) -> str:
    """Dotted key of a joint's reference in the scenario."""
    return f"references.{block.joint if name in scenario.references.get(block.joint, {}) else '*'}.{name}"


def undersampled(scenario: Scenario, substeps: int) -> Iterator[Problem]:
    """Warnings about signals that change faster than the substeps sample them, so that the robot follows a slower motion.

    In a substep h, a sine of frequency f deviates from the straight line between two samples by at most the fraction tan(pi f h
    / 2) / 2 of its largest change in a substep. At half the sampling rate, this is half of the change. A signal that deviates
    by more than half of its change counts as undersampled. Corners of slower signals stay below this limit.
    """
    length = scenario.step / substeps
    numbers = np.arange(POINTS)
    begin = numbers * ((scenario.duration - length) / POINTS)
    inside = np.mod(numbers * GOLDEN_RATIO, 1.0)
    for key, signal in signals_of(scenario):
        jumps = signal.jumps(0.0, scenario.duration)
        smooth = np.searchsorted(jumps, begin) == np.searchsorted(jumps, begin + length, side="right")
        first, between, last = (signal.values((begin + part * length)[smooth]) for part in (0.0, inside, 1.0))
        change = last - first
        off = np.abs(between - first - inside[smooth] * change).max(initial=0.0)
        if 2.0 * off > np.abs(change).max(initial=0.0) + ROUNDING * np.abs(first).max(initial=0.0):
            message = f"changes too fast for substeps of {length:g} s: the robot follows a slower motion"
            hint = "Lower the frequency or the step"
            yield scenario.placed(Problem(message, key=key, hint=hint, code="undersampled"))


def hidden_jump(scenario: Scenario, signal: Signal) -> float | None:
    """A time in s at which a signal jumps although its `jumps` does not state this jump; None if there is no such jump.

    Of the intervals between `POINTS` times, the interval in which the signal changes most is narrowed by bisection. The change
    is a jump if most of it remains in an interval that is as short as the rounding of the time.
    """
    time = np.linspace(0.0, scenario.duration, POINTS + 1)
    values, stated = signal.values(time), signal.jumps(0.0, scenario.duration)
    change = np.abs(np.diff(values))
    near = np.searchsorted(stated, time[:-1] - SLACK) < np.searchsorted(stated, time[1:] + SLACK, side="right")
    change[near] = 0.0
    cell = int(np.argmax(change))
    least = 0.5 * float(change[cell])
    if not least > ROUNDING * float(np.abs(values).max()):
        return None
    low, high = time[cell], time[cell + 1]
    while high - low > 4.0 * np.spacing(high):
        middle = 0.5 * (low + high)
        early, late = np.abs(np.diff(signal.values(np.array([low, middle, high]))))
        if max(early, late) <= least:
            return None
        low, high = (low, middle) if early > late else (middle, high)
    return float(high)


def not_a_number(signal: Signal) -> str:
    """Name of a field of the signal, or of its parts, that is NaN; empty if no field is NaN."""
    for name, value in vars(signal).items():
        for part in value if isinstance(value, tuple) else (value,):
            if isinstance(part, float) and math.isnan(part):
                return name
            if isinstance(part, Signal) and (inner := not_a_number(part)):
                return inner
    return ""


def signal_faults(scenario: Scenario) -> Iterator[Problem]:
    """Errors for signals that raise errors, are not finite, are too large, or jump too often."""
    steps = scenario.duration / scenario.step
    wanted = wanted_positions(scenario)
    for key, signal in signals_of(scenario):
        bound, where = LARGEST_NUMBER, "too large for a robot"
        if key.rpartition(".")[0] in wanted:
            bound, where = FARTHEST, "too far for a joint"
        try:
            with np.errstate(all="ignore"):
                time, values = over_run(scenario, signal)
                bad = np.flatnonzero(~np.isfinite(values))
        except Exception as error:  # a user's signal may raise any error
            yield Problem(f"the signal fails: {type(error).__name__}: {error}", key=key, code="signal")
            continue
        jumps = len(time) - POINTS - 1
        if name := not_a_number(signal):
            yield Problem(f"'{name}' of the signal is not a number (NaN)", key=key, code="signal")
        elif bad.size:
            yield Problem(f"is not finite at {time[bad[0]]:g} s", key=key, code="signal")
        elif (largest := float(np.abs(values).max())) > bound:
            yield Problem(f"is larger than {bound:g}, {where}", key=key, value=largest, code="signal")
        elif jumps > MOST_JUMPS * max(steps, POINTS):
            yield Problem(f"jumps {jumps} times in {steps:.0f} steps, too often to follow", key=key, code="signal")
