"""A twin beside a robot: a simulation that gets the robot's commands and is pulled onto its measured positions."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import DivergenceError, InputError, did_you_mean
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.scenario.overrides import Overrides
from asrsim.simulation.prepare import prepare
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.quantities import EXTERNAL_TORQUE
from asrsim.simulation.simulation import Simulation
from asrsim.twin.mismatch import Mismatch
from asrsim.twin.observer import Observer

SIGMAS = 6.0
"""Alarm threshold for noise of the torque, in standard deviations."""
TOLERANCE, UNLEARNED = 0.08, 0.6
"""Alarm threshold for errors of the model, as a fraction of the springs' largest recent torque: after the mismatch of the model
was estimated, and before.
"""
FRICTION = 0.5
"""Alarm threshold for errors of the friction, as a fraction of the friction."""
RELEASE = 0.7
"""An alarm ends when the torque falls below this fraction of the alarm threshold."""
PEAK_MEMORY, NOISE_MEMORY = 0.5, 1.0
"""Time constants of the largest spring torque and of the noise variance, s."""
SETTLE = 0.5
"""Duration after a start in which no alarms are raised, s."""
REFRESH = 0.02
"""Interval between updates of the mass matrix, s."""
JUMP = 0.25
"""Distance between a joint's positions in robot and twin above which the twin is set to the robot's positions, rad (m)."""
EVERY = 0.01
"""Interval between rows of the mismatch regression, s."""
KNOWN = 0.04
"""Largest relative standard error of a stiffness that is reported."""
LONGEST_GAP = 0.03
"""Time without a measurement above which the twin is set to the next measured position, s."""
MISSING = 0.1
"""Time without a measurement after which a note is given, s."""
CHUNK = 32
"""Number of steps whose inputs are prepared together."""
TINY = 1e-12
"""Small torque (N m) or stiffness (N m/rad) that avoids a division by zero."""
REPEAT = 1.0
"""Shortest time between two notes with equal text, s."""


@dataclass(frozen=True, kw_only=True)
class TwinStep:
    """Estimates of a twin after a measurement; arrays (n,) have an element for each joint, in the order of the
    twin's joints.
    """

    time: float
    """Time since the first step, s."""
    external_torque: Array
    """External torque on the link, N m; NaN if no position is measured."""
    stiffness: Array
    """Present stiffness of the robot's joint, N m/rad; NaN if the stiffness cannot be estimated from the motion."""
    residual: Array
    """Measured position minus the twin's position, rad."""
    threshold: Array
    """External torque above which an alarm is raised, N m."""
    alarm: NDArray[np.bool_]
    """Whether an alarm is raised: an object touches the link, or the robot differs from its model."""
    notes: tuple[str, ...] = ()
    """Messages about faults of this step, after which the twin continues."""


