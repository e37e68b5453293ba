"""Error of the time step at the resonances of links and motors. The phase error of a lasting oscillation grows with time.

The leapfrog step raises the frequency w of a mode by the fraction (w h)^2 / 24, with the substep h. An oscillation with the
decay rate s therefore has the phase error w t (w h)^2 / 24 after the time t, when its amplitude is exp(-s t) of the first
amplitude.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from asrsim.errors import Problem, counted
from asrsim.registry.steppings import stepping_called
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.substeps import Resolution, link_damping

TOLERATED = 0.1
"""Largest error of an oscillation that causes no warning, as a fraction of the oscillation's first amplitude."""
AIM = 0.02
"""Error that remains with the number of substeps that the warning proposes, as a fraction of the first amplitude."""


def resonance_doubts(
    scenario: Scenario, drives: Sequence[SteppedJoint], masses: Array | None, resolution: Resolution
) -> Iterator[Problem]:
    """Warning about the resonance with the largest error, if this error is above `TOLERATED`. Friction is neglected.

    masses: mass matrix (n, n) at the initial positions; None if the engine prescribes the motion of the links.
    """
    if masses is None or stepping_called(scenario.stepping).order < 2 or not any(resolution.stiffness):
        return
    h = scenario.step / resolution.substeps
    matrix, names = _system(drives, masses, resolution.stiffness)
    values = np.linalg.eigvals(matrix)
    rates, frequencies = np.maximum(-values.real, 0.0), np.abs(values.imag)
    with np.errstate(divide="ignore"):
        times = np.minimum(scenario.duration, 1.0 / rates)
    errors = frequencies * times * (frequencies * h) ** 2 / 24.0 * np.exp(-rates * times)
    worst = int(np.argmax(errors))
    if errors[worst] <= TOLERATED:
        return
    resonance = values[worst]
    # Compute eigenvectors only for a warning, since they take most of the time of an eigenvalue problem.
    values, vectors = np.linalg.eig(matrix)
    share = np.abs(vectors[: len(drives), np.abs(values - resonance).argmin()])
    needed = math.ceil(resolution.substeps * math.sqrt(errors[worst] / AIM))
    message = (
        f"the resonance at {frequencies[worst] / math.tau:.3g} Hz is resolved coarsely by "
        f"{counted(resolution.substeps, 'substep')} (omega h = {frequencies[worst] * h:.2g}): without "
        f"friction, the phase of the oscillation is {errors[worst]:.2g} rad ahead after "
        f"{times[worst]:.2g} s, which is an error of {2.0 * math.sin(min(errors[worst], math.pi) / 2.0):.0%} of the amplitude"
    )
    hint = f"`substeps: {needed}` reduces the error to {AIM:.0%}"
    yield Problem(message, key=names[int(np.argmax(share))], hint=hint, code="resonance")


def _system(drives: Sequence[SteppedJoint], masses: Array, stiffness: Sequence[float]) -> tuple[Array, list[str]]:
    """Matrix of the system, linearised at the initial state, of the positions and velocities of links and motors; and the names
    of the joints.

    Each motor of a joint has an equal part of the joint's stiffness.
    """
    motors = [(j, i) for j, drive in enumerate(drives) if drive.mode and drive.mode.spring for i in range(drive.dynamic_motors)]
    n, size = len(drives), len(drives) + len(motors)
    mass, spring, damping = np.zeros((size, size)), np.zeros((size, size)), np.zeros((size, size))
    mass[:n, :n] = masses
    for j, (drive, k) in enumerate(zip(drives, stiffness, strict=True)):
        spring[j, j], damping[j, j] = k + max(drive.joint.spring_stiffness, 0.0), link_damping(drive, k)
    for row, (j, i) in enumerate(motors, start=n):
        own = drives[j].drive
        assert own is not None  # a joint with motors has a drive
        k = stiffness[j] / own.dynamic_motors
        gains = (own.proportional[i], own.derivative[i]) if own.mode.controller else (0.0, 0.0)
        mass[row, row] = own.motor_inertia[i]
        spring[row, row], spring[row, j], spring[j, row] = k + gains[0], -k, -k
        damping[row, row] = own.motor_damping[i] + gains[1]
    inverse = np.linalg.inv(mass)
    upper = np.hstack([np.zeros((size, size)), np.eye(size)])
    return np.vstack([upper, np.hstack([-inverse @ spring, -inverse @ damping])]), [drive.name for drive in drives]
