"""Live runs: simulation in real time with ROS or WebSocket topics. Commands are recorded, so the run can be repeated."""

from __future__ import annotations

from asrsim.live.foxglove import FoxgloveTransport
from asrsim.live.ros import RosTransport
from asrsim.live.transport import TRANSPORTS, Access, Interface, LiveTopic, Received, Transport, TransportEntry

__all__ = ["TRANSPORTS", "Access", "Interface", "LiveTopic", "Received", "Transport", "TransportEntry"]

TRANSPORTS.own("ros", TransportEntry(make=RosTransport, doc="ROS 2 topics, by rclpy", module="rclpy", extra="ros"))
TRANSPORTS.own(
    "foxglove",
    TransportEntry(make=FoxgloveTransport, doc="a WebSocket for Foxglove and Lichtblick", module="foxglove", extra="foxglove"),
)
