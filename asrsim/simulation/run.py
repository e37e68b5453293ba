"""A run: from a scenario to samples. Pure data goes in; chunks of samples go to sinks (the log), or are kept."""

from __future__ import annotations

import gc
import math
import time as clock
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from asrsim.errors import DivergenceError, Problem, SimulationError
from asrsim.robot.model import Robot
from asrsim.samples import Array, RunInfo, Samples
from asrsim.scenario.data import Scenario
from asrsim.simulation.choice import available, pays
from asrsim.simulation.divergence import EnergyGuard, blame, not_finite, runaway
from asrsim.simulation.loop import Hook, Loop, NoValueError
from asrsim.simulation.prepare import Prepared, prepare
from asrsim.simulation.recorder import Counts, Recorder
from asrsim.simulation.substeps import COARSE, TARGET, Resolution
from asrsim.simulation.world import WorldRecorder

BLOCK = 1024
"""Substeps of the first block, between samples handed on, checks and progress."""
LONGEST_BLOCK = 8192
"""Blocks grow to it with the time already simulated: a divergence early in the run is found early."""
BLOCK_NUMBERS = 20_480
"""The most times joints: what still goes through the processor's cache."""


class Sink(Protocol):
    """Takes samples as they come."""

    def write(self, samples: Samples) -> None:
        """The next chunk."""


@dataclass(frozen=True, kw_only=True)
class Run:
    """What a run gives."""

    scenario: Scenario
    robot: Robot
    info: RunInfo
    status: str
    """complete, interrupted or diverged."""
    resolution: Resolution
    counts: Counts
    wall_time: float
    """s of the loop."""
    simulated_time: float
    """s."""
    samples: Samples | None = None
    """Everything that was logged, if kept."""
    message: str = ""
    warnings: tuple[Problem, ...] = ()

    @property
    def speed(self) -> float:
        """Simulated seconds per second."""
        return self.simulated_time / self.wall_time if self.wall_time > 0 else float("inf")


