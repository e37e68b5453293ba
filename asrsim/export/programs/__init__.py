"""Programs that an exported file can be made for (`asrsim export --for`)."""

from __future__ import annotations

from asrsim.export.programs.base import Program
from asrsim.export.programs.mjlab import Mjlab
from asrsim.export.programs.mjx import Mjx
from asrsim.export.programs.mujoco import Mujoco
from asrsim.export.programs.warp import MujocoWarp
from asrsim.registry import Registry

PROGRAMS: Registry[type[Program]] = Registry("program", base=Program)
for one in (Mujoco, MujocoWarp, Mjx, Mjlab):
    PROGRAMS.add(one.name, one)

__all__ = ["PROGRAMS", "Program"]
