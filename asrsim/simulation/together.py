"""Short runs of one kind, stepped one after the other and looked at together: NumPy's calls on the arrays of one take as long
as on those of twenty."""

from __future__ import annotations

import time as clock
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from asrsim.samples import Samples
from asrsim.simulation.divergence import EnergyGuard
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.recorder import Counts, Recorder, recorded_quantities
from asrsim.simulation.recording import Part, Sink
from asrsim.simulation.run import Run, run_of
from asrsim.simulation.simulation import CHUNK_NUMBERS, Simulation


@dataclass(frozen=True)
class Track:
    """A run that is stepped, and not looked at yet."""

    simulation: Simulation
    """That has gone on to other runs since."""
    prepared: Prepared
    parts: Sequence[Part]
    energy: float
    """J, of the links at the start."""
    wall_time: float
    """s."""

    @property
    def kind(self) -> tuple[tuple[str, ...], ...]:
        """Runs of one simulation with equal ones can be looked at together."""
        return tuple(map(recorded_quantities, self.prepared.drives))


def fit_together(prepared: Prepared, substeps: int) -> int:
    """Runs of so many substeps that are looked at together while their numbers fit into the processor's cache; 1: none."""
    scenario = prepared.scenario
    if not (scenario.world.empty and scenario.fixed_base) or scenario.task is not None:
        # What is looked at while the engine is there is nothing for afterwards.
        return 1
    return max(1, CHUNK_NUMBERS // (substeps * len(prepared.drives)))


def deferred(prepared: Prepared, *, expected_substeps: int) -> Simulation:
    """A simulation whose runs are looked at later."""
    simulation = Simulation(prepared, expected_substeps=expected_substeps)
    simulation.recording.defer()
    return simulation


def track(simulation: Simulation) -> Track:
    """Step a simulation that is :func:`deferred` and just reset to its end. Raises DivergenceError."""
    began = clock.perf_counter()
    while simulation.substep < simulation.total:
        simulation.advance_to(simulation.next_chunk(simulation.total))
    simulation.flush()
    recording = simulation.recording
    return Track(simulation, simulation.prepared, recording.parts or (), recording.energy or 0.0, clock.perf_counter() - began)


def finish(tracks: Sequence[Track], sinks: Sequence[Sink]) -> list[Run | None]:
    """Each track as a run, its samples to its sink, which takes those of every step; None where energy came from nowhere.

    All numbers are those of a run alone, to the bit: every law and sum is one joint's, and the joints of all runs stand side
    by side as those of one robot would.
    """
    simulation = tracks[0].simulation
    first, width = tracks[0].prepared, len(tracks[0].prepared.drives)
    drives = [drive for one in tracks for drive in one.prepared.drives]
    recorder = Recorder(
        drives, first.stepping, substep=first.substep, every=first.resolution.substeps, last=simulation.last
    )  # fmt: skip
    mine = [slice(i * width, (i + 1) * width) for i in range(len(tracks))]
    guards = [EnergyGuard(one.energy) for one in tracks]
    sane = [True] * len(tracks)
    for parts in zip(*(one.parts for one in tracks), strict=True):
        samples = recorder.add(
            [np.concatenate(arrays, axis=1) for arrays in zip(*(part.inputs for part in parts), strict=True)],
            np.concatenate([part.raw for part in parts], axis=1),
            {k: np.concatenate([part.sides[k] for part in parts], axis=1) for k in parts[0].sides},
        )
        for i, sink in enumerate(sinks):
            if samples is not None:
                values = {name: table[:, mine[i]] for name, table in samples.values.items()}
                sink.write(Samples(time=samples.time, joints=samples.joints[mine[i]], values=values))
            balance = {name: getattr(recorder.meter, name)[mine[i]] for name in ("given", "residual", "turnover")}
            if simulation.recording.guarded:
                part, names = parts[i], simulation.joints
                sane[i] &= guards[i].fault(part.energy, kinetic=part.kinetic, **balance, names=names) is None
    runs: list[Run | None] = []
    for one, pick, fine in zip(tracks, mine, sane, strict=True):
        counts = Counts(**{n: c if n == "substeps" else c[pick] for n, c in vars(recorder.counts).items()})
        run = run_of(simulation, "complete", wall_time=one.wall_time, prepared=one.prepared, counts=counts)
        runs.append(run if fine else None)
    return runs
