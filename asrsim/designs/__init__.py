"""Experiment design: the motion within limits that gives the most information about unknown parameters (`asrsim design`)."""

from __future__ import annotations

from asrsim.designs.run import Design, design

__all__ = ["Design", "design"]
