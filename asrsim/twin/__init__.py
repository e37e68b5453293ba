"""A twin of a running robot (`asrsim twin`): external torques, alarms and stiffness from measured positions and commands."""

from __future__ import annotations

from asrsim.twin.twin import Twin, TwinStep

__all__ = ["Twin", "TwinStep"]
