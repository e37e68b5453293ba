"""Equilibria and oscillations of the joints in figure 8, in closed form and independent of the simulator.

Every number is copied from the paper (section 4.1, figure 8) and from the defaults of the released toolbox. The motors stand
at the equilibrium plus and minus the preset, and the torques of both springs are added analytically. Nothing comes from the
actuators, the robot files or a run, so that a change in any of them is noticed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from asrsim.samples import Array

STEP, AT = 0.8, 0.1
"""Size (rad) and time (s) of the reference step."""
RESIDUAL = 1e-6
"""Largest amplitude of the last swings, rad."""
GRAVITY = 9.81
"""Gravitational acceleration, m/s^2."""
MASS, ARM = 0.2, 0.04
"""Mass of the paper's load (kg), and distance of its centre of mass from the axis (m)."""
INERTIA = MASS * ARM**2 + 1e-6
"""Inertia of the load about the axis, kg m^2. In the example files, its inertia about its own centre is 1e-6."""
DAMPING = 0.02
"""Damping of the joints in the example files, N m s/rad."""


@dataclass(frozen=True, kw_only=True)
class Spring:
    """Spring torque over the deflection d = equilibrium - link: scale sinh(rate d), scale sin(rate d) or scale d."""

    kind: str
    """Kind of the law: sinh, sin or linear."""
    scale: float
    """Scale of the torque, N m (linear: N m/rad)."""
    rate: float = 1.0
    """Rate of the law, 1/rad."""
    straight: float = 0.8
    """Largest deflection at which no spring reaches its limit, rad."""

    def torque(self, deflection: Array | float) -> Array:
        """Torque on the link, N m."""
        d = self.rate * np.asarray(deflection, dtype=np.float64)
        return np.asarray(self.scale * (np.sinh(d) if self.kind == "sinh" else np.sin(d) if self.kind == "sin" else d))

    def energy(self, deflection: Array) -> Array:
        """Elastic energy relative to the undeflected joint, J."""
        d = self.rate * deflection
        return np.asarray(
            self.scale
            / self.rate
            * (np.cosh(d) - 1.0 if self.kind == "sinh" else 1.0 - np.cos(d) if self.kind == "sin" else 0.5 * d * d)
        )

    def slope(self, deflection: float) -> float:
        """Slope of the torque: stiffness, N m/rad."""
        d = self.rate * deflection
        return self.scale * self.rate * (math.cosh(d) if self.kind == "sinh" else math.cos(d) if self.kind == "sin" else 1.0)


def _awas(sigma: float) -> Spring:
    """Spring of AwAS-II: g sin(d) cos(d), g = 2 Ks ((L / r) sigma / (L - sigma))^2, Ks = 10 N m/rad, L = .05 m, r = .015 m."""
    return Spring(kind="sin", scale=10.0 * (0.05 / 0.015 * sigma / (0.05 - sigma)) ** 2, rate=2.0, straight=0.3)


def _bavs(preset: float) -> Spring:
    """Spring of BAVS: the four exponentials of both motors add up to 2 k (b exp(k_e p) + a exp(-k_e p)) sinh(k_e d)."""
    a, b, k, rate = 1.21e-6, 2.38e-6, 1.6e5, 8.71
    scale = 2.0 * k * (b * math.exp(rate * preset) + a * math.exp(-rate * preset))
    return Spring(kind="sinh", scale=scale, rate=rate, straight=0.27 - preset)


def _qbmove(preset: float) -> Spring:
    """Spring of qbMove: two hyperbolic sines add up to 2 k cosh(a p) sinh(a d), with k = 0.0019 N m, a = 8.9992 1/rad."""
    return Spring(kind="sinh", scale=2.0 * 0.0019 * math.cosh(8.9992 * preset), rate=8.9992, straight=0.8 - preset)


