"""MuJoCo itself: the file for its C library, `mujoco.rollout` and its viewer."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from asrsim.engines.mujoco_library import load
from asrsim.exports.programs.base import Program
from asrsim.samples import Array


class Mujoco(Program):
    """MuJoCo's C library."""

    name, title, packages, modules = "mujoco", "MuJoCo", ("mujoco-core",), ("mujoco",)

    def positions(self, path: Path, model: Any, start: Any, controls: Array, torques: Array) -> Array:
        """Positions of the replay; see `Program`."""
        mujoco, data = load(), start
        found = np.full((len(controls), model.nq), np.nan)
        for k in range(len(controls)):
            # After a divergence MuJoCo restarts at time 0, which is too early for step k.
            if data.time < (k - 0.5) * model.opt.timestep:
                break
            found[k] = data.qpos
            data.ctrl[:], data.qfrc_applied[:] = controls[k], torques[k]
            mujoco.mj_step(model, data)
        return found