class Twin:
    """Twin of a robot that a scenario describes; a context manager.

        with asrsim.Twin("lab.yaml", bandwidth=8) as twin:
            found = twin.step({"joint_1": position}, {"joint_1": {"equilibrium_position": goal}})
            found.external_torque, found.alarm

    A step lasts as long as the scenario's `step:`, which must be the sampling time of the measurements. References without
    commands follow the scenario. Raises the errors of `asrsim.prepare`, and InputError for unknown joints; wrong measurements
    raise no error.
    """

    def __init__(
        self, scenario: str | Path | Scenario | Prepared, *, bandwidth: float = 8.0, variant: str | None = None,
        overrides: Overrides = (), compiled: bool | None = None,
    ) -> None:  # fmt: skip
        """bandwidth: bandwidth of the observer, Hz, at most a twentieth of the rate of steps; variant, overrides: as for
        `asrsim.prepare`; compiled: as for `asrsim.Simulation`."""
        ready = scenario if isinstance(scenario, Prepared) else prepare(scenario, variant=variant, overrides=overrides)
        # The observer's torque must not be clipped to a declared range of external torques.
        ranges = {joint: {k: v for k, v in own.items() if k != EXTERNAL_TORQUE} for joint, own in ready.ranges.items()}
        ready = replace(ready, ranges=ranges)
        self._step = ready.scenario.step
        if not 0.0 < bandwidth <= 0.05 / self._step:
            message = f"must be above 0 and at most a twentieth of the rate of steps, {0.05 / self._step:g} Hz"
            raise InputError(message, key="bandwidth", value=bandwidth, code="bandwidth")
        self.simulation = Simulation(
            ready, compiled=compiled, expected_substeps=10**7, duration=1e7, chunk=CHUNK * ready.resolution.substeps
        )
        if (model := self.simulation.model) is None:
            self.close()
            engine = ready.scenario.engine
            raise InputError("has no dynamics, so it cannot simulate a twin", key="engine", value=engine, code="twin-engine")
        self._model = model
        self.joints, self._drives = self.simulation.joints, ready.drives
        n = len(self.joints)
        known = self.simulation.recording.selection.names
        self._springs = [name for name in known if name.startswith("elastic_torque_")]
        self._read = [*self._springs, *(name for name in known if name == "stiffness")]
        """Names of the quantities that each step reads from the simulation."""
        self._effort = np.array([drive.joint.most_effort for drive in ready.drives])
        self._friction = FRICTION * np.array(
            [drive.joint.friction + sum(drive.drive.motor_friction if drive.drive else ()) for drive in ready.drives]
        )
        self._observer = Observer(n, step=self._step, bandwidth=bandwidth)
        motors = np.zeros((3, len(self._springs), n))
        motors[0] = np.inf
        for j, drive in enumerate(ready.drives):
            if (own := drive.drive) is not None:
                for row, values in zip(motors, (own.motor_inertia, own.motor_damping, own.proportional), strict=True):
                    row[: len(values), j] = values[: len(self._springs)]
                motors[1, : len(own.derivative), j] += own.derivative[: len(self._springs)]
        self._mismatch = Mismatch(motors, step=self._step, bandwidth=bandwidth, interval=EVERY)
        self._refresh, self._every = (max(1, round(seconds / self._step)) for seconds in (REFRESH, EVERY))
        self._state = self.simulation.observe()
        self._stiffness, self._stiffness_factor = np.full(n, np.nan), np.full(n, np.nan)
        self._masses, self._peak, self._variance = np.eye(n), np.zeros(n), np.zeros(n)
        self._alarm, self._missing = np.zeros(n, dtype=bool), np.zeros(n, dtype=np.int64)
        self._before = np.full((2, n), np.nan)
        """Positions that were measured in the last two steps."""
        self._commands: dict[tuple[str, str], float] = {}
        """Commands that are in effect, by joint and reference."""
        self._steps = self._settled = 0
        self._noted: dict[str, int] = {}
        """Step of the last occurrence of each note, by the note's text without numbers."""

    def step(self, measured: Mapping[str, float] | Sequence[float] | Array, commands: Mapping[str, Any]) -> TwinStep:
        """Simulate one step and return the estimates after the step.

        measured: positions of links in rad (m), by joint or all in order; a joint without a finite position is not corrected.
        commands: by joint, the value of the first reference from now on, or values by name of the reference.
        """
        notes: list[str] = []
        positions = self._positions(measured)
        for joint, given in commands.items():
            values = given if isinstance(given, Mapping) else {self._first_reference(joint): given}
            for reference, value in values.items():
                self._command(joint, reference, value, notes)
        lost = self._missing * self._step > LONGEST_GAP
        if self._steps == 0 or (lost & np.isfinite(positions)).any():
            self._place(positions)
        self._state = self.simulation.observe()
        error = self._difference(positions, notes)
        self._measure_noise(positions, notes)
        torque = self._pull(error)
        try:
            self.simulation.advance()
        except DivergenceError as problem:
            self._note(f"the twin diverged and was set to the robot's position ({problem})", notes)
            self._place(positions)
        found = self._estimate(error, torque, notes)
        self._steps += 1
        return found

    def _positions(self, measured: Mapping[str, float] | Sequence[float] | Array) -> Array:
        if not isinstance(measured, Mapping):
            positions = np.array(measured, dtype=float)
            if positions.shape != (len(self.joints),):
                message = f"must be {len(self.joints)} positions, of {', '.join(self.joints)}"
                raise InputError(message, key="measured", value=positions.shape, code="twin-measured")
            return positions
        for name in measured:
            if name not in self.joints:
                hint = did_you_mean(name, self.joints)
                raise InputError(f"no joint is called '{name}'", choices=self.joints, hint=hint, code="unknown-joint")
        return np.array([measured.get(name, math.nan) for name in self.joints], dtype=float)

    def _command(self, joint: str, reference: str, value: float, notes: list[str]) -> None:
        if not isinstance(value, int | float | np.number) or isinstance(value, bool):
            raise InputError("must be a number", key=f"commands.{joint}.{reference}", value=value, code="twin-command")
        if self._commands.get((joint, reference)) == value:
            return
        if math.isfinite(value):
            self.simulation.set_reference(joint, reference, float(value))
            self._commands[joint, reference] = float(value)
        else:
            self._note(f"{joint}: the command {reference} is not finite: the last command stays in effect", notes)

    def _first_reference(self, joint: str) -> str:
        """Name of a joint's first reference. Raises InputError for an unknown joint, or a joint without references."""
        mode = next((drive.mode for drive in self._drives if drive.name == joint), None)
        if mode is None:
            raise InputError(f"no joint '{joint}' takes commands", choices=self.joints, code="unknown-joint")
        return mode.references[0]

    def _place(self, positions: Array) -> None:
        """Set the twin's links to their measured positions, at rest, and its motors to their commanded positions."""
        simulation, drives = self.simulation, self._drives
        links = {
            drive.name: float(np.clip(q, *drive.joint.stops)) for drive, q in zip(drives, positions, strict=True) if q == q
        }
        self._reset(links)
        names = [name for name in simulation.recording.selection.names if name.startswith("reference_")]
        references = simulation.read(names)
        motors = {}
        for j, drive in enumerate(drives):
            if drive.drive is not None and drive.drive.mode.motor and drive.drive.mode.controller:
                own = np.nan_to_num([references[name][j] for name in names])
                goals = drive.goals(np.array([*own, 0.0, 0.0])[: max(2, len(own)), None])
                motors[drive.name] = goals[: drive.dynamic_motors, 0].tolist()
        self._reset(links, motors=motors)
        self._observer.restart()
        self._state = simulation.observe()
        self._settled = self._steps + round(SETTLE / self._step)

    def _reset(self, links: Mapping[str, float], **motors: Any) -> None:
        self.simulation.reset(links, **motors)
        for (joint, reference), value in self._commands.items():
            self.simulation.set_reference(joint, reference, value)

    def _difference(self, positions: Array, notes: list[str]) -> Array:
        """Measured positions minus the twin's positions (n,). If the distance exceeds `JUMP`, the twin is set to the robot's
        positions.
        """
        error = positions - self._state.link_position
        if (np.abs(error) > JUMP).any():
            for joint, distance in zip(self.joints, error, strict=True):
                if abs(distance) > JUMP:
                    why = "another robot, a motor that is off, or a wrong command?"
                    text = f"the robot is {distance:+.2g} from its twin ({why}): the twin is set to the robot's position"
                    self._note(f"{joint}: {text}", notes)
            self._place(positions)
            error = positions - self._state.link_position
        return error

    def _pull(self, error: Array) -> Array:
        """Apply the torques that reduce the differences; return the torques that the model lacks (n,), N m."""
        if self._steps % self._refresh == 0:
            self._masses = self._model.mass_matrix(self._state.link_position)
        torque = self._observer.update(error, self._masses, self._effort)
        for joint, value in zip(self.joints, torque.tolist(), strict=True):
            self.simulation.set_reference(joint, EXTERNAL_TORQUE, value)
        # The deflections of the springs in twin and robot differ by the difference of the link positions.
        pull = self._stiffness * error
        return np.where(pull == pull, torque + pull, torque)

    def _measure_noise(self, positions: Array, notes: list[str]) -> None:
        """Update the noise variance of the measurements, and note missing measurements."""
        bend = positions - 2.0 * self._before[1] + self._before[0]
        # The second difference of white noise has six times the variance of the noise.
        change = self._step / NOISE_MEMORY * (bend * bend / 6.0 - self._variance)
        self._variance += np.where(change == change, change, 0.0)
        self._before[0], self._before[1] = self._before[1], positions
        self._missing = (self._missing + 1) * (positions != positions)
        if self._missing.any():
            for joint in np.flatnonzero(self._missing * self._step > MISSING).tolist():
                self._note(f"{self.joints[joint]}: no position is measured, so its twin is not corrected", notes)

    def _estimate(self, error: Array, torque: Array, notes: list[str]) -> TwinStep:
        read, state = self.simulation.read(self._read), self._state
        springs = _zero_if_missing(np.array([read[name] for name in self._springs]).reshape(-1, len(self.joints)))
        spring, sizes = springs.sum(axis=0), np.abs(springs)
        self._stiffness = read.get("stiffness", self._stiffness)
        # The joint stiffness is divided among the springs in proportion to their torques, since torque stiffens a spring.
        stiffness = _zero_if_missing(self._stiffness * sizes / (sizes.sum(axis=0) + TINY))
        motors = np.zeros_like(springs)
        for row, velocity in zip(motors, (state.motor_1_velocity, state.motor_2_velocity), strict=False):
            row[:] = _zero_if_missing(velocity)
        self._mismatch.take(torque, springs, stiffness, state.link_velocity, motors)
        slow, fast = self._mismatch.external()
        self._peak = np.maximum(np.abs(spring), self._peak * (1.0 - self._step / PEAK_MEMORY))
        noise = self._observer.noise_gain * np.sqrt(self._masses**2 @ self._variance)
        tolerance = np.where(self._mismatch.learned, TOLERANCE, UNLEARNED)
        # Noise and errors of the model are independent, so their thresholds are added as root sum of squares.
        threshold = np.hypot(SIGMAS * noise, tolerance * self._peak + self._friction)
        measured, ready = error == error, self._steps >= self._settled
        self._alarm = (np.abs(fast) > threshold * np.where(self._alarm, RELEASE, 1.0)) & ready
        if self._steps % self._every == 0:
            self._mismatch.learn(~self._alarm & measured & ready)
            known = self._mismatch.deviation < KNOWN
            self._stiffness_factor = np.where(known, 1.0 + self._mismatch.spring, np.nan)
        return TwinStep(
            time=round(self._steps * self._step, 9), external_torque=np.where(measured, slow, np.nan),
            stiffness=self._stiffness * self._stiffness_factor, residual=error, threshold=threshold, alarm=self._alarm,
            notes=tuple(notes),
        )  # fmt: skip

    def _note(self, text: str, notes: list[str]) -> None:
        """Add a note, unless a note with equal text but other numbers was given within the last `REPEAT` seconds."""
        kind = re.sub(r"[-+]?[0-9][0-9.e+-]*", "", text)
        if self._steps - self._noted.get(kind, -math.inf) >= REPEAT / self._step:
            self._noted[kind] = self._steps
            notes.append(text)

    def close(self) -> None:
        """Release the simulation."""
        self.simulation.close()

    def __enter__(self) -> Twin:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


def _zero_if_missing(values: Array) -> Array:
    """Values in which 0 replaces NaN; several times faster than `numpy.nan_to_num`."""
    return np.where(values == values, values, 0.0)
