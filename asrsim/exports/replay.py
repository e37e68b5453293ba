"""The scenario's motion in another program, compared with the motion in asrsim. The difference is the error of the exported
model for each joint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.actuators.vectorised import over_arrays
from asrsim.engines.mujoco_library import load
from asrsim.errors import SimulationError
from asrsim.exports.motors import motor_name, stiffness_name
from asrsim.exports.programs.base import Program
from asrsim.exports.programs.mujoco import Mujoco
from asrsim.metrics.values import root_mean_squares
from asrsim.plots import style
from asrsim.plots.chart import Chart, Line
from asrsim.plots.charts import save_charts
from asrsim.registry import result_fault
from asrsim.samples import Array
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.worlds import Worlds


@dataclass(frozen=True, kw_only=True)
class Replay:
    """The scenario's motion in asrsim and in another program, at the steps of the scenario."""

    program: str
    """Name and versions of the other program: the program of the file, or MuJoCo if that program was not tried."""
    untried: str
    """Reason why the program that the file is made for was not tried; empty if it was tried."""
    joints: tuple[str, ...]
    units: tuple[str, ...]
    """Unit of each joint's error: mrad or mm."""
    time: Array
    """Times (n,), s."""
    ours: Array
    """Link positions (n, joints) of asrsim, rad (m)."""
    theirs: Array
    """Link positions (n, joints) of the other program, rad (m); NaN after a divergence."""
    apart: float
    """Largest difference in mrad (mm) between the other program and MuJoCo on the same file. Such a difference is an error of
    the program and not of the file."""

    @property
    def error(self) -> Array:
        """Positions in the other program minus positions in asrsim (n, joints), mrad (mm)."""
        return 1e3 * (self.theirs - self.ours)

    @property
    def rms(self) -> Array:
        """Root mean square of the error (joints,), mrad (mm)."""
        return root_mean_squares(self.error)

    @property
    def diverged_at(self) -> float | None:
        """Time at which the other program's motion diverges, s; None if the motion does not diverge."""
        lost = ~np.isfinite(self.theirs).all(axis=1)
        return float(self.time[int(np.argmax(lost))]) if lost.any() else None


def run_of(prepared: Prepared) -> dict[str, Array]:
    """Values (n, joints) by quantity of the scenario's run in asrsim. Raises SimulationError if the run diverges."""
    with Worlds(prepared, 1, watched=False) as worlds:
        kinds = "link_position", "external_torque", "reference_", "motor_"
        names = [name for name in worlds.names if name.startswith(kinds)]
        found = {name: values[0] for name, values in worlds.rollout(names).items()}
    if not np.isfinite(found["link_position"]).all():
        raise SimulationError("the scenario diverges in asrsim itself: find the cause by `asrsim run` first")
    return found


def replay(prepared: Prepared, run: Mapping[str, Array], path: Path, program: Program) -> Replay:
    """Motions in asrsim, in MuJoCo, and in the program that the model at `path` is made for, if it is installed. Each program
    gets the scenario's external torques, and the scenario's references without delay, since the model itself delays them.
    """
    mujoco = load()
    model = mujoco.MjModel.from_xml_path(str(path))
    times, step = prepared.scenario.step_times(), model.opt.timestep
    stamps = np.arange(np.ceil(times[-1] / step) + 1.0) * step
    controls, torques = inputs_of(prepared, model, stamps)
    rows = [int(model.joint(stepped.name).qposadr[0]) for stepped in prepared.drives]

    def positions(one: Program, count: int) -> Array:
        found = one.positions(path, model, _start_of(model, controls), controls[:count], torques[:count])
        if np.shape(found) != (count, model.nq):
            message = f"`positions` must return an array of shape {(count, model.nq)}; its shape is {np.shape(found)}"
            raise result_fault(one.positions, message)
        found = np.asarray(found, dtype=float)[:, rows]
        at = times[times <= stamps[count - 1] + 0.5 * step]
        return np.column_stack([np.interp(at, stamps[:count], own) for own in found.T])

    plain = Mujoco()
    theirs = exact = positions(plain, len(stamps))
    untried = program.missing()
    if not untried and program.name != plain.name:
        theirs = positions(program, min(len(stamps), program.longest))
    count = len(theirs)
    return Replay(
        program=_versioned(plain if untried else program),
        untried=untried,
        joints=tuple(stepped.name for stepped in prepared.drives),
        units=tuple("mm" if stepped.joint.kind == "prismatic" else "mrad" for stepped in prepared.drives),
        time=times[:count],
        ours=run["link_position"][:count],
        theirs=theirs,
        apart=float(1e3 * np.nanmax(np.abs(theirs - exact[:count]), initial=0.0)),
    )


def _versioned(program: Program) -> str:
    """Title of a program, with its version if the version is known."""
    version = program.version()
    return f"{program.title} ({version})" if version else program.title


def _start_of(model: Any, controls: Array) -> Any:
    """Initial state of the model as MjData, from the keyframe of the model. The delays begin with the first row of the controls
    (n, nu)."""
    mujoco = load()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    history = getattr(model, "actuator_history", np.zeros((model.nu, 2)))
    for i in np.flatnonzero(history[:, 0]).tolist():
        samples = int(history[i, 0])
        earlier = -model.opt.timestep * np.arange(samples, 0.0, -1.0)
        mujoco.mj_initCtrlHistory(model, data, i, earlier, np.full(samples, controls[0, i]))
    return data


def inputs_of(prepared: Prepared, model: Any, stamps: Array) -> tuple[Array, Array]:
    """Controls (n, nu) and external torques (n, nv) of the scenario at the times `stamps` (n,), s, for the model. The controls
    are not delayed, since the model's actuators delay them.
    """
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
    """Rows of charts, one row for each joint: the two motions, and their difference."""
    rows, title = [], found.program.partition(" (")[0]
    for j, joint in enumerate(found.joints):
        unit = found.units[j]
        both = [
            Line(label="asrsim", x=found.time, y=found.ours[:, j], colour=style.LIGHT, width=style.WIDE),
            Line(label=title, x=found.time, y=found.theirs[:, j], colour=style.VERMILION),
        ]
        error = Line(label=f"{title} minus asrsim", x=found.time, y=found.error[:, j], colour=style.PURPLE)
        rms = f"RMS {found.rms[j]:.3g} {unit}"
        rows.append(
            [
                Chart(head=joint, words="link position", unit=unit.removeprefix("m") if unit != "mm" else "m", lines=both),
                Chart(words="difference", unit=unit, lines=[error], note=rms),
            ]
        )
    return rows


def draw_replay(found: Replay, path: Path) -> list[Path]:
    """Draw the two motions and their difference. The picture is written into the folder of the model. Raises OutputError."""
    return save_charts(path.with_suffix(".png"), charts(found), title=f"{path.stem} · replayed in {found.program}")
