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
from asrsim.simulation.prepared import EXTERNAL_TORQUE, Prepared
from asrsim.simulation.simulation import Simulation
from asrsim.twin.mismatch import Mismatch
from asrsim.twin.observer import Observer

SIGMAS = 6.0
"""Deviations of the noise that an alarm is above."""
TOLERANCE, UNLEARNED = 0.15, 0.3
"""Share of the springs' largest recent torque by which the model may be wrong without an alarm; before its error is known."""
FRICTION = 0.5
"""Share of the friction, likewise."""
RELEASE = 0.7
"""Of the threshold, below which an alarm ends."""
HOLD, NOISE = 0.5, 1.0
"""s in which the largest torque, and what is known of the noise, are forgotten."""
SETTLE = 0.5
"""s after a start in which there is no alarm."""
REFRESH = 0.02
"""s between mass matrices."""
JUMP = 0.25
"""rad (m) between robot and twin, from which on the twin is put where the robot is."""
EVERY = 0.01
"""s between rows of the regression of what the twin has wrong."""
KNOWN = 0.04
"""Standard error of the stiffness, as a share, up to which it is known."""
MISSING = 0.1
"""s without a measurement that are told."""
CHUNK = 32
"""Steps that are prepared at once."""
AGAIN = 1.0
"""s until the same note is given again."""


@dataclass(frozen=True, kw_only=True)
class TwinStep:
    """What a twin knows after a measurement; arrays are (n,) in the order of its joints."""

    time: float
    """s since the first step."""
    external_torque: Array
    """N m that act on the link and that the model does not have; NaN where nothing is measured."""
    stiffness: Array
    """N m/rad of the robot's joint now; NaN where its motion does not show it."""
    residual: Array
    """rad, measured position minus that of the twin."""
    threshold: Array
    """N m, from which on there is an alarm."""
    alarm: NDArray[np.bool_]
    """Whether something touches the link, or the robot is no longer the modelled one."""
    notes: tuple[str, ...] = ()
    """What went wrong in this step, in words; the twin goes on."""


