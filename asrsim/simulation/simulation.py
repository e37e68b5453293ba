"""A simulation that somebody else steps: `asrsim.run`, live runs, learning, sweeps and identification are loops on it."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Any, Protocol

import numpy as np

from asrsim.errors import DivergenceError, InputError, Problem, SimulationError, did_you_mean
from asrsim.samples import Array, RunInfo, Samples
from asrsim.scenario.data import Scenario
from asrsim.simulation.choice import pays
from asrsim.simulation.divergence import EnergyGuard, blame, not_finite, runaway
from asrsim.simulation.inputs import Block, Inputs
from asrsim.simulation.loop import Loop, NoValueError
from asrsim.simulation.prepare import Prepared, prepare
from asrsim.simulation.recorder import Recorder
from asrsim.simulation.world import WorldRecorder

CHUNK = 4096
"""Substeps, at most, of a chunk: between samples handed on, checks of energy, and progress."""
CHUNK_NUMBERS = 20_480
"""The most times joints: what still goes through the processor's cache."""
SHORTEST_CHUNK = 256
UNSTABLE = 2.0
"""omega h from which no stepping is stable."""


class Sink(Protocol):
    """Takes samples as they come: logged ones, or all of them if it has `full_rate = True`."""

    def write(self, samples: Samples) -> None:
        """The next chunk."""


@dataclass(frozen=True, kw_only=True)
class Observation:
    """The state at a whole step; arrays are (n,) in the order of the joints, NaN where a joint has no such thing."""

    time: float
    """s."""
    link_position: Array
    """rad (m)."""
    link_velocity: Array
    """rad/s (m/s)."""
    motor_1_position: Array
    """rad; of ideal motors: nan, they stand at their references."""
    motor_1_velocity: Array
    motor_2_position: Array
    motor_2_velocity: Array


@dataclass(frozen=True, kw_only=True)
class Snapshot:
    """Everything that decides how a simulation goes on."""

    substep: int
    engine: Any
    joints: Any
    held: Mapping[tuple[int, int], float]
    record: Any


