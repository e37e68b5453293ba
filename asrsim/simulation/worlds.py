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
from asrsim.simulation.counts import Counts, counts_of
from asrsim.simulation.divergence import EnergyGuard
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.inputs import Given, Inputs, joined
from asrsim.simulation.layout import GOALS, HEALTHY
from asrsim.simulation.observation import Observation, observe
from asrsim.simulation.prepare import check_inertia, prepare
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.quantities import EXTERNAL_TORQUE, WATCHED, Selection

VARIANTS_KEPT = 256
"""Number of cached parameter sets with their robots, since the same parameters often recur with other references."""
Numbers = Mapping[str, Mapping[str, float]]
"""Parameters: joint or link -> name -> value, as in `asrsim.Prepared.vary`."""
Signals = Mapping[str, Mapping[str, Signal]]
"""Joint -> reference, or `external_torque` -> signal."""


@dataclass(frozen=True, kw_only=True)
class Start:
    """Start of a world; values that are not given come from the scenario."""

    parameters: Numbers = field(default_factory=dict)
    references: Signals = field(default_factory=dict)
    positions: Mapping[str, float] = field(default_factory=dict)
    """Joint -> position of its link, rad (m)."""
    velocities: Mapping[str, float] = field(default_factory=dict)
    """Joint -> velocity of its link, rad/s (m/s)."""
    motors: Mapping[str, Sequence[float]] = field(default_factory=dict)
    """Joint -> positions of its motors, rad; others begin where their link is."""


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
class Block:
    """Inputs of some worlds for some substeps."""

    numbers: NDArray[np.int64]
    which: NDArray[np.int64]
    """(m, 4) worlds, and for each its set of inputs, its place and its set of wrenches, lengths and cuts."""
    given: Given
    end: int
    """Rows."""
    row: int = 0
    """Rows that are used up."""

    def references(self, place: int, count: int) -> Any:
        """(count, joints, columns) of one of its worlds, in the rows that were used last."""
        return self.given.references[self.which[place, 1]][self.row - count : self.row]


