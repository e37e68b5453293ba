"""MuJoCo XLA (MJX): the file for JAX."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.errors import SimulationError
from asrsim.exports.constructs import Constructs
from asrsim.exports.programs.base import Program
from asrsim.samples import Array


class Mjx(Program):
    """MuJoCo XLA in its JAX implementation. With version 3.17 it refused DC motors, and ignored polynomial springs, delays and,
    with the implicit integrator, torque limits."""

    name, title, packages = "mjx", "MuJoCo XLA", ("mujoco-mjx", "jax")
    modules = "mujoco.mjx", "jax"
    constructs = Constructs(dc_motors=False, curved_springs=False, delays=False, contacts=False)
    longest = 40_000

    def positions(self, path: Path, model: Any, start: Any, controls: Array, torques: Array) -> Array:
        """Positions of the replay; see `Program`."""
        jax, mjx = import_module("jax"), import_module("mujoco.mjx")
        try:
            m, d = mjx.put_model(model), mjx.put_data(model, start)
        except NotImplementedError as error:
            raise SimulationError(f"MuJoCo XLA cannot step the model: {error}") from error

        def step(data: Any, given: Any) -> Any:
            control, torque = given
            return mjx.step(m, data.replace(ctrl=control, qfrc_applied=torque)), data.qpos

        run = jax.jit(lambda data, given: jax.lax.scan(step, data, given)[1])
        single = controls.astype(np.float32), torques.astype(np.float32)
        return np.asarray(run(d, single), dtype=float)