class Simulation:
    """A scenario, stepped from outside; a context manager that releases the engine.

        with asrsim.Simulation(asrsim.load_scenario("arm.yaml")) as simulation:
            simulation.set_reference("joint_1", "equilibrium_position", 0.3)
            simulation.advance(20)
            simulation.observe().link_position

    Steps are the scenario's; however they are grouped into calls, the bits are the same. References follow the scenario's
    signals until they are set, then hold; a value set takes effect at the next step. Raises what :func:`prepare` raises, and
    DivergenceError where the motion is no longer sane.
    """

    def __init__(
        self,
        scenario: Scenario | Prepared,
        *,
        ranges: Mapping[str, Mapping[str, tuple[float, float]]] | None = None,
        sinks: Sequence[Sink] | Callable[[RunInfo], Sequence[Sink]] = (),
        record: bool = False,
        compiled: bool | None = None,
        expected_substeps: int | None = None,
    ) -> None:
        """ranges: joint or "*" -> reference -> least and largest value that :meth:`set_reference` takes (substeps are chosen
        for them). sinks: take chunks of samples, or a function that makes them; record: keep all samples. compiled: whether
        the loop is compiled; None: the scenario's choice, else where Numba is installed and `expected_substeps` are many.
        """
        self.prepared = prepared = scenario if isinstance(scenario, Prepared) else prepare(scenario, ranges=ranges)
        self.scenario = prepared.scenario
        resolution = prepared.resolution
        self.substeps = resolution.substeps
        """Of a step."""
        self._engine = prepared.make_engine()
        try:
            self._begin(sinks, record, compiled, expected_substeps)
        except BaseException:
            self._engine.close()
            raise

    def _begin(self, sinks: Any, record: bool, compiled: bool | None, expected: int | None) -> None:
        prepared, scenario, engine = self.prepared, self.scenario, self._engine
        stepping, substep = prepared.stepping, prepared.substep
        engine.prepare(substep, staggered=stepping.staggered)
        engine.set_state(prepared.initial_positions, prepared.initial_velocities)
        self.joints = engine.joints
        every = self.substeps * scenario.log_every
        self.last = round(scenario.duration / scenario.step) * self.substeps
        """Substep at which the scenario's duration ends."""
        watched = not scenario.world.empty or not scenario.fixed_base
        self._world = WorldRecorder(engine, every, self.last)
        self._sinks = list(sinks(prepared.info) if callable(sinks) else sinks)
        self._recording = bool(record or self._sinks)
        self.kept: list[Samples] | None = [] if record else None
        self.recorder = Recorder(prepared.drives, stepping, substep=substep, every=self.substeps, last=self.last)
        self._inputs = Inputs(
            scenario, prepared.drives, substep=substep, staggered=stepping.staggered, sensors=prepared.sensors
        )
        self._loop = self._make_loop(compiled, expected, self._world.look if watched and self._recording else None)
        energy = engine.mechanical_energy()
        self._alone = energy is not None and not scenario.wrenches
        self._guard = EnergyGuard(energy or 0.0) if engine.model is not None and self._recording else None
        self._chunk = max(SHORTEST_CHUNK, min(CHUNK, CHUNK_NUMBERS // len(prepared.drives)))
        self._raw: list[tuple[tuple[Array, ...], Array]] = []
        self._sides: dict[int, Array] = {}
        self._pending = 0
        self._block: Block | None = None
        self._first: Block | None = None
        self.substep = 0
        """Substeps done."""
        self._start = self.snapshot()

    def _make_loop(self, compiled: bool | None, expected: int | None, watch: Callable[[int], None] | None) -> Loop:
        from asrsim.compiling import available

        prepared, scenario = self.prepared, self.scenario
        options: dict[str, Any] = {
            "substep": prepared.substep,
            "motor_substeps": prepared.resolution.motor_substeps,
            "sensings": [None if sensor is None else sensor.sensing for sensor in prepared.sensors],
            "cut": prepared.velocity_cutoff,
            "floating": not scenario.fixed_base,
            "every": self.substeps * scenario.log_every,
            "watch": watch,
        }
        wanted = scenario.compiled if compiled is None else compiled
        motor_steps = (self.last if expected is None else expected) * prepared.resolution.motor_substeps
        if wanted or (wanted is None and pays(len(prepared.drives), motor_steps) and available()):
            if not available():
                raise SimulationError("the compiled loop needs Numba: pip install 'asrsim[fast]'")
            try:
                return Loop(self._engine, prepared.drives, prepared.stepping, compiled=True, **options)
            except SimulationError:
                if wanted:
                    raise
        return Loop(self._engine, prepared.drives, prepared.stepping, compiled=False, **options)

    # -- stepping ---------------------------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """s that are simulated."""
        return round(self.substep * self.prepared.substep, 12)

    @property
    def compiled(self) -> bool:
        """Whether the loop runs compiled."""
        return self._loop.compiled

    def advance(self, steps: int = 1) -> None:
        """Go on by a number of steps. Raises DivergenceError; what was recorded by then has gone to the sinks."""
        self.advance_to(self.substep + steps * self.substeps)

    def advance_to(self, end: int) -> None:
        """Go on until `end` substeps are done."""
        while self.substep < end:
            block = self._block
            if block is None or self.substep >= block.first + len(block):
                block = self._block = self._next_block()
            start = self.substep - block.first
            stop = min(end - block.first, len(block))
            self._run(block, start, stop)
            if self._recording and self.substep % self._chunk == 0:
                self.flush()

    def next_chunk(self, end: int) -> int:
        """The substep, at most `end`, at which the present chunk ends: where to look up from a long run."""
        return min(end, self.substep - self.substep % self._chunk + self._chunk)

    def _next_block(self) -> Block:
        """Inputs up to the next multiple of the chunk's length: where blocks end does not depend on how time is cut."""
        if self.substep == 0 and not self._inputs.held:
            if self._first is None:
                self._first = self._inputs.block(0, self._chunk)
            return self._first
        return self._inputs.block(self.substep, self._chunk - self.substep % self._chunk)

    def _run(self, block: Block, start: int, stop: int) -> None:
        try:
            raw = self._loop.run(block, start, stop)
        except NoValueError as fault:
            time = fault.substep * self.prepared.substep
            self.substep = block.first + start
            raise self._diverged(runaway(fault.joint, time, str(fault), self.prepared.resolution.omega_h)) from fault
        row = not_finite(raw)
        rows = stop - start if row is None else max(row, 1)
        if self._recording:
            self._raw.append((tuple(array[start : start + rows] for array in block.arrays), raw[:rows]))
            self._sides |= {k: sides for k, sides in block.sides.items() if start <= k - block.first < start + rows}
        self.substep += rows
        if row is not None:
            joint = blame(raw, row, self.prepared.drives)
            time = (block.first + start + row) * self.prepared.substep
            what = "its motion is no longer finite or sane"
            raise self._diverged(runaway(joint, time, what, self.prepared.resolution.omega_h))

    def _diverged(self, error: DivergenceError) -> DivergenceError:
        self.flush(check=False)
        return error

    def flush(self, *, check: bool = True) -> None:
        """Hand on what is recorded so far; raises DivergenceError where energy came from nowhere."""
        if not self._raw:
            return
        inputs = [np.concatenate(arrays) for arrays in zip(*(taken for taken, _ in self._raw), strict=True)]
        raw = self._raw[0][1] if len(self._raw) == 1 else np.concatenate([part for _, part in self._raw])
        sides, self._sides, self._raw = self._sides, {}, []
        samples = self.recorder.add(inputs, raw, sides)
        if samples is not None:
            self._hand_on(samples)
        if check and self._guard is not None:
            error = self._energy_fault()
            if error is not None:
                raise error

    def _hand_on(self, samples: Samples) -> None:
        step, every = self.scenario.step, self.scenario.log_every
        first = round(float(samples.time[0]) / step)
        rows = slice((-first) % every, None, every)
        logged = samples if every == 1 else _part(samples, rows)
        logged = self._world.add_to(logged)
        if self.kept is not None and len(logged.time):
            self.kept.append(logged)
        for sink in self._sinks:
            if getattr(sink, "full_rate", False):
                sink.write(samples)
            elif len(logged.time):
                sink.write(logged)

    def _energy_fault(self) -> DivergenceError | None:
        """Energy of links or actuators from nowhere; contacts and wrenches do work of their own on the links."""
        engine, meter, guard = self._engine, self.recorder.meter, self._guard
        if guard is None or (self.prepared.stepping.released and self.prepared.resolution.omega_h < UNSTABLE):
            # The released order of a step is not passive, which is no fault of the user's; springs beyond the step are.
            return None
        kinetic = 0.0
        if self._alone and engine.model is not None:
            positions, velocities = engine.read()
            speeds = np.array(velocities)
            kinetic = 0.5 * float(speeds @ engine.model.mass_matrix(positions) @ speeds)
        fault = guard.fault(
            engine.mechanical_energy() if self._alone else None,
            kinetic=kinetic,
            given=meter.given,
            residual=meter.residual,
            turnover=meter.turnover,
            names=engine.joints,
        )
        if fault is None:
            return None
        return runaway(fault[0], self.substep * self.prepared.substep, fault[1], self.prepared.resolution.omega_h)

    # -- from outside -----------------------------------------------------------------------------------------------

    def set_reference(self, joint: str, reference: str, value: float | None) -> float | None:
        """Hold a reference (by its mode's name) at `value` from the next step on, or None: follow the scenario again.

        Returns what is held: values beyond the declared range are clamped to it. Raises InputError for unknown names and
        values that are not finite.
        """
        j, slot = self._slot(joint, reference)
        if value is None:
            self._inputs.held.pop((j, slot), None)
        else:
            if not math.isfinite(value):
                raise InputError(Problem(message=f"{reference} of '{joint}' must be finite", code="reference-value"))
            low, high = self.prepared.range_of(joint, reference)
            value = min(max(float(value), low), high)
            if self._inputs.held.get((j, slot)) == value:
                return value
            self._inputs.held[j, slot] = value
        self._block = None
        return value

    def _slot(self, joint: str, reference: str) -> tuple[int, int]:
        if joint not in self.joints:
            hint = did_you_mean(joint, self.joints)
            raise InputError(
                Problem(message=f"no joint is called '{joint}'", choices=self.joints, hint=hint, code="unknown-joint")
            )
        j = self.joints.index(joint)
        mode = self.prepared.drives[j].mode
        names = mode.references if mode else ()
        if reference not in names:
            raise InputError(
                Problem(message=f"joint '{joint}' has no reference '{reference}'", choices=names, code="unknown-reference")
            )
        return j, names.index(reference)

    def observe(self) -> Observation:
        """The state now."""
        loop = self._loop
        positions, _ = self._engine.read()
        motors = np.full((4, len(self.joints)), np.nan)
        for j, (drive, state) in enumerate(zip(self.prepared.drives, loop.motor_states(), strict=True)):
            lag = drive.stepping.first_drift * self.prepared.substep
            for i in range(drive.dynamic_motors):
                motors[2 * i, j] = state[4 * i] + lag * state[4 * i + 1]
                motors[2 * i + 1, j] = state[4 * i + 1]
        return Observation(
            time=self.time,
            link_position=np.array(positions),
            link_velocity=np.array(loop.velocities()),
            motor_1_position=motors[0],
            motor_1_velocity=motors[1],
            motor_2_position=motors[2],
            motor_2_velocity=motors[3],
        )

    def snapshot(self) -> Snapshot:
        """The state, to be given to :meth:`restore`; what is recorded, too."""
        record = copy.deepcopy((self.recorder, self._raw, self._sides, self._world.kept())) if self._recording else None
        return Snapshot(
            substep=self.substep,
            engine=self._engine.snapshot(),
            joints=self._loop.snapshot(),
            held=dict(self._inputs.held),
            record=record,
        )

    def restore(self, snapshot: Snapshot) -> None:
        """Continue from a snapshot of this simulation, to the bit. What went to sinks stays there."""
        self._engine.restore(snapshot.engine)
        self._loop.restore(snapshot.joints)
        self.substep = snapshot.substep
        self._inputs.held = dict(snapshot.held)
        self._block = None
        if snapshot.record is not None:
            self.recorder, self._raw, self._sides, world = copy.deepcopy(snapshot.record)
            self._world.put_back(world)

    def reset(
        self,
        initial: Mapping[str, float] | None = None,
        *,
        velocities: Mapping[str, float] | None = None,
        parameters: Mapping[str, Mapping[str, float]] | None = None,
    ) -> None:
        """Back to the start, with the bits of a fresh one; references follow the scenario again.

        initial: positions (rad, m) by joint that differ from the scenario's; velocities: likewise (rad/s, m/s); parameters:
        joint or link -> name -> value, as :meth:`Prepared.vary` takes them. Substeps stay as they were chosen. A recording
        starts anew.
        """
        if parameters is not None:
            self._take_over(self.prepared.vary(parameters))
        if initial is None and velocities is None and parameters is None:
            self.restore(self._start)
            return
        self.restore(self._start)
        positions = [
            float((initial or {}).get(name, q)) for name, q in zip(self.joints, self.prepared.initial_positions, strict=True)
        ]
        speeds = [
            float((velocities or {}).get(name, v))
            for name, v in zip(self.joints, self.prepared.initial_velocities, strict=True)
        ]
        self._engine.set_state(positions, speeds)
        if initial:
            drives = tuple(replace(drive, initial_position=q) for drive, q in zip(self.prepared.drives, positions, strict=True))
            self._loop.take_drives(drives)
        self._loop.reset()
        self._loop.refresh_response(0)

    def _take_over(self, varied: Prepared) -> None:
        if varied.robot is not self.prepared.robot and not self._engine.vary(varied.robot):
            self._engine.close()
            self._engine = varied.make_engine()
            self._loop.engine = self._engine
        self.prepared = varied
        self._loop.take_drives(varied.drives)

    def close(self) -> None:
        """Release the engine; what is recorded has to be handed on before, by :meth:`flush`."""
        self._engine.close()

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


def _part(samples: Samples, rows: slice) -> Samples:
    return replace(samples, time=samples.time[rows], values={name: values[rows] for name, values in samples.values.items()})
