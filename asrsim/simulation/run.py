"""A run: from a scenario to samples. Pure data goes in; chunks of samples go to sinks (the log), or are kept."""

from __future__ import annotations

import gc
import time as clock
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from asrsim.engines.base import Engine
from asrsim.errors import DivergenceError, InputError, Problem, SimulationError
from asrsim.robot.model import Robot
from asrsim.samples import Array, JointInfo, RunInfo, Samples
from asrsim.scenario.data import Scenario
from asrsim.simulation.divergence import EnergyGuard, blame, not_finite, runaway
from asrsim.simulation.drives import Drive, make_drives
from asrsim.simulation.inputs import Block, Inputs
from asrsim.simulation.loop import Hook, Loop
from asrsim.simulation.recorder import Counts, Recorder, has_second_reference, recorded_quantities
from asrsim.simulation.steppings import STEPPINGS, Stepping
from asrsim.simulation.substeps import Resolution, reachable_stiffness, resolve

BLOCK = 1024
"""Substeps between samples handed on, checks and progress."""
CONFIGURATIONS = 8
"""Random joint positions, beside the initial ones, in which the mass matrix is looked at."""


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


@dataclass(frozen=True, kw_only=True)
class Prepared:
    """A scenario made ready: everything but the running."""

    scenario: Scenario
    robot: Robot
    stepping: Stepping
    drives: tuple[Drive, ...]
    resolution: Resolution
    engine: Engine
    inputs: Inputs
    hooks: tuple[Hook, ...]
    info: RunInfo
    warnings: tuple[Problem, ...]

    @property
    def substep(self) -> float:
        """s."""
        return self.scenario.step / self.resolution.substeps


def prepare(scenario: Scenario, robot: Robot | None = None) -> Prepared:
    """Build the actuators and the engine; raises RobotError, ScenarioError or UnresolvedSpringError."""
    from asrsim.robot import load_robot
    from asrsim.scenario import apply_to_robot, check_against_robot

    if robot is None:
        robot = load_robot(scenario.robot, xacro_arguments=scenario.xacro_arguments, package_paths=scenario.package_paths)
    errors, warnings = check_against_robot(scenario, robot)
    if errors:
        from asrsim.errors import ScenarioError

        raise ScenarioError(errors)
    robot = apply_to_robot(scenario, robot)
    if not robot.moving_joints:
        raise InputError(Problem(message="the robot has no moving joint", file=robot.path, code="no-joint"))
    stepping = STEPPINGS.get(scenario.stepping)
    drives = make_drives(robot, stepping, initial_positions=scenario.initial_positions, link_damping=scenario.link_damping)
    scenario = plan_task(scenario, robot)
    engine, engine_warnings = make_engine(scenario, robot)
    try:
        resolution = _resolve(scenario, drives, engine)
        substep = scenario.step / resolution.substeps
        engine.set_step(substep)
        inputs = Inputs(scenario, drives, substep=substep, staggered=stepping.staggered)
        drives, hooks = _sensing(scenario, drives, substep)
        hooks += tuple(_wrenches(scenario, engine, substep))
        info = describe(scenario, robot, drives, stepping, resolution)
    except BaseException:
        engine.close()
        raise
    return Prepared(
        scenario=scenario,
        robot=robot,
        stepping=stepping,
        drives=drives,
        resolution=resolution,
        engine=engine,
        inputs=inputs,
        hooks=hooks,
        info=info,
        warnings=(*robot.warnings, *warnings, *engine_warnings),
    )


def plan_task(scenario: Scenario, robot: Robot) -> Scenario:
    """References from the Cartesian task, if the scenario has one."""
    if scenario.task is None:
        return scenario
    from asrsim.kinematics import plan_references

    return plan_references(scenario, robot)


def make_engine(scenario: Scenario, robot: Robot, *, visuals: bool = False) -> tuple[Engine, tuple[Problem, ...]]:
    """The scenario's engine, at its step."""
    from asrsim.engines import ENGINES

    built: tuple[Engine, tuple[Problem, ...]] = ENGINES.get(scenario.engine)(scenario, robot, visuals=visuals)
    return built


