"""Simulations of random runs with many imperfections, and comparison of their samples bit for bit."""

import re

import numpy as np

from asrsim.samples import concatenate


class Tape:
    """Sink that keeps all samples."""

    def __init__(self):
        self.chunks = []

    def write(self, samples):
        self.chunks.append(samples)

    def of(self, simulation, end=None):
        """Samples of `simulation` from now to the substep `end`, by default to the end of the scenario."""
        simulation.advance_to(simulation.total if end is None else end)
        simulation.flush()
        chunks, self.chunks = self.chunks, []
        return concatenate(chunks)


def assert_same(first, second, *, moves=True):
    np.testing.assert_array_equal(first.time, second.time)
    assert first.values.keys() == second.values.keys()
    for name, values in first.values.items():
        np.testing.assert_array_equal(values, second.values[name], err_msg=name)
    for name, poses in first.bodies.items():
        np.testing.assert_array_equal(poses, second.bodies[name], err_msg=name)
    assert not moves or np.nanmax(np.abs(first.values["link_velocity"])) > 0.01


def busy_keys(run):
    """Keys of the scenario, with late and noisy sensors, a wrench that jumps, and damping that follows the stiffness."""
    last = re.findall(r'<child link="(\w+)"', run.urdf)[-1]
    force = [{"step": {"at": 0.0503, "to": 1.0}}, 0, {"sinusoid": {"amplitude": 1.0, "frequency": 3.0}}]
    damping = {"constant": 0.05, "ratio": 0.1, "inertia": 0.02}
    return run.keys() | {
        "imperfections": {"sensors": {"*": {"delay": 0.003, "rate": 250, "noise": 1e-4, "quantum": 1e-5}}},
        "wrenches": [{"link": last, "force": force, "torque": [0, 0.1, 0]}],
        "link_damping": {joint.name: damping for joint in run.joints if joint.actuator},
    }
