"""A scenario that is ready to run: immutable data from which simulations are made."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from asrsim.engines import ENGINES
from asrsim.engines.base import Engine
from asrsim.errors import InputError, Problem, SimulationError, did_you_mean
from asrsim.robot.dynamics import RobotModel
from asrsim.robot.model import Robot
from asrsim.robot.vary import varied_robot
from asrsim.samples import RunInfo
from asrsim.scenario import robot_model
from asrsim.scenario.data import Scenario
from asrsim.signals.base import Signal
from asrsim.simulation.drives import SteppedJoint, make_drives, with_sensors
from asrsim.simulation.equilibrium import at_equilibrium
from asrsim.simulation.layout import EXTERNAL, GOALS
from asrsim.simulation.quantities import EXTERNAL_TORQUE
from asrsim.simulation.steppings import Stepping
from asrsim.simulation.substeps import Resolution, resolution_of


def make_engine(scenario: Scenario, robot: Robot) -> tuple[Engine, tuple[Problem, ...]]:
    """The scenario's engine, and its warnings. Raises SimulationError if the engine is not installed."""
    entry = ENGINES.get(scenario.engine)
    if not entry.available:
        installed = ", ".join(name for name in ENGINES.names() if ENGINES.get(name).available)
        message = f"the engine '{scenario.engine}' needs '{entry.module}', which is not installed; here are: {installed}"
        raise SimulationError(message)
    return entry.make(scenario, robot)


def dynamics_of(scenario: Scenario, robot: Robot) -> RobotModel | None:
    """Model of the robot on its base; None if the scenario's engine prescribes the motion of the links."""
    return None if ENGINES.get(scenario.engine).prescribed else robot_model(scenario, robot)


def _start_fault(drive: SteppedJoint, what: str, value: Any) -> str:
    """Fault of a start value of a joint; empty if there is none. what: `initial`, `velocities` or `motors`."""
    if what == "motors":
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
    """Start of a world; values that are not given come from the scenario.

    If the scenario starts at equilibrium, the start is the equilibrium for the parameters given here, but for the scenario's
    references: `references` do not change the start.
    """

    parameters: Numbers = field(default_factory=dict)
    references: Signals = field(default_factory=dict)
    positions: Mapping[str, float] = field(default_factory=dict)
    """Position of each joint's link, by joint, rad (m)."""
    velocities: Mapping[str, float] = field(default_factory=dict)
    """Velocity of each joint's link, by joint, rad/s (m/s)."""
    motors: Mapping[str, Sequence[float]] = field(default_factory=dict)
    """Positions of each joint's motors, by joint, rad; motors without an entry start at their link's position."""


@dataclass(frozen=True, kw_only=True)
class Prepared:
    """A scenario that has been read, checked and prepared. It is immutable and can serve many simulations."""

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

    def range_of(self, joint: str, reference: str) -> tuple[float, float]:
        """Smallest and largest value of a reference that callers may set; infinite if the scenario declares no range."""
        return self.scenario.ranges_of(joint).get(reference, (-math.inf, math.inf))

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

    def check_start(self, start: Start) -> None:
        """Raise InputError for wrong names and values in the positions, velocities and motors of a start."""
        joints = {drive.name: drive for drive in self.drives}
        problems = []
        for what, given in (("initial", start.positions), ("velocities", start.velocities), ("motors", start.motors)):
            for name, value in given.items():
                if name not in joints:
                    message, hint = "the robot has no moving joint of this name", did_you_mean(name, tuple(joints))
                    problems.append(Problem(message, key=f"{what}.{name}", value=value, hint=hint, code="start"))
                elif message := _start_fault(joints[name], what, value):
                    problems.append(Problem(message, key=f"{what}.{name}", value=value, code="start"))
        if problems:
            raise InputError(problems)

    def started(self, start: Start) -> Prepared:
        """A copy with the positions, velocities and motors of a start. Raises InputError for wrong names and values."""
        self.check_start(start)
        moved = {*start.positions, *start.velocities, *start.motors}
        drives = tuple(
            replace(
                drive,
                initial_position=float(start.positions.get(drive.name, drive.initial_position)),
                initial_velocity=float(start.velocities.get(drive.name, drive.initial_velocity)),
                motor_positions=tuple(map(float, start.motors.get(drive.name, ()))) or drive.motor_positions,
            )
            if drive.name in moved
            else drive
            for drive in self.drives
        )
        return replace(self, drives=drives) if moved else self

    def with_references(self, signals: Signals) -> Prepared:
        """A copy with other signals, given by joint and by the name of the reference or `external_torque`. No file is read
        again; substeps and start are unchanged. Only `vary`, or a reset with other parameters, computes a start at equilibrium
        again, then for the new signals.

        An unused engine of this object is passed on to the copy. Raises InputError for names that the robot does not have, and
        for values that are not signals.
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
        return replace(self, scenario=replace(self.scenario, references=references, external_torques=torques))

    def vary(self, parameters: Numbers) -> Prepared:
        """A copy with other parameters. No file is read or checked again; the substeps are unchanged.

        parameters: values by joint and name (a parameter of the actuator, `damping` or `friction`), or by link and name
        (`mass`; `x`, `y`, `z` of the centre of mass; `ixx` .. `izz` about the centre of mass, in the inertial frame). A start
        at equilibrium is computed again. Raises RobotError that names unknown or unphysical parameters, ScenarioError for an
        arm without equilibrium.
        """
        return self.with_numbers(parameters).settled()

    def settled(self) -> Prepared:
        """A copy that starts at equilibrium if the scenario requires it. Raises ScenarioError."""
        if not self.scenario.initial_equilibrium or self.model is None:
            return self
        return replace(self, drives=at_equilibrium(self.scenario, self.drives, self.model))

    def with_numbers(self, parameters: Numbers) -> Prepared:
        """A copy with other parameters, as `vary` makes it, but with the start that the scenario states."""
        robot = varied_robot(self.robot, parameters)
        drives = make_drives(robot, self.stepping, self.scenario)
        drives = with_sensors(drives, self.scenario, self.substep)
        model = self.model if robot.links == self.robot.links else dynamics_of(self.scenario, robot)
        return replace(self, robot=robot, drives=drives, model=model, _spare=[])
