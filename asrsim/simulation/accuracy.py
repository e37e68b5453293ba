"""Accuracy of a run: its numerical error, estimated from runs with finer steps, and its difference from another engine.

The runs that are compared advance together, so that no motion is stored.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import combinations
from typing import Any

import numpy as np

from asrsim.engines import ENGINES
from asrsim.errors import AsrsimError, DivergenceError, SimulationError
from asrsim.plain import finite_or_none
from asrsim.plugins import blame_plugins
from asrsim.progress import Progress, Stop, Tell
from asrsim.samples import Array
from asrsim.simulation.examine import Plan
from asrsim.simulation.prepare import build
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.run import Run
from asrsim.simulation.simulation import Simulation
from asrsim.simulation.start import Start

COMPARED = ("link_position", "link_torque")
MEASURES = ("position_max", "position_rms", "torque_max", "torque_rms")
BLOCK = 500
"""Number of logged samples between two comparisons of the runs."""
ORDER_TOLERANCE = 0.35
"""Tolerance of the measured order of convergence: an order that is lower than the order of the scheme by more than this value
is reported, and the estimate of the error uses the measured order.
"""
FASTER = 0.75
"""A warning is given if the measured order of every joint exceeds the order of the scheme by more than this value. At coarse
steps, a scheme of order two has a measured order of up to 2.5.
"""
RESOLVED = 1e-12
"""Differences below this value, in rad or N m, are rounding errors; no order of convergence is computed from such
differences.
"""
LIMIT = 1e-8
"""Largest difference in rad (m) between engines that count as equal, for motion without contacts. Measured differences are
about 1e-12."""
NUDGE = 1e-12
"""Change of the initial positions in rad (m) with which the sensitivity of the motion is measured."""
SENSITIVE = 100.0
"""Allowed difference between engines, as a multiple of the effect of `NUDGE`. It is larger than 1, since engines round in every
step and not only at the start.
"""


class RunDifferences:
    """Differences between the motions of several runs of one robot. Iterating over this object simulates the runs."""

    def __init__(self, runs: Sequence[Prepared]) -> None:
        self._runs = runs
        self._largest, self._squares = np.zeros((2, math.comb(len(runs), 2), len(COMPARED), len(runs[0].drives)))
        self._samples = 0

    def __iter__(self) -> Iterator[float]:
        """Simulate and compare all runs block by block, and yield the simulated times in s. Raises DivergenceError."""
        scenario = self._runs[0].scenario
        substeps = sum(run.last_substep(None) for run in self._runs)
        for blocks in zip(*(_motion(run, substeps) for run in self._runs), strict=True):
            difference = np.abs([one - other for one, other in combinations(blocks, 2)])
            self._largest = np.maximum(self._largest, difference.max(axis=1))
            self._squares += (difference**2).sum(axis=1)
            self._samples += len(blocks[0])
            yield (self._samples - 1) * scenario.step * scenario.log_every

    @property
    def measures(self) -> Array:
        """Differences (pairs, joints, `MEASURES`) between the runs of each pair. The pairs consist of the first run and each
        later run, then of the second run and each later run, and so on.
        """
        both = np.stack([self._largest, np.sqrt(self._squares / self._samples)], axis=-1)
        return both.swapaxes(1, 2).reshape(len(both), -1, len(MEASURES))


def _motion(prepared: Prepared, substeps: int) -> Iterator[Array]:
    """Logged samples of a run, in blocks that are arrays (samples, quantities of `COMPARED`, joints). Raises DivergenceError.

    substeps: total number of substeps in the compared runs, by which a Python loop or a compiled loop is chosen.
    """
    length = BLOCK * prepared.scenario.log_every * prepared.resolution.substeps
    with Simulation(prepared, record=True, names=COMPARED, expected_substeps=substeps) as simulation:
        for end in range(length, simulation.last + length, length):
            simulation.advance_to(min(end, simulation.last) + 1)
            values = simulation.samples.values
            simulation.recording.kept.clear()
            if values:
                yield np.stack([values[name] for name in COMPARED], axis=1)


@blame_plugins()
def certify(
    plan: Plan,
    run: Run,
    *,
    progress: Tell | None = None,
    stop: Stop | None = None,
) -> dict[str, Any]:
    """Estimate of the numerical error of `run` by Richardson extrapolation, from runs with a half and a quarter of the step of
    `run`.

    plan: the examined scenario of the run. progress, stop: as in `simulate`; if `stop` returns True, the
    result is empty. Returns plain values for JSON: stepping and its order, the
    substep of the run in s, and for each joint the largest and the root-mean-square error of position (rad, m) and torque (N m,
    N) and the measured order of convergence of the position (None where the error is at rounding level). Raises SimulationError
    if a finer run fails.
    """
    scenario, stepping = plan.scenario, plan.stepping
    comparison = RunDifferences([build(_finer(plan, run, finer)) for finer in (1, 2, 4)])
    for time in comparison:
        if progress is not None:
            progress(Progress(task="finer steps", fraction=time / scenario.duration, time=time))
        if stop is not None and stop():
            return {}
    joints: dict[str, dict[str, float | None]] = {}
    warnings = []
    # Differences between two runs each. half: runs with the whole step and half the step; quarter: runs with the whole step and
    # a quarter of the step; finest: runs with half and a quarter of the step.
    for joint, half, quarter, finest in zip(run.robot.moving_joints, *comparison.measures, strict=True):
        order = math.log2(half[1] / finest[1]) if min(half[1], finest[1]) > RESOLVED else math.nan
        low = order < stepping.order - ORDER_TOLERANCE
        used = max(order, 0.5) if low else stepping.order
        # Richardson extrapolation: the error of the run with a quarter of the step is 4^-order times the error of the coarse
        # run.
        errors = quarter / (1.0 - 4.0**-used)
        joints[joint.name] = {**dict(zip(MEASURES, errors.tolist(), strict=True)), "order": finite_or_none(order)}
        if low:
            warnings.append(
                f"joint '{joint.name}': declared order {stepping.order}, measured {order:.2f}. {stepping.name} has the "
                "declared order where forces are smooth; friction, stops, contacts and limits lower the order. The estimate "
                "uses the measured order"
            )
    orders = [known for joint in joints.values() if (known := joint["order"]) is not None]
    if orders and (slowest := min(orders)) > stepping.order + FASTER:
        warnings.append(
            f"declared order {stepping.order}, measured {slowest:.2f}. The error of {stepping.name} decreases faster than "
            "declared in this run, and the estimate is too large"
        )
    return {
        "stepping": stepping.name,
        "scheme_order": stepping.order,
        "step": scenario.step / run.resolution.substeps,
        "joints": joints,
        "warnings": warnings,
    }


def _finer(plan: Plan, run: Run, finer: int) -> Plan:
    """The plan with the run's substeps, divided by `finer`, and with unchanged logging times."""
    scenario = plan.scenario
    if plan.stepping.released:
        return plan.on(step=scenario.step / finer, log_every=scenario.log_every * finer)
    resolution = run.resolution
    return plan.on(substeps=resolution.substeps * finer, motor_substeps=resolution.motor_substeps)