def _resolve(scenario: Scenario, drives: Sequence[Drive], engine: Engine) -> Resolution:
    points = np.linspace(0.0, scenario.duration, 2001)
    sampled = Inputs(scenario, drives, substep=scenario.step, staggered=False).sample(points)
    configurations = _configurations(drives)
    masses = [engine.mass_matrix(position) for position in configurations]
    gravity = np.max([np.abs(engine.gravity_torques(position)) for position in configurations], axis=0)
    external = np.max(np.abs(sampled[2]), axis=0)
    stiffness = [
        reachable_stiffness(
            drive,
            sampled[0][:, j],
            sampled[1][:, j],
            load=float(gravity[j] + external[j]),
            inertia=max(float(mass[j, j]) for mass in masses),
        )
        for j, drive in enumerate(drives)
    ]
    if STEPPINGS.get(scenario.stepping).released:
        # The released code knows no substeps, and runs springs that it does not resolve.
        finite = np.minimum(stiffness, 1e12).tolist()
        found = resolve(drives, masses, finite, step=scenario.step, substeps=None, motor_substeps=1, cap=10**15)
        return replace(found, substeps=1, motor_substeps=1, omega_h=found.frequency * scenario.step, stiffness=tuple(stiffness))
    return resolve(
        drives,
        masses,
        stiffness,
        step=scenario.step,
        substeps=scenario.substeps,
        motor_substeps=scenario.motor_substeps,
        cap=scenario.substep_cap,
    )


def _configurations(drives: Sequence[Drive]) -> list[list[float]]:
    """Joint positions at which the mass matrix counts: the initial ones and some within the limits."""
    generator = np.random.default_rng(0)
    low = np.array([-np.pi if d.joint.lower is None else max(d.joint.lower, -np.pi) for d in drives])
    high = np.array([np.pi if d.joint.upper is None else min(d.joint.upper, np.pi) for d in drives])
    initial = [drive.initial_position for drive in drives]
    return [initial, *(generator.uniform(low, np.maximum(low, high)).tolist() for _ in range(CONFIGURATIONS))]


def _sensing(scenario: Scenario, drives: Sequence[Drive], substep: float) -> tuple[tuple[Drive, ...], tuple[Hook, ...]]:
    from asrsim.simulation.sensors import sensed

    changed: list[Drive] = []
    hooks: list[Hook] = []
    for index, drive in enumerate(drives):
        effects = scenario.sensor_effects.get(drive.name, scenario.sensor_effects.get("*"))
        if effects is not None and effects.active and drive.mode is not None and drive.mode.controller:
            seen, hook = sensed(drive, effects, substep=substep, index=index, seed=scenario.seed)
            hooks.append(hook)
            changed.append(seen)
        else:
            changed.append(drive)
    return tuple(changed), tuple(hooks)


def _wrenches(scenario: Scenario, engine: Engine, substep: float) -> list[Hook]:
    def make(link: str, signals: list[Any], point: Sequence[float], frame: str) -> Hook:
        def hook(k: int, joints: Sequence[Any], states: Sequence[Any]) -> None:
            time = np.array([round(k * substep, 12)])
            values = [0.0 if signal is None else float(signal.values(time)[0]) for signal in signals]
            if not k:
                values = [0.5 * value for value in values]
            engine.apply_wrench(link, values[:3], values[3:], point, frame)

        return hook

    return [make(w.link, [*w.force, *w.torque], w.point, w.frame) for w in scenario.wrenches]


def describe(scenario: Scenario, robot: Robot, drives: Sequence[Drive], stepping: Stepping, resolution: Resolution) -> RunInfo:
    """The run's description, for its log."""
    from asrsim import __version__
    from asrsim.versions import version

    joints = tuple(
        JointInfo(
            name=drive.name,
            actuator=drive.actuator.name if drive.actuator else "rigid",
            mode=drive.mode.number if drive.mode else None,
            namespace=drive.block.namespace if drive.block else "",
            motors=0 if not drive.mode or not drive.mode.spring else (2 if has_second_reference(drive) else 1),
            prismatic=drive.joint.kind == "prismatic",
            quantities=recorded_quantities(drive),
        )
        for drive in drives
    )
    order = {name: index for index, name in enumerate(scenario.joint_order)}
    joints = tuple(sorted(joints, key=lambda joint: order.get(joint.name, len(order)))) if order else joints
    return RunInfo(
        robot=robot.name,
        joints=joints,
        step=scenario.step,
        log_every=scenario.log_every,
        variant=scenario.variant,
        urdf=robot.text,
        urdf_path=str(robot.path),
        scenario=scenario.text,
        scenario_path=str(scenario.path or ""),
        resolved={
            "scenario": dict(scenario.resolved),
            "parameters": {drive.name: dict(drive.values) for drive in drives if drive.values},
        },
        metadata={
            "asrsim": __version__,
            "pybullet": version("pybullet"),
            "numpy": version("numpy"),
            "engine": scenario.engine,
            "stepping": stepping.name,
            "order": str(stepping.order),
            "step": repr(scenario.step),
            "substeps": str(resolution.substeps),
            "motor_substeps": str(resolution.motor_substeps),
            "omega_h": f"{resolution.omega_h:.4g}",
            "seed": str(scenario.seed),
            "gravity": repr(tuple(scenario.gravity)),
        },
        attachments={name: path.read_bytes() for name, path in scenario.attachments.items()},
    )


