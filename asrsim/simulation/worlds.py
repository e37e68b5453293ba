"""Many worlds of one scenario: what environments, sweeps, identification and learning step side by side."""

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
"""Sets of numbers whose robots, at their starts, are kept: the same numbers come again with other references."""
Numbers = Mapping[str, Mapping[str, float]]
"""Joint or link -> name -> value, as :meth:`asrsim.Prepared.vary` takes them."""
Signals = Mapping[str, Mapping[str, Signal]]
"""Joint -> reference, or `external_torque` -> signal."""


@dataclass(frozen=True, kw_only=True)
class Start:
    """How a world begins; what is left out is as the scenario has it."""

    parameters: Numbers = field(default_factory=dict)
    references: Signals = field(default_factory=dict)
    positions: Mapping[str, float] = field(default_factory=dict)
    """Of links, rad (m)."""
    velocities: Mapping[str, float] = field(default_factory=dict)
    """rad/s (m/s)."""
    motors: Mapping[str, Sequence[float]] = field(default_factory=dict)
    """Joint -> positions of its motors, rad; others begin where their link is."""


@dataclass(frozen=True)
class Snapshots:
    """Everything that decides how some worlds go on."""

    owner: object
    worlds: tuple[int, ...]
    states: tuple[Any, ...]
    prepared: tuple[Prepared, ...]
    inputs: tuple[Inputs, ...]
    held: Array
    rows: Array
    given: Array


