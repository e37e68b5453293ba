"""A complete run of a scenario. Samples go to sinks (such as the log) in chunks, or are collected in the result."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from asrsim.compiled.compiling import numba_available, time_spent
from asrsim.errors import DivergenceError, Problem
from asrsim.plugins import blame_plugins
from asrsim.progress import Progress, Stop, Tell
from asrsim.robot.model import Robot
from asrsim.samples import Command, RunInfo, Samples, WrenchCommand, concatenate
from asrsim.scenario.data import Scenario
from asrsim.simulation.observation import Counts
from asrsim.simulation.prepare import ScenarioLike, prepare
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.recording import Sink
from asrsim.simulation.simulation import Simulation
from asrsim.simulation.substeps import COARSE, TARGET, UNSTABLE, Resolution


@dataclass(frozen=True, kw_only=True)
class Run:
    """Result of a run."""

    scenario: Scenario
    robot: Robot
    info: RunInfo
    status: str
    """State in which the run ended: `complete`, `interrupted` (stopped by the caller) or `diverged`."""
    resolution: Resolution
    counts: Counts
    wall_time: float
    """Computing time of the loop in s."""
    simulated_time: float
    """Simulated time in s."""
    samples: Samples | None = None
    """All logged samples; None if samples are not collected."""
    message: str = ""
    warnings: tuple[Problem, ...] = ()
    compiled: bool
    """Whether the loop ran compiled."""


@blame_plugins()
def simulate(
    scenario: ScenarioLike,
    robot: Robot | None = None,
    *,
    sinks: Sequence[Sink] | Callable[[RunInfo], Sequence[Sink]] = (),
    keep: bool = True,
    progress: Tell | None = None,
    stop: Stop | None = None,
    commands: Iterable[Command | WrenchCommand] = (),
    duration: float | None = None,
    alike: int = 1,
) -> Run:
    """Result of a run of one scenario.

    Args:
        scenario: The scenario, or an examined or prepared scenario, which is not examined again.
        robot: Robot in place of the scenario's robot.
        sinks: Objects that receive chunks of samples, or a function of the run's description that returns them.
        keep: Whether all samples are collected in the result.
        progress: Function that is called with the simulated time in s and the completed fraction of the run.
        stop: Function that is called every few thousand substeps. The run ends when the function returns True.
        commands: References and wrenches that are set during the run, in the order of time.
        duration: Duration in s, instead of the scenario's duration.
        alike: Number of similar runs, including this run. The loop is compiled if this saves time over all these runs.

    Raises:
        InputError, SimulationError: The run cannot be built; ActuatorError if a user's law raises.
        DivergenceError: The motion diverged; the run up to the divergence is in `.run`.
    """
    prepared = prepare(scenario, robot)
    # By default the C library returns large freed blocks of memory to the system. When the memory is needed again, each page
    # causes a page fault. Therefore free a block of slightly less than 32 MB once. Afterwards the library keeps freed blocks up
    # to this size.
    np.empty((1 << 22) - (1 << 10))
    # Choose the loop (Python or compiled) of a live run of unknown duration as for a long run. The repetition of this run
    # states a duration, and must use the same loop.
    steps = prepared.scenario.steps * alike if duration is None else 10**6
    expected = steps * prepared.resolution.substeps
    with Simulation(prepared, sinks=sinks, record=keep, duration=duration, expected_substeps=expected) as simulation:
        return run_to_end(simulation, progress=progress, stop=stop, commands=commands)


def run_to_end(
    simulation: Simulation,
    *,
    progress: Tell | None = None,
    stop: Stop | None = None,
    commands: Iterable[Command | WrenchCommand] = (),
) -> Run:
    """Result of running a simulation to the end of its scenario's duration; arguments and errors as for `simulate`."""
    status, began = "complete", _clock()
    waiting = iter(commands)
    command = next(waiting, None)
    try:
        while simulation.substep < simulation.total:
            if stop is not None and stop():
                status = "interrupted"
                break
            while command is not None and command.substep <= simulation.substep:
                obey(simulation, command)
                command = next(waiting, None)
            until = simulation.total if command is None else min(simulation.total, command.substep)
            simulation.advance_to(simulation.next_chunk(until))
            if progress is not None:
                reached = min(simulation.substep, simulation.last)
                progress(Progress(fraction=reached / simulation.last, time=reached * simulation.prepared.substep))
        simulation.flush()
    except DivergenceError as error:
        error.run = run_of(simulation, "diverged", wall_time=_clock() - began, message=str(error))
        raise
    return run_of(simulation, status, wall_time=_clock() - began)


