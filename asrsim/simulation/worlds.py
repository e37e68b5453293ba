"""Many worlds of one scenario, stepped together; environments, sweeps, identification and learning use them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import pairwise
from operator import index
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asrsim.engines.base import Engine, Model
from asrsim.errors import InputError, SimulationError
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.scenario.overrides import Overrides
from asrsim.signals.base import Signal
from asrsim.simulation.chunks import chunk_at, longest_chunk
from asrsim.simulation.core import make_core
from asrsim.simulation.divergence import EnergyGuard
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.inputs import Given, Inputs, joined
from asrsim.simulation.layout import EXTERNAL, GOALS, HEALTHY
from asrsim.simulation.observation import Counts, Observation, counts_of, observe
from asrsim.simulation.prepare import check_inertia, prepare
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.quantities import WATCHED, QuantitySelection

VARIANTS_KEPT = 256
"""Number of cached parameter sets with their robots, since the same parameters often recur with other references."""
Numbers = Mapping[str, Mapping[str, float]]
"""Values of parameters by joint or link, and by name, as in `asrsim.Prepared.vary`."""
Signals = Mapping[str, Mapping[str, Signal]]
"""Signals by joint, and by the name of the reference or `external_torque`."""


@dataclass(frozen=True, kw_only=True)
class Start:
    """Start of a world; values that are not given come from the scenario."""

    parameters: Numbers = field(default_factory=dict)
    references: Signals = field(default_factory=dict)
    positions: Mapping[str, float] = field(default_factory=dict)
    """Position of each joint's link, by joint, rad (m)."""
    velocities: Mapping[str, float] = field(default_factory=dict)
    """Velocity of each joint's link, by joint, rad/s (m/s)."""
    motors: Mapping[str, Sequence[float]] = field(default_factory=dict)
    """Positions of each joint's motors, by joint, rad; motors without an entry start at their link's position."""


@dataclass(frozen=True)
class Snapshots:
    """Complete states of some worlds."""

    owner: object
    worlds: tuple[int, ...]
    states: tuple[Any, ...]
    prepared: tuple[Prepared, ...]
    inputs: tuple[Inputs, ...]
    held: Array
    rows: Array
    given: Array


@dataclass
class InputBlock:
    """Inputs of some worlds for some substeps."""

    numbers: NDArray[np.int64]
    which: NDArray[np.int64]
    """Indices (m, 4): number of each world, of its set of inputs, of its row in the output, and of its set of wrenches, lengths
    and cuts."""
    given: Given
    end: int
    """Number of rows."""
    row: int = 0
    """Number of rows that have been simulated."""

    def references(self, place: int, count: int) -> Any:
        """References (count, joints, columns) of the world at `place`, in the last `count` simulated rows."""
        return self.given.references[self.which[place, 1]][self.row - count : self.row]


