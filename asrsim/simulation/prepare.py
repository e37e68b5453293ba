"""Preparation of a scenario: read the robot, build actuators and engine, determine the number of substeps.

A prepared scenario is immutable; simulations and worlds are made from it.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.engines import ENGINES
from asrsim.engines.base import MEMBERS, Engine
from asrsim.errors import InputError, Problem, RobotError, SimulationError, did_you_mean
from asrsim.plugins import blame_plugins
from asrsim.registry import result_fault
from asrsim.registry.steppings import Stepping
from asrsim.robot.dynamics import RobotModel, robot_model
from asrsim.robot.massless import SINGULAR
from asrsim.robot.model import Robot
from asrsim.robot.vary import varied_robot
from asrsim.samples import Array, RunInfo
from asrsim.scenario.data import Scenario
from asrsim.scenario.overrides import Overrides
from asrsim.scenario.signal_checks import undersampled
from asrsim.signals.base import Signal
from asrsim.simulation.description import describe
from asrsim.simulation.drives import DELAYS, EXTERNAL_TORQUE, SteppedJoint, make_drives, ranges_of, with_delays, with_sensors
from asrsim.simulation.equilibrium import at_equilibrium
from asrsim.simulation.examine import Plan, examine
from asrsim.simulation.inputs import sampled_signals
from asrsim.simulation.layout import EXTERNAL, GOALS
from asrsim.simulation.resonance import resonance_doubts
from asrsim.simulation.substeps import Resolution, resolution_of

WARP = "mujoco_warp"
"""Name of the engine of worlds on a device of Warp."""


def make_engine(scenario: Scenario, robot: Robot) -> tuple[Engine, tuple[Problem, ...]]:
    """The scenario's engine, and its warnings. Raises SimulationError if the engine is not installed or ignores wrenches."""
    entry = ENGINES.get(scenario.engine)
    if not entry.available:
        installed = ", ".join(name for name in ENGINES.names() if ENGINES.get(name).available)
        message = f"the engine '{scenario.engine}' needs '{entry.module}', which is not installed; here are: {installed}"
        raise SimulationError(message)
    made = entry.make(scenario, robot)
    if not isinstance(made, tuple) or len(made) != 2:
        message = f"`make` of the engine '{scenario.engine}' must return an engine and a tuple of warnings; it returns {made!r}"
        raise result_fault(entry.make, message)
    engine, warnings = made
    for name in MEMBERS:
        if inspect.getattr_static(engine, name, MEMBERS) is MEMBERS:
            message = f"the engine '{scenario.engine}' must have the member `{name}`; {type(engine).__name__} lacks it"
            raise result_fault(entry.make, message)
    if scenario.wrenches and not engine.takes_wrenches:
        engine.close()
        raise SimulationError(f"the engine '{scenario.engine}' takes no wrenches: the scenario's would have no effect")
    return engine, warnings


def _start_fault(drive: SteppedJoint | None, what: str, value: Any) -> str:
    """Fault of a start value of a joint; empty if there is none. what: key of `started`."""
    if drive is None:
        return "the robot has no moving joint of this name"
    if what.startswith("motor"):
        if np.ndim(value) != 1 or not all(map(_is_finite, value)):
            return "must be a list of finite numbers, one for each motor"
        if len(value) > drive.motors:
            return f"has {len(value)} values, but the number of motors of '{drive.name}' is {drive.motors}"
        return ""
    low, high = drive.joint.stops
    if not _is_finite(value):
        return "must be a finite number"
    if what == "initial" and not low <= value <= high:
        return f"lies outside the limits of '{drive.name}', {low:g} to {high:g}"
    return ""


def _is_finite(value: Any) -> bool:
    try:
        return math.isfinite(value)
    except TypeError:
        return False


Numbers = Mapping[str, Mapping[str, float]]
"""Values of parameters by joint or link, and by name, as in `Prepared.vary`."""
Signals = Mapping[str, Mapping[str, Signal]]
"""Signals by joint, and by the name of the reference or `external_torque`."""


@dataclass(frozen=True, kw_only=True)
class Start:
    """Start of a world; values that are not given come from the scenario. If the scenario starts at equilibrium, a world starts
    at the equilibrium for its own parameters and references."""

    parameters: Numbers = field(default_factory=dict)
    references: Signals = field(default_factory=dict)
    positions: Mapping[str, float] = field(default_factory=dict)
    """Position of each joint's link, by joint, rad (m)."""
    velocities: Mapping[str, float] = field(default_factory=dict)
    """Velocity of each joint's link, by joint, rad/s (m/s)."""
    motors: Mapping[str, Sequence[float]] = field(default_factory=dict)
    """Positions of each joint's motors, by joint, rad; motors without an entry start at their link's position."""
    motor_velocities: Mapping[str, Sequence[float]] = field(default_factory=dict)
    """Velocities of each joint's motors, by joint, rad/s; motors without an entry start as the scenario states."""


