"""A twin of a running robot: a simulation that receives the robot's commands and is pulled towards the measured positions."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asrsim.compiled.compiling import compile_function
from asrsim.errors import InputError
from asrsim.robot.chain_masses import find_masses
from asrsim.samples import Array
from asrsim.scenario.overrides import Overrides
from asrsim.simulation.prepare import ScenarioLike, prepare_worlds
from asrsim.simulation.start import Start
from asrsim.simulation.worlds import Worlds
from asrsim.twin.loops import JUMPED, LOST, MISSING, AlarmLimits, JointWatch, TwinLoops, compiled_loops, tables
from asrsim.twin.mismatch import COLUMNS, SHARE, SLOWEST, mismatch_of, varied
from asrsim.twin.observer import filter_shares, gains_of, noise_gain

SIGMAS = 6.0
"""Alarm threshold for noise, as a multiple of the standard deviation of the observed torque due to noise."""
TOLERANCE, UNLEARNED = 0.08, 0.6
"""Alarm thresholds for errors of the model, as fractions of the springs' largest recent torque. UNLEARNED applies until these
errors have been estimated, and TOLERANCE applies afterwards.
"""
FRICTION, STICKING = 0.5, 2.0
"""Alarm thresholds for errors of the friction, as multiples of the friction. FRICTION applies in motion. STICKING applies at
rest, since the friction torques of the robot and the twin may then have opposite signs.
"""
RELEASE = 0.7
"""An alarm ends when the torque is at or below this fraction of the alarm threshold."""
PEAK_MEMORY, NOISE_MEMORY = 0.5, 1.0
"""PEAK_MEMORY: time constant with which the springs' largest recent torque decays, s.
NOISE_MEMORY: time constant of the average for the noise variance, s.
"""
SETTLE = 0.5
"""Time without alarms after the twin was set to the robot's positions, s."""
JUMP = 0.25
"""The twin is set to the robot's positions if a joint's positions in robot and twin differ by more than this value, rad (m)."""
EVERY = 0.01
"""Interval between two rows of the regression (`asrsim.twin.mismatch`), and between two updates of the mass matrix, s."""
LONGEST_GAP = 0.03
"""If the position of a joint was not measured for longer than this time, the twin is set to the next measured positions, s."""
MISSING_NOTED = 0.1
"""If the position of a joint is not measured for longer than this time, the user gets a note, s."""
EXPECTED = 10**7
"""Assumed number of substeps of a run of unknown length. It is so large that compilation saves time."""
REPEAT = 1.0
"""Shortest time between two notes with equal texts except for numbers, s."""

NUMBERS = (int, float, np.number)
"""Types of numbers that a command may have."""

Commands = Mapping[str, Mapping[str, float]]
"""Commanded values of references, by joint and by name of the reference."""


@dataclass(frozen=True, kw_only=True)
class TwinStep:
    """Estimates of a twin after a step. Arrays (n,) have an element for each joint, in the order of the twin's joints. Units in
    brackets apply to prismatic joints.
    """

    time: float
    """Time since the first step, s."""
    external_torque: Array
    """External torque on the link, N m (N); NaN if no position is measured."""
    stiffness: Array
    """Present stiffness of the robot's joint, N m/rad (N/m); NaN if the stiffness cannot be estimated from the motion."""
    residual: Array
    """Measured position minus the twin's position, rad (m)."""
    threshold: Array
    """Alarm threshold of the external torque, N m (N)."""
    alarm: NDArray[np.bool_]
    """Whether the joint has an alarm. Then an object touches the link, or the robot differs from its model."""
    notes: tuple[str, ...] = ()
    """Messages about faults in this step. The twin continues in spite of them."""