def _clock() -> float:
    """Time in s on a clock that stops while functions are compiled."""
    return clock.perf_counter() - time_spent()


def obey(simulation: Simulation, command: Command | WrenchCommand) -> None:
    """Set the reference or the wrench that a command contains."""
    if isinstance(command, Command):
        simulation.set_reference(command.joint, command.reference, command.value)
    else:
        wrench = command.wrench
        simulation.set_wrench(wrench.body, wrench.force, torque=wrench.torque, point=wrench.point)


def run_of(simulation: Simulation, status: str, *, wall_time: float, message: str = "") -> Run:
    """Result of a simulation up to the present time."""
    kept, prepared = simulation.recording.kept, simulation.prepared
    return make_run(
        prepared,
        simulation.counts,
        status,
        slow_because=simulation.slow_because,
        wall_time=wall_time,
        compiled=simulation.compiled,
        message=message,
        samples=concatenate(kept) if kept else None,
        simulated_time=min(simulation.substep, simulation.last) * prepared.substep,
    )


def make_run(prepared: Prepared, counts: Counts, status: str, *, slow_because: str = "", **more: Any) -> Run:
    """Result of a run with its warnings. slow_because: reason why the loop ran in Python although compiled code would have been
    faster. more: other fields of `Run`.
    """
    return Run(
        scenario=prepared.scenario,
        robot=prepared.robot,
        info=prepared.info,
        status=status,
        resolution=prepared.resolution,
        counts=counts,
        warnings=(*prepared.warnings, *_stiffer_than_foreseen(prepared, counts), *_slow(slow_because)),
        **more,
    )


def _slow(reason: str) -> Iterator[Problem]:
    """A warning if the loop ran in Python although a compiled loop would have been faster."""
    if reason:
        message = f"the loop ran in plain Python, several times slower than compiled code: {reason}"
        yield Problem(message, hint="" if numba_available() else "pip install numba", code="slow-loop")


def _stiffer_than_foreseen(prepared: Prepared, counts: Counts) -> Iterator[Problem]:
    """Warnings for springs that became so much stiffer than expected that the substeps no longer resolve the springs well."""
    resolution = prepared.resolution
    if prepared.stepping.released and resolution.omega_h >= UNSTABLE:
        message = (
            f"toolbox stepping does not resolve the stiffest spring (omega h = {resolution.omega_h:.2g}, unstable at "
            f"{UNSTABLE:g} and above): the motion is not physical"
        )
        hint = "Lower the step, or use stepping leapfrog, which chooses substeps."
        yield Problem(message, key="stepping", hint=hint, code="unresolved-spring")
    for drive, foreseen, seen in zip(prepared.drives, resolution.stiffness, counts.stiffest.tolist(), strict=True):
        if foreseen <= 0.0 or seen <= foreseen:
            continue
        omega_h = resolution.omega_h * math.sqrt(seen / foreseen)
        if omega_h > COARSE:
            yield Problem(
                f"the spring reached a stiffness of {seen:.4g} N m/rad, more than the expected {foreseen:.4g}: the substeps "
                f"may have been too coarse (omega h up to {omega_h:.2g})",
                key=drive.name,
                hint=f"Set substeps to {math.ceil(resolution.substeps * omega_h / TARGET)} or more.",
                code="spring-stiffer-than-foreseen",
            )
