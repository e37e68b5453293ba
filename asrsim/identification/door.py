"""Access to simulation, engines and actuators. No other module of this package imports modules inside those packages."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from asrsim.actuators.stages import STAGES, Stage
from asrsim.actuators.vectorised import over_arrays
from asrsim.engines import ENGINES
from asrsim.errors import RobotError
from asrsim.quantities import MOST_MOTORS, QUANTITIES, each_motor
from asrsim.records import declared
from asrsim.robot import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.simulation.drives import EXTERNAL_TORQUE as EXTERNAL
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.examine import examine
from asrsim.simulation.prepare import prepare
from asrsim.simulation.quantities import columns_of, simulated_quantities
from asrsim.simulation.shape import shape_of
from asrsim.simulation.start import Numbers, Start
from asrsim.simulation.worlds import Observer, Worlds
from asrsim.workers import cores

__all__ = ["EXTERNAL", "Door", "Numbers", "Observer", "Start", "SteppedJoint", "Substeps", "comparable", "examine"]

SOURCES = ("link_position", *each_motor("motor_{}_position"))
"""Quantities from which derived quantities are computed."""
DERIVED = ("equilibrium_position", "deflection")
"""Quantities computed from motor and link positions."""
OFTEN = 10**7
"""Expected number of substeps of all simulations of a fit. With so many substeps, compiling the kernel saves time."""
ENGINES_KEPT = 3
"""Number of settings (substeps and recorded quantities) whose engines stay open."""
THREADED = 3
"""Smallest number of joints of a robot at which several worlds run in parallel threads. In fits of 4 s with one or two joints,
threads took 3 to 5 % more CPU time, and between 5 % less and 5 % more wall-clock time.
"""

Substeps = tuple[int, int]
"""Number of substeps in a step, and number of motor substeps in a substep."""


def comparable() -> tuple[str, ...]:
    """Quantities that a sensor can measure and a simulation computes, including the quantities of all registered stages."""
    measured = (name for name in simulated_quantities(MOST_MOTORS) if QUANTITIES[name].unit not in ("J", "N m/rad"))
    return *measured, *DERIVED


def stage_of(quantity: str) -> type[Stage] | None:
    """The stage that logs this quantity; None if no stage logs it."""
    for stage in STAGES.loaded():
        if any(one["log"] and quantity in each_motor(one["log"]) for one in declared(stage.Memory).values()):
            return stage
    return None


class Door:
    """Simulation of a scenario with many sets of parameters."""

    def __init__(self, scenario: Scenario, robot: Robot) -> None:
        faster = ENGINES.get(scenario.engine).faster
        if faster and scenario.world.empty and ENGINES.get(faster).available:
            scenario = replace(scenario, engine=faster)
        self.scenario, self._prepared = scenario, prepare(scenario, robot)
        self.robot, self.drives = self._prepared.robot, self._prepared.drives
        self.joints = tuple(drive.name for drive in self.drives)
        self.positions, self.velocities = self._prepared.initial_positions, self._prepared.initial_velocities
        self.substeps: Substeps = self._prepared.resolution.substeps, self._prepared.resolution.motor_substeps
        self.exact_in_time = not self._prepared.stepping.released
        """Whether finer substeps reduce the time-step error. False for the stepping of the released code, which prescribes its
        steps.
        """
        self._together = cores() if len(self.joints) >= THREADED else 1
        """Number of worlds that a rollout simulates together."""
        self._made: dict[tuple[Substeps, tuple[str, ...]], Worlds] = {}
        """Worlds; the key contains their numbers of substeps and the quantities that they record."""
        self._columns = tuple(columns_of(shape_of(self.drives)))
        """Quantities that the joints have."""

    def _worlds(self, substeps: Substeps, quantities: Collection[str]) -> Worlds:
        """Worlds with these numbers of substeps. They record the given quantities, except quantities that no joint has."""
        # Record only these quantities, since each further quantity lengthens a simulation by 1 %.
        names = tuple(name for name in self._columns if name in quantities)
        found = self._made.pop((substeps, names), None)
        if found is None:
            prepared = self._prepared
            if substeps != self.substeps:
                # These numbers of substeps suit the estimates. The springs of the start values may be too stiff for them.
                # Therefore make the copy by `vary`, which does not check this.
                resolution = replace(prepared.resolution, substeps=substeps[0], motor_substeps=substeps[1])
                prepared = replace(prepared, resolution=resolution).vary({})
            count = self._together
            found = Worlds(prepared, count, names=names, watched=False, expected_substeps=OFTEN, threads=count)
        while len(self._made) >= ENGINES_KEPT:
            self._made.pop(next(iter(self._made))).close()
        self._made[substeps, names] = found
        return found

    @property
    def observes(self) -> bool:
        """Whether the simulation can be corrected towards measured positions."""
        return (next(iter(self._made.values()), None) or self._worlds(self.substeps, SOURCES)).observes

    def rollout(
        self, names: Sequence[tuple[int, str]], starts: Sequence[Start], *, steps: int | None = None, substeps: Substeps,
        observer: Observer | None = None,
    ) -> Iterator[Array | None]:  # fmt: skip
        """Yield the simulated values (names, rows) of each start at whole steps, with at least `steps` rows; None if the
        simulation diverges. Positions are the values before the observer's corrections. names: pairs of the index of a joint
        and the name of a quantity.
        """
        made = self._worlds(substeps, {*SOURCES, *(name for _, name in names)})

        def run(first: int, several: Sequence[Start]) -> Iterator[Array | None]:
            here = observer
            if observer is not None:
                here = replace(observer, measured=observer.measured[first : first + len(several)].copy())
            try:
                found = made.rollout(made.names, start=several, steps=steps, observer=here)
            except RobotError:
                # One of the parameter sets is not physical. Simulate each set alone, so that only this set fails.
                alone = (one for i, start in enumerate(several) for one in run(first + i, [start]))
                yield from alone if len(several) > 1 else [None]
                return
            if here is not None and observer is not None:
                before = observer.measured[first : first + len(several)] - here.measured
                for column, source in enumerate(SOURCES[: before.shape[-1]]):
                    if source in found:
                        np.copyto(found[source], before[..., column], where=np.isfinite(before[..., column]))
            for world in range(len(several)):
                channels = (self._channel(found, world, *name) for name in names)
                yield np.stack([*channels]) if made.healthy[world] else None

        for first in range(0, len(starts), self._together):
            yield from run(first, starts[first : first + self._together])

    def _channel(self, found: Mapping[str, Array], world: int, joint: int, name: str) -> Array:
        """Values (rows,) of a joint's quantity; NaN if the simulation does not record the quantity."""
        missing = np.full(next(iter(found.values())).shape[1], np.nan)
        own = {source: found[source][world, :, joint] if source in found else missing for source in (*SOURCES, name)}
        if name not in DERIVED:
            return own[name]
        actuator, (position, *motors) = self.drives[joint].actuator, (own[source] for source in SOURCES)
        rest = motors[0] if actuator is None else over_arrays(actuator.equilibrium_position)(*motors[: actuator.positions()])
        return np.asarray(rest - position if name == "deflection" else rest)

    def substeps_of(self, parameters: Numbers) -> Substeps:
        """Numbers of substeps that a simulation with these parameters needs. Raises RobotError or UnresolvedSpringError."""
        found = replace(self._prepared.vary(parameters), scenario=self.scenario).needed_resolution()
        return found.substeps, found.motor_substeps

    def close(self) -> None:
        """Release the engines."""
        for one in self._made.values():
            one.close()
        self._made.clear()
