"""The door to the simulation, its engines and actuators: the only place of this package that knows inner modules of theirs."""

from __future__ import annotations

import time as clock
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from asrsim.actuators.electric import electric_of
from asrsim.actuators.user import load_plugin_file
from asrsim.actuators.vectorised import equilibrium_over_arrays, over_arrays
from asrsim.engines import ENGINES
from asrsim.engines.bench import link_motion
from asrsim.errors import AsrsimError, RobotError
from asrsim.quantities import QUANTITIES
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.signals.base import Signal
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.prepare import prepare, resolution_of
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.quantities import EXTERNAL_TORQUE as EXTERNAL
from asrsim.simulation.quantities import columns_of
from asrsim.simulation.worlds import Start, Worlds
from asrsim.workers import Executor, in_order

__all__ = [
    "COMPARABLE", "EXTERNAL", "Door", "Drive", "Numbers", "Pool", "Substeps", "World", "electric_of",
    "equilibrium_over_arrays", "link_motion", "load_plugin_file", "over_arrays",
]  # fmt: skip

SOURCES = ("link_position", "motor_1_position", "motor_2_position")
"""Quantities of which others are made."""
DERIVED = ("equilibrium_position", "deflection")
"""Quantities of motor positions."""
COMPARABLE = (*(name for name in columns_of(2) if QUANTITIES[name].unit not in ("J", "N m/rad")), *DERIVED)
"""Quantities that a sensor can measure, and a simulation give."""
OFTEN = 10**7
"""Substeps that the simulations of one fit come to at least: compiling pays."""
ENGINES_KEPT = 3
"""Numbers of substeps whose engines are kept: fits go to and fro between two."""
LONG = 12.0
"""s of simulation after which other processes are worth their start."""

Drive = SteppedJoint
Numbers = Mapping[str, Mapping[str, float]]
"""Joint or link -> name -> value."""
Substeps = tuple[int, int]
"""Of a step, and of the motors in each of these."""


@dataclass(frozen=True, kw_only=True, eq=False)
class World:
    """What one simulation of a rollout has of its own."""

    parameters: Numbers
    references: Mapping[str, Mapping[str, Signal]]
    positions: Sequence[float]
    velocities: Sequence[float]
    motors: Mapping[str, Sequence[float]]


