"""Where figure 8's joints must come to rest, and how they must swing there: closed forms, without the simulator's laws.

Every number is written here as the paper (section 4.1, figure 8) and the released toolbox's defaults have it, and the laws are
summed on paper for motors that stand at the equilibrium plus and minus the preset. Nothing is taken from the actuators, from
the robots' files or from a run: a change of any of them shows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from asrsim.samples import Array

STEP, AT = 0.8, 0.1
"""rad, s, of the reference's step."""
RESIDUAL = 1e-6
"""rad that the last swings may still have."""
GRAVITY = 9.81
"""m/s^2."""
MASS, ARM = 0.2, 0.04
"""kg, m: the paper's load, from the axis to its centre of mass."""
INERTIA = MASS * ARM**2 + 1e-6
"""kg m^2 about the axis; the examples' files give the load 1e-6 about its centre."""
DAMPING = 0.02
"""N m s/rad, of the examples' joints."""


@dataclass(frozen=True, kw_only=True)
class Spring:
    """A spring's torque over its deflection d = equilibrium minus link: scale sinh(rate d), scale sin(rate d) or scale d."""

    kind: str
    """sinh, sin or linear."""
    scale: float
    """N m (linear: N m/rad)."""
    rate: float = 1.0
    """1/rad."""
    straight: float = 0.8
    """rad, deflection of the equilibrium up to which no spring is at its limit."""

    def torque(self, deflection: Array | float) -> Array:
        """N m."""
        d = self.rate * np.asarray(deflection, dtype=np.float64)
        return np.asarray(self.scale * (np.sinh(d) if self.kind == "sinh" else np.sin(d) if self.kind == "sin" else d))

    def energy(self, deflection: Array) -> Array:
        """J over the undeflected joint's."""
        d = self.rate * deflection
        return np.asarray(
            self.scale
            / self.rate
            * (np.cosh(d) - 1.0 if self.kind == "sinh" else 1.0 - np.cos(d) if self.kind == "sin" else 0.5 * d * d)
        )

    def slope(self, deflection: float) -> float:
        """N m/rad."""
        d = self.rate * deflection
        return self.scale * self.rate * (math.cosh(d) if self.kind == "sinh" else math.cos(d) if self.kind == "sin" else 1.0)


def _awas(sigma: float) -> Spring:
    """g sin(d) cos(d), g = 2 Ks ((L / r) sigma / (L - sigma))^2, with Ks = 10 N m/rad, L = 0.05 m, r = 0.015 m."""
    return Spring(kind="sin", scale=10.0 * (0.05 / 0.015 * sigma / (0.05 - sigma)) ** 2, rate=2.0, straight=0.3)


def _bavs(preset: float) -> Spring:
    """The four exponentials of both motors add up to 2 k (b exp(k_e p) + a exp(-k_e p)) sinh(k_e d)."""
    a, b, k, rate = 1.21e-6, 2.38e-6, 1.6e5, 8.71
    scale = 2.0 * k * (b * math.exp(rate * preset) + a * math.exp(-rate * preset))
    return Spring(kind="sinh", scale=scale, rate=rate, straight=0.27 - preset)


def _qbmove(preset: float) -> Spring:
    """The two hyperbolic sines add up to 2 k cosh(a p) sinh(a d), with k = 0.0019 N m, a = 8.9992 1/rad."""
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
"""Actuator and setting of figure 8 -> its spring."""
ACTUATORS = {"sea": "SEA", "awas_ii": "AwAS-II", "bavs": "BAVS", "qbmove": "qbMove"}


def label_of(case: tuple[str, str]) -> str:
    """A case for people."""
    return f"{ACTUATORS[case[0]]} {case[1]}"


@dataclass(frozen=True, kw_only=True)
class Rest:
    """A joint's equilibrium under gravity with its motors held."""

    position: float
    """rad."""
    spring: float
    """N m/rad, the spring's own slope there."""
    lowest: float
    """rad, least position at which the joint's friction still holds it."""
    highest: float
    """rad, largest such position."""
    damping: float = DAMPING
    """N m s/rad."""
    inertia: float = INERTIA
    """kg m^2 about the axis."""

    def outside(self, position: float) -> float:
        """rad by which a position lies outside of what friction can hold; 0 inside."""
        return max(self.lowest - position, position - self.highest, 0.0)

    @property
    def slope(self) -> float:
        """N m/rad, with the slope of gravity."""
        return self.spring + MASS * GRAVITY * ARM * math.cos(self.position)

    @property
    def natural(self) -> float:
        """rad/s, sqrt(slope / inertia)."""
        return math.sqrt(self.slope / self.inertia)

    @property
    def decay(self) -> float:
        """1/s, damping / (2 inertia)."""
        return self.damping / (2.0 * self.inertia)

    @property
    def frequency(self) -> float:
        """Hz, of the undamped small oscillation."""
        return self.natural / (2.0 * math.pi)


def rest(case: tuple[str, str], *, damping: float = DAMPING, friction: float = 0.0) -> Rest:
    """Where a joint of figure 8 rests: roots of spring torque less weight, plus and minus friction (N m), by Brent's method."""
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
    """What a motion lost."""

    damping: float
    """N m s/rad."""
    friction: float
    """N m."""


def losses(case: tuple[str, str], position: Array, step: float) -> Losses:
    """Damping and friction of a joint of figure 8, from its positions (n,) rad alone, every `step` s after the step.

    Newton's law with spring, weight and inertia of this file: what it leaves over is -c v - f sign(v), by least squares.
    """
    q = position[1:-1]
    velocity = (position[2:] - position[:-2]) / (2.0 * step)
    acceleration = (position[2:] - 2.0 * q + position[:-2]) / step**2
    left = INERTIA * acceleration - SPRINGS[case].torque(STEP - q) + MASS * GRAVITY * ARM * np.sin(q)
    use = (np.abs(STEP - q) < SPRINGS[case].straight) & (np.abs(velocity) > 0.02 * np.max(np.abs(velocity)))
    # A step in which the velocity changes its sign has friction of both signs.
    use[1:-1] &= (np.sign(velocity[:-2]) == np.sign(velocity[1:-1])) & (np.sign(velocity[1:-1]) == np.sign(velocity[2:]))
    columns = -np.column_stack([velocity, np.sign(velocity)])
    damping, friction = np.linalg.lstsq(columns[use], left[use], rcond=None)[0]
    return Losses(damping=float(damping), friction=float(friction))