@dataclass
class _World:
    """Poses and contacts, looked at where a row is logged."""

    engine: Engine
    every: int
    last: int
    bodies: dict[str, list[tuple[float, ...]]] = field(default_factory=dict)
    contacts: dict[str, list[tuple[float, ...]]] = field(default_factory=dict)

    def hook(self, k: int, joints: Sequence[Any], states: Sequence[Any]) -> None:
        if k % self.every == 0 and k <= self.last:
            for name, pose in self.engine.bodies().items():
                self.bodies.setdefault(name, []).append(pose)
            for name, force in self.engine.contacts().items():
                self.contacts.setdefault(name, []).append(force)

    def add_to(self, samples: Samples) -> Samples:
        n = len(samples.time)
        bodies = {name: np.array(rows[:n]) for name, rows in self.bodies.items()}
        contacts = {name: np.array(rows[:n]) for name, rows in self.contacts.items()}
        for rows in (*self.bodies.values(), *self.contacts.values()):
            del rows[:n]
        return replace(samples, bodies=bodies, contacts=contacts)


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
    the result; progress: told the simulated time; stop: asked about every 2000 substeps, True ends the run cleanly.
    Raises InputError and SimulationError; DivergenceError carries the run so far as `.run`.
    """
    prepared = prepare(scenario, robot)
    with closing(prepared.engine):
        ready = sinks(prepared.info) if callable(sinks) else sinks
        with _no_collection():
            return _run(prepared, ready, keep=keep, progress=progress, stop=stop)


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
    world = _World(engine, every, last)
    hooks = prepared.hooks if scenario.world.empty else (*prepared.hooks, world.hook)
    loop = make_loop(prepared, hooks, last)
    recorder = Recorder(prepared.drives, prepared.stepping, substep=prepared.substep, every=every, last=last)
    guard = EnergyGuard(engine.mechanical_energy()) if scenario.engine == "bullet" else None
    kept: list[Samples] = []
    status, error = "complete", None
    done = 0
    began = clock.perf_counter()
    # One row beyond the end completes the last velocity.
    total = last + 2
    while done < total:
        if stop is not None and stop():
            status = "interrupted"
            break
        block = prepared.inputs.block(done, min(BLOCK, total - done))
        raw = loop.run(block)
        error = _faults(prepared, block, raw, done)
        if error is not None:
            rows = max(round(error.time / prepared.substep) - done, 1)
            raw, block = raw[:rows], replace(block, arrays=tuple(a[:rows] for a in block.arrays))  # type: ignore[arg-type]
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
        warnings=prepared.warnings,
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
    if scenario.compiled is not False:
        from asrsim.simulation import compiled

        wanted = scenario.compiled or compiled.pays(len(prepared.drives), last)
        if scenario.compiled and not compiled.available():
            raise SimulationError("the compiled loop needs Numba: pip install 'asrsim[fast]'")
        if wanted and compiled.available():
            try:
                return compiled.CompiledLoop(prepared.engine, prepared.drives, prepared.stepping, **options)
            except SimulationError:
                if scenario.compiled:
                    raise
    return Loop(prepared.engine, prepared.drives, prepared.stepping, **options)


def _faults(prepared: Prepared, block: Block, raw: Array, done: int) -> DivergenceError | None:
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
    fault = guard.fault(
        prepared.engine.mechanical_energy() if alone else None,
        given=meter.given,
        residual=meter.residual,
        turnover=meter.turnover,
        names=prepared.engine.joints,
    )
    if fault is None:
        return None
    joint, what = fault
    return runaway(joint, done * prepared.substep, what, prepared.resolution.omega_h)


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
