"""Masses and losses of the qbMove arms of figures 11 to 15, fitted to the logged motion with Newton's law.

Masses, inertias, losses and springs are copied from the paper (section 4.2) and AlterEgo's description. The equations of
motion of one or two links in a plane are written here. Nothing comes from the actuators, the robot files, the logged torques
or an engine: the torques on the links are computed from the logged positions of motors and links. A motion with other
springs, masses, damping or friction does not fit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from asrsim.reproduce import Claim, near
from paper.statics import GRAVITY

if TYPE_CHECKING:
    from collections.abc import Mapping

    from asrsim.samples import Array, Samples

    Law = Callable[[Array, Array, Array], Array]
    """Inverse dynamics: positions, velocities and accelerations (n, joints) in rad and s -> torques in N m."""

MASS, CENTRE, INERTIA, LENGTH = 0.5408, 0.0793, 6.33e-4, 0.09
"""A c-flange with a cube: mass (kg), distance of its centre from the axis (m), inertia about the centre (kg m^2), and
distance between the axes (m)."""
DAMPING, FRICTION = 0.065, 0.025
"""Damping (N m s/rad) and friction (N m) of each joint."""
DEFLECTION = 0.8
"""Deflection at which the toolbox clips a spring, rad."""
SLOWEST = 0.02
"""Fraction of the largest velocity below which rows are left out, since the friction of a resting joint is not known."""
SHARE = 0.02
"""Tolerated relative error of masses, damping and friction."""


@dataclass(frozen=True, kw_only=True)
class Springs:
    """Two springs of a joint, each with the torque k sinh(a (motor - link))."""

    rates: tuple[float, float] = (11.0, 11.0)
    """Rate a of each spring, 1/rad."""
    scales: tuple[float, float] = (0.02, 0.02)
    """Scale k of each spring, N m."""

    def torques(self, link: Array, motors: tuple[Array, Array]) -> list[Array]:
        """Torque (n,) of each spring on the link, N m. The spring acts on its motor with the opposite torque."""
        bent = [np.clip(motor - link, -DEFLECTION, DEFLECTION) for motor in motors]
        return [k * np.sinh(a * d) for a, k, d in zip(self.rates, self.scales, bent, strict=True)]


ALTEREGO = Springs()
IDENTIFIED = (
    Springs(rates=(6.257, 3.9), scales=(0.01038, 0.08918)),
    Springs(rates=(3.383, 7.011), scales=(0.1015, 0.05944)),
)
"""Springs identified in section 4.3. The paper's text swaps their labels a and k."""


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Parameters fitted to a motion."""

    masses: float
    """Inertia and weight of the links, as a multiple of the numbers above."""
    damping: float
    """Damping, N m s/rad."""
    friction: float
    """N m."""


def read_motion(samples: Samples, springs: Sequence[Springs], law: Law, *, until: float = np.inf) -> Motion:
    """Masses, damping and friction of links with these springs, by a least-squares fit of Newton's law.

    samples: positions of links and motors at equidistant times; law: inverse dynamics of the links; until: time at which the
    fitted part ends, s.
    """
    step = float(samples.time[1] - samples.time[0])
    links, first, second = (samples.values[name] for name in ("link_position", "motor_1_position", "motor_2_position"))
    v, acceleration = differences(links, step)
    inertial = law(links[1:-1], v, acceleration)
    free = samples.time[1:-1] < until
    rows, torques = [], []
    for j, spring in enumerate(springs):
        use = free & sliding(v[:, j])
        rows.append(np.column_stack([inertial[:, j], v[:, j], np.sign(v[:, j])])[use])
        torques.append(np.sum(spring.torques(links[:, j], (first[:, j], second[:, j])), axis=0)[1:-1][use])
    found = np.linalg.lstsq(np.vstack(rows), np.concatenate(torques), rcond=None)[0]
    return Motion(masses=float(found[0]), damping=float(found[1]), friction=float(found[2]))


def differences(positions: Array, step: float) -> tuple[Array, Array]:
    """Velocities and accelerations at `positions` (n, ...), by central differences, without the first and the last row."""
    ahead, behind = positions[2:], positions[:-2]
    return (ahead - behind) / (2.0 * step), (ahead - 2.0 * positions[1:-1] + behind) / step**2


def sliding(velocity: Array) -> NDArray[np.bool_]:
    """Mask (n,) of the rows in which the joint slides during the whole step."""
    sign = np.sign(velocity)
    use = np.abs(velocity) > SLOWEST * np.max(np.abs(velocity))
    # If the velocity changes its sign within a step, so does the friction.
    use[1:-1] &= (sign[:-2] == sign[1:-1]) & (sign[1:-1] == sign[2:])
    use[[0, -1]] = False
    return np.asarray(use)


def level(q: Array, v: Array, acceleration: Array) -> Array:
    """Joint torques (n, joints) of one or two links in a horizontal plane without losses, N m.

    Angles are relative to the previous link.
    """
    return _planar(q, v, acceleration, 0.0)


def hanging(q: Array, v: Array, acceleration: Array) -> Array:
    """Joint torques (n, joints) of one or two links under gravity without losses, N m. At zero, the links hang down."""
    return _planar(q, v, acceleration, GRAVITY)


def _planar(q: Array, v: Array, acceleration: Array, gravity: float) -> Array:
    own = INERTIA + MASS * CENTRE**2
    weight = MASS * CENTRE * gravity
    if q.shape[1] == 1:
        return np.asarray(own * acceleration + weight * np.sin(q))
    (q_1, q_2), (v_1, v_2), (a_1, a_2) = q.T, v.T, acceleration.T
    coupled = MASS * LENGTH * CENTRE
    outer = own * (a_1 + a_2) + coupled * (a_1 * np.cos(q_2) + v_1**2 * np.sin(q_2)) + weight * np.sin(q_1 + q_2)
    inner = (
        own * a_1
        + outer
        + MASS * LENGTH**2 * a_1
        + coupled * (a_1 + a_2) * np.cos(q_2)
        - coupled * (v_1 + v_2) ** 2 * np.sin(q_2)
        + (weight + MASS * LENGTH * gravity) * np.sin(q_1)
    )
    return np.column_stack([inner, outer])


def motion_claims(
    runs: Mapping[str, Samples],
    law: Law,
    springs: Sequence[Springs] | None = None,
    *,
    until: Mapping[str, float] | None = None,
) -> list[Claim]:
    """Claims that the motion of each run fits the paper's masses and losses with these springs.

    springs: springs of each joint; None: AlterEgo's springs. until: end of the fitted part of each run (s); None: its end.
    """
    motions = {
        name: read_motion(samples, springs or [ALTEREGO] * len(samples.joints), law, until=until[name] if until else math.inf)
        for name, samples in runs.items()
    }
    wanted = {
        "masses": ("masses fitted to the motion, as a multiple of the paper's", 1.0, ""),
        "damping": ("damping fitted to the motion", DAMPING, "N m s/rad"),
        "friction": ("friction fitted to the motion", FRICTION, "N m"),
    }
    return [
        Claim(
            origin="theory",
            text=f"{name}: the links move by Newton's law with the paper's springs and {what}",
            quantity=quantity,
            measured=getattr(motion, what),
            bound=near(value, SHARE * value, unit),
        )
        for name, motion in motions.items()
        for what, (quantity, value, unit) in wanted.items()
    ]