@dataclass(frozen=True, kw_only=True)
class Prepared:
    """A scenario that has been read, checked and prepared. It is immutable and can serve many simulations."""

    plan: Plan = field(repr=False, compare=False)
    """The examined scenario, without planned references and what `vary` and `with_references` change."""
    scenario: Scenario
    robot: Robot
    stepping: Stepping
    drives: tuple[SteppedJoint, ...]
    """The moving joints, with their drives, sensors and start."""
    resolution: Resolution
    info: RunInfo
    warnings: tuple[Problem, ...]
    model: RobotModel | None = field(repr=False, compare=False)
    """Kinematics and dynamics of the robot; None if the engine prescribes the motion of the links."""
    _spare: list[Engine] = field(default_factory=list, repr=False, compare=False)
    """Engine that the preparation built; the first simulation uses this engine."""
    _latest: list[tuple[object, RobotModel]] = field(default_factory=list, repr=False, compare=False)
    """Inertials of the latest variant, and its model."""

    @property
    def initial_positions(self) -> tuple[float, ...]:
        """Start positions of the moving joints in rad (m)."""
        return tuple(drive.initial_position for drive in self.drives)

    @property
    def initial_velocities(self) -> tuple[float, ...]:
        """Start velocities of the moving joints in rad/s (m/s)."""
        return tuple(drive.initial_velocity for drive in self.drives)

    @property
    def substep(self) -> float:
        """Length of a substep in s."""
        return self.scenario.step / self.resolution.substeps

    def last_substep(self, duration: float | None) -> int:
        """Number of the substep at which `duration` (s; default: the scenario's) ends. Raises InputError if the duration is
        shorter than a step."""
        seconds = self.scenario.duration if duration is None else duration
        if not self.scenario.step / 2.0 < seconds < math.inf:
            raise InputError("must last a step at least", key="duration", value=seconds, code="duration")
        return round(seconds / self.scenario.step) * self.resolution.substeps

    @property
    def velocity_cutoff(self) -> bool:
        """Whether torques that accelerate a joint beyond its velocity limit are set to 0, as Gazebo does with URDF files."""
        given = self.scenario.velocity_cutoff
        return self.stepping.released if given is None else given

    def make_engine(self) -> Engine:
        """A new engine for this scenario; the caller must close it."""
        return self._spare.pop() if self._spare else make_engine(self.scenario, self.robot)[0]

    def needed_resolution(self) -> Resolution:
        """Numbers of substeps that a new preparation with these parameters would choose; `vary` keeps the earlier numbers.

        Raises UnresolvedSpringError.
        """
        return resolution_of(self.scenario, self.drives, self.model)

    def slot_of(self, joint: str, reference: str) -> tuple[int, int]:
        """Number of the joint, and the column of the reference (or of `external_torque`) in an input row. Raises InputError for
        unknown names."""
        if joint not in self._slots:
            names = tuple(self._slots)
            hint = did_you_mean(joint, names)
            raise InputError(f"no joint is called '{joint}'", choices=names, hint=hint, code="unknown-joint")
        j, known = self._slots[joint]
        if reference not in known:
            message = f"joint '{joint}' has no reference '{reference}'"
            raise InputError(message, choices=tuple(known), code="unknown-reference")
        return j, known[reference]

    @cached_property
    def _slots(self) -> dict[str, tuple[int, dict[str, int]]]:
        """Number of each joint, and the columns of its references in an input row, by name."""
        found = {}
        for j, drive in enumerate(self.drives):
            columns = {name: GOALS + i for i, name in enumerate(drive.references)}
            found[drive.name] = j, {**columns, EXTERNAL_TORQUE: EXTERNAL}
        return found

    def undelayed_inputs(self, time: Array) -> Array:
        """External torques, then references before the reference map, (columns, joints, n), at the times `time` (n,) in s.
        Commands have the imperfections that the scenario states, except for delays."""
        drives = [
            replace(
                drive, command_imperfections=drive.command_imperfections and replace(drive.command_imperfections, delay=0.0)
            )
            for drive in self.drives
        ]
        return sampled_signals(self.scenario, drives, time)

    def started(self, start: Start) -> Prepared:
        """A copy with the positions, velocities and motors of a start. Raises InputError for wrong names and values."""
        given = {
            "initial": start.positions, "velocities": start.velocities, "motors": start.motors,
            "motor_velocities": start.motor_velocities,
        }  # fmt: skip
        if not any(given.values()):
            return self
        joints = {drive.name: drive for drive in self.drives}
        problems = []
        for key, table in given.items():
            for name, value in table.items():
                if fault := _start_fault(joints.get(name), key, value):
                    hint = None if name in joints else did_you_mean(name, tuple(joints))
                    problems.append(Problem(fault, key=f"{key}.{name}", value=value, hint=hint, code="start"))
        if problems:
            raise InputError(problems)
        drives = tuple(
            replace(
                drive,
                initial_position=float(start.positions.get(drive.name, drive.initial_position)),
                initial_velocity=float(start.velocities.get(drive.name, drive.initial_velocity)),
                motor_positions=tuple(map(float, start.motors.get(drive.name, ()))) or drive.motor_positions,
                motor_velocities=tuple(map(float, start.motor_velocities.get(drive.name, ()))) or drive.motor_velocities,
            )
            for drive in self.drives
        )
        return replace(self, drives=drives)

    def with_references(self, signals: Signals) -> Prepared:
        """A copy with other signals, given by joint and by the name of the reference or `external_torque`. No file is read
        again; the substeps are unchanged. A start at equilibrium is computed again.

        An unused engine of this object is passed on to the copy. Raises InputError for names that the robot does not have, and
        for values that are not signals; ScenarioError for an arm without equilibrium.
        """
        references, torques = dict(self.scenario.references), dict(self.scenario.external_torques)
        for joint, table in signals.items():
            for name, signal in table.items():
                self.slot_of(joint, name)
                if not isinstance(signal, Signal):
                    raise InputError("must be a signal, such as Constant", key=f"{joint}.{name}", value=signal, code="signal")
            own = {**self.scenario.references_of(joint), **table}
            if EXTERNAL_TORQUE in own:
                torques[joint] = own.pop(EXTERNAL_TORQUE)
            references[joint] = own
        scenario = replace(self.scenario, references=references, external_torques=torques)
        return replace(self, scenario=scenario)._settled()

    def vary(self, parameters: Numbers) -> Prepared:
        """A copy with other parameters. No file is read or checked again; the substeps are unchanged.

        parameters: values by joint and name (a parameter of the actuator, `damping` or `friction`; `command_delay` and
        `sensor_delay` in s, at most those of the scenario's `imperfections`), or by link and name (`mass`; `x`, `y`, `z` of the
        centre of mass; `ixx` .. `izz` about the centre of mass, in the inertial frame). A start at equilibrium is computed
        again. Raises RobotError that names unknown or unphysical parameters, InputError for delays, ScenarioError for an arm
        without equilibrium.
        """
        delays = {
            drive.name: {name: own[name] for name in DELAYS if name in own}
            for drive in self.drives if (own := parameters.get(drive.name))
        }  # fmt: skip
        numbers = {
            owner: {name: value for name, value in own.items() if name not in delays.get(owner, ())}
            for owner, own in parameters.items()
        }
        robot, model = varied_robot(self.robot, numbers), self.model
        drives = with_sensors(make_drives(robot, self.stepping, self.scenario), self.scenario, self.substep)
        drives = tuple(with_delays(drive, delays.get(drive.name, {})) for drive in drives)
        if model is not None and robot.inertials != self.robot.inertials:
            model = self._model_of(robot, drives)
        return replace(self, robot=robot, drives=drives, model=model, _spare=[])._settled()

    def _model_of(self, robot: Robot, drives: Sequence[SteppedJoint]) -> RobotModel:
        """Model of a varied robot; the latest is kept, since many variants have equal inertials. Raises RobotError."""
        for inertials, model in self._latest:
            if inertials == robot.inertials:
                return model
        model = robot_model(self.scenario, robot)
        check_inertia(drives, model)
        self._latest[:] = [(robot.inertials, model)]
        return model

    def _settled(self) -> Prepared:
        """A copy that starts at equilibrium if the scenario requires it. Raises ScenarioError."""
        if self.model is None or not self.scenario.initial_equilibrium:
            return self
        return replace(self, drives=at_equilibrium(self.scenario, self.drives, self.model))


