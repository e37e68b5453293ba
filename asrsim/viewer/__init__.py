"""View: the robot in a browser, live or played back, with sliders, pulling, ghosts and plots (`asrsim view`)."""

from __future__ import annotations

from asrsim.viewer.open import View, view

__all__ = ["View", "view"]
