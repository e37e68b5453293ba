"""Sink that records the samples of a simulation, and comparison of samples bit for bit."""

from __future__ import annotations

import numpy as np

from asrsim.samples import Samples, concatenate
from asrsim.simulation.simulation import Simulation


class Tape:
    """Sink that keeps all samples."""

    def __init__(self) -> None:
        self.chunks: list[Samples] = []

    def write(self, samples: Samples) -> None:
        self.chunks.append(samples)

    def of(self, simulation: Simulation, end: int | None = None) -> Samples:
        """Samples of `simulation` from now to the substep `end`, by default to the end of the scenario."""
        simulation.advance_to(simulation.total if end is None else end)
        simulation.flush()
        chunks, self.chunks = self.chunks, []
        return concatenate(chunks)


def assert_same(first: Samples, second: Samples, *, moves: bool = True) -> None:
    np.testing.assert_array_equal(first.time, second.time)
    assert first.values.keys() == second.values.keys()
    for name, values in first.values.items():
        np.testing.assert_array_equal(values, second.values[name], err_msg=name)
    for name, poses in first.bodies.items():
        np.testing.assert_array_equal(poses, second.bodies[name], err_msg=name)
    assert not moves or np.nanmax(np.abs(first.values["link_velocity"])) > 0.01