def simulate(
    scenario: Scenario,
    robot: Robot | None = None,
    *,
    sinks: Sequence[Sink] | Callable[[RunInfo], Sequence[Sink]] = (),
    keep: bool = True,
    progress: Callable[[float], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> Run:
    """Run one variant.

    sinks: take chunks of samples, or a function that makes them from the run's description; keep: collect all samples in
    the result; progress: told the simulated time; stop: asked every some thousand substeps, True ends the run cleanly.
    Raises InputError (ActuatorError if a user's law raises) and SimulationError; DivergenceError carries the run so far as
    `.run`.
    """
    with blame_laws():
        prepared = prepare(scenario, robot)
        with closing(prepared.engine):
            ready = sinks(prepared.info) if callable(sinks) else sinks
            _keep_freed_memory()
            with _no_collection():
                return _run(prepared, ready, keep=keep, progress=progress, stop=stop)


@contextmanager
def blame_laws() -> Iterator[None]:
    """Whatever a user's law raises becomes an ActuatorError with its file and line."""
    try:
        yield
    except (Exception, SystemExit) as error:
        from asrsim.actuators.user import law_fault

        fault = law_fault(error)
        if fault is None:
            raise
        raise fault from error


def _keep_freed_memory() -> None:
    """Ask the C library to keep what a block's arrays free for those of the next.

    It gives large memory back to the system, which costs a fault for each page when it is wanted again, until it has seen
    a block as large as this one go.
    """
    np.empty(1 << 21)


@contextmanager
def _no_collection() -> Iterator[None]:
    """The loop makes no reference cycles, and every collection would walk through all that is loaded."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def _run(
    prepared: Prepared,
    sinks: Sequence[Sink],
    *,
    keep: bool,
    progress: Callable[[float], None] | None,
    stop: Callable[[], bool] | None,
) -> Run:
    scenario, engine, resolution = prepared.scenario, prepared.engine, prepared.resolution
    n = resolution.substeps
    last = round(scenario.duration / scenario.step) * n
    every = n * scenario.log_every
    world = WorldRecorder(engine, every, last)
    hooks = prepared.hooks if scenario.world.empty and scenario.fixed_base else (*prepared.hooks, world.hook)
    loop = make_loop(prepared, hooks, last)
    recorder = Recorder(prepared.drives, prepared.stepping, substep=prepared.substep, every=every, last=last)
    guard = EnergyGuard(engine.mechanical_energy()) if scenario.engine == "bullet" else None
    kept: list[Samples] = []
    status, error = "complete", None
    done = 0
    began = clock.perf_counter()
    # One row beyond the end completes the last velocity.
    total = last + 2
    longest = max(BLOCK, min(LONGEST_BLOCK, BLOCK_NUMBERS // len(prepared.drives)))
    while done < total:
        if stop is not None and stop():
            status = "interrupted"
            break
        block = prepared.inputs.block(done, min(max(done, BLOCK), longest, total - done))
        try:
            raw = loop.run(block)
        except NoValueError as fault:
            status = "diverged"
            error = runaway(fault.joint, fault.substep * prepared.substep, str(fault), resolution.omega_h)
            break
        error = _faults(prepared, raw, done)
        if error is not None:
            rows = max(round(error.time / prepared.substep) - done, 1)
            first, second, external = block.arrays
            raw, block = raw[:rows], replace(block, arrays=(first[:rows], second[:rows], external[:rows]))
        samples = recorder.add(block, raw)
        if samples is not None:
            samples = world.add_to(samples)
            for sink in sinks:
                sink.write(samples)
            if keep:
                kept.append(samples)
        if error is None and guard is not None:
            error = _energy_fault(prepared, guard, recorder, done + len(raw))
        done += len(raw)
        if error is not None:
            status = "diverged"
            break
        if progress is not None:
            progress(min(done, last) * prepared.substep)
    wall = clock.perf_counter() - began
    run = Run(
        scenario=scenario,
        robot=prepared.robot,
        info=prepared.info,
        status=status,
        resolution=resolution,
        counts=recorder.counts,
        wall_time=wall,
        simulated_time=min(done, last) * prepared.substep,
        samples=join(kept) if kept else None,
        message=str(error) if error is not None else "",
        warnings=(*prepared.warnings, *_stiffer_than_foreseen(prepared, recorder)),
    )
    if error is not None:
        error.run = run
        raise error
    return run


def make_loop(prepared: Prepared, hooks: Sequence[Hook], last: int) -> Loop:
    """The loop that pays: compiled where it can and the run is long, else plain. `last`: substeps of the run."""
    scenario = prepared.scenario
    options: dict[str, Any] = {
        "substep": prepared.substep,
        "motor_substeps": prepared.resolution.motor_substeps,
        "omega_h": prepared.resolution.omega_h,
        "before_step": hooks,
    }
    motor_steps = last * prepared.resolution.motor_substeps
    if scenario.compiled or (scenario.compiled is None and pays(len(prepared.drives), motor_steps) and available()):
        if not available():
            raise SimulationError("the compiled loop needs Numba: pip install 'asrsim[fast]'")
        from asrsim.simulation.compiled import CompiledLoop

        try:
            return CompiledLoop(prepared.engine, prepared.drives, prepared.stepping, **options)
        except SimulationError:
            if scenario.compiled:
                raise
    return Loop(prepared.engine, prepared.drives, prepared.stepping, **options)


def _faults(prepared: Prepared, raw: Array, done: int) -> DivergenceError | None:
    row = not_finite(raw)
    if row is None:
        return None
    joint = blame(raw, row, prepared.drives)
    time = (done + row) * prepared.substep
    return runaway(joint, time, "its motion is no longer finite or sane", prepared.resolution.omega_h)


def _energy_fault(prepared: Prepared, guard: EnergyGuard, recorder: Recorder, done: int) -> DivergenceError | None:
    """Energy of links or actuators from nowhere; contacts and wrenches do work of their own on the links."""
    scenario, meter = prepared.scenario, recorder.meter
    alone = scenario.world.empty and not scenario.wrenches and scenario.fixed_base
    engine = prepared.engine
    speeds = np.array([state[1] for state in engine.read()])
    fault = guard.fault(
        engine.mechanical_energy() if alone else None,
        kinetic=0.5 * float(speeds @ engine.mass_matrix() @ speeds) if alone else 0.0,
        given=meter.given,
        residual=meter.residual,
        turnover=meter.turnover,
        names=engine.joints,
    )
    if fault is None:
        return None
    joint, what = fault
    return runaway(joint, done * prepared.substep, what, prepared.resolution.omega_h)


def _stiffer_than_foreseen(prepared: Prepared, recorder: Recorder) -> list[Problem]:
    """Springs that got so much stiffer than the substeps were chosen for that the step no longer resolves them well."""
    warnings = []
    resolution = prepared.resolution
    for drive, foreseen, seen in zip(prepared.drives, resolution.stiffness, recorder.counts.stiffest.tolist(), strict=True):
        if foreseen <= 0.0 or seen <= foreseen:
            continue
        omega_h = resolution.omega_h * math.sqrt(seen / foreseen)
        if omega_h > COARSE:
            warnings.append(
                Problem(
                    message=f"the spring reached {seen:.4g} N m/rad where {foreseen:.4g} were foreseen: omega h may have been "
                    f"{omega_h:.2g}, which is coarse",
                    key=drive.name,
                    hint=f"Set substeps to {math.ceil(resolution.substeps * omega_h / TARGET)} or more.",
                    code="spring-stiffer-than-foreseen",
                )
            )
    return warnings


def join(chunks: Sequence[Samples]) -> Samples:
    """Chunks of one run as one."""
    first = chunks[0]
    return Samples(
        time=np.concatenate([chunk.time for chunk in chunks]),
        joints=first.joints,
        values={name: np.concatenate([chunk.values[name] for chunk in chunks]) for name in first.values},
        bodies={name: np.concatenate([chunk.bodies[name] for chunk in chunks]) for name in first.bodies},
        contacts={name: np.concatenate([chunk.contacts[name] for chunk in chunks]) for name in first.contacts},
    )


__all__ = ["Prepared", "Run", "SimulationError", "prepare", "simulate"]
