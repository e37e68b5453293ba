"""Experiment design (`asrsim design`): finds the motion that gives, within limits, the most information about parameters."""

from __future__ import annotations

from asrsim.designs.run import Design, design

__all__ = ["Design", "design"]