class Worlds:
    """N worlds of a scenario, stepped from outside; a context manager that releases the engines.

        with asrsim.Worlds("arm.yaml", 64) as worlds:
            worlds.set_reference("joint_1", "equilibrium_position", targets)
            worlds.advance(20)
            worlds.observe().link_position

    Each world is equal to a `asrsim.Simulation` of its own to the bit, in any order and on any number of threads. A
    world whose motion is no longer sane stops, which `healthy` tells; it goes on after a reset. Substeps are the scenario's:
    other numbers do not change them. Raises what `asrsim.prepare` raises.
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
        """count: number of worlds; names: quantities that `read` and `rollout` give, None: all that the
        scenario's joints record; watched: energies and limits are found at each step, as `counts` and `sane` need
        them; without it runs are a fifth faster; compiled, expected_substeps (of one
        world), variant, overrides and ranges: as of `asrsim.Simulation`; threads: that share the worlds where the engine
        has native code."""
        if index(count) < 1 or index(threads) < 1:
            raise InputError("must be 1 at least", key="count", value=min(count, threads), code="worlds")
        if not isinstance(scenario, Prepared):
            scenario = prepare(scenario, variant=variant, overrides=overrides, ranges=ranges)
        substeps = expected_substeps or scenario.last_substep(None)
        self._begin(scenario, count, names=names, watched=watched, compiled=compiled, substeps=substeps, threads=threads)

    def _begin(
        self, prepared: Prepared, count: int, *, names: Sequence[str] | None, watched: bool, compiled: bool | None,
        substeps: int, threads: int = 1, chunk: int | None = None, watch: Callable[[], None] | None = None,
    ) -> None:  # fmt: skip
        """chunk: substeps whose inputs are found at once, at most; watch: called before each step of the engine."""
        self.prepared, self.count = prepared, count
        self.substeps = prepared.resolution.substeps
        """Of a step."""
        engine = prepared.make_engine()
        self._engines: dict[int, Engine] = {-1: engine}
        """Number of a world -> the engine that it has for itself; -1: that of all others."""
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
            self.selection = Selection(prepared.drives, self.core.shape.motors, names)
            self._other: dict[int, Selection] = {}
            """Selections for worlds in which other joints record the selected quantities."""
            self._watched = watched or not WATCHED.isdisjoint(self.selection.names)
            self._home_inputs = inputs_of(prepared)
            self._signals: tuple[Signals, Inputs] = {}, self._home_inputs
            """Latest signals of worlds, and the inputs made from them."""
            self._inputs = [self._home_inputs] * count
            self._own = [prepared] * count
            self._variants: dict[tuple[tuple[str, str, float], ...], Prepared] = {}
            """Parameters of worlds -> the prepared scenario with these parameters."""
            self._begun: list[tuple[Sequence[float], Sequence[float]]] = [((), ())] * count
            columns = GOALS + self.core.shape.motors
            self._held = np.full((count, len(self.joints), columns), np.nan)
            """Values that callers have set instead of the scenario's signals; NaN: not set."""
            self._rows = np.full((count, len(self.joints), len(self.selection.columns)), np.nan)
            """Logged columns at the last whole step of each world, and its inputs (count, joints, input columns)."""
            self._given = np.full((count, len(self.joints), columns), np.nan)
            self._everyone = np.arange(count)
            self._block: Block | None = None
            """Inputs of the next substeps, while nothing is set from outside."""
            self._owner = object()
            self.reset()
        except BaseException:
            self.close()
            raise

    # -- stepping ---------------------------------------------------------------------------------------------------

    @property
    def time(self) -> Array:
        """(N,) simulated time in s."""
        return np.round(self.core.done * self.prepared.substep, 12)

    @property
    def healthy(self) -> NDArray[np.bool_]:
        """(N,) whether each world can continue; False after a divergence."""
        return np.asarray(self.core.fault[:, 0] == HEALTHY)

    @property
    def compiled(self) -> bool:
        """Whether the loop runs compiled."""
        return self.core.compiled

    def advance(self, steps: int = 1, *, worlds: Any = None) -> None:
        """Advance by a number of steps. worlds: mask (N,) or list of numbers; None: all. Diverged worlds do not move."""
        if index(steps) < 0:
            raise InputError("steps go forward only: restore a snapshot, or reset", value=steps, code="steps")
        self._run(self._numbers(worlds), steps * self.substeps, keep=False)

    def _run(self, numbers: NDArray[np.int64], count: int, *, keep: bool) -> tuple[Array, Array]:
        """Advance by `count` substeps; if they are to be kept, the rows of whole steps in them, (m, rows, joints, columns), and
        their inputs, (m, columns, joints, rows)."""
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

    def go_on(self, numbers: NDArray[np.int64], length: int) -> tuple[Array, Block]:
        """Advance by some substeps of one chunk: rows (m, rows, joints, columns) at whole steps, and the inputs."""
        block = self._block
        if block is None or block.numbers is not numbers or block.row + length > block.end:
            block = self._make_block(numbers, length)
        # A run that fails leaves no block, since its worlds have not gone on alike.
        self._block = None
        first, block.row = block.row, block.row + length
        out = np.empty((len(numbers), -(-length // self.substeps), *self._rows.shape[1:]))
        self._in_threads(
            block, first, length, self.substeps, int(self._watched), self.selection.columns, out, self._rows, self._given
        )
        self._block = block
        return out, block

    def _in_threads(self, block: Block, *options: Any) -> None:
        which = block.which
        if self._pool is None or len(which) < 2:
            self.core.run(which, block.given, *options)
            return
        edges = np.linspace(0, len(which), min(self._threads, len(which)) + 1).astype(int).tolist()
        list(self._pool.map(lambda pair: self.core.run(which[slice(*pair)], block.given, *options), pairwise(edges)))

    def _make_block(self, numbers: NDArray[np.int64], length: int) -> Block:
        """Inputs of the next substeps: of more from block to block, as long as nothing is set from outside."""
        if self._block is not None and self._block.numbers is numbers:
            ends = (chunk_at(substep, self.chunk)[1] - substep for substep in set(self.core.done[numbers].tolist()))
            length = max(length, min(2 * self._block.end, *ends))
        alike: dict[tuple[int, int], list[int]] = {}
        for place, world in enumerate(numbers.tolist()):
            alike.setdefault((id(self._inputs[world]), int(self.core.done[world])), []).append(place)
        parts: list[Given] = []
        count = 0
        which = np.column_stack([numbers, numbers, np.arange(len(numbers)), numbers])
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
        return Block(numbers, which, self.core.taken(joined(parts)), length)

    # -- from outside -----------------------------------------------------------------------------------------------

    def set_reference(self, joint: str, reference: str, values: Any, *, worlds: Any = None) -> Array:
        """Hold a reference (by its mode's name), or `external_torque`, from now on: one value for all, or one a world; None:
        follow the scenario. Returns what is held, (m,): values beyond the declared range are clamped to it. Raises InputError.
        """
        numbers = self._numbers(worlds)
        j, slot = self.prepared.slot_of(joint, reference)
        low, high = self.prepared.range_of(joint, reference)
        held: Any = np.nan
        if isinstance(values, float):
            # A single number, as controllers set at every step: faster without arrays.
            held, finite = min(max(values, low), high), math.isfinite(values)
        elif values is not None:
            given = np.broadcast_to(np.asarray(values, dtype=float), len(numbers))
            held, finite = np.clip(given, low, high), bool(np.isfinite(given).all())
        if values is not None and not finite:
            raise InputError(f"{reference} of '{joint}' must be finite", code="reference-value")
        self._held[numbers, j, slot] = held
        self._block = None
        return np.asarray(self._held[numbers, j, slot])

    def observe(self) -> Observation:
        """The states now; arrays are (N, n) in the order of worlds and joints, and `time` is (N,)."""
        self._check_open()
        return observe(self.time, self.prepared.drives, self.core.S, self.prepared.substep)

    def read(self, names: Sequence[str]) -> dict[str, Array]:
        """Quantities by name, (N, n) each; see `asrsim.Simulation.read`."""
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
        """Kinematics and dynamics of the scenario's robot; None where its links have no dynamics."""
        return self._engines[-1].model

    def counts(self, world: int) -> Counts:
        """Number of substeps in which each limit of a world acted since its start. Raises SimulationError if not watched."""
        self._check_watched()
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
        """Some worlds, or all, back to a start, with the bits of fresh ones; references follow the scenario, or the start's
        signals. start: one for all, or one a world. Raises InputError and RobotError for what is unknown, not finite or beyond
        limits.
        """
        self._check_open()
        numbers = self._numbers(worlds).tolist()
        given = start or Start()
        starts = [given] * len(numbers) if isinstance(given, Start) else list(given)
        if len(starts) != len(numbers):
            message = f"needs one start a world: {len(numbers)}"
            raise InputError(message, key="start", value=len(starts), code="worlds")
        for world, one in zip(numbers, starts, strict=True):
            self._begin_world(world, one)

    def set_state(
        self, positions: Mapping[str, Any], velocities: Mapping[str, Any] | None = None,
        motors: Mapping[str, Any] | None = None, *, worlds: Any = None,
    ) -> None:  # fmt: skip
        """Put worlds at time 0 with links there (rad, m), moving so (rad/s, m/s), motors there (rad); by joint, one number for
        all or one a world. Numbers of the robot stay. Raises InputError."""
        numbers = self._numbers(worlds)
        for place, world in enumerate(numbers.tolist()):

            def pick(table: Mapping[str, Any] | None, place: int = place) -> dict[str, float]:
                return {k: float(np.broadcast_to(v, len(numbers))[place]) for k, v in (table or {}).items()}

            own = {joint: np.atleast_2d(values)[place % len(np.atleast_2d(values))] for joint, values in (motors or {}).items()}
            self.place(world, Start(positions=pick(positions), velocities=pick(velocities), motors=own))

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
            if self._signals[0] is not start.references:
                self._signals = start.references, inputs_of(_with_signals(self.prepared, start.references))
            self._inputs[world] = self._signals[1]
        else:
            self._inputs[world] = self._home_inputs
        self.place(world, start)

    def take_over(self, world: int, varied: Prepared, *, signals: bool = False, settled: bool = False) -> Prepared:
        """Give a world other numbers, and other signals if they are to change; it has to be placed then. Its engine is that of
        all unless a link weighs something else. Returns the numbers, with the start at rest if the scenario asks for that;
        settled: they have it already."""
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
        if signals:
            self._inputs[world] = inputs_of(varied)
        return varied

    def select(self, varied: Prepared) -> Selection:
        """Selection of quantities for joints with these parameters."""
        self.selection, self._other = Selection(varied.drives, self.core.shape.motors, self._names), {}
        self._rows = np.full((self.count, len(self.joints), len(self.selection.columns)), np.nan)
        return self.selection

    def engine_of(self, world: int) -> Engine:
        """The engine that steps a world."""
        return self.core.engine_of(world)

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
        positions, velocities = prepared.start(start.positions, start.velocities)
        self.core.start(world, started(prepared, positions, start.motors), positions, velocities)
        self._begun[world] = positions, velocities
        self._block = None
        self._held[world] = self._rows[world] = self._given[world] = np.nan
        return positions, velocities

    # -- whole runs -------------------------------------------------------------------------------------------------

    def rollout(
        self,
        names: Sequence[str],
        *,
        parameters: Numbers | Sequence[Numbers] = (),
        references: Signals | Sequence[Signals] = (),
        start: Start | Sequence[Start] | None = None,
        steps: int | None = None,
    ) -> dict[str, Array]:
        """Run worlds from their start: quantities by name, (worlds, steps + 1, n), at whole steps from 0 on. NaN where a joint
        does not record a quantity, and from where a world's motion is no longer sane.

        As many worlds run as the longest of the sequences has entries, at most N; what is given once is for all. parameters,
        references: laid over those of `start`. steps: None: the scenario's. Raises InputError, and RobotError for unphysical
        numbers.
        """
        lists = [_listed(given) for given in (parameters, references, start)]
        count = max((len(one) for one in lists if one is not None), default=1)
        if count > self.count or any(one is not None and len(one) not in (1, count) for one in lists):
            message = f"there are {self.count} worlds, and what is given for each must have the same length"
            raise InputError(message, key="rollout", value=count, code="worlds")
        tables, signals, begins = [list(one) * (count // len(one)) if one else [None] * count for one in lists]
        numbers = np.arange(count)
        for world, table, own, begin in zip(numbers.tolist(), tables, signals, begins, strict=True):
            base = begin or Start()
            self._begin_world(
                world, replace(base, parameters=_merged(base.parameters, table), references=_merged(base.references, own))
            )
        return self.record(names, steps=steps, worlds=numbers)

    def record(self, names: Sequence[str], *, steps: int | None = None, worlds: Any = None) -> dict[str, Array]:
        """Quantities of a run of the worlds from their start; see `rollout`."""
        self.selection.check(names)
        numbers = self._numbers(worlds)
        total = (self.prepared.scenario.steps if steps is None else index(steps)) * self.substeps + 1
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
        prepared, model, state = self._own[world], self.core.look(world).model, self.core.S[world]
        if not self.healthy[world]:
            return False
        if model is None or prepared.stepping.released:
            return True
        alone = prepared.scenario.world.empty and prepared.scenario.fixed_base and not prepared.scenario.wrenches
        fault = EnergyGuard(model.energy(*self._begun[world])).look(model if alone else None, state, self.joints)
        return fault is None

    def prepared_of(self, world: int) -> Prepared:
        """The scenario with the parameters of a world."""
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
        """Numbers of the worlds of a mask (N,) or of a list."""
        if worlds is None:
            return self._everyone
        given = np.asarray(worlds)
        numbers = np.flatnonzero(given) if given.dtype == bool else given.astype(np.int64).reshape(-1)
        if (given.dtype == bool and given.shape != (self.count,)) or ((numbers < 0) | (numbers >= self.count)).any():
            message = f"are numbers from 0 to {self.count - 1}, or a mask of {self.count}"
            raise InputError(message, key="worlds", value=worlds, code="worlds")
        return numbers

    def _check_watched(self) -> None:
        if not self._watched:
            raise SimulationError("energies and limits are known of worlds that are watched only: Worlds(..., watched=True)")

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
    """A single world; options: as of `Worlds._begin`."""
    world = Worlds.__new__(Worlds)
    world._begin(prepared, 1, watched=True, **options)
    return world


def whole_steps(before: int, after: int, every: int) -> tuple[int, int]:
    """Number of the first whole step from one substep to another, and how many there are."""
    first = -(-before // every)
    return first, -(-after // every) - first


def inputs_of(prepared: Prepared) -> Inputs:
    """The input signals of the scenario."""
    staggered = prepared.stepping.staggered
    return Inputs(prepared.scenario, prepared.drives, substep=prepared.substep, staggered=staggered, sensors=prepared.sensors)


def started(prepared: Prepared, positions: Sequence[float], motors: Mapping[str, Sequence[float]]) -> tuple[SteppedJoint, ...]:
    """The drives, begun at other positions of links and motors; motors that are not named begin where their link is."""
    drives = list(prepared.drives)
    for j, (drive, q) in enumerate(zip(prepared.drives, positions, strict=True)):
        if drive.initial_position != q or drive.name in motors:
            motor_positions = tuple(float(theta) for theta in motors.get(drive.name, ())) or drive.motor_positions
            drives[j] = replace(drive, initial_position=float(q), motor_positions=motor_positions)
    return tuple(drives)


def _with_signals(prepared: Prepared, signals: Signals) -> Prepared:
    """A copy with other references and external torques of some joints."""
    own = {joint: {k: v for k, v in table.items() if k != EXTERNAL_TORQUE} for joint, table in signals.items()}
    torques = {joint: table[EXTERNAL_TORQUE] for joint, table in signals.items() if EXTERNAL_TORQUE in table}
    changed = prepared.with_references(own)
    torques = {**changed.scenario.external_torques, **torques}
    return replace(changed, scenario=replace(changed.scenario, external_torques=torques))


def _listed(given: Any) -> list[Any] | None:
    """The value, or the values for each world, as a list; None if nothing is given."""
    if given is None or (isinstance(given, Sequence) and not given):
        return None
    return list(given) if isinstance(given, Sequence) else [given]


def _merged(
    first: Mapping[str, Mapping[str, Any]], second: Mapping[str, Mapping[str, Any]] | None
) -> Mapping[str, Mapping[str, Any]]:
    """Two nested tables merged; values of the second override those of the first."""
    if not second:
        return first
    return {joint: {**first.get(joint, {}), **second.get(joint, {})} for joint in {**first, **second}}
