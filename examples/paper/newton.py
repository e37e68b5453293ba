"""What the qbMove arms of figures 11 to 15 weigh and lose, read from their logged motion by Newton's law.

Masses, inertias, losses and springs are written here as the paper (section 4.2) and AlterEgo's description have them, and so is
the motion of one or two such links in a plane. Nothing comes from the actuators, the robots' files, the logged torques or an
engine: what moved the links are the springs at the logged positions of motors and links. A motion of other springs, masses,
damping or friction does not fit.
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
    """(n, joints) rad, rad/s, rad/s^2 -> N m."""

MASS, CENTRE, INERTIA, LENGTH = 0.5408, 0.0793, 6.33e-4, 0.09
"""kg, m from the axis, kg m^2 about the centre of mass, m from axis to axis: a c-flange with a cube."""
DAMPING, FRICTION = 0.065, 0.025
"""N m s/rad, N m, of each joint."""
DEFLECTION = 0.8
"""rad, at which the toolbox cuts a spring's deflection."""
SLOWEST = 0.02
"""Share of a joint's largest velocity below which a row is left out, since friction that holds takes any value."""
SHARE = 0.02
"""By which masses, damping and friction may be off."""


@dataclass(frozen=True, kw_only=True)
class Springs:
    """A joint's two springs: torque k sinh(a (motor - link)) each."""

    rates: tuple[float, float] = (11.0, 11.0)
    """1/rad."""
    scales: tuple[float, float] = (0.02, 0.02)
    """N m."""

    def torques(self, link: Array, motors: tuple[Array, Array]) -> list[Array]:
        """(n,) N m of each spring on the link, and of its motor against it."""
        bent = [np.clip(motor - link, -DEFLECTION, DEFLECTION) for motor in motors]
        return [k * np.sinh(a * d) for a, k, d in zip(self.rates, self.scales, bent, strict=True)]


ALTEREGO = Springs()
IDENTIFIED = (
    Springs(rates=(6.257, 3.9), scales=(0.01038, 0.08918)),
    Springs(rates=(3.383, 7.011), scales=(0.1015, 0.05944)),
)
"""Of section 4.3, whose labels a and k stand swapped in the paper."""


@dataclass(frozen=True, kw_only=True)
class Motion:
    """What a motion tells."""

    masses: float
    """Times those above: what the links' inertia and weight are."""
    damping: float
    """N m s/rad."""
    friction: float
    """N m."""


def read_motion(samples: Samples, springs: Sequence[Springs], law: Law, *, until: float = np.inf) -> Motion:
    """Masses, damping and friction of links with these springs, by least squares of Newton's law.

    samples: positions of links and motors at even times; law: what moves such links; until: s, what comes later is left out.
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
    """Velocities and accelerations at all but the first and last of `positions` (n, ...)."""
    ahead, behind = positions[2:], positions[:-2]
    return (ahead - behind) / (2.0 * step), (ahead - 2.0 * positions[1:-1] + behind) / step**2


def sliding(velocity: Array) -> NDArray[np.bool_]:
    """Rows (n,) in which friction brakes with all it has."""
    sign = np.sign(velocity)
    use = np.abs(velocity) > SLOWEST * np.max(np.abs(velocity))
    # A step in which the velocity changes its sign has friction of both signs.
    use[1:-1] &= (sign[:-2] == sign[1:-1]) & (sign[1:-1] == sign[2:])
    use[[0, -1]] = False
    return np.asarray(use)


def level(q: Array, v: Array, acceleration: Array) -> Array:
    """(n, joints) N m that move one or two links in a level plane without losses; angles are relative to the link before."""
    return _planar(q, v, acceleration, 0.0)


def hanging(q: Array, v: Array, acceleration: Array) -> Array:
    """The same under gravity, with 0 straight down."""
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
    """That each run's motion is one of the paper's masses and losses under these springs.

    springs: of each joint, AlterEgo's if not given; until: s, of each run, if not to its end.
    """
    motions = {
        name: read_motion(samples, springs or [ALTEREGO] * len(samples.joints), law, until=until[name] if until else math.inf)
        for name, samples in runs.items()
    }
    wanted = {
        "masses": ("masses, times the paper's, that the motion tells", 1.0, ""),
        "damping": ("damping that the motion tells", DAMPING, "N m s/rad"),
        "friction": ("friction that the motion tells", FRICTION, "N m"),
    }
    return [
        Claim(
            origin="theory",
            text=f"{name}: the links move as Newton's law with the paper's springs and {what} has it",
            quantity=quantity,
            measured=getattr(motion, what),
            bound=near(value, SHARE * value, unit),
        )
        for name, motion in motions.items()
        for what, (quantity, value, unit) in wanted.items()
    ]