class Door:
    """A scenario that is simulated with many sets of numbers."""

    def __init__(self, scenario: Scenario, robot: Robot) -> None:
        faster = ENGINES.get(scenario.engine).faster
        if faster and scenario.world.empty and ENGINES.get(faster).available:
            scenario = replace(scenario, engine=faster)
        self.scenario, self.given = scenario, robot
        self._prepared = prepare(scenario, robot)
        self.robot, self.drives = self._prepared.robot, self._prepared.drives
        self.joints = tuple(drive.name for drive in self.drives)
        self.positions, self.velocities = self._prepared.initial_positions, self._prepared.initial_velocities
        self.substeps: Substeps = _substeps(self._prepared)
        self.own_substeps = not self._prepared.stepping.released and scenario.substeps is None
        """Whether the number of substeps is asrsim's choice."""
        self.exact_in_time = not self._prepared.stepping.released
        """Whether finer substeps come nearer to the truth: the released code has steps of its own."""
        self._made: dict[Substeps, Worlds] = {}
        self.pool: Pool | None = None

    def _worlds(self, substeps: Substeps) -> Worlds:
        found = self._made.pop(substeps, None)
        if found is None:
            own = substeps == self.substeps
            scenario = replace(self.scenario, substeps=substeps[0], motor_substeps=substeps[1])
            prepared = self._prepared if own else prepare(scenario, self.given)
            found = Worlds(
                prepared, 1, names=[n for n in columns_of(2) if n in COMPARABLE], watched=False, expected_substeps=OFTEN
            )
        while len(self._made) >= ENGINES_KEPT:
            self._made.pop(next(iter(self._made))).close()
        self._made[substeps] = found
        return found

    def rollout(
        self, names: Sequence[tuple[int, str]], worlds: Sequence[World], *, steps: int | None = None, substeps: Substeps
    ) -> Iterator[Array | None]:
        """(names, rows) at whole steps of each world, at least `steps` of them; None where the motion is not sane.

        names: number of a joint and quantity.
        """
        if len(worlds) > 1 and self.pool is not None and self.pool.pays:
            found = self.pool.rollout(self, names, worlds, steps, substeps)
            if found is not None:
                yield from found
                return
        for world in worlds:
            began = clock.perf_counter()
            yield self._run(names, world, steps, substeps)
            if self.pool is not None:
                self.pool.seconds += clock.perf_counter() - began

    def _run(self, names: Sequence[tuple[int, str]], world: World, steps: int | None, substeps: Substeps) -> Array | None:
        made = self._worlds(substeps)
        wanted = {SOURCES[0], *(name for _, name in names)}
        wanted |= {*SOURCES} if wanted & {*DERIVED} else set()
        quantities = [name for name in made.selection.names if name in wanted]
        start = Start(
            parameters=world.parameters, references=world.references, motors=world.motors,
            # A recording may begin a hair beyond a stop.
            positions={
                drive.name: min(max(q, drive.joint.stops[0]), drive.joint.stops[1])
                for drive, q in zip(self.drives, world.positions, strict=True)
            },
            velocities=dict(zip(self.joints, world.velocities, strict=True)),
        )  # fmt: skip
        try:
            found = made.rollout(quantities, start=start, steps=steps)
        except RobotError:
            return None
        if not made.healthy[0]:
            return None
        return np.stack([self._channel(found, joint, name) for joint, name in names])

    def _channel(self, found: Mapping[str, Array], joint: int, name: str) -> Array:
        """(rows,) of one quantity of a joint; NaN where no joint records it."""
        missing = np.full(next(iter(found.values())).shape[1], np.nan)
        own = {source: found[source][0, :, joint] if source in found else missing for source in (*SOURCES, name)}
        if name not in DERIVED:
            return own[name]
        actuator, (position, first, second) = self.drives[joint].actuator, (own[source] for source in SOURCES)
        rest = first if actuator is None else equilibrium_over_arrays(actuator)(first, second)
        return np.asarray(rest - position if name == "deflection" else rest)

    def varied(self, parameters: Numbers) -> Prepared:
        """Its `drives` and its `robot` are those with other numbers. Raises RobotError."""
        return self._prepared.vary(parameters)

    def substeps_of(self, parameters: Numbers) -> Substeps:
        """Those that a run with these numbers takes. Raises RobotError, UnresolvedSpringError."""
        found = resolution_of(replace(self.varied(parameters), scenario=self.scenario))
        return found.substeps, found.motor_substeps

    def inverse_dynamics(self, robot: Robot, q: Array, v: Array, a: Array) -> Array:
        """(rows, joints) torques of inertia, gravity and Coriolis forces along a motion."""
        model = self._worlds(self.substeps).model_of(robot)
        assert model is not None  # links that nothing prescribes have dynamics
        return np.array([model.inverse_dynamics(*row) for row in zip(q, v, a, strict=True)])

    def close(self) -> None:
        """Release the engines."""
        for one in self._made.values():
            one.close()
        self._made.clear()


def _substeps(prepared: Prepared) -> Substeps:
    return prepared.resolution.substeps, prepared.resolution.motor_substeps


Item = tuple[int, Sequence[tuple[int, str]], World, int | None, Substeps]


@dataclass
class _Elsewhere:
    """What another process does: one world of one door."""

    models: Sequence[tuple[Scenario, Robot]]
    _doors: dict[int, Door] = field(default_factory=dict, init=False)

    def __call__(self, item: Item) -> Array | None:
        number, names, world, steps, substeps = item
        if number not in self._doors:
            self._doors[number] = Door(*self.models[number])
        return next(self._doors[number].rollout(names, [world], steps=steps, substeps=substeps))

    def close(self) -> None:
        """Release the engines."""
        for door in self._doors.values():
            door.close()


class Pool:
    """Processes that simulate the worlds of several doors; results are the same bits as here."""

    def __init__(self, doors: Sequence[Door], workers: Executor) -> None:
        self._workers: Executor | None = workers
        self._numbers = {id(door): number for number, door in enumerate(doors)}
        self._task = _Elsewhere([(door.scenario, door.given) for door in doors])
        self.seconds = 0.0
        """Of simulation in this process."""
        for door in doors:
            door.pool = self

    @property
    def pays(self) -> bool:
        """Whether so much has been simulated that other processes are worth their start."""
        return self._workers is not None and self.seconds > LONG

    def rollout(
        self, door: Door, names: Sequence[tuple[int, str]], worlds: Sequence[World], steps: int | None, substeps: Substeps
    ) -> list[Array | None] | None:
        """As :meth:`Door.rollout`; None where no process can, as one without an actuator that was only registered here."""
        assert self._workers is not None  # pays has looked
        number = self._numbers[id(door)]
        try:
            return in_order(self._workers, self._task, [(number, names, world, steps, substeps) for world in worlds])
        except AsrsimError:
            self._workers = None
            return None
