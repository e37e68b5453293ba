"""Short runs of one kind, stepped one after the other and evaluated together: NumPy takes as long for the small arrays of one
run as for those of twenty."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from asrsim.samples import Array, Samples
from asrsim.simulation.chunks import LONGEST_NUMBERS
from asrsim.simulation.divergence import EnergyGuard
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.recorder import Counts, Recorder, recorded_quantities
from asrsim.simulation.recording import Part
from asrsim.simulation.run import Run, run_of
from asrsim.simulation.simulation import Simulation


@dataclass(frozen=True)
class Track:
    """A run that has been stepped, and is not evaluated yet."""

    simulation: Simulation
    """It has gone on to other runs since."""
    prepared: Prepared
    parts: Sequence[Part]
    energy: float
    """J, of the links at the start."""
    quantities: tuple[tuple[str, ...], ...]
    """Of each joint, as far as they are wanted; runs of one simulation with equal ones can be evaluated together."""
    wall_time: float
    """s."""


def name_in(run: int, joint: str) -> str:
    """Name of a joint among those of all runs."""
    return f"{run}:{joint}" if run else joint


def fit_together(prepared: Prepared, substeps: int) -> int:
    """How many runs of so many substeps are evaluated together: those whose numbers fit into the processor's cache."""
    scenario = prepared.scenario
    if not (scenario.world.empty and scenario.fixed_base) or scenario.task is not None:
        # Poses and contacts are asked of the engine as the run goes on: such a run cannot be evaluated later.
        return 1
    return max(1, LONGEST_NUMBERS // (substeps * len(prepared.drives)))


def deferred(prepared: Prepared, wanted: Collection[str], *, expected_substeps: int) -> Simulation:
    """A simulation whose runs are evaluated later; wanted: the quantities that will be needed."""
    simulation = Simulation(prepared, expected_substeps=expected_substeps)
    simulation.recording.defer(wanted)
    return simulation


def track(simulation: Simulation) -> Track:
    """Step a simulation that is :func:`deferred` and just reset to its end. Raises DivergenceError."""
    began = clock.perf_counter()
    while simulation.substep < simulation.total:
        simulation.advance_to(simulation.next_chunk(simulation.total))
    simulation.flush()
    recording, prepared = simulation.recording, simulation.prepared
    wanted = tuple(tuple(name for name in recorded_quantities(d) if name in recording.wanted) for d in prepared.drives)
    wall_time = clock.perf_counter() - began
    return Track(simulation, prepared, recording.parts or (), recording.energy or 0.0, wanted, wall_time)


def finish(tracks: Sequence[Track], write: Callable[[Samples], None]) -> list[Run | None]:
    """Each track as a run, in their order; None where energy came from nowhere. write: takes the samples of all, of every step.

    The joints of all runs stand side by side (see :func:`name_in`) as if they were of one robot. No law or sum goes over
    several joints, so all numbers are those of a run alone, to the bit.
    """
    simulation = tracks[0].simulation
    first, width = tracks[0].prepared, len(tracks[0].prepared.drives)
    recorder = Recorder(
        [drive for one in tracks for drive in one.prepared.drives], tracks[0].quantities * len(tracks), first.stepping,
        substep=first.substep, every=first.resolution.substeps, last=simulation.last,
    )  # fmt: skip
    names = tuple(name_in(i, drive.name) for i in range(len(tracks)) for drive in first.drives)
    guards = [(EnergyGuard(one.energy), slice(i * width, (i + 1) * width)) for i, one in enumerate(tracks)]
    sane = [True] * len(tracks)
    for parts in zip(*(one.parts for one in tracks), strict=True):
        samples = recorder.add(
            _side_by_side([part.inputs for part in parts]),
            _side_by_side([part.raw for part in parts]),
            {k: np.concatenate([part.sides[k] for part in parts], axis=1) for k in parts[0].sides},
        )
        if samples is not None:
            write(replace(samples, joints=names))
        for i, (guard, rows) in enumerate(guards if simulation.recording.guarded else ()):
            balance = {name: getattr(recorder.meter, name)[rows] for name in ("given", "residual", "turnover")}
            fault = guard.fault(parts[i].energy, kinetic=parts[i].kinetic, **balance, names=simulation.joints)
            sane[i] &= fault is None
    runs: list[Run | None] = []
    for one, (_, rows), is_sane in zip(tracks, guards, sane, strict=True):
        counts = Counts(**{name: count if name == "substeps" else count[rows] for name, count in vars(recorder.counts).items()})
        run = run_of(simulation, "complete", wall_time=one.wall_time, prepared=one.prepared, counts=counts)
        # The simulation has gone on to other runs: its own time is not this run's.
        runs.append(replace(run, simulated_time=simulation.last * first.substep) if is_sane else None)
    return runs


def _side_by_side(tables: Sequence[Array]) -> Array:
    """Tables (columns, joints, n) of several runs as one, a joint's numbers side by side whatever their order was."""
    columns, joints, n = tables[0].shape
    return np.concatenate(tables, axis=1, out=np.empty((columns, joints * len(tables), n)))
