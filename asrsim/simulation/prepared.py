"""A prepared scenario, from which simulations and worlds are created, and copies of it with other parameters or references."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from asrsim.engines.base import Engine
from asrsim.errors import InputError, Problem, did_you_mean
from asrsim.registry.steppings import Stepping
from asrsim.robot.dynamics import RobotModel
from asrsim.robot.model import Robot
from asrsim.robot.vary import varied_robot
from asrsim.samples import Array, RunInfo
from asrsim.scenario.data import Scenario
from asrsim.signals.base import Signal
from asrsim.simulation.drives import DELAYS, EXTERNAL_TORQUE, SteppedJoint, make_drives, with_delays, with_sensors
from asrsim.simulation.engine import make_engine
from asrsim.simulation.equilibrium import at_equilibrium
from asrsim.simulation.examine import Plan
from asrsim.simulation.inertia import masses_at_start
from asrsim.simulation.inputs import sampled_signals
from asrsim.simulation.layout import EXTERNAL, GOALS
from asrsim.simulation.start import Numbers, Signals, Start, started_joints
from asrsim.simulation.substeps import Resolution, resolution_of


@dataclass(frozen=True, kw_only=True)
class Prepared:
    """A scenario that has been read, checked and prepared. It is immutable and can serve many simulations."""

    plan: Plan = field(repr=False, compare=False)
    """The examined scenario, without planned references and without the changes of `vary` and `with_references`."""
    scenario: Scenario
    robot: Robot
    stepping: Stepping
    drives: tuple[SteppedJoint, ...]
    """The moving joints, with their drives, sensors and initial states."""
    resolution: Resolution
    info: RunInfo
    warnings: tuple[Problem, ...]
    model: RobotModel | None = field(repr=False, compare=False)
    """Kinematics and dynamics of the robot; None if the engine prescribes the motion of the links."""
    _spare: list[Engine] = field(default_factory=list, repr=False, compare=False)
    """Engine that the preparation built; the first simulation uses this engine."""
    _latest: list[tuple[object, RobotModel]] = field(default_factory=list, repr=False, compare=False)
    """Inertials of the latest variant, and the model with these inertials."""

    @property
    def initial_positions(self) -> tuple[float, ...]:
        """Initial positions of the moving joints in rad (m)."""
        return tuple(drive.initial_position for drive in self.drives)

    @property
    def initial_velocities(self) -> tuple[float, ...]:
        """Initial velocities of the moving joints in rad/s (m/s)."""
        return tuple(drive.initial_velocity for drive in self.drives)

    @property
    def substep(self) -> float:
        """Length of a substep in s."""
        return self.scenario.step / self.resolution.substeps

    def last_substep(self, duration: float | None) -> int:
        """Number of the substep at which `duration` (s; default: the scenario's duration) ends. Raises InputError if the
        duration is shorter than a step.
        """
        seconds = self.scenario.duration if duration is None else duration
        if not self.scenario.step / 2.0 < seconds < math.inf:
            raise InputError("must be at least one step", key="duration", value=seconds, code="duration")
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
        unknown names.
        """
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
        Commands have the imperfections that the scenario states, except delays.
        """
        drives = [
            replace(
                drive, command_imperfections=drive.command_imperfections and replace(drive.command_imperfections, delay=0.0)
            )
            for drive in self.drives
        ]
        return sampled_signals(self.scenario, drives, time)

    def started(self, start: Start) -> Prepared:
        """A copy with the positions, velocities and motors of `start`. Raises InputError for wrong names and values."""
        drives = started_joints(self.drives, start)
        return self if drives is self.drives else replace(self, drives=drives)

    def with_references(self, signals: Signals) -> Prepared:
        """A copy with other signals, given by joint and by the name of the reference or `external_torque`. No file is read
        again; the substeps are unchanged. An initial state at equilibrium is computed again.

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
        `sensor_delay` in s, at most the delays in the scenario's `imperfections`), or by link and name (`mass`; `x`, `y`, `z`
        of the centre of mass; `ixx` .. `izz` about the centre of mass, in the inertial frame). A start at equilibrium is
        computed again. Raises RobotError, which names unknown or unphysical parameters; InputError for wrong delays;
        ScenarioError for an arm without equilibrium.
        """
        delays = {
            drive.name: {name: own[name] for name in DELAYS if name in own}
            for drive in self.drives
            if (own := parameters.get(drive.name))
        }
        numbers = {
            owner: {name: value for name, value in own.items() if name not in delays.get(owner, ())}
            for owner, own in parameters.items()
        }
        robot, model = varied_robot(self.robot, numbers), self.model
        drives = with_sensors(make_drives(robot, self.stepping, self.scenario), self.scenario, self.substep)
        drives = tuple(with_delays(drive, delays.get(drive.name, {})) for drive in drives)
        if model is not None and robot.inertials != self.robot.inertials:
            model = self._model_of(model, robot, drives)
        return replace(self, robot=robot, drives=drives, model=model, _spare=[])._settled()

    def _model_of(self, model: RobotModel, robot: Robot, drives: Sequence[SteppedJoint]) -> RobotModel:
        """Model of a varied robot. The latest model is kept, since many variants have equal inertials. Raises RobotError."""
        for inertials, known in self._latest:
            if inertials == robot.inertials:
                return known
        varied = model.varied(robot)
        masses_at_start(drives, varied)
        self._latest[:] = [(robot.inertials, varied)]
        return varied

    def _settled(self) -> Prepared:
        """A copy that starts at equilibrium if the scenario requires it. Raises ScenarioError."""
        if self.model is None or not self.scenario.initial_equilibrium:
            return self
        return replace(self, drives=at_equilibrium(self.scenario, self.drives, self.model))
