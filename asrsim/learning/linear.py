"""The joints' dynamics linearised about a posture: what gain learns fast, and how fast it will.

About a posture q with motors at theta, for small motions (complex amplitudes at angular frequency w):

    [-w^2 M + i w c + dG/dq + diag(sum_i k_i)] q = sum_i k_i theta_i,      k_i = d tau_i / d theta_i
    [-w^2 J_i + i w (D_i + k_d) + k_p + k_i] theta_i = k_p r + k_i q

so that q = P(w) r with the equilibrium r. An error e becomes (1 - P K) e in the next trial (paper equation 13): learning
converges monotonically at the frequencies where the largest singular value of 1 - P K is below 1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from asrsim.kinematics.compensation import JointDrive, resting_motors
from asrsim.samples import Array

Complex = NDArray[np.complex128]
NUDGE = 1e-6
"""rad, for slopes by central differences."""


class DynamicModel(Protocol):
    """What linearisation asks of a robot model; n joints, SI units."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""

    def mass_matrix(self, positions: Array) -> Array:
        """(n, n) kg m^2."""

    def gravity_torques(self, positions: Array) -> Array:
        """(n,) N m."""


@dataclass(frozen=True, kw_only=True)
class JointDynamics:
    """Linear dynamics of the driven joints about one posture; all matrices in the order of `joints`."""

    joints: tuple[str, ...]
    mass: Array
    """(n, n) kg m^2."""
    damping: Array
    """(n,) N m s/rad, of the links."""
    gravity: Array
    """(n, n) N m/rad, dG/dq."""
    springs: tuple[tuple[float, ...], ...]
    """N m/rad, slope k_i of each joint's springs."""
    drives: tuple[JointDrive, ...]

    def response(self, omega: float) -> Complex:
        """(n, n) complex: link positions for equilibrium positions at `omega` rad/s; 0: at rest."""
        n = len(self.joints)
        carried, driven = np.zeros(n, dtype=complex), np.zeros(n, dtype=complex)
        for joint, (drive, slopes) in enumerate(zip(self.drives, self.springs, strict=True)):
            for motor, slope in enumerate(slopes):
                follow, yielding = _motor(drive, motor, slope, omega)
                carried[joint] += slope * (1.0 - yielding)
                driven[joint] += slope * follow
        stiffness = -(omega**2) * self.mass + np.diag(1j * omega * self.damping + carried) + self.gravity
        return np.asarray(np.linalg.solve(stiffness, np.diag(driven)), dtype=np.complex128)

    def contraction(self, gains: Sequence[float], omega: float) -> float:
        """Factor by which an error at `omega` shrinks in one update with these gains, at worst: |1 - P K|."""
        matrix = np.eye(len(self.joints)) - self.response(omega) * np.asarray(gains)
        return float(np.linalg.norm(matrix, 2))

    def learnable(self, gains: Sequence[float], *, up_to: float = 50.0, points: int = 500) -> float:
        """Hz: below it every error shrinks with these gains; a cutoff for the learning filter. At most `up_to`."""
        frequencies = np.linspace(0.0, up_to, points)
        for before, frequency in zip(np.concatenate([[0.0], frequencies]), frequencies, strict=False):
            if self.contraction(gains, 2.0 * np.pi * float(frequency)) >= 1.0:
                return float(before)
        return up_to


def linearise(
    model: DynamicModel,
    drives: Sequence[JointDrive],
    positions: Mapping[str, float],
    equilibria: Sequence[float],
    presets: Sequence[float],
    damping: Mapping[str, float],
) -> JointDynamics:
    """Linear dynamics of the driven joints; the others are held still.

    positions: link positions by joint (absent ones 0). equilibria, presets: references of the driven joints.
    damping: of the links by joint, N m s/rad.
    """
    q = np.array([positions.get(joint, 0.0) for joint in model.joints])
    index = [model.joints.index(drive.joint) for drive in drives]
    gravity = np.empty((len(index), len(index)))
    for column, joint in enumerate(index):
        nudge = np.zeros(len(q))
        nudge[joint] = NUDGE
        slope = (model.gravity_torques(q + nudge) - model.gravity_torques(q - nudge)) / (2.0 * NUDGE)
        gravity[:, column] = slope[index]
    springs = tuple(
        spring_slopes(drive, float(q[joint]), float(equilibrium), float(preset))
        for drive, joint, equilibrium, preset in zip(drives, index, equilibria, presets, strict=True)
    )
    return JointDynamics(
        joints=tuple(drive.joint for drive in drives),
        mass=np.asarray(model.mass_matrix(q))[np.ix_(index, index)],
        damping=np.array([damping.get(drive.joint, 0.0) for drive in drives]),
        gravity=gravity,
        springs=springs,
        drives=tuple(drives),
    )


def spring_slopes(drive: JointDrive, position: float, equilibrium: float, preset: float) -> tuple[float, ...]:
    """d tau_i / d theta_i in N m/rad of a joint's springs, motors at rest; 0 beyond the deflection limit."""
    law, spring = drive.actuator.elastic_torques, drive.spring
    theta = resting_motors(drive, position, equilibrium, preset)
    slopes = []
    for motor in range(drive.actuator.motors):
        above = [theta[0], theta[1]]
        below = [theta[0], theta[1]]
        above[motor] += NUDGE
        below[motor] -= NUDGE
        rise = law(position, above[0], above[1], spring)[motor] - law(position, below[0], below[1], spring)[motor]
        slopes.append(rise / (2.0 * NUDGE))
    return tuple(slopes)


def choose_gains(dynamics: Sequence[JointDynamics], *, largest: float = 1.0) -> tuple[float, ...]:
    """Gains that make the slowest error of slow motions shrink fastest over the given postures, at most `largest`.

    With S the static share of the equilibrium that arrives at the link, an update leaves 1 - S K of the error; over S
    from S_min to S_max the least of the largest is at K = 2 / (S_min + S_max). Gains above 1 learn faster where gravity
    works against soft springs, but leave no margin to resonances: hence the bound.
    """
    shares = np.array([np.diag(item.response(0.0)).real for item in dynamics])
    best = 2.0 / np.maximum(shares.min(axis=0) + shares.max(axis=0), 1e-9)
    return tuple(float(gain) for gain in np.minimum(best, largest))


def _motor(drive: JointDrive, motor: int, slope: float, omega: float) -> tuple[complex, complex]:
    """How a motor follows its reference, and how it yields to the link: theta = follow r + yielding q."""
    if not drive.proportional:
        return 1.0, 0.0
    gain = complex(drive.proportional[motor])
    if drive.integral[motor] > 0.0:
        if omega == 0.0:
            return 1.0, 0.0
        gain += drive.integral[motor] / (1j * omega)
    impedance = (
        gain
        + slope
        + 1j * omega * (drive.motor_damping[motor] + drive.derivative[motor])
        - omega**2 * drive.motor_inertia[motor]
    )
    return gain / impedance, slope / impedance
