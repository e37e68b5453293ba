"""Experiment design (`asrsim design`): finds the motion within limits that tells the most about unknown parameters."""

from __future__ import annotations

from asrsim.designs.run import Design, design

__all__ = ["Design", "design"]
