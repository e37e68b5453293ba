"""Constructs of MJCF that some programs simulate correctly and others do not."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Constructs:
    """Constructs of MJCF that a program simulates correctly."""

    dc_motors: bool = True
    """DC motors with speed limit, integral action and bristles, and an implicit integrator that keeps the motors' limits. For a
    program without them, motors are affine actuators, and the integrator is Euler's method.
    """
    curved_springs: bool = True
    """Tendons whose stiffness is a polynomial. For a program without them, springs are made of linear pieces."""
    delays: bool = True
    """Actuators that delay their control."""
    stiffness_controls: bool = True
    """Actuators on tendons, whose control is a stiffness."""
    contacts: bool = True
    """Contact pairs with elliptic friction cones."""