class Worlds:
    """N worlds of a scenario, stepped from outside; a context manager that releases the engines.

        with asrsim.Worlds("arm.yaml", 64) as worlds:
            worlds.set_reference("joint_1", "equilibrium_position", targets)
            worlds.advance(20)
            worlds.observe().link_position

    Each world is equal to a :class:`asrsim.Simulation` of its own to the bit, in any order and on any number of threads. A
    world whose motion is no longer sane stops, which `healthy` tells; it goes on after a reset. Substeps are the scenario's:
    other numbers do not change them. Raises what :func:`asrsim.prepare` raises.
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
        """count: number of worlds; names: quantities that :meth:`read` and :meth:`rollout` give, None: all that the
        scenario's joints record; watched: energies and limits are found at each step, as :meth:`counts` and :meth:`sane` need
        them; without it runs are a fifth faster; compiled, expected_substeps (of one
        world), variant, overrides and ranges: as of :class:`asrsim.Simulation`; threads: that share the worlds where the engine
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
            """Of worlds in which other joints record what is selected."""
            self._watched = watched or not WATCHED.isdisjoint(self.selection.names)
            self._home_inputs = inputs_of(prepared)
            self._signals: tuple[Signals, Inputs] = {}, self._home_inputs
            """Those that worlds had last, and what they are as inputs."""
            self._inputs = [self._home_inputs] * count
            self._own = [prepared] * count
            self._variants: dict[tuple[tuple[str, str, float], ...], Prepared] = {}
            """Numbers that worlds had -> the robot with them, at its start."""
            self._begun: list[tuple[Sequence[float], Sequence[float]]] = [((), ())] * count
            columns = GOALS + self.core.shape.motors
            self._held = np.full((count, len(self.joints), columns), np.nan)
            """What is set from outside in place of the scenario's signals; NaN: nothing."""
            self._rows = np.full((count, len(self.joints), len(self.selection.columns)), np.nan)
            """Logged columns at the last whole step of each world, and its inputs (count, input columns, joints)."""
            self._given = np.full((count, columns, len(self.joints)), np.nan)
            self._owner = object()
            self.reset()
        except BaseException:
            self.close()
            raise

    # -- stepping ---------------------------------------------------------------------------------------------------

    @property
    def time(self) -> Array:
        """(N,) s that are simulated."""
        return np.round(self.core.done * self.prepared.substep, 12)

    @property
    def healthy(self) -> NDArray[np.bool_]:
        """(N,) whether the world's motion is sane."""
        return np.asarray(self.core.fault[:, 0] == HEALTHY)

    @property
    def compiled(self) -> bool:
        """Whether the loop runs compiled."""
        return self.core.compiled

    def advance(self, steps: int = 1, *, worlds: Any = None) -> None:
        """Go on by a number of steps, in the worlds of a mask (N,) or list of numbers, or all. Stopped worlds stay."""
        if index(steps) < 0:
            raise InputError("steps go forward only: restore a snapshot, or reset", value=steps, code="steps")
        self._run(self._numbers(worlds), steps * self.substeps, keep=False)

    def _run(self, numbers: NDArray[np.int64], count: int, *, keep: bool) -> tuple[Array, Array]:
        """Advance by `count` substeps; if they are to be kept, the rows of whole steps in them, (m, rows, joints, columns), and
        their inputs, (m, columns, joints, rows)."""
        self._check_open()
        rows, joints = -(-count // self.substeps) if keep else 0, len(self.joints)
        kept = np.full((len(numbers), rows, joints, len(self.selection.columns)), np.nan)
        inputs = np.full((len(numbers), self._given.shape[1], joints, rows), np.nan)
        ran, start = 0, -(-self.core.done[numbers] // self.substeps)
        while ran < count and len(numbers):
            before = self.core.done[numbers]
            length = min(count - ran, *(chunk_at(k, self.chunk)[1] - k for k in set(before.tolist())))
            out, first, found, references, sets = self.go_on(numbers, length)
            for place in range(len(numbers)) if keep else ():
                at = slice(first[place] - start[place], first[place] - start[place] + found[place])
                kept[place, at] = out[place, : found[place]]
                own = references[:, :, sets[place], first[place] * self.substeps - before[place] :: self.substeps]
                inputs[place, :, :, at] = own[:, :, : found[place]]
            ran += length
        return kept, inputs

    def go_on(self, numbers: NDArray[np.int64], length: int) -> tuple[Array, Any, Any, Array, Any]:
        """Advance by some substeps of one chunk: rows (m, rows, joints, columns) at whole steps; (m,) the number of the first
        one of each world, and (m,) how many they are; references of all substeps (columns, joints, sets, n), and (m,) the set
        of each world."""
        done, every, columns = self.core.done, self.substeps, self.selection.columns
        before = done[numbers]
        given, sets, references = self._inputs_for(numbers, length)
        out = np.empty((len(numbers), -(-length // every), len(self.joints), len(columns)))
        self._in_threads(np.column_stack([numbers, sets]), given, out)
        first = -(-before // every)
        found = -(-done[numbers] // every) - first
        # Of the worlds that came by a whole step.
        places = np.flatnonzero(found > 0)
        last = found[places] - 1
        self._rows[numbers[places]] = out[places, last]
        at = (first[places] + last) * every - before[places]
        self._given[numbers[places]] = references[:, :, sets[places], at].transpose(2, 0, 1)
        return out, first, found, references, sets

    def _in_threads(self, which: NDArray[np.int64], given: Given, out: Array) -> None:
        options: Any = self.substeps, self._watched, self.selection.columns
        if self._pool is None or len(which) < 2:
            self.core.run(which, given, out, *options)
            return
        edges = np.linspace(0, len(which), min(self._threads, len(which)) + 1).astype(int).tolist()
        parts = [slice(a, b) for a, b in pairwise(edges)]
        list(self._pool.map(lambda part: self.core.run(which[part], given, out[part], *options), parts))

    def _inputs_for(self, numbers: NDArray[np.int64], length: int) -> tuple[Given, NDArray[np.int64], Array]:
        """Inputs of the next substeps, the number of each world's set, and references (columns, joints, sets, n)."""
        alike: dict[tuple[int, int], list[int]] = {}
        for place, world in enumerate(numbers.tolist()):
            alike.setdefault((id(self._inputs[world]), int(self.core.done[world])), []).append(place)
        parts, tables, count = [], [], 0
        sets = np.empty(len(numbers), dtype=np.int64)
        for (_, substep), places in alike.items():
            worlds = numbers[places]
            inputs, held = self._inputs[worlds[0]], self._held[worlds]
            free = bool(np.isnan(held).all())
            begin, end = chunk_at(substep, self.chunk)
            chunk, first = inputs.chunk(begin, end - begin), substep - begin
            given, references = inputs.given(chunk, first, first + length, None if free else held)
            sets[places] = count if free else count + np.arange(len(places))
            count += references.shape[2]
            parts.append(given)
            tables.append(references)
        return joined(parts), sets, tables[0] if len(tables) == 1 else np.concatenate(tables, axis=2)

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
            # As at every step of a controller: without arrays.
            held, finite = min(max(values, low), high), math.isfinite(values)
        elif values is not None:
            given = np.broadcast_to(np.asarray(values, dtype=float), len(numbers))
            held, finite = np.clip(given, low, high), bool(np.isfinite(given).all())
        if values is not None and not finite:
            raise InputError(f"{reference} of '{joint}' must be finite", code="reference-value")
        self._held[numbers, j, slot] = held
        return np.asarray(self._held[numbers, j, slot])

    def observe(self) -> Observation:
        """The states now; arrays are (N, n) in the order of worlds and joints, and `time` is (N,)."""
        self._check_open()
        return observe(self.time, self.prepared.drives, self.core.S, self.prepared.substep)

    def read(self, names: Sequence[str]) -> dict[str, Array]:
        """As :meth:`asrsim.Simulation.read`, (N, n) each."""
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
        values = {name: found.copy() for name, found in self.selection.values(rows, given.transpose(1, 2, 0), names).items()}
        for world, selection in self._other.items():
            for name, own in selection.values(rows[world][None], given[world][:, :, None], names).items():
                values[name][world] = own[0]
        return values

    @property
    def model(self) -> Model | None:
        """Kinematics and dynamics of the scenario's robot; None where its links have no dynamics."""
        return self._engines[-1].model

    def counts(self, world: int) -> Counts:
        """Limits that a world met since its start. Raises SimulationError where worlds are not watched."""
        self._check_watched()
        return counts_of(self.core.S[world], int(self.core.done[world]))

    def snapshot(self, *, worlds: Any = None) -> Snapshots:
        """The states of some worlds, or all, to be given to :meth:`restore`."""
        self._check_open()
        chosen = self._numbers(worlds)
        numbers = tuple(chosen.tolist())
        return Snapshots(
            self._owner, numbers, tuple(self.core.state(world) for world in numbers),
            tuple(self._own[world] for world in numbers), tuple(self._inputs[world] for world in numbers),
            self._held[chosen].copy(), self._rows[chosen].copy(), self._given[chosen].copy(),
        )  # fmt: skip

    def restore(self, snapshot: Snapshots) -> None:
        """Continue those worlds from a snapshot, to the bit. Raises InputError for one of other worlds."""
        self._check_open()
        if snapshot.owner is not self._owner:
            raise InputError("is a snapshot of other worlds", key="snapshot", code="snapshot")
        for place, world in enumerate(snapshot.worlds):
            if self._own[world] is not snapshot.prepared[place]:
                self.take_over(world, snapshot.prepared[place])
            self.core.put(world, snapshot.states[place])
            self._inputs[world] = snapshot.inputs[place]
        numbers = list(snapshot.worlds)
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
        """Read from now on what the joints with these numbers record."""
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
        """Put a world at its start; positions and velocities of the links then."""
        prepared = self._own[world]
        positions, velocities = prepared.start(start.positions, start.velocities)
        self.core.start(world, started(prepared, positions, start.motors), positions, velocities)
        self._begun[world] = positions, velocities
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
        """Run worlds, or all, from their start on; see :meth:`rollout`."""
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
        """Whether the world's motion is finite, and no energy came from nowhere since its start. Raises SimulationError where
        worlds are not watched."""
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
        """The scenario with the numbers that a world has."""
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
            return np.arange(self.count)
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
    """The same under other references and external torques of some joints."""
    own = {joint: {k: v for k, v in table.items() if k != EXTERNAL_TORQUE} for joint, table in signals.items()}
    torques = {joint: table[EXTERNAL_TORQUE] for joint, table in signals.items() if EXTERNAL_TORQUE in table}
    changed = prepared.with_references(own)
    torques = {**changed.scenario.external_torques, **torques}
    return replace(changed, scenario=replace(changed.scenario, external_torques=torques))


def _listed(given: Any) -> list[Any] | None:
    """What is given once, or for each world, as a list; None where nothing is."""
    if given is None or (isinstance(given, Sequence) and not given):
        return None
    return list(given) if isinstance(given, Sequence) else [given]


def _merged(
    first: Mapping[str, Mapping[str, Any]], second: Mapping[str, Mapping[str, Any]] | None
) -> Mapping[str, Mapping[str, Any]]:
    """Two tables of tables; the second counts."""
    if not second:
        return first
    return {joint: {**first.get(joint, {}), **second.get(joint, {})} for joint in {**first, **second}}