ScenarioLike = str | Path | Scenario | Plan | Prepared
"""What a simulation is made of. Only a file or a scenario is examined, and only a prepared scenario is not built."""


def prepare(
    scenario: ScenarioLike, robot: Robot | str | Path | None = None, *, variant: str | None = None, overrides: Overrides = (),
    plugins: Sequence[str | Path] = (), settable: bool = False,
) -> Prepared:  # fmt: skip
    """Examine a scenario, and build its actuators and engine; arguments as for `examine` and `build`. A prepared scenario is
    returned as it is. Raises RobotError, ScenarioError or UnresolvedSpringError."""
    if isinstance(scenario, Prepared):
        return scenario
    return build(examine(scenario, robot, variant=variant, overrides=overrides, plugins=plugins), settable=settable)


def prepare_worlds(
    scenario: ScenarioLike, *, engine: str | None = None, variant: str | None = None, overrides: Overrides = (),
    plugins: Sequence[str | Path] = (), settable: bool = False,
) -> Prepared:  # fmt: skip
    """As `prepare`, for many worlds or a twin: in MuJoCo if neither caller nor scenario states an engine, since it steps about
    ten times faster than PyBullet. engine: name of the engine; `WARP` takes the links' model from MuJoCo. Raises InputError if
    the scenario is prepared for another engine."""
    if isinstance(scenario, Prepared):
        if engine not in (None, WARP, scenario.scenario.engine):
            raise InputError("the scenario is prepared for another engine", key="engine", value=engine, code="engine")
        return scenario
    plan = examine(scenario, variant=variant, overrides=overrides, plugins=plugins)
    if engine == WARP or (engine is None and not plan.scenario.states_engine and ENGINES.get("mujoco").available):
        engine = "mujoco"
    return build(plan if engine in (None, plan.scenario.engine) else plan.on(engine=engine), settable=settable)


