"""Live runs: a simulation in real time with real topics, whose commands are recorded so that it can be repeated."""

from __future__ import annotations

from asrsim.live.transport import TRANSPORTS, Access, Interface, Received, Transport, TransportEntry

__all__ = ["TRANSPORTS", "Access", "Interface", "Received", "Transport", "TransportEntry"]
