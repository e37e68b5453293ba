"""The signals of a scenario: their keys, their values over the run, and signals that cannot be followed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from asrsim.errors import Problem
from asrsim.robot import ActuatorBlock
from asrsim.robot.findings import LARGEST
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.signals.base import Signal

POINTS = 2000
"""Points of the run at which a signal is evaluated."""
FARTHEST = 1e6
"""rad or m: a wanted position beyond it has lost the digits in which a motion differs from rest."""
MOST_JUMPS = 100
"""Largest number of jumps a step."""


def signals_of(scenario: Scenario) -> Iterator[tuple[str, Signal]]:
    """Every signal of the scenario, with its key."""
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
    """Link positions that are wanted or prescribed, by section and joint."""
    return {"desired": scenario.desired, "motion": scenario.motion, **scenario.trajectories}


def over_run(scenario: Scenario, signal: Signal) -> tuple[Array, Array]:
    """Times of the run in order, the signal's jumps among them, and its values."""
    end = scenario.duration
    time = np.sort(np.concatenate([np.linspace(0.0, end, POINTS + 1), signal.jumps(0.0, end)]))
    return time, signal.values(time)


def extremes(scenario: Scenario, signal: Signal) -> tuple[float, float]:
    """The least and the largest value over the run."""
    _, values = over_run(scenario, signal)
    return float(values.min()), float(values.max())


def reference_key(scenario: Scenario, block: ActuatorBlock, name: str) -> str:
    """Key of a joint's reference in the scenario."""
    return f"references.{block.joint if name in scenario.references.get(block.joint, {}) else '*'}.{name}"


def signal_faults(scenario: Scenario) -> Iterator[Problem]:
    """Errors: signals that raise, that are not finite or absurdly large, or that jump too often for any run to follow."""
    steps = scenario.duration / scenario.step
    wanted = wanted_positions(scenario)
    for key, signal in signals_of(scenario):
        bound, where = LARGEST, "which no robot has"
        if key.rpartition(".")[0] in wanted:
            bound, where = FARTHEST, "where no joint goes"
        try:
            with np.errstate(all="ignore"):
                time, values = over_run(scenario, signal)
                bad = np.flatnonzero(~np.isfinite(values))
        except Exception as error:  # a user's own signal may raise anything
            yield Problem(f"the signal fails: {type(error).__name__}: {error}", key=key, code="signal")
            continue
        jumps = len(time) - POINTS - 1
        if bad.size:
            yield Problem(f"is not finite at {time[bad[0]]:g} s", key=key, code="signal")
        elif (largest := float(np.abs(values).max())) > bound:
            yield Problem(f"is larger than {bound:g}, {where}", key=key, value=largest, code="signal")
        elif jumps > MOST_JUMPS * max(steps, POINTS):
            yield Problem(f"jumps {jumps} times in {steps:.0f} steps, too often to follow", key=key, code="signal")
