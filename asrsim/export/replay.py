"""The scenario's motion in plain MuJoCo, compared with the motion in asrsim: error of the exported model for each joint."""

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
    """The scenario's motion in asrsim and in MuJoCo, at the scenario's steps."""

    joints: tuple[str, ...]
    units: tuple[str, ...]
    """Unit of each joint's error: mrad or mm."""
    time: Array
    """Times (n,), s."""
    ours: Array
    """Link positions (n, joints) of asrsim, rad (m)."""
    theirs: Array
    """Link positions (n, joints) of MuJoCo, rad (m); NaN after a divergence."""

    @property
    def error(self) -> Array:
        """Positions in MuJoCo minus positions in asrsim (n, joints), mrad (mm)."""
        return 1e3 * (self.theirs - self.ours)

    @property
    def rms(self) -> Array:
        """Root mean square of the error (joints,), mrad (mm)."""
        return np.asarray(np.sqrt(np.mean(self.error**2, axis=0)))

    @property
    def diverged_at(self) -> float | None:
        """Time at which MuJoCo's motion diverges, s; None if the motion does not diverge."""
        lost = ~np.isfinite(self.theirs).all(axis=1)
        return float(self.time[int(np.argmax(lost))]) if lost.any() else None


def run_of(prepared: Prepared) -> dict[str, Array]:
    """Results of the scenario's run in asrsim: values (n, joints) by quantity. Raises SimulationError if it diverges."""
    motors = max((drive.drive.actuator.positions() for drive in prepared.drives if drive.drive), default=0)
    names = ["link_position", "external_torque"]
    for i in range(1, motors + 1):
        names += [f"reference_{i}", f"motor_{i}_position", f"motor_{i}_velocity"]
    with Worlds(prepared, 1, watched=False) as worlds:
        known = [name for name in names if name in worlds.selection.names]
        found = {name: values[0] for name, values in worlds.rollout(known).items()}
    if not np.isfinite(found["link_position"]).all():
        raise SimulationError("the scenario diverges in asrsim itself: run it by `asrsim run` first")
    return found


def controls(prepared: Prepared, run: Mapping[str, Array], model: Any) -> Array:
    """Controls of the model's actuators (n, actuators) at the scenario's steps: commanded motor positions that follow from the
    references.
    """
    shape = run["link_position"].shape
    found = np.zeros((shape[0], model.nu))
    for j, stepped in enumerate(prepared.drives):
        if (drive := stepped.drive) is None:
            continue
        slots = range(1, max(2, drive.actuator.positions()) + 1)
        goals = drive.goals(np.nan_to_num([run.get(f"reference_{i}", np.zeros(shape))[:, j] for i in slots]))
        motors = [motor_name(drive.joint, i + 1) for i in range(drive.actuator.motors)] if drive.mode.spring else [drive.joint]
        for name, goal in zip(motors, goals, strict=False):
            found[:, model.actuator(name).id] = goal
    return found


def replay(prepared: Prepared, run: Mapping[str, Array], path: Path) -> Replay:
    """Motions in asrsim and in MuJoCo. MuJoCo simulates the model at `path` with the references of asrsim's run. Raises
    SimulationError if MuJoCo cannot load it.
    """
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
    # Inputs are interpolated linearly between the scenario's steps.
    at = np.arange((length - 1) * fine) / fine
    columns = np.column_stack([controls(prepared, run, model), forces]).T
    inputs = np.array([np.interp(at, np.arange(length), column) for column in columns]).T
    kind = mujoco.mjtState
    start = np.empty(mujoco.mj_stateSize(model, kind.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, start, kind.mjSTATE_FULLPHYSICS)
    spec = int(kind.mjSTATE_CTRL) | int(kind.mjSTATE_QFRC_APPLIED)
    states, _ = rollout.rollout(model, data, start, inputs, control_spec=spec)
    rows = np.vstack([start, states[0][fine - 1 :: fine]])
    times = prepared.scenario.step_times()
    theirs = rows[:, [1 + int(model.joint(name).qposadr[0]) for name in joints]]
    # After a divergence MuJoCo stops, or restarts at time 0.
    theirs[np.abs(rows[:, 0] - times) > 0.5 * step] = np.nan
    units = tuple("mm" if drive.joint.kind == "prismatic" else "mrad" for drive in prepared.drives)
    return Replay(joints=tuple(joints), units=units, time=times, ours=run["link_position"], theirs=theirs)


def draw(found: Replay, path: Path) -> list[Path]:
    """Draw both motions and the error in a picture in the folder of the model. Raises OutputError."""
    with styled(mathematics=False):
        from matplotlib.figure import Figure

        count = len(found.joints)
        figure = Figure(figsize=(9.0, 1.2 + 1.6 * count), layout="constrained")
        axes = figure.subplots(count, 2, squeeze=False, sharex=True)
        for j, (left, right) in enumerate(axes):
            unit = found.units[j]
            left.plot(found.time, found.ours[:, j], linewidth=2.2, color="0.7", label="asrsim")
            left.plot(found.time, found.theirs[:, j], linewidth=0.9, label="MuJoCo")
            left.set_ylabel(f"{found.joints[j]}\nlink [{unit.removeprefix('m')}]")
            right.plot(found.time, found.error[:, j], linewidth=0.9)
            right.set_ylabel(f"MuJoCo - asrsim\n[{unit}]")
            right.set_title(f"rms {found.rms[j]:.3g} {unit}", fontsize="small", loc="right")
        axes[0][0].legend(fontsize="x-small", loc="upper right")
        for last in axes[-1]:
            last.set_xlabel("time [s]")
        return save_figure(figure, path.parent, path.stem, ("png",))
