"""Many worlds of one scenario, stepped together; environments, sweeps, identification and learning use them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import index
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asrsim.engines.base import Engine
from asrsim.engines.rigid import RigidEngine
from asrsim.errors import InputError, Problem, SimulationError, listed
from asrsim.robot.dynamics import RobotModel
from asrsim.samples import Array
from asrsim.scenario.overrides import Overrides
from asrsim.simulation import kernel
from asrsim.simulation.arguments import Corrections
from asrsim.simulation.blocks import Blocks
from asrsim.simulation.core import UNOBSERVED, Core, make_core
from asrsim.simulation.divergence import EnergyGuard
from asrsim.simulation.engine import WARP
from asrsim.simulation.fields import JOINT
from asrsim.simulation.inputs import longest_chunk
from asrsim.simulation.layout import EXTERNAL, HEALTH
from asrsim.simulation.observation import Counts, Observation, Snapshot, counts_of, observe
from asrsim.simulation.prepare import ScenarioLike, prepare_worlds
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.quantities import RowColumns, all_recorded, is_watched, without_energies
from asrsim.simulation.setups import Setups, WorldSetup
from asrsim.simulation.start import Start
from asrsim.simulation.strides import ALWAYS_ALL, strides_of


@dataclass(frozen=True, kw_only=True, eq=False)
class Observer:
    """Corrections of simulated positions and velocities by measured positions, for several worlds."""

    measured: Array
    """Positions of links and motors at the whole steps 0, 1, ..., (worlds, steps, joints, 1 + motors); NaN: not measured. After
    a rollout, this array contains the errors before the corrections: measured minus simulated positions.
    """
    gains: tuple[float, float]
    """Change of the position, and of the velocity in 1/s, per error."""


class Worlds:
    """N simulated worlds of one scenario, which the caller steps. The object is a context manager, which releases the engines.

        with asrsim.Worlds("arm.yaml", 64) as worlds:
            worlds.set_reference("joint_1", "equilibrium_position", targets)
            worlds.advance(20)
            worlds.observe().link_position

    Each world gives bitwise the same results as a separate `asrsim.Simulation`, in any order and on any number of threads. A
    world that diverges stops until its next reset; see `healthy`. The number of substeps is chosen for the scenario, and does
    not depend on the parameters of the worlds. Raises the errors of `asrsim.prepare`.
    """

    def __init__(
        self,
        scenario: ScenarioLike,
        count: int,
        *,
        variant: str | None = None,
        overrides: Overrides = (),
        plugins: Sequence[str | Path] = (),
        names: Sequence[str] | None = None,
        watched: bool = True,
        compiled: bool | None = None,
        expected_substeps: int | None = None,
        threads: int = 1,
        chunk: int | None = None,
        watch: Callable[[], None] | None = None,
        engine: str | None = None,
        device: str = "cpu",
        adaptive: bool = False,
    ) -> None:
        """Prepare the worlds.

        Args:
            scenario: As in `asrsim.Simulation`, which also explains variant, overrides, plugins and compiled.
            count: Number of worlds.
            names: Quantities that `read` and `rollout` return; None: all quantities that the joints record; with `adaptive`,
                energies and stiffness are left out.
            watched: Whether energies and limits are computed in each step, for `counts` and `sane`. Runs without energies and
                limits are a fifth faster.
            expected_substeps: Number of substeps that each world will take, by which a Python loop or a compiled loop is
                chosen.
            threads: Number of threads that step the worlds. It has an effect if the engine has a compiled step.
            chunk: Largest number of substeps whose inputs are sampled in one call.
            watch: Function that is called before each step of the engine.
            engine: Name of the engine; None: the scenario's engine, or MuJoCo if the scenario states no engine. With
                "mujoco_warp", MuJoCo Warp moves the links, and Warp runs asrsim's own laws in single precision; then energies
                and limits are not computed. This engine is made for thousands of worlds, since one world takes as long as
                hundreds of worlds.
            device: Device of Warp, such as "cpu" or "cuda".
            adaptive: Whether each world takes fewer substeps while its springs are soft enough (`asrsim.simulation.strides`). A
                world whose signals jump takes all substeps. `adaptive` needs a compiled loop in MuJoCo, and excludes contacts,
                imperfect sensors, stages, energies (`watched`) and stiffness.
        """
        for key, value in (("count", count), ("threads", threads)):
            check_number(value, key)
        if device != "cpu" and engine != WARP:
            raise InputError(
                "a device can be chosen for worlds on Warp only",
                key="device",
                value=device,
                hint=f"engine: {WARP}",
                code="warp",
            )
        prepared = prepare_worlds(scenario, engine=engine, variant=variant, overrides=overrides, plugins=plugins)
        strides = strides_of(prepared) if adaptive else ALWAYS_ALL
        self.on_warp = engine == WARP
        """Whether the worlds are on a device of Warp."""
        if self.on_warp:
            names, watched = without_energies(prepared.drives, names), False
        elif adaptive and names is None and not watched:
            names = [name for name in all_recorded(prepared.drives) if not is_watched(name)]
        self.prepared, self.count = prepared, count
        self.substeps = prepared.resolution.substeps
        """Number of substeps per step."""
        self.joints = tuple(drive.name for drive in prepared.drives)
        self.chunk = longest_chunk(len(self.joints) * count, chunk, motor_substeps=prepared.resolution.motor_substeps)
        self._options = names, watched
        links, substeps = prepared.make_engine(), expected_substeps or prepared.last_substep(None)
        try:
            self.core, self.slow_because = (
                (_warp_core(prepared, links, count, device), "")
                if self.on_warp
                else make_core(
                    prepared,
                    links,
                    compiled=True if adaptive and compiled is None else compiled,
                    substeps=substeps,
                    worlds=count,
                    watch=watch,
                    strides=strides,
                )
            )
            self.record_as(prepared)
            if adaptive:
                self._check_adaptive()
            self._setups = Setups(prepared, chunk=self.chunk)
            self._worlds = [self._setups.home] * count
            self.blocks = Blocks(self.core, [world.inputs for world in self._worlds], chunk=self.chunk, threads=threads)
            """Object that advances the worlds through blocks of their inputs."""
            self._everyone = np.arange(count)
            self._slots: dict[tuple[str, str], tuple[int, int, float, float]] = {}
            """Index of the joint, column and range of each reference that was set, by joint and reference."""
            self._sizes = np.array(strides.sizes)
            """Lengths of the strides in substeps."""
            self.closed = False
            self.reset()
        except BaseException:
            links.close()
            raise

    def record_as(self, prepared: Prepared) -> None:
        """Record the quantities that joints with these parameters have; earlier snapshots can no longer be restored."""
        names, watched = self._options
        self.columns = RowColumns(prepared.drives, self.core.shape, names)
        self.names = self.columns.names
        """Quantities that are recorded."""
        self._watched = not self.on_warp and (watched or any(map(is_watched, self.names)))
        self.core.record(self.columns, watched=self._watched)
        self._absent = np.repeat(self.columns.absent(prepared.drives)[None], self.count, axis=0)
        """Mask (count, joints, columns) of the quantities that the joints of each world do not record."""
        self._owner = object()

    # -- stepping ---------------------------------------------------------------------------------------------------

    @property
    def time(self) -> Array:
        """Simulated time of each world (N,) in s."""
        # Write out the formula of numpy.round, since the function takes four times as long for a few numbers.
        found: Array = np.rint(self.core.done * self.prepared.substep * 1e12) / 1e12
        return found

    @property
    def healthy(self) -> NDArray[np.bool_]:
        """Whether each world can continue, (N,); False after a divergence."""
        return np.asarray(self.core.fault[:, 0] == HEALTH.healthy)

    @property
    def compiled(self) -> bool:
        """Whether the loop runs compiled."""
        return self.core.compiled

    def advance(self, steps: int = 1, *, worlds: Any = None) -> None:
        """Advance by a number of steps. worlds: mask (N,) or list of numbers; None: all. Diverged worlds do not move."""
        numbers, substeps = self._numbers(worlds), count_of(steps) * self.substeps
        self.check_open()
        self.blocks.run(numbers, substeps, keep=False)

    # -- from outside -----------------------------------------------------------------------------------------------

    def set_reference(self, joint: str, reference: str, values: Any, *, worlds: Any = None) -> Array:
        """Set a reference (by its name in the joint's mode) or `external_torque`; the values act in the next step and later.
        Returns the values that are set.

        values: one value for all worlds, or a value for each world; values are clamped to the declared range. None: the
        scenario's signal acts again. Raises InputError.
        """
        self.check_open()
        numbers = self._numbers(worlds)
        known = self._slots.get((joint, reference))
        if known is None:
            limits = self.prepared.scenario.ranges_of(joint).get(reference, (-math.inf, math.inf))
            known = self._slots[joint, reference] = *self.prepared.slot_of(joint, reference), *limits
        j, slot, low, high = known
        held: Any = np.nan
        if isinstance(values, float):
            # Process a single number without arrays, since controllers set single numbers in every step and this is faster.
            held, finite = min(max(values, low), high), math.isfinite(values)
        elif values is not None:
            given = _spread(values, (len(numbers),), reference)
            held, finite = np.clip(given, low, high), bool(np.isfinite(given).all())
        if values is not None and not finite:
            raise InputError(f"{reference} of '{joint}' must be finite", code="reference-value")
        which: Any = slice(None) if numbers is self._everyone else numbers
        self.core.held[which, j, slot] = held
        self.blocks.renew()
        if values is None:
            self.blocks.discard()
        return np.array(self.core.held[which, j, slot])

    def push(self, torques: Array) -> None:
        """Set the external torques (N, n) in N m on all links of all worlds; the torques act in the next step and later.
        Declared ranges do not apply. Raises InputError for values that are not finite.
        """
        self.check_open()
        if not np.isfinite(torques).all():
            raise InputError("must be finite", key="torques", code="reference-value")
        self.core.held[:, :, EXTERNAL] = torques
        self.blocks.renew()

    def observe(self) -> Observation:
        """Present states; arrays are (N, n) in the order of worlds and joints, and `time` is (N,)."""
        self.check_open()
        return observe(self.time, self.prepared.drives, self.core.joint_states, self._stride)

    @property
    def _stride(self) -> Any:
        """Present length of the steps of all worlds in s; (N, 1) if they differ."""
        sizes = self.core.strides[:, 0]
        return self.prepared.substep * self._sizes[sizes][:, None] if np.count_nonzero(sizes) else self.prepared.substep

    def links(self) -> tuple[Array, Array]:
        """Present positions and velocities of the links, (N, n) each; faster than `observe`."""
        self.check_open()
        return self.core.joint_states[..., JOINT["position"]].copy(), self.core.joint_states[
            ..., JOINT["engine_velocity"]
        ].copy()

    def read(self, names: Sequence[str]) -> dict[str, Array]:
        """Quantities by name, as arrays (N, n); see `asrsim.Simulation.read`."""
        self.columns.check(names)
        return self.columns.values(self.latest(), names)

    def latest(self) -> Array:
        """Recorded values of the last step, (N, n, columns), with the columns of `columns.place`; see `read`."""
        self.check_open()
        if np.count_nonzero(self.core.done) == self.count:
            return np.where(self._absent, np.nan, self.core.rows)
        # Worlds at their start have taken no step, so show the values of their first step.
        fresh = np.flatnonzero((self.core.done == 0) & self.healthy)
        states = [self.core.state(world) for world in fresh.tolist()]
        if len(fresh):
            self.blocks.run(fresh, 1, keep=False)
        rows = np.where(self._absent, np.nan, self.core.rows)
        for world, state in zip(fresh.tolist(), states, strict=True):
            self.core.put(world, self._worlds[world].prepared, state)
        return rows

    @property
    def model(self) -> RobotModel | None:
        """Kinematics and dynamics of the scenario's robot; None if the engine prescribes the motion of the links."""
        self.check_open()
        return self.prepared.model

    def counts(self, world: int) -> Counts:
        """Number of substeps in which each limit of a world acted since the last reset. Raises SimulationError if the worlds
        are not watched."""
        self._check_watched()
        self._numbers(world)
        return counts_of(self.core.joint_states[world], int(self.core.done[world]))

    def snapshot(self, *, worlds: Any = None) -> Snapshot:
        """Snapshots of some worlds, or of all, for `restore`."""
        self.check_open()
        numbers = self._numbers(worlds).tolist()
        return Snapshot(self._owner, {world: (self._worlds[world], self.core.state(world)) for world in numbers})

    def restore(self, snapshot: Snapshot) -> None:
        """Set worlds to their states in a snapshot. Raises InputError for a snapshot of other worlds."""
        self.check_open()
        if snapshot.owner is not self._owner:
            message = "is a snapshot of another simulation, or of this simulation with other parameters"
            raise InputError(message, key="snapshot", code="snapshot")
        for number, (world, state) in snapshot.states.items():
            self._note(number, world)
            self.core.put(number, world.prepared, state)
        self.blocks.discard()

    def reset(self, start: Start | Sequence[Start] | None = None, *, worlds: Any = None) -> None:
        """Reset worlds to an initial state. The worlds then give bitwise the same results as new worlds, and follow the
        references of the scenario or of `start`.

        start: one `Start` for all worlds, or a `Start` for each world; None: the scenario's initial state. Raises InputError
        and RobotError for unknown names, and for values that are not finite or beyond limits; then no world has changed.
        """
        self.check_open()
        numbers = self._numbers(worlds).tolist()
        given = Start() if start is None else start
        starts = [given] * len(numbers) if isinstance(given, Start) else list(given)
        if len(starts) != len(numbers):
            message = f"needs one `Start` for each world: {len(numbers)}"
            raise InputError(message, key="start", value=len(starts), code="worlds")
        for number, world in zip(numbers, list(map(self._setups.of, starts)), strict=True):
            if world.prepared is not self._worlds[number].prepared:
                self.core.take_over(number, world.prepared)
            self._note(number, world)
            self.core.start(number, world.started)
        self.blocks.discard()

    def set_state(
        self,
        positions: Mapping[str, Any],
        velocities: Mapping[str, Any] | None = None,
        motors: Mapping[str, Any] | None = None,
        *,
        worlds: Any = None,
    ) -> None:
        """Reset worlds to positions (rad, m) and velocities (rad/s, m/s) of the links and positions (rad) of the motors.

        Each mapping has an entry by joint: one number for all worlds, or a number for each world. For a joint with several
        motors, the entry of `motors` has a number for each motor, or the shape (worlds, motors). Parameters are unchanged.
        Raises InputError.
        """
        self.check_open()
        numbers = self._numbers(worlds)
        each, motors_of = (len(numbers),), {drive.name: drive.motors for drive in self.prepared.drives}
        links = {name: _spread(values, each, name) for name, values in positions.items()}
        speeds = {name: _spread(values, each, name) for name, values in (velocities or {}).items()}
        turned = {}
        for name, values in (motors or {}).items():
            # For a joint with one motor, a list contains one number for each world.
            count = motors_of.get(name, 1)
            shape = each if count == 1 and np.ndim(values) < 2 else (*each, count)
            turned[name] = _spread(values, shape, name).reshape(*each, -1)
        starts = [
            replace(
                self._worlds[world].start,
                positions={name: float(values[place]) for name, values in links.items()},
                velocities={name: float(values[place]) for name, values in speeds.items()},
                motors={name: values[place].tolist() for name, values in turned.items()},
            )
            for place, world in enumerate(numbers.tolist())
        ]
        self.reset(starts, worlds=numbers)

    def _note(self, number: int, world: WorldSetup) -> None:
        """Store parameters, inputs and initial state of a world."""
        if world.prepared is not self._worlds[number].prepared:
            self._absent[number] = self.columns.absent(world.prepared.drives)
        self._worlds[number] = world
        self.blocks.put(number, world.inputs)
        if len(self._sizes) > 1:
            own = 1 if world.prepared is self.prepared else kernel.OTHER
            self.core.strides[number, 2] = 0 if world.inputs.jumps else own

    def look(self, world: int) -> Engine:
        """The engine in the present state of a world, to read its model and its scene."""
        self.check_open()
        self._numbers(world)
        return self.core.look(world)

    # -- whole runs -------------------------------------------------------------------------------------------------

    @property
    def observes(self) -> bool:
        """Whether `rollout` can correct the worlds by measured positions: the whole loop is machine code."""
        return self.core.native and isinstance(self.core.engine_of(0), RigidEngine)

    def rollout(
        self,
        names: Sequence[str],
        *,
        start: Start | Sequence[Start] | None = None,
        steps: int | None = None,
        observer: Observer | None = None,
    ) -> dict[str, Array]:
        """Run worlds from their initial states. Returns quantities by name, (worlds, steps + 1, n), at the steps 0, 1, ...

        Values are NaN where a joint does not record a quantity, and after a world has diverged.

        Args:
            names: Quantities to return.
            start: Initial state of one world, or of several worlds (at most N); None: one world that starts as the scenario
                states.
            steps: Number of steps; None: the number of steps of the scenario.
            observer: Observer that corrects the worlds by measured positions; see `observes`.

        Raises:
            InputError: A name or value is wrong.
            SimulationError: The worlds cannot be observed.
            RobotError: Parameters are not physical.
        """
        starts = list(start) if isinstance(start, Sequence) else [start or Start()]
        if len(starts) > self.count:
            raise InputError(f"there are {self.count} worlds", key="start", value=len(starts), code="worlds")
        numbers = np.arange(len(starts))
        self.reset(starts, worlds=numbers)
        if observer is None:
            return self.record(names, steps=steps, worlds=numbers)
        engine = self.core.engine_of(0)
        if not (self.core.native and isinstance(engine, RigidEngine)):
            raise SimulationError("an observer needs an engine without contacts and with a compiled step")
        # Do not correct the followers, since each follows the corrected position of its master.
        followers = [drive.name in self.prepared.robot.followers for drive in self.prepared.drives]
        observer.measured[:, :, followers, 0] = np.nan
        self.core.corrections = Corrections(observer.measured, np.array(observer.gains), engine.coordinates)
        try:
            return self.record(names, steps=steps, worlds=numbers)
        finally:
            self.core.corrections = UNOBSERVED

    def record(self, names: Sequence[str], *, steps: int | None = None, worlds: Any = None) -> dict[str, Array]:
        """Quantities of a run of the worlds from their initial states; see `rollout`."""
        self.columns.check(names)
        numbers = self._numbers(worlds)
        total = self.prepared.scenario.steps if steps is None else count_of(steps)
        self.check_open()
        rows = self.blocks.run(numbers, total * self.substeps + 1, keep=True)
        for own, absent in zip(rows, self._absent[numbers], strict=True):
            own[:, absent] = np.nan
        return {name: values.copy() for name, values in self.columns.values(rows, names).items()}

    def device_arrays(self) -> dict[str, Any]:
        """Present state of worlds on a device of Warp, without a copy: arrays of Warp (N, n) in single precision by name
        (`link_position` in rad or m, `link_velocity`, `motor_1_velocity`, ...).

        The arrays stay valid, and change with every `advance`; after `reset` or `restore`, call this method again.
        `warp.to_torch`, `torch.from_dlpack` and `numpy.from_dlpack` (CPU) take them without a copy. Raises InputError without
        Warp.
        """
        self.check_open()
        if not self.on_warp:
            raise InputError("only worlds on Warp have arrays on a device", key="engine", hint=f"engine: {WARP}", code="warp")
        core: Any = self.core
        found: dict[str, Any] = core.device_arrays()
        return found

    def sane(self, world: int) -> bool:
        """Whether the world's motion is finite and its energy balance has been correct since the last reset. Raises
        SimulationError if the worlds are not watched.
        """
        self._check_watched()
        self._numbers(world)
        guard = EnergyGuard(self._worlds[world].started)
        return bool(self.healthy[world]) and guard.look(self.core.joint_states[world]) is None

    def prepared_of(self, world: int) -> Prepared:
        """The scenario with the parameters of a world."""
        self._numbers(world)
        return self._worlds[world].prepared

    # -- the rest ---------------------------------------------------------------------------------------------------

    def _numbers(self, worlds: Any) -> NDArray[np.int64]:
        """Numbers of the worlds that a mask (N,) or a list selects."""
        if worlds is None:
            return self._everyone
        given = np.asarray(worlds)
        if given.dtype == bool:
            if given.shape == (self.count,):
                return np.flatnonzero(given)
        elif given.dtype.kind in "iu" or not given.size:
            numbers = given.astype(np.int64).reshape(-1)
            if len({number for number in numbers.tolist() if 0 <= number < self.count}) == len(numbers):
                return numbers
        message = f"must be different numbers from 0 to {self.count - 1}, or a mask of {self.count} flags"
        raise InputError(message, key="worlds", value=worlds, code="worlds")

    def _check_adaptive(self) -> None:
        """Raise InputError if these worlds cannot take longer strides (`asrsim.simulation.strides`)."""
        found, hints = list(filter(is_watched, self.names)), {}
        if self._watched:
            hint = f"Record other quantities than {listed(found, 4)}" if found else "watched=False"
            hints["needs worlds without energies and stiffness"] = hint
        if not self.core.native:
            hints["needs the compiled loop"] = "engine: mujoco" if self.on_warp else "compiled=True"
        if hints:
            raise InputError(Problem(text, key="adaptive", hint=hint, code="adaptive") for text, hint in hints.items())

    def _check_watched(self) -> None:
        if not self._watched:
            raise SimulationError("energies and limits are computed with Worlds(..., watched=True) only")

    def check_open(self) -> None:
        """Raise SimulationError after `close`."""
        if self.closed:
            raise SimulationError("the simulation is closed: make a new one")

    def close(self) -> None:
        """Release the engines."""
        if not self.closed:
            self.closed = True
            self.core.close()
            self.blocks.close()

    def __enter__(self) -> Worlds:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _warp_core(prepared: Prepared, engine: Engine, count: int, device: str) -> Core:
    """Worlds on a device of Warp, whose module is imported only now."""
    from asrsim.simulation.warp_core import WarpCore

    return WarpCore(prepared, engine, worlds=count, device=device)


def _spread(values: Any, shape: tuple[int, ...], name: str) -> Array:
    """Values as an array of this shape; a single value is repeated. Raises InputError for values of another shape, and for
    values that are not numbers.
    """
    try:
        return np.broadcast_to(np.asarray(values, dtype=float), shape)
    except (TypeError, ValueError) as error:
        raise InputError(f"must be numbers of the shape {shape}", key=name, value=values, code="shape") from error


def check_number(value: Any, key: str) -> None:
    """Raise InputError if a value is not a whole number of at least 1."""
    if not isinstance(value, int | np.integer) or isinstance(value, bool) or value < 1:
        raise InputError("must be a whole number of at least 1", key=key, value=value, code="worlds")


def count_of(steps: int) -> int:
    """The number of steps as a Python integer. Raises InputError if it is negative."""
    if index(steps) < 0:
        raise InputError("must not be negative: restore a snapshot or reset to go back", key="steps", value=steps, code="steps")
    return index(steps)