class Twin:
    """A scenario as the twin of a robot; a context manager.

        with asrsim.Twin("lab.yaml", bandwidth=8) as twin:
            found = twin.step({"joint_1": position}, {"joint_1": {"equilibrium_position": goal}})
            found.external_torque, found.alarm

    A step is the scenario's (`step:`), and must be that of the measurements. References that no command sets follow the
    scenario. Raises what :func:`asrsim.prepare` raises, and InputError for unknown joints; bad measurements raise nothing.
    """

    def __init__(
        self, scenario: str | Path | Scenario | Prepared, *, bandwidth: float = 8.0, variant: str | None = None,
        overrides: Overrides = (), compiled: bool | None = None,
    ) -> None:  # fmt: skip
        """bandwidth: Hz of the observer, at most a twentieth of the rate of steps; variant, overrides: as of
        :func:`asrsim.prepare`; compiled: as of :class:`asrsim.Simulation`."""
        ready = scenario if isinstance(scenario, Prepared) else prepare(scenario, variant=variant, overrides=overrides)
        # The observer's torque knows no declared range.
        ranges = {joint: {k: v for k, v in own.items() if k != EXTERNAL_TORQUE} for joint, own in ready.ranges.items()}
        ready = replace(ready, ranges=ranges)
        self._step = ready.scenario.step
        if not 0.0 < bandwidth <= 0.05 / self._step:
            message = f"must be above 0 and at most a twentieth of the rate of steps, {0.05 / self._step:g} Hz"
            raise InputError(message, key="bandwidth", value=bandwidth, code="bandwidth")
        self._simulation = Simulation(
            ready, compiled=compiled, expected_substeps=10**7, duration=1e7, chunk=CHUNK * ready.resolution.substeps
        )
        if (model := self._simulation.model) is None:
            self.close()
            engine = ready.scenario.engine
            raise InputError("has no dynamics, and makes no twin", key="engine", value=engine, code="twin-engine")
        self._model = model
        self.joints, self._drives = self._simulation.joints, ready.drives
        known, n = self._simulation.recording.selection.names, len(self.joints)
        self._springs = [name for name in known if name.startswith("elastic_torque_")]
        self._references = [name for name in known if name.startswith("reference_")]
        self._names = [*self._springs, *(name for name in known if name == "stiffness")]
        self._most = np.array([drive.joint.most_effort for drive in ready.drives])
        self._friction = FRICTION * np.array(
            [drive.joint.friction + sum(drive.drive.motor_friction if drive.drive else ()) for drive in ready.drives]
        )
        self._observer = Observer(n, step=self._step, bandwidth=bandwidth)
        self._mismatch = Mismatch(n, step=self._step, bandwidth=bandwidth, interval=EVERY)
        self._hold_gain = np.array([sum(drive.drive.proportional) if drive.drive else 0.0 for drive in ready.drives])
        self._refresh, self._every = (max(1, round(seconds / self._step)) for seconds in (REFRESH, EVERY))
        self._state = self._simulation.observe()
        self._stiffness, self._known = np.full(n, np.nan), np.full(n, np.nan)
        self._masses, self._peak, self._variance = np.eye(n), np.zeros(n), np.zeros(n)
        self._alarm, self._missing = np.zeros(n, dtype=bool), np.zeros(n, dtype=np.int64)
        self._before = np.full((2, n), np.nan)
        """Positions measured in the last two steps."""
        self._held: dict[tuple[str, str], float] = {}
        """Commands that hold."""
        self._steps = self._settled = 0
        self._said: dict[str, int] = {}
        """Note -> step at which it was given last."""

    def step(self, measured: Mapping[str, float] | Sequence[float] | Array, commands: Mapping[str, Any]) -> TwinStep:
        """One step on.

        measured: positions of links in rad (m), by joint or all in order; what is missing or not finite is not pulled.
        commands: joint -> what its first reference is from now on, or name of a reference -> value.
        """
        notes: list[str] = []
        positions = self._positions(measured)
        self._command(commands, notes)
        if self._steps == 0:
            self._place(positions)
        self._state = self._simulation.observe()
        error = self._difference(positions, notes)
        self._look(positions, notes)
        torque = self._pull(error)
        try:
            self._simulation.advance()
        except DivergenceError as problem:
            self._note(f"the twin diverged: it is put where the robot is ({problem})", notes)
            self._place(positions)
        found = self._found(error, torque, notes)
        self._steps += 1
        return found

    def _positions(self, measured: Mapping[str, float] | Sequence[float] | Array) -> Array:
        if not isinstance(measured, Mapping):
            positions = np.array(measured, dtype=float)
            if positions.shape != (len(self.joints),):
                message = f"are {len(self.joints)} positions, of {', '.join(self.joints)}"
                raise InputError(message, key="measured", value=positions.shape, code="twin-measured")
            return positions
        for name in measured:
            if name not in self.joints:
                hint = did_you_mean(name, self.joints)
                raise InputError(f"no joint is called '{name}'", choices=self.joints, hint=hint, code="unknown-joint")
        return np.array([measured.get(name, math.nan) for name in self.joints], dtype=float)

    def _command(self, commands: Mapping[str, Any], notes: list[str]) -> None:
        for joint, given in commands.items():
            values = given if isinstance(given, Mapping) else {self._first_reference(joint): given}
            for reference, value in values.items():
                if self._held.get((joint, reference)) == value:
                    continue
                if math.isfinite(value):
                    self._simulation.set_reference(joint, reference, float(value))
                    self._held[joint, reference] = float(value)
                else:
                    self._note(f"{joint}: the command {reference} is no number: the last one holds", notes)

    def _first_reference(self, joint: str) -> str:
        """Raises InputError for an unknown joint, or one without references."""
        mode = next((drive.mode for drive in self._drives if drive.name == joint), None)
        if mode is None:
            raise InputError(f"no joint '{joint}' takes commands", choices=self.joints, code="unknown-joint")
        return mode.references[0]

    def _place(self, positions: Array) -> None:
        """Put links where they are measured, at rest, and motors at their goals."""
        simulation, drives = self._simulation, self._drives
        known = {
            drive.name: float(np.clip(q, *drive.joint.stops)) for drive, q in zip(drives, positions, strict=True) if q == q
        }
        simulation.reset(known)
        self._hold()
        references = simulation.read(self._references)
        motors = {}
        for j, drive in enumerate(drives):
            if drive.drive is not None and drive.drive.mode.motor and drive.drive.mode.controller:
                own = np.nan_to_num([references[name][j] for name in self._references])
                goals = drive.goals(np.array([*own, 0.0, 0.0])[: max(2, len(own)), None])
                motors[drive.name] = goals[: drive.dynamic_motors, 0].tolist()
        simulation.reset(known, motors=motors)
        self._hold()
        self._observer.restart()
        self._state = simulation.observe()
        self._settled = self._steps + round(SETTLE / self._step)

    def _hold(self) -> None:
        for (joint, reference), value in self._held.items():
            self._simulation.set_reference(joint, reference, value)

    def _difference(self, positions: Array, notes: list[str]) -> Array:
        """(n,) measured - twin; a twin that is far off is put where the robot is."""
        error = positions - self._state.link_position
        if (np.abs(error) > JUMP).any():
            for joint, one in zip(self.joints, error, strict=True):
                if abs(one) > JUMP:
                    why = "another robot, a motor that is off, or a wrong command?"
                    self._note(f"{joint}: the robot is {one:+.2g} from its twin ({why}): the twin is put there", notes)
            self._place(positions)
            error = positions - self._state.link_position
        return error

    def _pull(self, error: Array) -> Array:
        """Set the torques that make the differences smaller; (n,) N m that the model does not have."""
        if self._steps % self._refresh == 0:
            self._masses = self._model.mass_matrix(self._state.link_position)
        torque = self._observer.update(error, self._masses, self._most)
        for joint, value in zip(self.joints, torque.tolist(), strict=True):
            self._simulation.set_reference(joint, EXTERNAL_TORQUE, value)
        # The twin's spring is not where the robot's is.
        pull = self._stiffness * error
        return np.where(pull == pull, torque + pull, torque)

    def _look(self, positions: Array, notes: list[str]) -> None:
        """Noise of the measurements, and what is missing."""
        bend = positions - 2.0 * self._before[1] + self._before[0]
        seen = np.isfinite(bend)
        # The second difference of white noise has six times its variance.
        self._variance[seen] += self._step / NOISE * (bend[seen] ** 2 / 6.0 - self._variance[seen])
        self._before = np.array([self._before[1], positions])
        lost = ~np.isfinite(positions)
        self._missing = np.where(lost, self._missing + 1, 0)
        for joint in np.flatnonzero(self._missing * self._step > MISSING).tolist():
            self._note(f"{self.joints[joint]}: no position is measured: its twin runs free", notes)

    def _found(self, error: Array, torque: Array, notes: list[str]) -> TwinStep:
        read, state = self._simulation.read(self._names), self._state
        spring = np.zeros(len(self.joints))
        for name in self._springs:
            spring += np.where(np.isnan(read[name]), 0.0, read[name])
        self._stiffness = read.get("stiffness", self._stiffness)
        motor = np.where(np.isnan(state.motor_1_velocity), 0.0, state.motor_1_velocity)
        self._mismatch.take(torque, spring, state.link_velocity, motor)
        slow, fast = self._mismatch.external()
        self._peak = np.maximum(np.abs(spring), self._peak * (1.0 - self._step / HOLD))
        noise = self._observer.noise_gain * np.sqrt(self._masses**2 @ self._variance)
        tolerance = np.where(self._mismatch.learned, TOLERANCE, UNLEARNED)
        threshold = SIGMAS * noise + tolerance * self._peak + self._friction
        measured, ready = np.isfinite(error), self._steps >= self._settled
        self._alarm = (np.abs(fast) > threshold * np.where(self._alarm, RELEASE, 1.0)) & ready
        if self._steps % self._every == 0:
            self._mismatch.learn(~self._alarm & measured & ready)
            self._known = self._stiffness_known()
        return TwinStep(
            time=round(self._steps * self._step, 9), external_torque=np.where(measured, slow, np.nan),
            stiffness=self._stiffness * self._known, residual=error, threshold=threshold, alarm=self._alarm.copy(),
            notes=tuple(notes),
        )  # fmt: skip

    def _stiffness_known(self) -> Array:
        """(n,) stiffness of the robot as a share of the twin's; NaN where it is not known."""
        with np.errstate(divide="ignore", invalid="ignore"):
            # Motors give way to a stiffer spring: less of it is seen.
            seen = self._hold_gain / (self._hold_gain + self._stiffness)
            known = self._mismatch.deviation / seen < KNOWN
            return np.where(known, 1.0 + self._mismatch.spring / seen, np.nan)

    def _note(self, text: str, notes: list[str]) -> None:
        """Say something, but not again within a while."""
        kind = re.sub(r"[-+]?[0-9][0-9.e+-]*", "", text)
        if self._steps - self._said.get(kind, -math.inf) >= AGAIN / self._step:
            self._said[kind] = self._steps
            notes.append(text)

    def close(self) -> None:
        """Release the simulation."""
        self._simulation.close()

    def __enter__(self) -> Twin:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()
