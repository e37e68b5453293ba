"""The scenario's motion in plain MuJoCo beside asrsim's: how far the exported model is off, joint by joint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.errors import SimulationError
from asrsim.export.mjcf import motor_name
from asrsim.plots.output import save_figure, styled
from asrsim.samples import Array
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.worlds import Worlds


@dataclass(frozen=True, kw_only=True)
class Replay:
    """One motion in both simulators, at the scenario's steps."""

    joints: tuple[str, ...]
    units: tuple[str, ...]
    """mrad or mm, of each joint's error."""
    time: Array
    """(n,) s."""
    ours: Array
    """(n, joints) rad (m), of asrsim."""
    theirs: Array
    """(n, joints) rad (m), of MuJoCo; NaN from where it diverged."""

    @property
    def error(self) -> Array:
        """(n, joints) mrad (mm)."""
        return 1e3 * (self.theirs - self.ours)

    @property
    def rms(self) -> Array:
        """(joints,) mrad (mm)."""
        return np.asarray(np.sqrt(np.mean(self.error**2, axis=0)))

    @property
    def diverged_at(self) -> float | None:
        """s at which MuJoCo's motion is no longer finite; None: it always is."""
        lost = ~np.isfinite(self.theirs).all(axis=1)
        return float(self.time[int(np.argmax(lost))]) if lost.any() else None


ENDS = (("reference", ""), ("motor", "_position"), ("motor", "_velocity"))
"""Quantities of a motor that are kept: what stands before its number, and after."""


def run_of(prepared: Prepared) -> dict[str, Array]:
    """asrsim's run of the scenario: quantity -> (n, joints). Raises SimulationError where it diverges."""
    names = ["link_position", "external_torque"]
    motors = max((drive.drive.actuator.positions() for drive in prepared.drives if drive.drive), default=0)
    names += [f"{name}_{i}{end}" for i in range(1, motors + 1) for name, end in ENDS]
    with Worlds(prepared, 1, watched=False) as worlds:
        known = [name for name in names if name in worlds.selection.names]
        found = {name: values[0] for name, values in worlds.rollout(known).items()}
    if not np.isfinite(found["link_position"]).all():
        raise SimulationError("the scenario diverges in asrsim itself: run it by `asrsim run` first")
    return found


def deflections(prepared: Prepared, run: Mapping[str, Array]) -> dict[str, float]:
    """Joint -> rad, the largest deflection of its springs."""
    found = {}
    for j, drive in enumerate(prepared.drives):
        if drive.drive is not None and drive.drive.mode.spring:
            motors = np.array([run[f"motor_{i}_position"][:, j] for i in range(1, drive.drive.actuator.motors + 1)])
            found[drive.name] = float(np.abs(motors - run["link_position"][:, j]).max())
    return found


def at_speed_limit(prepared: Prepared, run: Mapping[str, Array]) -> set[str]:
    """Joints whose motors meet their speed limit."""
    found = set()
    for j, drive in enumerate(prepared.drives):
        for i, most in enumerate(drive.drive.max_velocity if drive.drive else (), start=1):
            if np.abs(run[f"motor_{i}_velocity"][:, j]).max() > 0.999 * most:
                found.add(drive.name)
    return found


def controls(prepared: Prepared, run: Mapping[str, Array], model: Any) -> Array:
    """(n, actuators of the model) at the scenario's steps: the references as goals of the motors."""
    found = np.zeros((len(run["link_position"]), model.nu))
    for j, stepped in enumerate(prepared.drives):
        drive = stepped.drive
        if drive is None:
            continue
        rows = max(2, drive.actuator.positions())
        blank = np.full(run["link_position"].shape, np.nan)
        references = np.array([run.get(f"reference_{i}", blank)[:, j] for i in range(1, rows + 1)])
        goals = drive.goals(np.nan_to_num(references))
        if not drive.mode.spring:
            found[:, model.actuator(drive.joint).id] = goals[0]
            continue
        for i in range(drive.actuator.motors):
            found[:, model.actuator(motor_name(drive.joint, i + 1)).id] = goals[i]
    return found


def replay(prepared: Prepared, run: Mapping[str, Array], path: Path) -> Replay:
    """Play the run's references in MuJoCo on the model of a file. Raises SimulationError where MuJoCo cannot load it."""
    import mujoco
    from mujoco import rollout

    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise SimulationError(f"{path}: MuJoCo cannot load the model: {' '.join(str(error).split())[:300]}") from error
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    joints = [drive.name for drive in prepared.drives]
    step, length = prepared.scenario.step, len(run["link_position"])
    fine = max(1, round(step / model.opt.timestep))
    forces = np.zeros((length, model.nv))
    forces[:, [int(model.joint(name).dofadr[0]) for name in joints]] = run["external_torque"]
    given = np.column_stack([controls(prepared, run, model), forces])
    at = np.arange((length - 1) * fine) / fine
    inputs = np.array([np.interp(at, np.arange(length), column) for column in given.T]).T
    kind = mujoco.mjtState
    start = np.empty(mujoco.mj_stateSize(model, kind.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, start, kind.mjSTATE_FULLPHYSICS)
    spec = int(kind.mjSTATE_CTRL) | int(kind.mjSTATE_QFRC_APPLIED)
    states, _ = rollout.rollout(model, data, start, inputs, control_spec=spec)
    rows = np.vstack([start, states[0][fine - 1 :: fine]])
    times = prepared.scenario.step_times()
    places = [1 + int(model.joint(name).qposadr[0]) for name in joints]
    theirs = rows[:, places].copy()
    # Where MuJoCo finds a motion bad it stops, or starts anew at time 0.
    theirs[np.abs(rows[:, 0] - times) > 0.5 * step] = np.nan
    units = tuple("mm" if drive.joint.kind == "prismatic" else "mrad" for drive in prepared.drives)
    return Replay(joints=tuple(joints), units=units, time=times, ours=run["link_position"], theirs=theirs)


def draw(found: Replay, path: Path) -> list[Path]:
    """A picture of both motions and of the error, beside the model. Raises OutputError."""
    with styled(mathematics=False):
        from matplotlib.figure import Figure

        count = len(found.joints)
        figure = Figure(figsize=(9.0, 1.2 + 1.6 * count), layout="constrained")
        grid = figure.subplots(count, 2, squeeze=False, sharex=True)
        for j, (left, right) in enumerate(grid):
            linear = found.units[j] == "mm"
            left.plot(found.time, found.ours[:, j], linewidth=2.2, color="0.7", label="asrsim")
            left.plot(found.time, found.theirs[:, j], linewidth=0.9, label="MuJoCo")
            left.set_ylabel(f"{found.joints[j]}\nlink [{'m' if linear else 'rad'}]")
            right.plot(found.time, found.error[:, j], linewidth=0.9)
            right.axhline(0.0, color="0.7", linewidth=0.6)
            right.set_ylabel(f"MuJoCo - asrsim\n[{found.units[j]}]")
            right.set_title(f"rms {found.rms[j]:.3g} {found.units[j]}", fontsize="small", loc="right")
        grid[0][0].legend(fontsize="x-small", loc="upper right")
        for axis in grid[-1]:
            axis.set_xlabel("time [s]")
        return save_figure(figure, path.parent, path.stem, ("png",))
