"""A simulation that its user steps: `asrsim.run`, live runs, learning, sweeps and identification are loops on it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from operator import index
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from asrsim.compiling import available
from asrsim.engines.base import Engine, Model
from asrsim.errors import InputError, SimulationError
from asrsim.samples import Array, RunInfo, Samples
from asrsim.scenario.data import Scenario
from asrsim.scenario.overrides import Overrides
from asrsim.simulation.chunks import chunk_end, longest_chunk
from asrsim.simulation.core import Core, given_by, pays
from asrsim.simulation.counts import Counts, counts_of
from asrsim.simulation.divergence import runaway
from asrsim.simulation.drives import started
from asrsim.simulation.inputs import Block, Inputs
from asrsim.simulation.layout import HEALTHY, LAGGING, NO_VALUE
from asrsim.simulation.observation import Observation, Snapshot, observe
from asrsim.simulation.prepare import check_inertia, prepare
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.recording import Recording, Sink
from asrsim.simulation.rows import shape_of

ONE = np.zeros((1, 2), dtype=np.int64)
"""The only world, and the only set of inputs."""


class Simulation:
    """A scenario, stepped from outside; a context manager that releases the engine.

        with asrsim.Simulation("arm.yaml", variant="soft") as simulation:
            simulation.set_reference("joint_1", "equilibrium_position", 0.3)
            simulation.advance(20)
            simulation.observe().link_position

    Steps are the scenario's; however they are grouped into calls, the bits are the same. References follow the scenario's
    signals until they are set, then hold; a value set takes effect at the next step. Raises what :func:`prepare` raises, and
    DivergenceError where the motion is no longer sane.
    """

    def __init__(
        self,
        scenario: str | Path | Scenario | Prepared,
        *,
        variant: str | None = None,
        overrides: Overrides = (),
        ranges: Mapping[str, Mapping[str, tuple[float, float]]] | None = None,
        sinks: Sequence[Sink] | Callable[[RunInfo], Sequence[Sink]] = (),
        record: bool = False,
        compiled: bool | None = None,
        expected_substeps: int | None = None,
        duration: float | None = None,
        chunk: int | None = None,
    ) -> None:
        """variant, overrides, ranges: as :func:`prepare` takes them; of what is prepared already they are not asked. sinks:
        take chunks of samples, or a function that makes them; record: keep what is logged, as `samples`. compiled: whether the
        loop is compiled; None: the scenario's choice, else where Numba is installed and `expected_substeps` are many. duration:
        s that are recorded, instead of the scenario's; chunk: substeps, at most, between samples handed on."""
        if not isinstance(scenario, Prepared):
            scenario = prepare(scenario, variant=variant, overrides=overrides, ranges=ranges)
        self.prepared, self.scenario = scenario, scenario.scenario
        self.substeps = scenario.resolution.substeps
        """Of a step."""
        self.engine = scenario.make_engine()
        try:
            self._begin(sinks, record, compiled, expected_substeps, duration, chunk)
        except BaseException:
            self.engine.close()
            raise

    def _begin(self, sinks: Any, record: bool, compiled: bool | None, expected: Any, duration: Any, chunk: Any) -> None:
        prepared, engine = self.prepared, self.engine
        self.joints = engine.joints
        self.last = prepared.last_substep(duration)
        """Substep at which the scenario's duration ends, and of the last sample."""
        self.total = self.last + 1
        motors = shape_of(prepared.drives, prepared.sensors).motors
        self.recording = Recording(prepared, engine, motors=motors, last=self.last, sinks=sinks, keep=record)
        self._peeking = False
        watch = self._watch if self.recording.watch is not None else None
        self._core, self.slow_because = make_core(
            prepared, engine, compiled=compiled, substeps=expected or self.last, watch=watch
        )
        self._inputs = inputs_of(prepared)
        self._chunk = longest_chunk(len(prepared.drives), chunk)
        self._row: tuple[Array, Array] | None = None
        """Of the last whole step: logged columns (joints, columns) of the state, and references (input columns, joints)."""
        self._block: Block | None = None
        self._stale = False
        """Another value is held than the block has."""
        self._first: Block | None = None
        self._closed, self._owner = False, object()
        self._core.start(0, prepared.drives, prepared.initial_positions, prepared.initial_velocities)
        self._start: Snapshot | None = self.snapshot()

    # -- stepping ---------------------------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """s that are simulated."""
        return round(self.substep * self.prepared.substep, 12)

    @property
    def substep(self) -> int:
        """Substeps done."""
        return int(self._core.done[0])

    @property
    def compiled(self) -> bool:
        """Whether the loop runs compiled."""
        return self._core.compiled

    def advance(self, steps: int = 1) -> None:
        """Go on by a number of steps. Raises DivergenceError; what was recorded by then has gone to the sinks."""
        if index(steps) < 0:
            raise InputError("steps go forward only: restore a snapshot, or reset", value=steps, code="steps")
        self.advance_to(self.substep + steps * self.substeps)

    def advance_to(self, end: int) -> None:
        """Go on until `end` substeps are done."""
        self._check_open()
        while self.substep < end:
            block = self._block
            if block is None or self.substep >= block.first + len(block):
                block = self._block = self._next_block()
            elif self._stale:
                self._inputs.hold(block, self.substep - block.first)
            self._stale = False
            self._run(block, self.substep - block.first, min(end - block.first, len(block)))
            if self.substep == block.first + len(block):
                self.flush()

    def next_chunk(self, end: int) -> int:
        """The substep, at most `end`, at which the present chunk ends: where to look up from a long run."""
        return min(end, chunk_end(self.substep, self._chunk))

    def _next_block(self) -> Block:
        """Inputs up to the end of the chunk, or of the run."""
        length = self.next_chunk(self.total if self.substep < self.total else self.substep + self._chunk) - self.substep
        if self.substep or self._inputs.held:
            return self._inputs.block(self.substep, length)
        self._first = self._first or self._inputs.block(0, length)
        return self._first

    def _watch(self) -> None:
        """Before a substep of the engine: where the world is looked at."""
        watch = self.recording.watch
        if watch is not None and not self._peeking and self.substep % self.recording.look_every == 0:
            watch(self.substep)

    def _run(self, block: Block, start: int, stop: int) -> None:
        """Rows of the block."""
        first, every, columns = self.substep, self.recording.every, self.recording.selection.columns
        rows: Sequence[int] = range(first + (-first) % every, first + stop - start, every)
        out = np.empty((1, len(rows), len(self.joints), len(columns)))
        self._core.run(ONE, given_by(block, start, stop), out, every=every, columns=columns)
        healthy = self._core.fault[0, 0] == HEALTHY
        rows = [row for row in rows if row < self.substep] if not healthy else rows
        if len(rows):
            places = [row - block.first for row in rows]
            references = block.references[:, :, places[0] : places[-1] + 1 : every]
            self.recording.take(rows[0] // every, out[0, : len(rows)], references)
            self._row = out[0, len(rows) - 1].copy(), references[:, :, -1].copy()
        if not healthy:
            self._diverge(out[0, : len(rows)])

    def _diverge(self, rows: Array) -> None:
        """Raises DivergenceError; rows: the last ones that were recorded."""
        core, prepared = self._core, self.prepared
        self.recording.flush(self.substep, core.S[0], check=False)
        kind, joint = core.fault[0]
        time = self.substep * prepared.substep
        if kind == NO_VALUE:
            raise runaway(self.joints[joint], time, "its law has no finite value", prepared.resolution.omega_h)
        joint = fastest_joint(core.S[0, :, LAGGING])
        raise runaway(self.joints[joint], time, "its motion is no longer finite or sane", prepared.resolution.omega_h)

    def flush(self) -> None:
        """Hand on what is recorded so far; raises DivergenceError where energy came from nowhere."""
        self.recording.flush(self.substep, self._core.S[0])

    @property
    def samples(self) -> Samples:
        """What is logged since the start, of a simulation that was made with `record=True`; another raises InputError."""
        if not self._closed:
            self.flush()
        return self.recording.samples

    @property
    def counts(self) -> Counts:
        """Limits that were met since the start."""
        return counts_of(self._core.S[0], self.substep)

    # -- from outside -----------------------------------------------------------------------------------------------

    def set_reference(self, joint: str, reference: str, value: float | None) -> float | None:
        """Hold a reference (by its mode's name), or `external_torque`, at `value` from now on, or None: follow the scenario.

        Returns what is held: values beyond the declared range are clamped to it. Raises InputError for unknown names and
        values that are not finite.
        """
        j, slot = self.prepared.slot_of(joint, reference)
        held = self._inputs.held
        if value is None:
            held.pop((j, slot), None)
            self._block = None
        else:
            if not math.isfinite(value):
                raise InputError(f"{reference} of '{joint}' must be finite", code="reference-value")
            low, high = self.prepared.range_of(joint, reference)
            value = min(max(float(value), low), high)
            if held.get((j, slot)) == value:
                return value
            # A block that is kept for later runs, or that a reference's jumps cut, is no place for another value.
            if (j, slot) not in held or self._block is self._first or (self._block and len(self._block.cuts.places)):
                self._block = None
            held[j, slot], self._stale = value, True
        return value

    def observe(self) -> Observation:
        """The state now."""
        self._check_open()
        return observe(self.time, self.prepared.drives, self._core.S[0], self.prepared.substep)

    def read(self, names: Sequence[str]) -> dict[str, Array]:
        """Quantities as they were at the last whole step that is done, by name, (n,) each in the order of the joints; at the
        start, as they will be in the first step. NaN where a joint does not record a quantity. Raises InputError for a name
        that no joint records."""
        self._check_open()
        self.recording.selection.check(names)
        rows, references = self._row or self._first_row()
        values = self.recording.selection.values(rows[None], references[:, :, None], names)
        return {name: found[0].copy() for name, found in values.items()}

    def _first_row(self) -> tuple[Array, Array]:
        """What the next step would record; nothing moves."""
        state, block = self._core.state(0), self._inputs.block(self.substep, 1)
        out = np.empty((1, 1, len(self.joints), len(self.recording.selection.columns)))
        self._peeking = True
        try:
            self._core.run(ONE, given_by(block, 0, 1), out, every=1, columns=self.recording.selection.columns)
        finally:
            self._peeking = False
        self._core.put(0, state)
        return out[0, 0], block.references[:, :, 0]

    @property
    def model(self) -> Model | None:
        """Kinematics and dynamics of the robot; None where its links have no dynamics."""
        return self.engine.model

    def look(self) -> Engine:
        """The engine in the present state: its model, and what is around the robot."""
        self._check_open()
        return self._core.look(0)

    def snapshot(self) -> Snapshot:
        """The state, to be given to :meth:`restore`; what is recorded, too."""
        self._check_open()
        return Snapshot(self._owner, self._core.state(0), dict(self._inputs.held), self.recording.state(), self._row)

    def restore(self, snapshot: Snapshot) -> None:
        """Continue from a snapshot of this simulation, to the bit. What went to sinks stays there.

        Raises InputError for a snapshot of another one, or from before a reset with other parameters.
        """
        self._check_open()
        if snapshot.owner is not self._owner:
            message = "is a snapshot of another simulation, or of this one with other parameters"
            raise InputError(message, key="snapshot", code="snapshot")
        self._core.put(0, snapshot.state)
        self._inputs.held = dict(snapshot.held)
        self._block, self._row = None, snapshot.row
        self.recording.put_back(snapshot.record)

    def reset(
        self,
        initial: Mapping[str, float] | None = None,
        *,
        velocities: Mapping[str, float] | None = None,
        motors: Mapping[str, Sequence[float]] | None = None,
        parameters: Mapping[str, Mapping[str, float]] | None = None,
        signals: Scenario | None = None,
    ) -> None:
        """Back to the start, with the bits of a fresh one; references follow the scenario again.

        initial: positions (rad, m) by joint that differ from the scenario's; velocities: likewise (rad/s, m/s); motors: of each
        joint's motors (rad), others begin where their link is; parameters: joint or link -> name -> value, as
        :meth:`Prepared.vary` takes them; signals: a scenario whose references and external torques replace those of this
        simulation. Substeps stay; a recording starts anew. Raises InputError and RobotError for
        what is unknown, not finite or beyond limits.
        """
        same = initial is None and velocities is None and motors is None and parameters is None and signals is None
        if same and self._start is not None:
            self.restore(self._start)
            return
        self._check_open()
        if signals is not None:
            own = replace(self.scenario, references=signals.references, external_torques=signals.external_torques)
            self.scenario, self.prepared = own, replace(self.prepared, scenario=own)
            self._inputs, self._first, self._start, self._owner = inputs_of(self.prepared), None, None, object()
        positions, speeds = self.prepared.start(initial or {}, velocities or {})
        if parameters is not None:
            self._take_over(self.prepared.with_numbers(parameters))
            # Another robot may be at equilibrium elsewhere.
            positions, speeds = self.prepared.start(initial or {}, velocities or {})
        self._block, self._row, self._inputs.held = None, None, {}
        self._core.start(0, started(self.prepared.drives, positions, motors or {}), positions, speeds)
        self.recording.renew(positions, speeds)

    def _take_over(self, varied: Prepared) -> None:
        # What was kept has other numbers.
        self._start, self._owner = None, object()
        moved = varied.robot.links != self.prepared.robot.links
        if not self.engine.vary(varied.robot):
            self.engine.close()
            self.engine = varied.make_engine()
        self.prepared = varied = varied.settled(self.engine.model)
        self.recording.take_over(varied, self.engine)
        if moved and self.engine.model is not None:
            check_inertia(varied.drives, self.engine.model.mass_matrix(varied.initial_positions))
        self._core.take_over(0, varied, self.engine)

    def close(self) -> None:
        """Release the engine; what is recorded has to be handed on before, by :meth:`flush`."""
        self._closed = True
        self.engine.close()

    def _check_open(self) -> None:
        if self._closed:
            raise SimulationError("the simulation is closed: make a new one")

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


def inputs_of(prepared: Prepared) -> Inputs:
    """The input signals of the scenario."""
    staggered = prepared.stepping.staggered
    return Inputs(prepared.scenario, prepared.drives, substep=prepared.substep, staggered=staggered, sensors=prepared.sensors)


def make_core(
    prepared: Prepared, engine: Engine, *, compiled: bool | None, substeps: int, worlds: int = 1,
    watch: Callable[[], None] | None = None,
) -> tuple[Core, str]:  # fmt: skip
    """The core, and why it is the plain one where compiled code would pay; empty where it would not.

    compiled: whether it is; None: the scenario's choice, else where it pays in a run of so many substeps. Raises
    SimulationError where it cannot be had and is asked for. worlds, watch: as of :class:`Core`.
    """
    wanted, slow_because = prepared.scenario.compiled if compiled is None else compiled, ""
    if wanted or (wanted is None and pays(len(engine.joints), worlds * substeps * prepared.resolution.motor_substeps)):
        try:
            if not available():
                raise SimulationError("Numba is not installed")
            return Core(prepared, engine, worlds=worlds, compiled=True, watch=watch), ""
        except SimulationError as error:
            if wanted:
                raise
            slow_because = str(error)
    return Core(prepared, engine, worlds=worlds, watch=watch), slow_because


def fastest_joint(velocities: Array) -> int:
    """The number of the joint that moves fastest; one that has no velocity moves faster than any."""
    return int(np.argmax(np.where(np.isfinite(velocities), np.abs(velocities), np.inf)))