class Twin:
    """Twin of a robot that a scenario describes. It is a context manager.

        with asrsim.Twin("lab.yaml", bandwidth=8) as twin:
            found = twin.step({"joint_1": position}, {"joint_1": {"equilibrium_position": goal}})
            found.external_torque, found.alarm

    The duration of a step is the scenario's `step:`. It must be equal to the sampling interval of the measurements. References
    without commands follow the scenario's signals. Raises the errors of `asrsim.prepare`, and InputError for unknown joints.
    Implausible measured positions cause notes (`TwinStep.notes`) and no errors.
    """

    def __init__(
        self,
        scenario: ScenarioLike,
        *,
        bandwidth: float = 8.0,
        variant: str | None = None,
        overrides: Overrides = (),
        plugins: Sequence[str | Path] = (),
        compiled: bool | None = None,
    ) -> None:
        """bandwidth: bandwidth of the observer, Hz, at most a twentieth of the number of steps per second; variant, overrides,
        plugins: as for `asrsim.prepare`; compiled: as for `asrsim.Simulation`.
        """
        ready = prepare_worlds(scenario, variant=variant, overrides=overrides, plugins=plugins)
        step = self._step = ready.scenario.step
        if not 0.0 < bandwidth <= 0.05 / step:
            message = f"must be above 0 and at most a twentieth of the rate of steps, {0.05 / step:g} Hz"
            raise InputError(message, key="bandwidth", value=bandwidth, code="bandwidth")
        self._starts = [Start(), *(Start(parameters=parameters) for parameters in varied(ready))]
        self.worlds = Worlds(ready, len(self._starts), compiled=compiled, expected_substeps=EXPECTED)
        """Simulated worlds. The first is the twin, and the others are its copies with other parameters."""
        if (model := self.worlds.model) is None:
            self.close()
            engine = ready.scenario.engine
            raise InputError("has no dynamics, so it cannot simulate a twin", key="engine", value=engine, code="twin-engine")
        self._model = model
        self.joints, self._drives = self.worlds.joints, ready.drives
        n = len(self.joints)
        place = self.worlds.columns.place
        motors = range(1, 1 + max(drive.motors for drive in ready.drives))
        self._springs = np.array(
            [[place.get(f"elastic_torque_{i}", -1) if i <= own.pulling else -1 for i in motors] for own in ready.drives],
            dtype=np.int64,
        )
        self._stiffness = place.get("stiffness", -1)
        self._friction = np.array(
            [drive.joint.friction + sum(drive.drive.motor_friction if drive.drive else ()) for drive in ready.drives]
        )
        self._coupled = np.array([drive.name in ready.robot.followers for drive in ready.drives])
        self._stops = np.array([drive.joint.stops for drive in ready.drives]).T.copy()
        self._watch = JointWatch(share=step / NOISE_MEMORY, step=step, gap=LONGEST_GAP, jump=JUMP)
        self._gains, self._shares = gains_of(step, bandwidth), np.append(filter_shares(step, bandwidth), SHARE)
        self._limits = AlarmLimits(
            forgotten=step / PEAK_MEMORY,
            noise_gain=noise_gain(step, bandwidth),
            sigmas=SIGMAS,
            release=RELEASE,
            slowest=SLOWEST,
            tolerance=TOLERANCE,
            unlearned=UNLEARNED,
            friction=FRICTION,
            sticking=STICKING,
        )
        self._tables = tables(len(self._starts), n, COLUMNS)
        self._mismatch, self._loops, self._chain = mismatch_of(n, EVERY), TwinLoops(), None
        self._find_masses: Any = None
        if self.worlds.compiled:
            self._loops = compiled_loops(self._tables, self._mismatch, self._watch, self._gains, self._limits)
            self._chain = model.chain()
        if self._chain is not None:
            self._find_masses = compile_function(find_masses, (self._chain, np.zeros(1), np.zeros((1, 1))))
        self._every = max(1, round(EVERY / step))
        self._alarm, self._external = np.zeros(n, dtype=bool), np.zeros((2, n))
        self._commands: dict[tuple[str, str], float] = {}
        """Last finite command of each joint and reference. It stays in effect until the next command."""
        self._steps = self._settled = 0
        self._noted: dict[str, int] = {}
        """Number of the step in which each note was last given, by the note's text without numbers."""

    def step(self, measured: Mapping[str, float] | Sequence[float] | Array, commands: Commands) -> TwinStep:
        """Simulate one step and return the estimates after the step.

        measured: positions of the links, rad (m), either by joint or all in the order of `joints`; the twin of a joint without
        a finite position is not corrected. commands: new values of references, by joint and by name of the reference; they stay
        in effect until the next command.
        """
        notes: list[str] = []
        positions = self._positions(measured)
        for joint, given in commands.items():
            if not isinstance(given, Mapping) or not all(isinstance(value, NUMBERS) for value in given.values()):
                message = "must be numbers by name of the reference"
                raise InputError(message, key=f"commands.{joint}", value=given, code="twin-command")
            for reference, value in given.items():
                if self._commands.get((joint, reference)) != value:
                    self._command(joint, reference, value, notes)
        links, velocities = self.worlds.links()
        error = np.empty(links.shape)
        compare, t = self._loops.compare, self._tables
        seen = compare(t, self._watch, positions, links, self._coupled, self._stops, error)
        if seen & MISSING:
            self._note_missing(notes)
        begins = self._steps == 0 or seen & LOST
        if begins or seen & JUMPED:
            self._note_jumps([] if begins else error[0].tolist(), notes)
            self._place(positions)
            links, velocities = self.worlds.links()
            error = positions - links
        if self._steps % self._every == 0:
            self._update_masses(links[0])
        self._loops.pull(t, self._gains, error, velocities[0], self._mismatch.found, self._shares, self._external)
        self.worlds.push(t.torques)
        self.worlds.advance()
        if not all(self.worlds.healthy.tolist()):
            self._note("the twin diverged: it is set to the robot's position", notes)
            self._place(positions)
        found = self._estimate(error[0], notes)
        self._steps += 1
        return found

    def _update_masses(self, positions: Array) -> None:
        """Compute the mass matrix at the twin's positions (n,)."""
        if self._chain is None:
            self._tables.masses[:] = self._model.mass_matrix(positions)
        else:
            self._find_masses(self._chain, positions, self._tables.masses)

    def _positions(self, measured: Mapping[str, float] | Sequence[float] | Array) -> Array:
        unknown: list[str] = []
        if isinstance(measured, Mapping):
            unknown = [name for name in measured if name not in self.joints]
            measured = [measured.get(name, math.nan) for name in self.joints]
        wrong: object = unknown
        if not unknown:
            try:
                positions = np.array(measured, dtype=float)
                if positions.shape == (len(self.joints),):
                    return positions
                wrong = positions.shape
            except (TypeError, ValueError):
                wrong = measured
        message = f"must be {len(self.joints)} positions, of {', '.join(self.joints)}"
        raise InputError(message, key="measured", value=wrong, code="twin-measured")

    def _command(self, joint: str, reference: str, value: float, notes: list[str]) -> None:
        if math.isfinite(value):
            self.worlds.set_reference(joint, reference, float(value))
            self._commands[joint, reference] = float(value)
        else:
            self._note(f"{joint}: the command {reference} is not finite: the last command stays in effect", notes)

    def _place(self, positions: Array) -> None:
        """Set the links of the twin to their measured positions at rest, and its motors to their commanded positions."""
        names = [name for name in self.worlds.names if name.startswith("reference_")]
        references = self.worlds.read(names)
        links, motors = {}, {}
        for j, (drive, position) in enumerate(zip(self._drives, positions.tolist(), strict=True)):
            if math.isfinite(position):
                links[drive.name] = position
            if drive.drive is not None and drive.drive.mode.motor and drive.drive.mode.controller:
                own = np.nan_to_num([*(values[0, j] for values in references.values()), 0.0])
                motors[drive.name] = drive.goals(own[:, None])[: drive.dynamic_motors, 0].tolist()
        self.worlds.reset([replace(start, positions=links, motors=motors) for start in self._starts])
        for (joint, reference), value in self._commands.items():
            self.worlds.set_reference(joint, reference, value)
        self._tables.integral[:] = self._tables.lagged[:] = 0.0
        self._settled = self._steps + round(SETTLE / self._step)

    def _note_missing(self, notes: list[str]) -> None:
        """Add a note for each joint whose position has not been measured for longer than `MISSING_NOTED`."""
        for joint in np.flatnonzero(self._tables.missing * self._step > MISSING_NOTED).tolist():
            self._note(f"{self.joints[joint]}: no position is measured, so the twin of this joint is not corrected", notes)

    def _note_jumps(self, distances: list[float], notes: list[str]) -> None:
        """Add a note for each joint that is farther than `JUMP` from its twin.

        distances: positions of the robot minus positions of the twin, rad (m); empty if the twin begins or a joint is measured
        again.
        """
        for joint, distance in zip(self.joints, distances, strict=False):
            if abs(distance) > JUMP:
                why = "another robot, a motor that is off, or a wrong command?"
                text = f"the robot is {distance:+.2g} from its twin ({why}): the twin is set to the robot's position"
                self._note(f"{joint}: {text}", notes)

    def _estimate(self, error: Array, notes: list[str]) -> TwinStep:
        """Estimates after a step, from the external torques that `pull` computed. error: position errors (n,) of the twin, rad
        (m).
        """
        own, mismatch, ready = self._tables, self._mismatch, self._steps >= self._settled
        found, alarm = np.empty((2, len(error))), self._alarm.copy()
        rows = self.worlds.latest()
        too_noisy = self._loops.judge(
            own, self._limits, rows, self._springs, self._stiffness, mismatch.learned, self._friction, self._external, ready,
            error, alarm, found,
        )  # fmt: skip
        self._alarm = alarm
        if too_noisy:
            self._note_noise(notes)
        if ready and self._steps % self._every == 0:
            self._loops.learn(mismatch, own.rows[0], error, alarm)
        return TwinStep(
            time=round(self._steps * self._step, 9),
            external_torque=found[0],
            stiffness=own.stiffness * mismatch.stiffening,
            residual=error,
            threshold=found[1],
            alarm=alarm,
            notes=tuple(notes),
        )

    def _note_noise(self, notes: list[str]) -> None:
        """Add a note for each joint whose alarm threshold for noise alone exceeds the largest torque of its springs so far."""
        threshold = SIGMAS * self._tables.noise
        for j in np.flatnonzero((threshold > self._tables.carried) & self._mismatch.learned).tolist():
            noise = 1e3 * math.sqrt(self._tables.variance[j])
            self._note(
                f"{self.joints[j]}: noise of {noise:.2g} mrad (mm) at {1.0 / self._step:.4g} Hz raises the alarm threshold "
                f"to {threshold[j]:.3g}, above the largest torque of its springs so far, {self._tables.carried[j]:.3g}; choose "
                "a smaller bandwidth, or measure more often",
                notes,
            )

    def _note(self, text: str, notes: list[str]) -> None:
        """Add a note, unless a note with the same text except for numbers was given in the last `REPEAT` seconds."""
        kind = re.sub(r"[-+]?[0-9][0-9.e+-]*", "", text)
        if self._steps - self._noted.get(kind, -math.inf) >= REPEAT / self._step:
            self._noted[kind] = self._steps
            notes.append(text)

    def close(self) -> None:
        """Close the simulations of the twin and of its copies."""
        self.worlds.close()

    def __enter__(self) -> Twin:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
