"""A scenario that is ready to run: immutable data from which simulations are made."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from asrsim.engines.base import Engine, Model
from asrsim.errors import InputError, Problem, SimulationError, did_you_mean
from asrsim.robot import drive_of
from asrsim.robot.model import Robot
from asrsim.robot.vary import varied_robot
from asrsim.samples import RunInfo
from asrsim.scenario.data import Scenario
from asrsim.signals.base import Signal
from asrsim.simulation.drives import SteppedJoint, references_of
from asrsim.simulation.equilibrium import at_equilibrium
from asrsim.simulation.layout import EXTERNAL, GOALS
from asrsim.simulation.quantities import EXTERNAL_TORQUE
from asrsim.simulation.sensors import Sensor
from asrsim.simulation.steppings import Stepping
from asrsim.simulation.substeps import Resolution


def make_engine(scenario: Scenario, robot: Robot) -> tuple[Engine, tuple[Problem, ...]]:
    """The scenario's engine, and its warnings. Raises SimulationError if the engine is not installed."""
    from asrsim.engines import ENGINES

    entry = ENGINES.get(scenario.engine)
    if not entry.available:
        installed = ", ".join(name for name in ENGINES.names() if ENGINES.get(name).available)
        message = f"the engine '{scenario.engine}' needs '{entry.module}', which is not installed; here are: {installed}"
        raise SimulationError(message)
    return entry.make(scenario, robot)


def _is_finite(value: Any) -> bool:
    try:
        return math.isfinite(value)
    except TypeError:
        return False


@dataclass(frozen=True, kw_only=True)
class Prepared:
    """A scenario that has been read, checked and prepared. It is immutable and can serve many simulations."""

    scenario: Scenario
    robot: Robot
    stepping: Stepping
    drives: tuple[SteppedJoint, ...]
    resolution: Resolution
    sensors: tuple[Sensor | None, ...]
    info: RunInfo
    warnings: tuple[Problem, ...]
    initial_positions: tuple[float, ...]
    """Start positions of the moving joints in rad (m)."""
    initial_velocities: tuple[float, ...]
    """Start velocities of the moving joints in rad/s (m/s)."""
    ranges: Mapping[str, Mapping[str, tuple[float, float]]] = field(default_factory=dict)
    _spare: list[Engine] = field(default_factory=list, repr=False, compare=False)
    """Engine that the preparation built; the first simulation uses this engine."""

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

    def range_of(self, joint: str, reference: str) -> tuple[float, float]:
        """Smallest and largest value of a reference that callers may set; infinite if the scenario declares no range."""
        given = {**self.ranges.get("*", {}), **self.ranges.get(joint, {})}
        return given.get(reference, (-math.inf, math.inf))

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
            names = references_of(drive) or (drive.mode.references if drive.mode else ())
            found[drive.name] = j, {**{name: GOALS + i for i, name in enumerate(names)}, EXTERNAL_TORQUE: EXTERNAL}
        return found

    def start(
        self,
        positions: Mapping[str, float],
        velocities: Mapping[str, float],
        motors: Mapping[str, Sequence[float]] | None = None,
    ) -> tuple[list[float], list[float]]:
        """Positions and velocities of all joints at a start that differs from the scenario's. Raises InputError, also for
        wrong positions of motors."""
        joints = {drive.name: drive.joint for drive in self.drives}
        problems = []
        for what, given in (("initial", positions), ("velocities", velocities)):
            for name, value in given.items():
                low, high = joints[name].stops if name in joints and what == "initial" else (-math.inf, math.inf)
                if name not in joints:
                    message = "the robot has no moving joint of this name"
                elif not _is_finite(value):
                    message = "must be a finite number"
                elif not low <= value <= high:
                    message = f"lies outside the limits of '{name}', {low:g} to {high:g}"
                else:
                    continue
                hint = None if name in joints else did_you_mean(name, tuple(joints))
                problems.append(Problem(message, key=f"{what}.{name}", value=value, hint=hint, code="start"))
        problems += self._motor_problems(motors or {})
        if problems:
            raise InputError(problems)
        ours = (positions, self.initial_positions), (velocities, self.initial_velocities)
        placed = [[float(given.get(name, own)) for name, own in zip(joints, owns, strict=True)] for given, owns in ours]
        return placed[0], placed[1]

    def _motor_problems(self, motors: Mapping[str, Sequence[float]]) -> Iterator[Problem]:
        known = {drive.name: drive.actuator.motors if drive.actuator else 0 for drive in self.drives}
        for name, values in motors.items():
            hint = None
            if name not in known:
                message, hint = "the robot has no moving joint of this name", did_you_mean(name, tuple(known))
            elif np.ndim(values) != 1 or not all(map(_is_finite, values)):
                message = "must be a list of finite numbers, one for each motor"
            elif len(values) > known[name]:
                message = f"has {len(values)} values, but the number of motors of '{name}' is {known[name]}"
            else:
                continue
            yield Problem(message, key=f"motors.{name}", value=values, hint=hint, code="start")

    def with_references(self, signals: Mapping[str, Mapping[str, Signal]]) -> Prepared:
        """A copy with other signals, given by joint and by the name of the reference or `external_torque`. No file is read
        again; substeps and start are unchanged.

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

    def vary(self, parameters: Mapping[str, Mapping[str, float]]) -> Prepared:
        """A copy with other parameters. No file is read or checked again; the substeps are unchanged.

        parameters: values by joint and name (a parameter of the actuator, `damping` or `friction`), or by link and name
        (`mass`; `x`, `y`, `z` of the centre of mass; `ixx` .. `izz` about the centre of mass, in the inertial frame). A start
        at equilibrium is computed again. Raises RobotError that names unknown or unphysical parameters, ScenarioError for an
        arm without equilibrium.
        """
        varied = self.with_numbers(parameters)
        if not self.scenario.initial_equilibrium:
            return varied
        engine = varied.make_engine()
        return replace(varied.settled(engine.model), _spare=[engine])

    def settled(self, model: Model | None) -> Prepared:
        """A copy that starts at equilibrium if the scenario requires it. model: model of this robot. Raises ScenarioError."""
        if model is None or not self.scenario.initial_equilibrium:
            return self
        drives = at_equilibrium(self.scenario, self.drives, model)
        return replace(self, drives=drives, initial_positions=tuple(drive.initial_position for drive in drives))

    def with_numbers(self, parameters: Mapping[str, Mapping[str, float]]) -> Prepared:
        """A copy with other parameters, as `vary` makes it, but with an unchanged start."""
        robot = varied_robot(self.robot, parameters)
        blocks = {block.joint: block for block in robot.actuators}
        joints = {joint.name: joint for joint in robot.joints}
        drives = tuple(
            replace(
                drive,
                joint=joints[drive.name],
                drive=drive_of(blocks[drive.name]) if drive.name in blocks else drive.drive,
                block=blocks.get(drive.name),
            )
            for drive in self.drives
        )
        return replace(self, robot=robot, drives=drives, _spare=[])