SPRINGS = {
    ("sea", "soft"): Spring(kind="linear", scale=200.0),
    ("sea", "stiff"): Spring(kind="linear", scale=400.0),
    ("awas_ii", "soft"): _awas(0.005),
    ("awas_ii", "stiff"): _awas(0.04),
    ("bavs", "soft"): _bavs(0.001),
    ("bavs", "stiff"): _bavs(0.22),
    ("qbmove", "soft"): _qbmove(0.2),
    ("qbmove", "stiff"): _qbmove(0.6),
}
"""Springs of figure 8, by actuator and setting."""
ACTUATORS = {"sea": "SEA", "awas_ii": "AwAS-II", "bavs": "BAVS", "qbmove": "qbMove"}


def label_of(case: tuple[str, str]) -> str:
    """Name of a case in texts and tables."""
    return f"{ACTUATORS[case[0]]} {case[1]}"


@dataclass(frozen=True, kw_only=True)
class Rest:
    """Equilibrium of a joint under gravity with fixed motors."""

    position: float
    """Position of the link, rad."""
    spring: float
    """Stiffness of the spring at the equilibrium, N m/rad."""
    lowest: float
    """Smallest position at which friction holds the joint at rest, rad."""
    highest: float
    """Largest position at which friction holds the joint at rest, rad."""
    damping: float = DAMPING
    """N m s/rad."""
    inertia: float = INERTIA
    """Inertia about the axis, kg m^2."""

    def outside(self, position: float) -> float:
        """Distance of a position from the range in which friction holds the joint at rest, rad; 0 inside the range."""
        return max(self.lowest - position, position - self.highest, 0.0)

    @property
    def slope(self) -> float:
        """Total stiffness of spring and gravity, N m/rad."""
        return self.spring + MASS * GRAVITY * ARM * math.cos(self.position)

    @property
    def natural(self) -> float:
        """Natural frequency sqrt(slope / inertia), rad/s."""
        return math.sqrt(self.slope / self.inertia)

    @property
    def decay(self) -> float:
        """Decay rate damping / (2 inertia), 1/s."""
        return self.damping / (2.0 * self.inertia)

    @property
    def frequency(self) -> float:
        """Frequency of small undamped oscillations, Hz."""
        return self.natural / (2.0 * math.pi)


def rest(case: tuple[str, str], *, damping: float = DAMPING, friction: float = 0.0) -> Rest:
    """Equilibrium of a joint of figure 8: roots of spring torque - weight +- friction (N m), found by Brent's method."""
    from scipy.optimize import brentq

    spring = SPRINGS[case]

    def root(surplus: float) -> float:
        def excess(q: float) -> float:
            return float(spring.torque(STEP - q)) - MASS * GRAVITY * ARM * math.sin(q) - surplus

        return float(brentq(excess, STEP - 0.7, STEP + 0.7, xtol=1e-15, rtol=1e-14))

    position = root(0.0)
    return Rest(
        position=position, spring=spring.slope(STEP - position), lowest=root(friction), highest=root(-friction), damping=damping
    )


@dataclass(frozen=True, kw_only=True)
class Losses:
    """Damping and friction fitted to a motion."""

    damping: float
    """N m s/rad."""
    friction: float
    """N m."""


def losses(case: tuple[str, str], position: Array, step: float) -> Losses:
    """Damping and friction of a joint of figure 8, fitted to its positions (n,) in rad at intervals of `step` s.

    The residual torque of Newton's law, with the spring, weight and inertia of this file, is fitted by -c v - f sign(v).
    """
    q = position[1:-1]
    velocity = (position[2:] - position[:-2]) / (2.0 * step)
    acceleration = (position[2:] - 2.0 * q + position[:-2]) / step**2
    left = INERTIA * acceleration - SPRINGS[case].torque(STEP - q) + MASS * GRAVITY * ARM * np.sin(q)
    use = (np.abs(STEP - q) < SPRINGS[case].straight) & (np.abs(velocity) > 0.02 * np.max(np.abs(velocity)))
    # If the velocity changes its sign within a step, so does the friction.
    use[1:-1] &= (np.sign(velocity[:-2]) == np.sign(velocity[1:-1])) & (np.sign(velocity[1:-1]) == np.sign(velocity[2:]))
    columns = -np.column_stack([velocity, np.sign(velocity)])
    damping, friction = np.linalg.lstsq(columns[use], left[use], rcond=None)[0]
    return Losses(damping=float(damping), friction=float(friction))
