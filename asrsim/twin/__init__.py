"""A twin of a running robot: external torques, alarms and stiffness from commands and measured positions (`asrsim twin`)."""

from __future__ import annotations

from asrsim.twin.twin import Twin, TwinStep

__all__ = ["Twin", "TwinStep"]
