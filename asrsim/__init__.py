"""asrsim simulates articulated soft robots: joints driven through springs (SEA) or variable-stiffness actuators (VSA)."""

from __future__ import annotations

__version__ = "0.1.0"
