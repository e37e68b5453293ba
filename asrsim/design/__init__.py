"""Experiments designed: the motion within limits that tells most of what is not known (`asrsim design`)."""

from __future__ import annotations

from asrsim.design.run import Design, design

__all__ = ["Design", "design"]
