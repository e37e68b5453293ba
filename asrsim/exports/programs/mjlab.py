"""mjlab: the file, and a small Python package with an entity, actions, events and a reach task."""

from __future__ import annotations

import json
import re
import sys
from importlib import import_module
from importlib.resources import files
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numpy as np

from asrsim import __version__
from asrsim.errors import ScenarioError
from asrsim.exports.constructs import Constructs
from asrsim.exports.motors import motor_name, starts_of
from asrsim.exports.programs.base import Program
from asrsim.outfile import make_folder, write_text
from asrsim.samples import Array
from asrsim.simulation.drives import SteppedJoint, ranges_of
from asrsim.simulation.prepared import Prepared

FILES = "__init__", "robot", "reach", "train"
"""Modules of the package that is written for mjlab; their texts are in the folder `mjlab_package`."""
UNLIMITED = -1.0, 1.0
"""Range of an action that sets a reference without limits, in the unit of the reference."""


class Mjlab(Program):
    """mjlab 1.6. It needs MuJoCo and MuJoCo Warp 3.11, in which the gains of DC motors are in volts."""

    name, title, packages, modules = "mjlab", "mjlab", ("mjlab", "mujoco-warp", "torch"), ("mjlab", "torch")
    constructs = Constructs(dc_motors=False, delays=False, contacts=False, stiffness_controls=False)
    longest = 1000

    def write(self, path: Path, prepared: Prepared, timestep: float, ranges: Path | None, remarks: list[str]) -> list[Path]:
        """Write the package. See `Program`."""
        import yaml

        folder = make_folder(path.parent / package_name(path))
        data = {
            "generator": f"asrsim {__version__}",
            "name": prepared.robot.name,
            "model": path.name,
            "timestep": timestep,
            "gravity": list(prepared.scenario.gravity),
            "start": {name: (position, velocity) for name, position, velocity in starts_of(prepared)},
            "joints": [_joint(prepared, drive) for drive in prepared.drives if drive.drive is not None],
            "ranges": yaml.safe_load(ranges.read_text(encoding="utf-8")) if ranges is not None else {},
        }
        written = [folder / "robot.json", *(folder / f"{name}.py" for name in FILES)]
        write_text(written[0], json.dumps(data, indent=2) + "\n", "json")
        for name, target in zip(FILES, written[1:], strict=True):
            text = files("asrsim.exports.programs").joinpath("mjlab_package", f"{name}.py.txt").read_text(encoding="utf-8")
            write_text(target, text.replace("PACKAGE", folder.name), "package")
        return written

    def positions(self, path: Path, model: Any, start: Any, controls: Array, torques: Array) -> Array:
        """Positions of the replay; see `Program`. The replay uses the entity of the package in a scene of mjlab."""
        robot = _module_at(path.parent / package_name(path) / "robot.py")
        scenes, sims, torch = (import_module(name) for name in ("mjlab.scene", "mjlab.sim", "torch"))
        scene = scenes.Scene(scenes.SceneCfg(num_envs=1, entities={robot.ROBOT: robot.robot_cfg()}), "cpu")
        settings = sims.SimulationCfg(mujoco=robot.mujoco_cfg(), nconmax=64, njmax=64)
        sim = sims.Simulation(num_envs=1, cfg=settings, model=scene.compile(), device="cpu")
        own = sim.mj_model

        def joint(i: int) -> Any:
            return own.joint(f"{robot.ROBOT}/{model.joint(i).name}")

        actuators = [own.actuator(f"{robot.ROBOT}/{model.actuator(i).name}").id for i in range(model.nu)]
        coordinates, freedoms = np.zeros(model.nq, dtype=int), np.zeros(model.nv, dtype=int)
        for i in range(model.njnt):
            one, there = model.joint(i), joint(i)
            coordinates[one.qposadr[0] : one.qposadr[0] + len(one.qpos0)] = there.qposadr[0] + np.arange(len(one.qpos0))
            freedoms[one.dofadr[0] : one.dofadr[0] + len(one.damping)] = there.dofadr[0] + np.arange(len(one.damping))
        sim.data.qpos[0, coordinates] = torch.tensor(start.qpos, dtype=torch.float32)
        sim.data.qvel[0, freedoms] = torch.tensor(start.qvel, dtype=torch.float32)
        found = np.full((len(controls), model.nq), np.nan)
        control, torque = (torch.tensor(table, dtype=torch.float32) for table in (controls, torques))
        for k in range(len(controls)):
            found[k] = sim.data.qpos[0, coordinates].numpy()
            sim.data.ctrl[0, actuators], sim.data.qfrc_applied[0, freedoms] = control[k], torque[k]
            sim.step()
        return found


def _module_at(path: Path) -> Any:
    """The module at `path`. It is loaded without its package, since the package would register its task."""
    found = spec_from_file_location(path.stem, path)
    module: Any = module_from_spec(found)  # type: ignore[arg-type]
    sys.modules[module.__name__] = module
    found.loader.exec_module(module)  # type: ignore[union-attr]
    return module


def package_name(path: Path) -> str:
    """Name of the package beside the model at `path`."""
    return re.sub(r"\W|^(?=\d)", "_", path.stem) + "_mjlab"


def _joint(prepared: Prepared, stepped: SteppedJoint) -> dict[str, Any]:
    """Motors and references of a joint for the package; the inputs of the motors are matrix @ references + offset. Raises
    ScenarioError."""
    drive: Any = stepped.drive
    own = ranges_of(prepared.scenario, prepared.drives)[stepped.name]
    names = [name for name in stepped.acting_references if name in own]
    motors = [motor_name(stepped.name, i + 1) for i in range(drive.actuator.motors)] if drive.mode.spring else [stepped.name]
    count, slots = len(motors), len(stepped.references)
    rows = [stepped.references.index(name) for name in names]

    def goals(references: Array) -> Array:
        table = np.zeros((slots, references.shape[1]))
        table[rows] = references
        return np.asarray(drive.goals(table))[:count]

    points = np.column_stack([np.zeros(len(names)), np.eye(len(names)), np.linspace(0.2, 0.3, len(names))])
    values = goals(points)
    offset = values[:, 0]
    matrix = values[:, 1:-1] - offset[:, None]
    # Leave out references that move no motor, such as the reference of an adjuster at rest.
    used = np.asarray(np.abs(matrix).any(axis=0)).tolist()
    names = [name for name, one in zip(names, used, strict=True) if one]
    bounds = [own[name] if np.isfinite(own[name]).all() else UNLIMITED for name in names]
    if not np.allclose(matrix @ points[:, -1] + offset, values[:, -1], rtol=1e-9, atol=1e-9):
        raise ScenarioError(
            f"the inputs of the motors of joint '{stepped.name}' are not affine functions of its references: the package for "
            "mjlab has no action for it",
            key=stepped.name,
            code="export-goals",
        )
    return {
        "name": stepped.name,
        "motors": motors,
        "references": names,
        "low": [low for low, _ in bounds],
        "high": [high for _, high in bounds],
        "matrix": matrix[:, used].tolist(),
        "offset": offset.tolist(),
        "command": "position" if drive.mode.controller else "effort",
    }
