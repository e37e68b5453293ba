"""Strides of worlds, for `Worlds(..., adaptive=True)`: a world takes fewer substeps while its springs are soft enough.

The number of substeps of a run resolves the stiffest spring that its references can reach. A stride takes several substeps at
once; the number of substeps in a step is a multiple of this number, so that a step consists of whole strides. Each stride
resolves springs up to a certain stiffness, by the rule of `asrsim.simulation.substeps`. At each whole step a world compares
this stiffness with the stiffness that its springs can reach within the step, at the present speeds
(`asrsim.simulation.kernel.stride_of`).

Positions belong to whole strides and velocities to their middles. The kick between two strides lasts from the middle of the
first to the middle of the second stride; it uses the forces at the time between the two strides. The scheme is of second order,
as with equal strides (Hairer, Lubich, Wanner, Geometric Numerical Integration, chapter VIII.3).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from asrsim.actuators.vectorised import over_arrays
from asrsim.errors import InputError, Problem, UnresolvedSpringError
from asrsim.samples import Array
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.fields import Scheme
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.substeps import TARGET, resolution_of

GRID = 33
"""Number of deflections of each spring at which its stiffness is computed."""


@dataclass(frozen=True, eq=False)
class Strides:
    """Strides of worlds, the shortest first."""

    sizes: tuple[int, ...] = (1,)
    """Number of substeps in each stride (s,)."""
    deflections: Array = field(default_factory=lambda: np.zeros((1, 0)))
    """Deflection (s, joints) in rad up to which the springs of each joint are soft enough for each stride."""
    stiffest: Array = field(default_factory=lambda: np.zeros((1, 0)))
    """Largest stiffness (s, joints) of the springs of each joint that each stride resolves, N m/rad."""

    @property
    def shares(self) -> Array:
        """Length (s, s) of the kick between two strides, as a fraction of the second stride."""
        lengths = np.array(self.sizes, dtype=float)
        shares: Array = 0.5 * (lengths[:, None] + lengths) / lengths
        return shares

    def schemes(self, scheme: Scheme) -> list[Scheme]:
        """Constants of the stepping for each pair of strides before and after a kick. The step is the length of the kick, and
        the first drift of a motor ends with the first stride.
        """
        found = []
        for before in self.sizes:
            for after in self.sizes:
                if before == after:
                    found.append(replace(scheme, step=after * scheme.step))
                else:
                    kick = 0.5 * (before + after)
                    found.append(replace(scheme, step=kick * scheme.step, first_drift=0.5 * before / kick))
        return found


ALWAYS_ALL = Strides()
"""Strides of worlds that take all substeps."""


def strides_of(prepared: Prepared) -> Strides:
    """Strides of a scenario's worlds. Raises InputError if something in the scenario needs all substeps."""
    if problems := [Problem(why, key="adaptive", value=True, code="adaptive") for why in _obstacles(prepared)]:
        raise InputError(problems)
    full, drives = prepared.resolution, prepared.drives
    sizes, deflections, stiffest = [1], [[np.inf] * len(drives)], [[np.inf] * len(drives)]
    for size in range(2, full.substeps + 1):
        # `share`: stiffness that a stride resolves, as a fraction of the stiffness that single substeps resolve.
        share = min((TARGET / (full.omega_h * size)) ** 2, 1.0) if full.omega_h else 1.0
        if full.substeps % size == 0 and _resolves(prepared, full.substeps // size, share):
            sizes.append(size)
            stiffest.append([share * one for one in full.stiffness])
            deflections.append([_safe_deflection(*pair) for pair in zip(drives, stiffest[-1], strict=True)])
    return Strides(tuple(sizes), np.array(deflections), np.array(stiffest))


def _obstacles(prepared: Prepared) -> list[str]:
    """Reasons in the scenario why worlds must take all substeps."""
    drives, found = prepared.drives, []
    if prepared.scenario.engine != "mujoco":
        found.append("needs the engine mujoco")
    if not prepared.stepping.staggered or prepared.stepping.released:
        found.append("needs the stepping leapfrog")
    if not prepared.scenario.world.empty:
        found.append("needs a world without contacts")
    if any(drive.sensor is not None for drive in drives):
        found.append("needs joints without imperfect sensors")
    if any(drive.stages for drive in drives):
        found.append("needs joints without stages")
    if any(drive.actuator is not None and drive.actuator.adjuster for drive in drives):
        found.append("needs actuators whose springs are deflected by their motors alone")
    return found


def _resolves(prepared: Prepared, substeps: int, share: float) -> bool:
    """Whether this number of substeps in a step resolves springs of up to this fraction of their largest stiffness."""
    full = prepared.resolution
    try:
        free, fixed = (
            resolution_of(replace(prepared.scenario, substeps=number), prepared.drives, prepared.model, softer=share)
            for number in (None, substeps)
        )
    except UnresolvedSpringError:
        return False
    return (
        free.substeps <= substeps
        and fixed.motor_substeps == full.motor_substeps == 1
        and fixed.link_implicitness == full.link_implicitness
    )


def _safe_deflection(drive: SteppedJoint, stiffness: float) -> float:
    """Deflection of the joint's springs in rad up to which their total stiffness is at most `stiffness` in N m/rad."""
    if drive.drive is None or not drive.drive.mode.spring:
        return np.inf
    actuator, limit = drive.drive.actuator, drive.values.get("max_deflection", np.pi)
    for most in map(float, np.linspace(limit, 0.0, GRID)):
        axis = np.linspace(-most, most, GRID)
        places = [one.ravel() for one in np.meshgrid(*[axis] * drive.positions)]
        found = over_arrays(actuator.stiffness)(np.zeros_like(places[0]), *places, drive.elastic)
        if np.isfinite(found).all() and float(found.max()) <= stiffness:
            return most
    return 0.0
