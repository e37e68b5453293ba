"""MuJoCo Warp: the file for thousands of worlds on a GPU."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.exports.programs.base import Program
from asrsim.samples import Array
from asrsim.warping.program import loaded_warp


class MujocoWarp(Program):
    """MuJoCo Warp, replayed on the CPU. The replay only compares its motion with the motion in MuJoCo, and measures no
    speed."""

    name, title, packages, modules = "warp", "MuJoCo Warp", ("mujoco-warp", "warp-lang"), ("mujoco_warp", "warp")
    longest = 1000

    def positions(self, path: Path, model: Any, start: Any, controls: Array, torques: Array) -> Array:
        """Positions of the replay; see `Program`."""
        wp, mjw = loaded_warp(), import_module("mujoco_warp")
        with wp.ScopedDevice("cpu"):
            m, d = mjw.put_model(model), mjw.put_data(model, start)
            found = np.full((len(controls), model.nq), np.nan)
            for k in range(len(controls)):
                found[k] = d.qpos.numpy()[0]
                d.ctrl.assign(controls[None, k].astype(np.float32))
                d.qfrc_applied.assign(torques[None, k].astype(np.float32))
                mjw.step(m, d)
        return found