@blame_plugins()
def build(plan: Plan, *, settable: bool = False) -> Prepared:
    """Build the actuators and the engine of an examined scenario. Raises UnresolvedSpringError, and errors of the engine.

    The number of substeps is chosen for the scenario's references and for all values in its `reference_ranges`. settable:
    whether callers may set all references within the limits of the robot; the scenario then gets these limits as
    `reference_ranges`.
    """
    planned, drives = plan.scenario, plan.drives
    if settable:
        # Only torques of joints without limits have infinite ranges; the number of substeps does not depend on these torques.
        ranges = {
            joint: {name: pair for name, pair in own.items() if all(map(math.isfinite, pair))}
            for joint, own in ranges_of(planned, drives).items()
        }
        planned = replace(planned, reference_ranges=ranges)
    if planned.task is not None or any(planned.inverse_dynamics.values()):
        # Imported only here, since most short runs do not need it.
        from asrsim.kinematics import plan_references

        planned = plan_references(planned, plan.robot)
    model = plan.model
    if model is not None:
        if planned.initial_equilibrium:
            drives = at_equilibrium(planned, drives, model)
        check_inertia(drives, model)
    resolution = resolution_of(planned, drives, model)
    drives = with_sensors(drives, planned, planned.step / resolution.substeps)
    engine, engine_warnings = make_engine(planned, plan.robot)
    try:
        info = describe(planned, plan, drives, resolution, engine.version)
    except BaseException:
        engine.close()
        raise
    return Prepared(
        plan=plan,
        scenario=planned,
        robot=plan.robot,
        stepping=plan.stepping,
        drives=drives,
        resolution=resolution,
        info=info,
        model=model,
        warnings=(
            *plan.warnings,
            *engine_warnings,
            *undersampled(planned, resolution.substeps),
            *resonance_doubts(planned, drives, model, resolution),
        ),
        _spare=[engine],
    )


def check_inertia(drives: Sequence[SteppedJoint], model: RobotModel) -> None:
    """Raise RobotError if a motion has no inertia at the start: a joint with a point mass on its axis, or two joints on an axis
    with no mass between them.
    """
    mass = model.mass_matrix([drive.initial_position for drive in drives])
    problems = [
        Problem(
            f"what joint '{drive.name}' moves has no inertia about its axis, so its motion is not defined",
            line=drive.joint.line,
            key=drive.name,
            hint=f"Give link '{drive.joint.child}' an inertia, or fix the joint: `locked: [{drive.name}]`",
            code="massless-joint",
        )
        for j, drive in enumerate(drives)
        if not mass[j, j] > 0.0
    ]
    if problems:
        raise RobotError(problems)
    scale = 1.0 / np.sqrt(np.diag(mass))
    values, vectors = np.linalg.eigh(mass * np.outer(scale, scale))
    if values[0] < SINGULAR:
        share = np.linalg.norm(vectors[:, values < SINGULAR], axis=1)
        names = ", ".join(f"'{drive.name}'" for drive, part in zip(drives, share, strict=True) if part > 0.1 * share.max())
        raise RobotError(
            f"joints {names} can move against each other without moving any mass: their motion is not defined",
            hint="Give the links between them inertias, or fix one of the joints: `locked: [NAME]`",
            code="massless-motion",
        )
