"""The scenario's motion in plain MuJoCo, compared with the motion in asrsim: error of the exported model for each joint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.actuators.vectorised import over_arrays
from asrsim.engines.mujoco_library import load
from asrsim.errors import SimulationError
from asrsim.export.mjcf import motor_name, stiffness_name
from asrsim.plots import style
from asrsim.plots.chart import Chart, Line
from asrsim.plots.charts import save_charts
from asrsim.samples import Array
from asrsim.simulation.prepare import Prepared
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
    with Worlds(prepared, 1, watched=False) as worlds:
        kinds = "link_position", "external_torque", "reference_", "motor_"
        names = [name for name in worlds.names if name.startswith(kinds)]
        found = {name: values[0] for name, values in worlds.rollout(names).items()}
    if not np.isfinite(found["link_position"]).all():
        raise SimulationError("the scenario diverges in asrsim itself: find the cause by `asrsim run` first")
    return found


def replay(prepared: Prepared, run: Mapping[str, Array], path: Path) -> Replay:
    """Motions in asrsim and in MuJoCo. MuJoCo simulates the model at `path` with the references and the external torques of the
    scenario; the model delays the references itself.
    """
    mujoco = load()
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    times, step = prepared.scenario.step_times(), model.opt.timestep
    stamps = np.arange(np.ceil(times[-1] / step) + 1.0) * step
    controls, torques = inputs_of(prepared, model, stamps)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for i in np.flatnonzero(model.actuator_history[:, 0]).tolist():
        samples = int(model.actuator_history[i, 0])
        earlier = -step * np.arange(samples, 0.0, -1.0)
        mujoco.mj_initCtrlHistory(model, data, i, earlier, np.full(samples, controls[0, i]))
    rows = [int(model.joint(stepped.name).qposadr[0]) for stepped in prepared.drives]
    theirs = np.full((len(stamps), len(rows)), np.nan)
    for k, stamp in enumerate(stamps):
        # After a divergence MuJoCo restarts at time 0.
        if data.time < stamp - 0.5 * step:
            break
        theirs[k] = data.qpos[rows]
        data.ctrl[:], data.qfrc_applied[:] = controls[k], torques[k]
        mujoco.mj_step(model, data)
    return Replay(
        joints=tuple(stepped.name for stepped in prepared.drives),
        units=tuple("mm" if stepped.joint.kind == "prismatic" else "mrad" for stepped in prepared.drives),
        time=times, ours=run["link_position"], theirs=np.column_stack([np.interp(times, stamps, own) for own in theirs.T]),
    )  # fmt: skip


def inputs_of(prepared: Prepared, model: Any, stamps: Array) -> tuple[Array, Array]:
    """Controls (n, nu) and external torques (n, nv) of the scenario at the times `stamps` (n,), s, for the model. The controls
    are not delayed: the model's actuators delay them."""
    torques, *references = prepared.undelayed_inputs(stamps)
    controls, external = np.zeros((len(stamps), model.nu)), np.zeros((len(stamps), model.nv))
    names = {model.actuator(i).name: i for i in range(model.nu)}
    for j, stepped in enumerate(prepared.drives):
        external[:, int(model.joint(stepped.name).dofadr[0])] = torques[j]
        if (drive := stepped.drive) is None:
            continue
        goals = drive.goals(np.array([values[j] for values in references]))
        motors = [motor_name(drive.joint, i + 1) for i in range(drive.actuator.motors)] if drive.mode.spring else [drive.joint]
        for name, goal in zip(motors, goals, strict=False):
            controls[:, names[name]] = goal
        if (spring := names.get(stiffness_name(drive.joint))) is not None:
            place = goals[drive.actuator.motors]
            controls[:, spring] = over_arrays(drive.actuator.stiffness)(0.0 * place, 0.0 * place, place, drive.elastic)
    return controls, external


def charts(found: Replay) -> list[list[Chart]]:
    """Rows of charts, one for each joint: both motions, and their difference."""
    rows = []
    for j, joint in enumerate(found.joints):
        unit = found.units[j]
        both = [
            Line(label="asrsim", x=found.time, y=found.ours[:, j], colour=style.LIGHT, width=style.WIDE),
            Line(label="MuJoCo", x=found.time, y=found.theirs[:, j], colour=style.VERMILION),
        ]
        error = Line(label="MuJoCo minus asrsim", x=found.time, y=found.error[:, j], colour=style.PURPLE)
        rms = f"RMS {found.rms[j]:.3g} {unit}"
        rows.append([
            Chart(head=joint, words="link position", unit=unit.removeprefix("m") if unit != "mm" else "m", lines=both),
            Chart(words="difference", unit=unit, lines=[error], note=rms),
        ])  # fmt: skip
    return rows


def draw(found: Replay, path: Path) -> list[Path]:
    """Draw both motions and the error in a picture in the folder of the model. Raises OutputError."""
    return save_charts(path.with_suffix(".png"), charts(found), title=f"{path.stem} · replayed in plain MuJoCo")
