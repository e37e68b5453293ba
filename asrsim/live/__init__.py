"""Live runs: simulation in real time with ROS or WebSocket topics. Commands are recorded, so the run can be repeated."""

from __future__ import annotations

from asrsim.live.transport import TRANSPORTS, Access, Interface, Received, Transport, TransportEntry

__all__ = ["TRANSPORTS", "Access", "Interface", "Received", "Transport", "TransportEntry"]
