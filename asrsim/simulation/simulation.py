"""A simulation that the caller steps. `asrsim.run`, live runs, learning, sweeps and identification use it in loops."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from asrsim.engines.base import Engine
from asrsim.errors import InputError
from asrsim.robot.dynamics import RobotModel
from asrsim.samples import Array, HeldWrench, RunInfo, Samples
from asrsim.scenario.overrides import Overrides
from asrsim.simulation.blocks import whole_steps
from asrsim.simulation.divergence import runaway
from asrsim.simulation.fields import JOINT
from asrsim.simulation.inputs import chunk_at
from asrsim.simulation.layout import HEALTH
from asrsim.simulation.observation import Counts, Observation, Snapshot, counts_of, observe
from asrsim.simulation.prepare import ScenarioLike, prepare
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.recording import RunRecording, Sink
from asrsim.simulation.start import Numbers, Start
from asrsim.simulation.worlds import Worlds, count_of

ONE = np.zeros(1, dtype=np.int64)
"""Index of the only world."""


class Simulation:
    """Simulation of a scenario that the caller steps. It is a context manager, which releases the engine.

        with asrsim.Simulation("arm.yaml", variant="soft") as simulation:
            simulation.set_reference("joint_1", "equilibrium_position", 0.3)
            simulation.advance(20)
            simulation.observe().link_position

    The results do not depend on how the steps are grouped into calls. References follow the scenario's signals until the caller
    sets them; a value that is set acts in the next step and later. Raises the errors of `prepare`, and DivergenceError if the
    motion is not finite or the energy balance is violated.
    """

    def __init__(
        self,
        scenario: ScenarioLike,
        *,
        variant: str | None = None,
        overrides: Overrides = (),
        plugins: Sequence[str | Path] = (),
        sinks: Sequence[Sink] | Callable[[RunInfo], Sequence[Sink]] = (),
        record: bool = False,
        names: Sequence[str] | None = None,
        compiled: bool | None = None,
        expected_substeps: int | None = None,
        duration: float | None = None,
        chunk: int | None = None,
    ) -> None:
        """Prepare the simulation.

        Args:
            scenario: Scenario file, loaded scenario, or prepared scenario, which is not read or examined again.
            variant, overrides, plugins: As in `prepare`; ignored for a prepared scenario. Declare `reference_ranges` for
                references that you will set: the number of substeps is chosen for these ranges, and values are clamped to them.
            sinks: Objects that receive chunks of samples, or a function of the run's description that returns them.
            record: Whether the logged samples are kept, as `samples`.
            names: Quantities that are recorded; None: all.
            compiled: Whether the loop is compiled; None: as the scenario states; if the scenario states nothing, the loop is
                compiled if Numba is installed and `expected_substeps` is large.
            expected_substeps: Number of substeps that the caller will take.
            duration: Recorded duration in s, instead of the scenario's duration.
            chunk: Largest number of substeps in a chunk of samples.
        """
        prepared = self.prepared = prepare(scenario, variant=variant, overrides=overrides, plugins=plugins)
        self.scenario, self.substeps = prepared.scenario, prepared.resolution.substeps
        """Number of substeps per step."""
        sinks = list(sinks(prepared.info) if callable(sinks) else sinks)
        self.last = prepared.last_substep(duration)
        """Substep at which the scenario's duration ends and the last sample is taken."""
        self.total = self.last + 1
        looks = (record or sinks) and not (self.scenario.world.empty and self.scenario.fixed_base)
        self._world = Worlds(
            prepared,
            1,
            names=names,
            compiled=compiled,
            expected_substeps=expected_substeps or self.last,
            chunk=chunk,
            watch=self._watch if looks else None,
        )
        self.joints, self._core, self.slow_because = self._world.joints, self._world.core, self._world.slow_because
        self._output = sinks, record
        self._held: dict[str, HeldWrench] = {}
        """Wrenches that the caller has set on bodies, by name of the body."""
        self._holding = self.engine
        """Engine to which the wrenches on bodies have been passed."""
        self._numbers: Numbers = {}
        """Parameters that all resets so far have set. Each reset replaces the parameters that it names."""
        self.recording = self._new_recording(prepared)

    def _new_recording(self, started: Prepared) -> RunRecording:
        """A recording of a run that begins at the initial state of `started`."""
        sinks, record = self._output
        return RunRecording(started, self.engine, self._world.columns, last=self.last, sinks=sinks, keep=record)

    # -- stepping ---------------------------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Simulated time in s."""
        return round(self.substep * self.prepared.substep, 12)

    @property
    def substep(self) -> int:
        """Number of completed substeps."""
        return int(self._core.done[0])

    @property
    def compiled(self) -> bool:
        """Whether the loop runs compiled."""
        return self._core.compiled

    def advance(self, steps: int = 1) -> None:
        """Advance by a number of steps. Raises DivergenceError, after the sinks have received the samples up to the
        divergence.
        """
        self.advance_to(self.substep + count_of(steps) * self.substeps)

    def advance_to(self, end: int) -> None:
        """Advance until `end` substeps are completed."""
        self._world.check_open()
        while self.substep < end:
            before = self.substep
            boundary = self.next_chunk(self.total if before < self.total else end)
            length = min(end, boundary) - before
            rows = self._world.blocks.go_on(ONE, length)
            if self.recording.active:
                first, found = whole_steps(before, self.substep, self.substeps)
                self.recording.take(first, rows[0, :found])
            if self._core.fault[0, 0] != HEALTH.healthy:
                self._diverge()
            if self.substep == boundary:
                self.flush()

    def next_chunk(self, end: int) -> int:
        """Substep at which the present chunk ends, or `end` if that is earlier; long runs report progress there."""
        return min(end, chunk_at(self.substep, self._world.chunk)[1])

    def _watch(self) -> None:
        """Read poses and contacts before a substep of the engine, if they are recorded."""
        if self.substep % self.recording.look_every == 0:
            self.recording.look(self.substep)

    def _diverge(self) -> None:
        """Raise the DivergenceError of the joint at fault."""
        core, prepared = self._core, self.prepared
        self.recording.flush(self.substep, core.joint_states[0], check=False)
        (kind, joint), what = core.fault[0], "its law has no finite value"
        if kind != HEALTH.no_value:
            # Report the fastest joint as the cause. A velocity of NaN counts as the fastest.
            joint = np.nan_to_num(np.abs(core.joint_states[0, :, JOINT["engine_velocity"]]), nan=np.inf).argmax()
            what = "its motion is no longer finite, or impossibly fast"
        raise runaway(prepared, self.joints[joint], self.substep * prepared.substep, what)

    def flush(self) -> None:
        """Pass the recorded samples to the sinks; raises DivergenceError if the energy balance is violated."""
        self.recording.flush(self.substep, self._core.joint_states[0])

    @property
    def samples(self) -> Samples:
        """Samples logged since the start. Raises InputError unless the simulation was created with `record=True`."""
        if not self._world.closed:
            self.flush()
        return self.recording.samples

    @property
    def counts(self) -> Counts:
        """Number of substeps since the start in which each limit acted."""
        return counts_of(self._core.joint_states[0], self.substep)

    # -- from outside -----------------------------------------------------------------------------------------------

    def set_reference(self, joint: str, reference: str, value: float | None) -> float | None:
        """Set a reference (by its name in the joint's mode) or `external_torque`; the value acts in the next step and later.
        Returns the value that is set.

        value: new value, which is clamped to the declared range; None: the scenario's signal acts again. Raises InputError for
        unknown names and values that are not finite.
        """
        held = self._world.set_reference(joint, reference, value)
        return None if value is None else float(held[0])

    def set_wrench(
        self,
        body: str,
        force: Sequence[float],
        *,
        torque: Sequence[float] = (0.0, 0.0, 0.0),
        point: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> None:
        """Let a force and a torque act on a link or a movable object of the world, from the next substep until the next call
        for this body.

        Args:
            body: Name of the link or object.
            force: Force (3,) in N, world frame; zeros end the action.
            torque: Torque (3,) in N m, world frame.
            point: Point (3,) of the body at which the force acts, in the frame of the body, m.

        Raises:
            InputError: There is no such body, the engine cannot move it, or a value is not finite.
        """
        self._world.check_open()
        engine = self.engine
        if not engine.holdable:
            message = f"the engine '{self.scenario.engine}' takes no wrenches"
            raise InputError(message, key=body, code="wrench", hint="Set `external_torque` on the joints")
        if body not in engine.holdable:
            message = f"'{body}' is neither a link nor a movable object"
            raise InputError(message, choices=engine.holdable, meant=body, code="wrench")
        wrench = HeldWrench(body, _vector(force, "force"), _vector(torque, "torque"), _vector(point, "point"))
        held = {**self._held, body: wrench}
        self._hold({name: one for name, one in held.items() if any((*one.force, *one.torque))})
        self.recording.note_outside_work()

    def _hold(self, held: Mapping[str, HeldWrench]) -> None:
        """Apply these wrenches instead of all that acted before."""
        self._holding.hold(())
        self._held, self._holding = dict(held), self.engine
        self._holding.hold(tuple(held.values()))

    def observe(self) -> Observation:
        """Present state."""
        self._world.check_open()
        return observe(self.time, self.prepared.drives, self._core.joint_states[0], self.prepared.substep)

    def read(self, names: Sequence[str]) -> dict[str, Array]:
        """Quantities at the last completed step by name; arrays (n,) in the order of the joints.

        Before the first step, the method returns the quantities of the first step. NaN where a joint does not record a
        quantity. Raises InputError for a name that no joint records.
        """
        return {name: found[0] for name, found in self._world.read(names).items()}

    @property
    def engine(self) -> Engine:
        """The engine that moves the links; see `look` for its present state."""
        return self._core.engine_of(0)

    @property
    def model(self) -> RobotModel | None:
        """Kinematics and dynamics of the robot; None if the engine prescribes the motion."""
        return self.prepared.model

    def look(self) -> Engine:
        """The engine in the present state, to read its model and its scene."""
        return self._world.look(0)

    def snapshot(self) -> Snapshot:
        """Snapshot of the state and of the recording, for `restore`."""
        return replace(self._world.snapshot(), recording=self.recording.copy(), wrenches=self._held)

    def restore(self, snapshot: Snapshot) -> None:
        """Continue from a snapshot of this simulation. Samples that the sinks have already received are not withdrawn.

        Raises InputError for a snapshot of another simulation, or for a snapshot that was taken before a reset with other
        parameters.
        """
        self._world.restore(snapshot)
        self._hold(snapshot.wrenches)
        self.recording = snapshot.recording.copy()

    def reset(
        self,
        initial: Mapping[str, float] | None = None,
        *,
        velocities: Mapping[str, float] | None = None,
        motors: Mapping[str, Sequence[float]] | None = None,
        parameters: Numbers | None = None,
    ) -> None:
        """Reset to the initial state. The simulation then gives bitwise the same results as a new simulation, follows the
        scenario's references again, and holds no wrenches.

        Args:
            initial: Initial positions (rad, m) by joint, instead of the scenario's positions.
            velocities: Initial velocities (rad/s, m/s) by joint.
            motors: Initial positions of the motors (rad) by joint. Other motors start at their link's position.
            parameters: Values by joint or link, and by name, as in `Prepared.vary`.

        The number of substeps is unchanged, and a recording starts anew. Raises InputError and RobotError for unknown names,
        and for values that are not finite or beyond limits.
        """
        numbers = dict(self._numbers)
        for owner, table in (parameters or {}).items():
            numbers[owner] = {**numbers.get(owner, {}), **table}
        start = Start(parameters=numbers, positions=initial or {}, velocities=velocities or {}, motors=motors or {})
        self._world.reset(start)
        self._hold({})
        if parameters is not None:
            self._numbers, self.prepared = numbers, self._world.prepared_of(0)
            self._world.record_as(self.prepared)
        self.recording = self._new_recording(self.prepared.started(start))

    def close(self) -> None:
        """Release the engine. Call `flush` first if the sinks must receive the recorded samples."""
        self._world.close()

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _vector(values: Sequence[float], name: str) -> tuple[float, float, float]:
    """Three finite numbers; raises InputError."""
    found = np.asarray(values, dtype=float)
    if found.shape != (3,) or not np.isfinite(found).all():
        raise InputError(f"must be three finite numbers, not {values}", key=name, code="wrench")
    x, y, z = found.tolist()
    return x, y, z
