"""Numbers that follow from the laws and the limits of a drive, without a simulation."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from asrsim.actuators.drive import Drive
from asrsim.actuators.stages.heating import Heating
from asrsim.actuators.vectorised import energy_law, over_arrays
from asrsim.errors import InputError
from asrsim.samples import Array

POINTS, PRESETS = 1001, 21
"""POINTS: number of deflections at which the laws are evaluated; PRESETS: number of presets."""
NEAR = 1e-4
"""Relative difference between the values of a law at neighbouring presets at which the search for its largest value ends."""
WIDEST = math.pi
"""Largest deflection in rad that is evaluated for a drive without a deflection limit."""
MARGIN = 0.75
"""Fraction of the possible presets that a sheet covers if the actuator states no range of presets. At the largest preset that
springs and motors allow, the joint could carry no load.
"""
ROUNDING = 1e-12


@dataclass(frozen=True, kw_only=True)
class Statics:
    """Torques, stiffness and limits of a drive at rest, without friction."""

    drive: Drive
    effort: float = math.inf
    """Effort limit of the joint that the drive moves, N m."""
    given: tuple[float, float] | None = None
    """Smallest and largest preset that the user states; None: the range follows from the drive."""

    def check(self) -> None:
        """Raise InputError if the user's presets cannot be set."""
        if self.given is None:
            return
        key, value = "--presets", "{:g} {:g}".format(*self.given)
        if not self.adjustable:
            message = f"{self.drive.actuator.title}: the second reference does not change the stiffness"
            raise InputError(message, key=key, value=value, code="no-preset")
        if self.given[1] >= self.highest_preset:
            unit = self.drive.actuator.reference_2_unit
            message = f"must stay below {self.highest_preset:.4g} {unit}, where a spring, a motor or the lever is at its limit"
            raise InputError(message, key=key, value=value, code="high-preset")

    @property
    def adjustable(self) -> bool:
        """Whether the second reference changes the stiffness."""
        return self.drive.actuator.motors > 1 or self.drive.actuator.adjuster

    @property
    def moving(self) -> int:
        """Number of motors that move with the link; the motors on the housing come after them."""
        return self.drive.actuator.motors - self.drive.actuator.housed

    @cached_property
    def presets(self) -> tuple[float, float]:
        """Smallest and largest second reference of the curves on the sheet, in the reference's unit."""
        actuator = self.drive.actuator
        if not self.adjustable:
            return 0.0, 0.0
        if self.given:
            return self.given
        most = float(f"{MARGIN * self.highest_preset:.3g}")
        usual = (0.5 * actuator.typical_preset, 2.0 * actuator.typical_preset) if actuator.adjuster else (0.0, most)
        low, high = actuator.preset_range or usual
        if high >= self.highest_preset:
            low, high = min(low, 0.5 * most), most
        return low, high

    @cached_property
    def highest_preset(self) -> float:
        """Largest preset that the unloaded joint can have. At this preset the springs, the motors or the adjuster's lever reach
        a limit. It is infinite without such a limit.
        """
        if self.drive.actuator.adjuster:
            return self.drive.values.get("lever_length", math.inf)
        farthest = min(self.drive.max_deflection, WIDEST)
        return _last(lambda presets: self.allowed(np.zeros_like(presets), presets), farthest)

    def motors(self, deflection: Array, preset: Array) -> Array:
        """Positions (motors, n) of the motors that deflect the joint by `deflection` (n,) at a preset (n,), with the link at
        0."""
        return over_arrays(self.drive.actuator.motor_references)(deflection, preset)

    def torques(self, deflection: Array, preset: Array) -> Array:
        """Torques (springs, n) of the springs on the motors, N m."""
        positions = self.motors(deflection, preset)
        return over_arrays(self.drive.actuator.elastic_torques)(np.zeros_like(deflection), *positions, self.drive.elastic)

    def torque(self, deflection: Array, preset: Array) -> Array:
        """Torque (n,) on the link, N m."""
        return self.drive.actuator.on_link(self.torques(deflection, preset))

    def stiffness(self, deflection: Array, preset: Array) -> Array:
        """Stiffness (n,), N m/rad."""
        positions = self.motors(deflection, preset)
        return over_arrays(self.drive.actuator.stiffness)(np.zeros_like(deflection), *positions, self.drive.elastic)

    def energy(self, deflection: Array, preset: Array) -> Array:
        """Energy (n,) of the springs, J."""
        positions = self.motors(deflection, preset)
        return over_arrays(energy_law(self.drive.actuator))(np.zeros_like(deflection), *positions, self.drive.elastic)

    def allowed(self, deflection: Array, preset: Array) -> NDArray[np.bool_]:
        """Whether (n,) the springs are within their deflection limit, the motors within their torque limit, and the joint
        within its effort limit.
        """
        drive = self.drive
        torques, positions = self.torques(deflection, preset), self.motors(deflection, preset)
        limits = np.array([*drive.max_torque, *[np.inf] * len(torques)][: len(torques)])[:, None]
        turns = np.abs(positions[: drive.actuator.motors]) <= drive.max_deflection * (1.0 + ROUNDING)
        held = np.abs(torques) <= limits * (1.0 + ROUNDING)
        carried = np.abs(drive.actuator.on_link(torques)) <= self.effort
        return np.asarray(turns.all(axis=0) & held.all(axis=0) & carried)

    def reach(self, preset: float) -> float:
        """Largest deflection at a preset, up to which all limits are kept, rad."""
        farthest = min(self.drive.max_deflection, WIDEST)
        return _last(lambda deflections: self.allowed(deflections, np.full_like(deflections, preset)), farthest)

    def deflections(self, presets: Array) -> Array:
        """Deflections (presets, points) from 0 to the largest deflection at each preset, rad."""
        return np.linspace(0.0, [self.reach(float(preset)) for preset in presets], POINTS).T

    def _highest(self, law: Callable[[Array, Array], Array], presets: Array) -> Array:
        """Largest value (presets,) of a law over the deflections at each preset."""
        deflections = self.deflections(presets)
        values = law(deflections.ravel(), np.repeat(presets, POINTS))
        return np.asarray(values.reshape(deflections.shape).max(axis=1))

    def _largest(self, law: Callable[[Array, Array], Array]) -> float:
        """Largest value of a law over presets and deflections. Where a limit begins to act, the largest value over the
        deflections has a sharp peak over the presets, so the presets near the best preset are searched more finely.
        """
        low, high = self.presets
        closest = ROUNDING * high
        while True:
            presets = np.linspace(low, high, PRESETS if high > low else 1)
            values = self._highest(law, presets)
            best = int(np.argmax(values))
            near = values[max(best - 1, 0) : best + 2]
            if high - low <= closest or near.max() - near.min() <= NEAR * near.max():
                return float(values[best])
            low, high = float(presets[max(best - 1, 0)]), float(presets[min(best + 1, len(presets) - 1)])

    @cached_property
    def peak_torque(self) -> float:
        """Largest torque on the link over presets and deflections, N m."""
        return self._largest(self.torque)

    @cached_property
    def held_torque(self) -> float:
        """Largest torque on the link that the drive holds within all limits at every preset, N m."""
        return float(self._highest(self.torque, np.linspace(*self.presets, PRESETS if self.adjustable else 1)).min())

    @cached_property
    def lasting(self) -> Statics | None:
        """The same drive with the torques that the motors hold continuously as limits; None if a motor has no model of heating.

        A motor with the torque tau heats its winding with the power h tau^2. The winding stays below its derating temperature
        T_d if R h tau^2 <= T_d - T_a, with the thermal resistance R and the ambient temperature T_a.
        """
        drive, limits = self.drive, dict(self.drive.values)
        for motor in range(1, drive.actuator.motors + 1):
            own = Heating.constants(drive.values, motor, drive.mode)
            if own is None:
                return None
            lasting = math.sqrt(max(own.derating - own.ambient, 0.0) / (own.resistance * own.heat))
            limits[f"motor_{motor}_max_torque"] = min(limits[f"motor_{motor}_max_torque"], lasting)
        return replace(self, drive=replace(drive, values=limits), given=self.presets)

    @cached_property
    def peak_energy(self) -> float:
        """Largest energy of the springs over presets and deflections, J."""
        return self._largest(self.energy)

    @cached_property
    def peak_stiffness(self) -> float:
        """Largest stiffness over presets and deflections, N m/rad."""
        return self._largest(self.stiffness)

    def unloaded_stiffness(self) -> tuple[float, float]:
        """Smallest and largest stiffness without load over the presets, N m/rad."""
        presets = np.linspace(*self.presets, POINTS)
        found = self.stiffness(np.zeros_like(presets), presets)
        return float(found.min()), float(found.max())

    @cached_property
    def softest(self) -> float:
        """End of the range of presets at which the unloaded stiffness is smaller."""
        low, high = self.presets
        ends = self.stiffness(np.zeros(2), np.array([low, high]))
        return low if ends[0] <= ends[1] else high

    @cached_property
    def stiffest(self) -> float:
        """End of the range of presets at which the unloaded stiffness is larger."""
        low, high = self.presets
        return high if self.softest == low else low

    def motor_torque(self, speed: Array) -> Array:
        """Torque (n,) in N m of all motors that move the link, together, at a steady speed (n,) in rad/s. It is the largest
        torque within their limits of torque and voltage, minus damping and friction. Motors on the housing stand still.
        """
        drive, total = self.drive, np.zeros_like(speed)
        for i, one in enumerate(drive.electric[: self.moving]):
            most = np.minimum(one.limit, one.stall - one.damping * speed)
            inner = drive.values[f"motor_{i + 1}_damping"]
            total += most - inner * speed - drive.motor_friction[i]
        return total

    def driving_torque(self, speed: Array) -> Array:
        """Torque (n,) in N m on the link at a steady speed (n,) in rad/s. It is `motor_torque`, limited to the largest torque
        that springs and joint transmit.
        """
        return np.minimum(self.motor_torque(speed), self.peak_torque)

    @cached_property
    def top_speed(self) -> float:
        """Largest steady speed without load, rad/s; infinite if nothing limits it."""
        fastest = min(self.drive.max_velocity[: self.moving])
        if math.isfinite(fastest) and self.driving_torque(np.array([fastest]))[0] >= 0.0:
            return fastest
        above = min(fastest, 1e6)
        if self.driving_torque(np.array([above]))[0] > 0.0:
            return math.inf
        return _last(lambda speeds: self.driving_torque(speeds) >= 0.0, above)

    def best_power(self) -> tuple[float, float, float]:
        """Largest output power in W, and the torque in N m and the speed in rad/s at which the drive gives it."""
        speeds = np.linspace(0.0, self.top_speed, 20_001)
        torques = self.driving_torque(speeds)
        best = int(np.argmax(torques * speeds))
        return float(torques[best] * speeds[best]), float(torques[best]), float(speeds[best])


def _last(allowed: Callable[[Array], NDArray[np.bool_]], farthest: float) -> float:
    """Largest number from 0 to `farthest` up to which all numbers are allowed. The search bisects the first interval whose end
    is not allowed.
    """
    low, high = 0.0, farthest
    if bool(allowed(np.linspace(low, high, POINTS)).all()):
        return farthest
    while high - low > ROUNDING * farthest:
        points = np.linspace(low, high, POINTS)
        inside = allowed(points)
        if inside.all():
            break
        first = int(np.argmin(inside))
        if first == 0:
            return low
        if points[first - 1] == low and points[first] == high:
            break
        low, high = float(points[first - 1]), float(points[first])
    return low