class Worlds:
    """N simulated worlds of one scenario, which the caller steps; a context manager that releases the engines.

        with asrsim.Worlds("arm.yaml", 64) as worlds:
            worlds.set_reference("joint_1", "equilibrium_position", targets)
            worlds.advance(20)
            worlds.observe().link_position

    Each world gives bitwise the same results as a separate `asrsim.Simulation`, in any order and on any number of threads. A
    world that diverges stops until its next reset; see `healthy`. The number of substeps is that of the scenario and does not
    depend on the parameters of the worlds. Raises the errors of `asrsim.prepare`.
    """

    def __init__(
        self,
        scenario: str | Path | Scenario | Prepared,
        count: int,
        *,
        variant: str | None = None,
        overrides: Overrides = (),
        ranges: Mapping[str, Mapping[str, tuple[float, float]]] | None = None,
        names: Sequence[str] | None = None,
        watched: bool = True,
        compiled: bool | None = None,
        expected_substeps: int | None = None,
        threads: int = 1,
    ) -> None:
        """Prepare the worlds.

        Args:
            scenario: As in `asrsim.Simulation`, which also explains variant, overrides, ranges and compiled.
            count: Number of worlds.
            names: Quantities that `read` and `rollout` return; None: all quantities that the joints record.
            watched: Whether energies and limits are computed in each step, for `counts` and `sane`. Without them, runs are
                a fifth faster.
            expected_substeps: Number of substeps that each world will take, from which the loop is chosen.
            threads: Number of threads that step the worlds, if the engine has a compiled step.
        """
        if index(count) < 1 or index(threads) < 1:
            raise InputError("must be at least 1", key="count", value=min(count, threads), code="worlds")
        if not isinstance(scenario, Prepared):
            scenario = prepare(scenario, variant=variant, overrides=overrides, ranges=ranges)
        substeps = expected_substeps or scenario.last_substep(None)
        self._begin(scenario, count, names=names, watched=watched, compiled=compiled, substeps=substeps, threads=threads)

    def _begin(
        self, prepared: Prepared, count: int, *, names: Sequence[str] | None, watched: bool, compiled: bool | None,
        substeps: int, threads: int = 1, chunk: int | None = None, watch: Callable[[], None] | None = None,
    ) -> None:  # fmt: skip
        """Make the engine, the core and the tables of the worlds.

        chunk: largest number of substeps whose inputs are sampled in one call. watch: called before each step of the engine.
        """
        self.prepared, self.count = prepared, count
        self.substeps = prepared.resolution.substeps
        """Number of substeps per step."""
        engine = prepared.make_engine()
        self._engines: dict[int, Engine] = {-1: engine}
        """Engines by number of the world that uses a separate engine; -1: the engine that all other worlds share."""
        self._pool: ThreadPoolExecutor | None = None
        try:
            self.joints = engine.joints
            self.chunk = longest_chunk(len(self.joints) * count, chunk)
            self.core, self.slow_because = make_core(
                prepared, engine, compiled=compiled, substeps=substeps, worlds=count, watch=watch
            )
            self._threads = threads if self.core.native else 1
            self._pool = ThreadPoolExecutor(threads) if self._threads > 1 else None
            self._names = names
            self.selection = QuantitySelection(prepared.drives, self.core.shape.motors, names)
            self._other: dict[int, QuantitySelection] = {}
            """Selections for worlds in which other joints record the selected quantities."""
            self._watched = watched or not WATCHED.isdisjoint(self.selection.names)
            self._home_inputs = inputs_of(prepared)
            self._signals: tuple[dict[tuple[str, str], Signal], Inputs] = {}, self._home_inputs
            """Latest signals of worlds by joint and reference, and the inputs made from them."""
            self._inputs = [self._home_inputs] * count
            self._own = [prepared] * count
            self._variants: dict[tuple[tuple[str, str, float], ...], Prepared] = {}
            """Prepared scenarios, by the parameters of the worlds."""
            self._begun: list[tuple[Sequence[float], Sequence[float]]] = [((), ())] * count
            columns = GOALS + self.core.shape.motors
            self._held = np.full((count, len(self.joints), columns), np.nan)
            """References that callers have set, which override the scenario's signals; NaN: not set."""
            self._rows = np.full((count, len(self.joints), len(self.selection.columns)), np.nan)
            """Logged columns (count, joints, columns) of each world at its last whole step."""
            self._given = np.full((count, len(self.joints), columns), np.nan)
            """Inputs (count, joints, input columns) of each world at its last whole step."""
            self._everyone = np.arange(count)
            self._block: InputBlock | None = None
            """Inputs of the next substeps; None after a change from outside."""
            self._owner = object()
            self.reset()
        except BaseException:
            self.close()
            raise

    # -- stepping ---------------------------------------------------------------------------------------------------

    @property
    def time(self) -> Array:
        """Simulated time of each world (N,) in s."""
        return np.round(self.core.done * self.prepared.substep, 12)

    @property
    def healthy(self) -> NDArray[np.bool_]:
        """Whether each world can continue, (N,); False after a divergence."""
        return np.asarray(self.core.fault[:, 0] == HEALTHY)

    @property
    def compiled(self) -> bool:
        """Whether the loop runs compiled."""
        return self.core.compiled

    def advance(self, steps: int = 1, *, worlds: Any = None) -> None:
        """Advance by a number of steps. worlds: mask (N,) or list of numbers; None: all. Diverged worlds do not move."""
        if index(steps) < 0:
            raise InputError("must not be negative: restore a snapshot or reset to go back", value=steps, code="steps")
        self._run(self._numbers(worlds), steps * self.substeps, keep=False)

    def _run(self, numbers: NDArray[np.int64], count: int, *, keep: bool) -> tuple[Array, Array]:
        """Advance by `count` substeps. With `keep`, returns rows (m, rows, joints, columns) at whole steps, and the inputs (m,
        columns, joints, rows) at these steps."""
        self._check_open()
        rows, joints = -(-count // self.substeps) if keep else 0, len(self.joints)
        kept = np.full((len(numbers), rows, joints, len(self.selection.columns)), np.nan)
        inputs = np.full((len(numbers), self._given.shape[2], joints, rows), np.nan)
        ran, start = 0, -(-self.core.done[numbers] // self.substeps)
        while ran < count and len(numbers):
            before = self.core.done[numbers]
            length = min(count - ran, *(chunk_at(k, self.chunk)[1] - k for k in set(before.tolist())))
            out, block = self.go_on(numbers, length)
            for place, world in enumerate(numbers.tolist()) if keep else ():
                first, found = whole_steps(int(before[place]), int(self.core.done[world]), self.substeps)
                at = slice(first - start[place], first - start[place] + found)
                kept[place, at] = out[place, :found]
                own = block.references(place, length)[first * self.substeps - before[place] :: self.substeps]
                inputs[place, :, :, at] = np.asarray(own[:found]).T
            ran += length
        return kept, inputs

    def go_on(self, numbers: NDArray[np.int64], length: int) -> tuple[Array, InputBlock]:
        """Advance by `length` substeps of one chunk. Returns rows (m, rows, joints, columns) at whole steps, and the inputs."""
        block = self._block
        if block is None or block.numbers is not numbers or block.row + length > block.end:
            block = self._make_block(numbers, length)
        # After an error the worlds may have advanced by different numbers of substeps: the block is then discarded.
        self._block = None
        first, block.row = block.row, block.row + length
        out = np.empty((len(numbers), -(-length // self.substeps), *self._rows.shape[1:]))
        self._in_threads(
            block, first, length, self.substeps, int(self._watched), self.selection.columns, out, self._rows, self._given
        )
        self._block = block
        return out, block

    def _in_threads(self, block: InputBlock, *options: Any) -> None:
        which = block.which
        if self._pool is None or len(which) < 2:
            self.core.run(which, block.given, *options)
            return
        edges = np.linspace(0, len(which), min(self._threads, len(which)) + 1).astype(int).tolist()
        list(self._pool.map(lambda pair: self.core.run(which[slice(*pair)], block.given, *options), pairwise(edges)))

    def _make_block(self, numbers: NDArray[np.int64], length: int) -> InputBlock:
        """Inputs of the next substeps. Each block has more substeps than the block before, until the caller sets a
        reference."""
        if self._block is not None and self._block.numbers is numbers:
            ends = (chunk_at(substep, self.chunk)[1] - substep for substep in set(self.core.done[numbers].tolist()))
            length = max(length, min(2 * self._block.end, *ends))
        alike: dict[tuple[int, int], list[int]] = {}
        for place, world in enumerate(numbers.tolist()):
            alike.setdefault((id(self._inputs[world]), int(self.core.done[world])), []).append(place)
        parts: list[Given] = []
        count = 0
        which = np.empty((len(numbers), 4), dtype=np.int64)
        which[:, 0], which[:, 2] = numbers, self._everyone[: len(numbers)]
        for (_, substep), places in alike.items():
            worlds = numbers[places]
            inputs, held = self._inputs[worlds[0]], self._held[worlds]
            free = bool(np.isnan(held).all())
            begin, end = chunk_at(substep, self.chunk)
            chunk, first = inputs.chunk(begin, end - begin), substep - begin
            which[places, 1] = count if free else count + np.arange(len(places))
            which[places, 3] = len(parts)
            parts.append(inputs.given(chunk, first, first + length, None if free else held))
            count += len(parts[-1].inputs)
        return InputBlock(numbers, which, self.core.taken(joined(parts)), length)

    # -- from outside -----------------------------------------------------------------------------------------------

    def set_reference(self, joint: str, reference: str, values: Any, *, worlds: Any = None) -> Array:
        """Set a reference (by its name in the joint's mode) or `external_torque` from the next step on. Returns the values set.

        values: one value for all worlds, or a value for each world; values are clamped to the declared range. None: the
        scenario's signal acts again. Raises InputError.
        """
        self._check_open()
        numbers = self._numbers(worlds)
        j, slot = self.prepared.slot_of(joint, reference)
        low, high = self.prepared.range_of(joint, reference)
        held: Any = np.nan
        if isinstance(values, float):
            # A single number, which controllers set in every step, is handled without arrays, since this is faster.
            held, finite = min(max(values, low), high), math.isfinite(values)
        elif values is not None:
            given = _spread(values, (len(numbers),), reference)
            held, finite = np.clip(given, low, high), bool(np.isfinite(given).all())
        if values is not None and not finite:
            raise InputError(f"{reference} of '{joint}' must be finite", code="reference-value")
        self._held[numbers, j, slot] = held
        self._block = None
        return np.asarray(self._held[numbers, j, slot])

    def push(self, torques: Array) -> None:
        """Set the external torques (N, n) in N m on all links of all worlds from the next step on; declared ranges do not
        apply. Raises InputError for values that are not finite."""
        self._check_open()
        if not np.isfinite(torques).all():
            raise InputError("must be finite", key="torques", code="reference-value")
        self._held[:, :, EXTERNAL] = torques
        self._block = None

    def observe(self) -> Observation:
        """Present states; arrays are (N, n) in the order of worlds and joints, and `time` is (N,)."""
        self._check_open()
        return observe(self.time, self.prepared.drives, self.core.S, self.prepared.substep)

    def read(self, names: Sequence[str]) -> dict[str, Array]:
        """Quantities by name, as arrays (N, n); see `asrsim.Simulation.read`."""
        self._check_open()
        self.selection.check(names)
        rows, given = self._rows, self._given
        fresh = np.flatnonzero((self.core.done == 0) & self.healthy)
        if len(fresh):
            states = [self.core.state(world) for world in fresh.tolist()]
            before = rows.copy(), given.copy()
            self._run(fresh, 1, keep=False)
            rows, given = self._rows, self._given
            self._rows, self._given = before
            for world, state in zip(fresh.tolist(), states, strict=True):
                self.core.put(world, state)
        values = {name: found.copy() for name, found in self.selection.values(rows, given.T, names).items()}
        for world, selection in self._other.items():
            for name, own in selection.values(rows[world][None], given[world].T[:, :, None], names).items():
                values[name][world] = own[0]
        return values

    @property
    def model(self) -> Model | None:
        """Kinematics and dynamics of the scenario's robot; None if the engine prescribes the motion of the links."""
        self._check_open()
        return self._engines[-1].model

    def counts(self, world: int) -> Counts:
        """Number of substeps in which each limit of a world acted since its start. Raises SimulationError if not watched."""
        self._check_watched()
        self._numbers(world)
        return counts_of(self.core.S[world], int(self.core.done[world]))

    def snapshot(self, *, worlds: Any = None) -> Snapshots:
        """Snapshots of some worlds, or of all, for `restore`."""
        self._check_open()
        chosen = self._numbers(worlds)
        numbers = tuple(chosen.tolist())
        return Snapshots(
            self._owner, numbers, tuple(self.core.state(world) for world in numbers),
            tuple(self._own[world] for world in numbers), tuple(self._inputs[world] for world in numbers),
            self._held[chosen].copy(), self._rows[chosen].copy(), self._given[chosen].copy(),
        )  # fmt: skip

    def restore(self, snapshot: Snapshots) -> None:
        """Set worlds to their states in a snapshot. Raises InputError for a snapshot of other worlds."""
        self._check_open()
        if snapshot.owner is not self._owner:
            raise InputError("is a snapshot of other worlds", key="snapshot", code="snapshot")
        for place, world in enumerate(snapshot.worlds):
            if self._own[world] is not snapshot.prepared[place]:
                self.take_over(world, snapshot.prepared[place])
            self.core.put(world, snapshot.states[place])
            self._inputs[world] = snapshot.inputs[place]
        numbers = list(snapshot.worlds)
        self._block = None
        self._held[numbers], self._rows[numbers], self._given[numbers] = snapshot.held, snapshot.rows, snapshot.given

    def reset(self, start: Start | Sequence[Start] | None = None, *, worlds: Any = None) -> None:
        """Reset worlds to a start. The worlds then give bitwise the same results as new worlds, and follow the references of
        the scenario or of `start`.

        start: one start for all worlds, or a start for each world. Raises InputError and RobotError for unknown names, and for
        values that are not finite or beyond limits.
        """
        self._check_open()
        numbers = self._numbers(worlds).tolist()
        given = Start() if start is None else start
        starts = [given] * len(numbers) if isinstance(given, Start) else list(given)
        if len(starts) != len(numbers):
            message = f"needs one start for each world: {len(numbers)}"
            raise InputError(message, key="start", value=len(starts), code="worlds")
        for world, one in zip(numbers, starts, strict=True):
            self._begin_world(world, one)

    def set_state(
        self, positions: Mapping[str, Any], velocities: Mapping[str, Any] | None = None,
        motors: Mapping[str, Any] | None = None, *, worlds: Any = None,
    ) -> None:  # fmt: skip
        """Reset worlds to positions (rad, m) and velocities (rad/s, m/s) of the links and positions (rad) of the motors.

        All tables are by joint, with one number for all worlds or a number for each world; for joints with several motors, a
        number for each motor, or (worlds, motors). Parameters are unchanged. Raises InputError.
        """
        self._check_open()
        numbers = self._numbers(worlds)
        counts = {drive.name: drive.actuator.motors if drive.actuator else 0 for drive in self.prepared.drives}
        one = (len(numbers),)
        links = [
            {name: _spread(given, one, name) for name, given in (table or {}).items()} for table in (positions, velocities)
        ]
        turned = {}
        for name, given in (motors or {}).items():
            # For a joint with one motor, a list contains one number for each world.
            many = counts.get(name, 1)
            turned[name] = (
                _spread(given, one, name)[:, None] if many == 1 and np.ndim(given) < 2 else _spread(given, (*one, many), name)
            )
        starts = [
            Start(
                positions={name: float(table[place]) for name, table in links[0].items()},
                velocities={name: float(table[place]) for name, table in links[1].items()},
                motors={name: table[place].tolist() for name, table in turned.items()},
            )
            for place in range(len(numbers))
        ]
        for start in starts:
            self.prepared.start(start.positions, start.velocities, start.motors)
        for world, start in zip(numbers.tolist(), starts, strict=True):
            self.place(world, start)

    def _begin_world(self, world: int, start: Start) -> None:
        home = self.prepared
        key = tuple((owner, *row) for owner, table in sorted(start.parameters.items()) for row in sorted(table.items()))
        known = self._variants.get(key) if key else home
        varied = known or home.with_numbers(start.parameters)
        if varied is not self._own[world]:
            self.take_over(world, varied, settled=known is not None)
            if known is None:
                if len(self._variants) >= VARIANTS_KEPT:
                    self._variants.clear()
                self._variants[key] = self._own[world]
        if start.references:
            signals = {(joint, name): one for joint, table in start.references.items() for name, one in table.items()}
            latest = self._signals[0]
            if latest.keys() != signals.keys() or any(latest[key] is not one for key, one in signals.items()):
                self._signals = signals, inputs_of(self.prepared.with_references(start.references))
            self._inputs[world] = self._signals[1]
        else:
            self._inputs[world] = self._home_inputs
        self.place(world, start)

    def take_over(self, world: int, varied: Prepared, *, settled: bool = False) -> Prepared:
        """Change the parameters of a world, which must then be placed at its start. Returns the parameters with the start.

        settled: whether `varied` already starts at equilibrium, if the scenario requires it. A world whose links have other
        inertias gets its own engine.
        """
        engine = self._engines[-1]
        if varied.robot.links != self.prepared.robot.links:
            engine = self._own_engine(world, varied)
            if engine.model is not None and not settled:
                check_inertia(varied.drives, engine.model.mass_matrix(varied.initial_positions))
        self._own[world] = varied = varied if settled else varied.settled(engine.model)
        self._other.pop(world, None)
        selection = self.selection.of(varied.drives)
        if selection.lacking != self.selection.lacking:
            self._other[world] = selection
        self.core.take_over(world, varied, engine)
        return varied

    def select(self, varied: Prepared) -> QuantitySelection:
        """Selection of quantities for joints with these parameters."""
        self.selection, self._other = QuantitySelection(varied.drives, self.core.shape.motors, self._names), {}
        self._rows = np.full((self.count, len(self.joints), len(self.selection.columns)), np.nan)
        return self.selection

    def engine_of(self, world: int) -> Engine:
        """The engine that steps a world."""
        return self.core.engine_of(world)

    def look(self, world: int) -> Engine:
        """The engine in the present state of a world, to read its model and its scene."""
        self._check_open()
        self._numbers(world)
        return self.core.look(world)

    def _own_engine(self, world: int, varied: Prepared) -> Engine:
        found = self._engines.get(world)
        if found is None or not found.vary(varied.robot):
            if found is not None:
                found.close()
            found = self._engines[world] = varied.make_engine()
        return found

    def place(self, world: int, start: Start) -> tuple[Sequence[float], Sequence[float]]:
        """Put a world at its start. Returns the start positions and velocities of the links."""
        prepared = self._own[world]
        positions, velocities = prepared.start(start.positions, start.velocities, start.motors)
        self.core.start(world, started(prepared, positions, start.motors), positions, velocities)
        self._begun[world] = positions, velocities
        self._block = None
        self._held[world] = self._rows[world] = self._given[world] = np.nan
        return positions, velocities

    # -- whole runs -------------------------------------------------------------------------------------------------

    def rollout(
        self, names: Sequence[str], *, start: Start | Sequence[Start] | None = None, steps: int | None = None
    ) -> dict[str, Array]:
        """Run worlds from their start. Returns quantities by name, (worlds, steps + 1, n), at all steps from 0 on.

        Values are NaN where a joint does not record a quantity, and after a world has diverged.

        Args:
            names: Quantities to return.
            start: Start of one world, or of several worlds, at most N; None: one world that starts as the scenario states.
            steps: Number of steps; None: those of the scenario.

        Raises:
            InputError: A name or value is wrong.
            RobotError: Parameters are not physical.
        """
        starts = list(start) if isinstance(start, Sequence) else [start or Start()]
        if len(starts) > self.count:
            raise InputError(f"there are {self.count} worlds", key="start", value=len(starts), code="worlds")
        numbers = np.arange(len(starts))
        self.reset(starts, worlds=numbers)
        return self.record(names, steps=steps, worlds=numbers)

    def record(self, names: Sequence[str], *, steps: int | None = None, worlds: Any = None) -> dict[str, Array]:
        """Quantities of a run of the worlds from their start; see `rollout`."""
        self.selection.check(names)
        numbers = self._numbers(worlds)
        total = (self.prepared.scenario.steps if steps is None else index(steps)) * self.substeps + 1
        if total < 1:
            raise InputError("must not be negative", key="steps", value=steps, code="steps")
        kept, inputs = self._run(numbers, total, keep=True)
        found: dict[str, Array] = {name: np.empty(kept.shape[:3]) for name in names}
        for place, world in enumerate(numbers.tolist()):
            selection = self._other.get(world, self.selection)
            for name, values in selection.values(kept[place], inputs[place], names).items():
                found[name][place] = values
        return found

    def sane(self, world: int) -> bool:
        """Whether the world's motion is finite and its energy balance has been correct since its start. Raises SimulationError
        if the worlds are not watched."""
        self._check_watched()
        model, prepared, state = self.look(world).model, self._own[world], self.core.S[world]
        if not self.healthy[world]:
            return False
        if model is None or prepared.stepping.released:
            return True
        alone = prepared.scenario.world.empty and prepared.scenario.fixed_base and not prepared.scenario.wrenches
        fault = EnergyGuard(model.energy(*self._begun[world])).look(model if alone else None, state, self.joints)
        return fault is None

    def prepared_of(self, world: int) -> Prepared:
        """The scenario with the parameters of a world."""
        self._numbers(world)
        return self._own[world]

    def model_of(self, robot: Robot) -> Model | None:
        """Kinematics and dynamics of a robot that differs in its inertials."""
        world = self.count
        engine = self._engines[-1]
        if robot.links != self.prepared.robot.links:
            engine = self._own_engine(world, replace(self.prepared, robot=robot, _spare=[]))
        return engine.model

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
        message = f"are different numbers from 0 to {self.count - 1}, or a mask of {self.count}"
        raise InputError(message, key="worlds", value=worlds, code="worlds")

    def _check_watched(self) -> None:
        if not self._watched:
            raise SimulationError("energies and limits are computed with Worlds(..., watched=True) only")

    def _check_open(self) -> None:
        if not self._engines:
            raise SimulationError("the worlds are closed: make new ones")

    def close(self) -> None:
        """Release the engines."""
        for engine in self._engines.values():
            engine.close()
        self._engines = {}
        if self._pool is not None:
            self._pool.shutdown()

    def __enter__(self) -> Worlds:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


def one_world(prepared: Prepared, **options: Any) -> Worlds:
    """A single world. options: arguments of `Worlds._begin`."""
    world = Worlds.__new__(Worlds)
    world._begin(prepared, 1, watched=True, **options)
    return world


def _spread(values: Any, shape: tuple[int, ...], name: str) -> Array:
    """Values as an array of this shape; a single value is repeated. Raises InputError for values of another shape, and for
    values that are not numbers."""
    try:
        return np.broadcast_to(np.asarray(values, dtype=float), shape)
    except (TypeError, ValueError) as error:
        raise InputError(f"must be numbers of the shape {shape}", key=name, value=values, code="shape") from error


def whole_steps(before: int, after: int, every: int) -> tuple[int, int]:
    """Index of the first whole step between two substeps, and number of whole steps between these substeps."""
    first = -(-before // every)
    return first, -(-after // every) - first


def inputs_of(prepared: Prepared) -> Inputs:
    """The input signals of the scenario."""
    staggered = prepared.stepping.staggered
    return Inputs(prepared.scenario, prepared.drives, substep=prepared.substep, staggered=staggered, sensors=prepared.sensors)


def started(prepared: Prepared, positions: Sequence[float], motors: Mapping[str, Sequence[float]]) -> tuple[SteppedJoint, ...]:
    """The drives with other start positions of links and motors; motors without a position start at their link's position."""
    drives = list(prepared.drives)
    for j, (drive, q) in enumerate(zip(prepared.drives, positions, strict=True)):
        if drive.initial_position != q or drive.name in motors:
            motor_positions = tuple(float(theta) for theta in motors.get(drive.name, ())) or drive.motor_positions
            drives[j] = replace(drive, initial_position=float(q), motor_positions=motor_positions)
    return tuple(drives)
