"""Cross-check of a run with another engine: the run is repeated in that engine, and the motion of each joint is compared."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from asrsim.errors import AsrsimError, DivergenceError, SimulationError
from asrsim.plain import finite_or_none
from asrsim.robot.model import Robot
from asrsim.samples import Array, RunInfo, Samples
from asrsim.scenario.data import Scenario
from asrsim.simulation.certify import COMPARED, Comparison
from asrsim.simulation.prepare import prepare
from asrsim.simulation.prepared import Prepared, Start
from asrsim.simulation.run import Run, simulate
from asrsim.simulation.steppings import STEPPINGS

LIMIT = 1e-8
"""Largest difference in rad (m) at which engines agree on motion without contacts (differences of about 1e-12 were
measured)."""
NUDGE = 1e-12
"""Change of the start positions in rad (m) by which the sensitivity of the motion is measured."""
SENSITIVE = 100.0
"""Allowed difference between engines, as a multiple of the effect of `NUDGE`: engines round in every step, not only at the
start."""


def other_engine(engine: str) -> str | None:
    """Name of the first installed engine with dynamics other than `engine`; None if there is none, or `engine` has no
    dynamics."""
    from asrsim.engines import ENGINES

    if ENGINES.get(engine).prescribed:
        return None
    entries = ((name, ENGINES.get(name)) for name in ENGINES.names() if name != engine)
    return next((name for name, entry in entries if entry.available and not entry.prescribed), None)


def require_other_engine(scenario: Scenario) -> str:
    """Name of the engine for a cross-check of the scenario. Raises SimulationError if there is none."""
    other = other_engine(scenario.engine)
    if other is None:
        raise SimulationError(
            f"there is no other engine to compare '{scenario.engine}' with: a cross-check needs two installed engines with "
            "dynamics, such as bullet (package pybullet) and mujoco (package mujoco-core)"
        )
    return other


def cross_check(
    scenario: Scenario,
    info: RunInfo,
    chunks: Iterable[Samples],
    robot: Robot | None = None,
    *,
    progress: Callable[[str, float], None] | None = None,
) -> dict[str, Any]:
    """Repeat a run in another engine and compare the motions.

    info, chunks: description and samples of the run, with the quantities of `COMPARED`; `chunks` is iterated once. robot: the
    robot as read from its file. progress: function that receives the name of the engine and its simulated time. Returns plain
    values for JSON: both engines and the versions of their libraries; whether bodies may touch; the differences of each joint
    (rad, m; N m, N; None for a joint without drive); `finding`: description of a fault, empty if the engines agree or may
    differ; `note`: explanation of the differences. Raises SimulationError if there is no other engine.
    """
    other = require_other_engine(scenario)
    same = scenario
    if not STEPPINGS.get(scenario.stepping).released:
        same = replace(scenario, substeps=int(info.metadata["substeps"]), motor_substeps=int(info.metadata["motor_substeps"]))
    names = [joint.name for joint in info.joints]
    found = np.full((2, len(COMPARED), len(names)), np.nan)
    contacts = not scenario.world.empty
    version, finding, note = other, "", ""
    logged = Comparison(same, [], keep=True)
    for chunk in chunks:
        logged.write(chunk)
    try:
        repeated = prepare(replace(same, engine=other), robot)
        version = repeated.info.metadata["engine_version"]
        again, found = _differences(repeated, logged.motion, progress and partial(progress, other))
        if again.status == "diverged":
            message = f"the run diverges with {other}: {again.message}"
            finding, note = ("", message) if contacts else (message, "")
    except AsrsimError as error:
        note = f"{other} cannot run this: {error}"
    worst, difference = max(zip(names, found[0, 0].tolist(), strict=True), key=lambda pair: _size(pair[1]))
    if contacts:
        note = note or (
            f"bodies may touch, which {scenario.engine} and {other} model differently: differences are legitimate here"
        )
    elif difference > LIMIT and not finding:
        nudged = _nudged(prepare(same, robot))
        moved, effect = _differences(nudged, logged.motion, progress and partial(progress, "sensitivity"))
        sensitivity = math.inf if moved.status == "diverged" else float(effect[0, 0].max())
        if difference <= SENSITIVE * sensitivity:
            note = (
                f"the motion multiplies differences: moved by {NUDGE:g} rad at the start, {scenario.engine} differs from "
                f"itself by {sensitivity:.2g} rad, so that the difference from {other} shows no fault of an engine"
            )
        else:
            finding = (
                f"joint '{worst}': {scenario.engine} and {other} differ by {difference:.2g} rad though nothing touches "
                f"(at most {LIMIT:g} is rounding): one of them is wrong"
            )
    keys = ("position_max", "position_rms", "torque_max", "torque_rms")
    values = {name: map(finite_or_none, found[:, :, j].T.ravel().tolist()) for j, name in enumerate(names)}
    return {
        "engine": scenario.engine, "other": other, "versions": [info.metadata["engine_version"], version], "contacts": contacts,
        "joints": {name: dict(zip(keys, own, strict=True)) for name, own in values.items()}, "finding": finding, "note": note,
        "agrees": not finding,
    }  # fmt: skip


def _nudged(prepared: Prepared) -> Prepared:
    """The run with start positions that are moved by `NUDGE`, away from stops. A joint beyond a stop keeps its start."""
    positions = {}
    for drive in prepared.drives:
        start, (low, high) = drive.initial_position, drive.joint.stops
        if low <= start <= high:
            positions[drive.name] = start + NUDGE if start + NUDGE <= high else start - NUDGE
    return prepared.started(Start(positions=positions))


def _differences(prepared: Prepared, logged: Array, progress: Callable[[float], None] | None) -> tuple[Run, Array]:
    """A further run, and its differences from the logged motion (see `Comparison.differences`). If the run diverges, the part
    before the divergence."""
    comparison = Comparison(prepared.scenario, [logged], keep=False)
    try:
        run = simulate(prepared, sinks=[comparison], keep=False, names=COMPARED, progress=progress)
    except DivergenceError as error:
        run = error.run  # type: ignore[assignment]
    return run, comparison.differences[0] if comparison.differences else np.full((2, *logged.shape[1:]), np.nan)


def _size(value: float) -> float:
    return 0.0 if math.isnan(value) else value
