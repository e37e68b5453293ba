"""Programs that an exported file can be made for (`asrsim export --for`)."""

from __future__ import annotations

from asrsim.exports.programs.base import Program
from asrsim.exports.programs.mjlab import Mjlab
from asrsim.exports.programs.mjx import Mjx
from asrsim.exports.programs.mujoco import Mujoco
from asrsim.exports.programs.warp import MujocoWarp
from asrsim.registry import Registry

PROGRAMS: Registry[type[Program]] = Registry("program", "asrsim.programs", base=Program, label="name")
for one in (Mujoco, MujocoWarp, Mjx, Mjlab):
    PROGRAMS.own(one.name, one)

__all__ = ["PROGRAMS", "Program"]