def other_engine(engine: str, *, required: bool = False) -> str | None:
    """Name of the first installed engine with dynamics, except `engine`; None if no such engine is installed, if `engine` has
    no dynamics, or if the masses in `engine` differ from the masses in the robot's file. required: also compare an engine with
    other masses, and raise SimulationError if no engine is found.
    """
    if not required and not ENGINES.get(engine).masses_of_file:
        return None
    entries = ((name, ENGINES.get(name)) for name in ENGINES.names() if name != engine)
    others = [name for name, entry in entries if entry.available and not entry.prescribed]
    if others and not ENGINES.get(engine).prescribed:
        return others[0]
    if required:
        raise SimulationError(
            f"there is no other engine to compare '{engine}' with: a cross-check needs two installed engines with "
            "dynamics, such as bullet (package pybullet) and mujoco (package mujoco-core)"
        )
    return None


@blame_plugins()
def cross_check(
    plan: Plan,
    run: Run,
    other: str,
    *,
    progress: Tell | None = None,
) -> dict[str, Any]:
    """Repeat a run in the engine `other` and compare the motions.

    plan: the examined scenario of the run. progress: as in `simulate`.
    Returns plain values for JSON: the two engines and the versions of their libraries; whether bodies may touch; the
    differences of each joint (rad, m; N m, N; None if the other engine cannot simulate the whole run); `finding`: description
    of a fault, empty if the engines agree or are allowed to differ; `note`: explanation of the differences.
    """
    scenario, version = plan.scenario, other
    names = [joint.name for joint in run.robot.moving_joints]
    contacts, finding, note = not scenario.world.empty, "", ""
    same = _finer(plan, run, 1)
    own = build(same)
    found = np.full((len(names), len(MEASURES)), np.nan)
    try:
        repeated = build(same.on(engine=other))
        version = repeated.info.metadata["engine_version"]
        found = _differences(own, repeated, other, progress)
    except DivergenceError as error:
        message = f"the run diverges with {other}: {error}"
        finding, note = ("", message) if contacts else (message, "")
    except AsrsimError as error:
        note = f"{other} cannot run the scenario: {error}"
    difference = np.nan_to_num(found[:, 0])
    worst = int(difference.argmax())
    if contacts:
        note = note or f"bodies may touch, which {scenario.engine} and {other} model differently: differences are legitimate"
    elif difference[worst] > LIMIT and not finding:
        sensitivity = math.inf
        with suppress(DivergenceError):
            sensitivity = float(_differences(own, _nudged(own), "sensitivity", progress)[:, 0].max())
        if difference[worst] <= SENSITIVE * sensitivity:
            note = (
                f"the motion amplifies small differences: a change of the initial positions by {NUDGE:g} rad changes the run "
                f"in {scenario.engine} by {sensitivity:.2g} rad, so the difference from {other} is not a fault of an engine"
            )
        else:
            finding = (
                f"joint '{names[worst]}': {scenario.engine} and {other} differ by {difference[worst]:.2g} rad although no "
                f"bodies touch (rounding explains at most {LIMIT:g} rad): one of the engines is wrong"
            )
    values = {name: map(finite_or_none, row) for name, row in zip(names, found.tolist(), strict=True)}
    joints = {name: dict(zip(MEASURES, row, strict=True)) for name, row in values.items()}
    return {
        "engine": scenario.engine,
        "other": other,
        "versions": [run.info.metadata["engine_version"], version],
        "contacts": contacts,
        "joints": joints,
        "finding": finding,
        "note": note,
        "agrees": not finding,
    }


def _differences(one: Prepared, other: Prepared, title: str, progress: Tell | None) -> Array:
    """Differences (joints, `MEASURES`) between two runs. Raises DivergenceError."""
    comparison = RunDifferences([one, other])
    for time in comparison:
        if progress is not None:
            progress(Progress(task=title, fraction=time / one.scenario.duration, time=time))
    return np.asarray(comparison.measures[0])


def _nudged(prepared: Prepared) -> Prepared:
    """The run with initial positions that are changed by `NUDGE`, away from stops. A joint beyond a stop keeps its initial
    position."""
    positions = {}
    for drive in prepared.drives:
        start, (low, high) = drive.initial_position, drive.joint.stops
        if low <= start <= high:
            positions[drive.name] = start + NUDGE if start + NUDGE <= high else start - NUDGE
    return prepared.started(Start(positions=positions))
