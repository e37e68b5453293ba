"""Steppings: how actuators and engine share a step. One table of constants serves all but the released order."""

from __future__ import annotations

from dataclasses import dataclass

from asrsim.registry import Registry


@dataclass(frozen=True, kw_only=True)
class Stepping:
    """The constants that make a scheme."""

    name: str
    order: int
    """Order of convergence where forces are smooth; 1 with Coulomb friction or impacts."""
    doc: str
    implicitness: float = 0.5
    """Of motor damping and derivative action: 1/2 midpoint, 0 explicit."""
    first_drift: float = 0.5
    """Part of a motor's step before its kick."""
    staggered: bool = True
    """Velocities live at half steps: the first kick is half, damping and controllers extrapolate the velocity, the Coriolis
    lag is corrected, kicks split where an input jumps, and logged velocities are centred."""
    released: bool = False
    """Joints step in the released toolbox's own order."""


STEPPINGS: Registry[Stepping] = Registry("stepping", entry_point_group="asrsim.steppings", instance=Stepping)
for _stepping in (
    Stepping(
        name="leapfrog",
        order=2,
        doc="default: one torque evaluation serves motor and link; second order where forces are smooth",
    ),
    Stepping(
        name="euler",
        order=1,
        implicitness=0.0,
        first_drift=0.0,
        staggered=False,
        doc="one torque evaluation serves motor and link; semi-implicit Euler, first order",
    ),
    Stepping(
        name="toolbox",
        order=1,
        implicitness=0.0,
        first_drift=0.0,
        staggered=False,
        released=True,
        doc="the released toolbox's order of a step, bit for bit where it is defined; not passive in modes 5 and 6",
    ),
):
    STEPPINGS.add(_stepping.name, _stepping)
