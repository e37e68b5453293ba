"""Export: a scenario's robot, with motors and springs, as a file for other simulators (`asrsim export`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.export.mjcf import Mjcf, model_of
from asrsim.export.replay import Replay, draw, replay, run_of
from asrsim.outfile import make_folder, write_text, written
from asrsim.samples import Array
from asrsim.scenario.overrides import Overrides
from asrsim.simulation.prepare import prepare
from asrsim.simulation.prepared import Prepared

if TYPE_CHECKING:
    from asrsim.scenario import Scenario

__all__ = ["Export", "Replay", "export_mjcf"]

MARGIN, LEAST_REACH = 2.0, 1.0
"""Springs are fitted up to a multiple of the scenario's largest deflection; the second number is the smallest such range, rad.
"""


@dataclass(frozen=True, kw_only=True)
class Export:
    """An exported model, and its differences from the simulation in asrsim."""

    files: tuple[Path, ...]
    """Paths of the written files; the model is the first file."""
    remarks: tuple[str, ...]
    """Sentences about parts of the scenario that the model lacks."""
    replay: Replay
    spring_errors: Mapping[str, float]
    """Largest difference between spring laws and their splines, divided by the stiffness, mrad, by joint."""

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        found = self.replay
        columns = zip(found.joints, found.rms, np.abs(found.error).max(axis=0), found.units, strict=True)
        return {
            "files": [str(path) for path in self.files],
            "joints": {
                name: {"rms": float(rms), "largest": float(largest), "unit": unit, "spring_error": self.spring_errors.get(name)}
                for name, rms, largest, unit in columns
            },
            "not_in_the_file": list(self.remarks),
            "diverged_at": found.diverged_at,
        }


def export_mjcf(
    scenario: str | Path | Scenario, out: str | Path, *, variant: str | None = None, overrides: Overrides = (),
    knots: int | None = None, timestep: float | None = None, fit: str | Path | None = None, plot: bool = True,
) -> Export:  # fmt: skip
    """Write a scenario's robot as MJCF for plain MuJoCo, and replay the scenario there.

    Args:
        scenario: Scenario in modes that MuJoCo can represent (all but 2 and 3).
        out: Path of the model; meshes, picture of the error, and ranges are written into the folder of the model.
        variant, overrides: As for `asrsim.run`.
        knots: Number of knots on each side of the spline of a spring's law; None: as many as keep its error below 0.1 mrad.
        timestep: Time step of the model, s; None: the scenario's step.
        fit: `fit.json` of `asrsim identify`: the model gets the fitted values, and the intervals of the fit become ranges for
            randomisation.
        plot: Draw the error.

    Raises:
        ScenarioError: A mode or a spring law that MJCF cannot represent.
        SimulationError: MuJoCo cannot load the model.
        OutputError: A file cannot be written.
    """
    path = Path(out)
    ready = prepare(scenario, variant=variant, overrides=overrides)
    distribution = None
    if fit is not None:
        from asrsim.export.ranges import mean_of, robot_numbers, write_ranges
        from asrsim.sweeps.fitted import joint_of, load_fit

        distribution = joint_of(load_fit(Path(fit)), Path(fit))
        ready = ready.vary(robot_numbers(ready, mean_of(distribution)))
    run, folder = run_of(ready), f"{path.stem}_meshes"
    reach, adjusters, at_limit = _extent(ready, run)

    def model_with(other: Prepared, knots: int | None = knots) -> Mjcf:
        return model_of(other, reach=reach, adjusters=adjusters, knots=knots, timestep=timestep, folder=folder)

    model = model_with(ready)
    make_folder(path.parent)
    files = _write_meshes(model, path.parent / folder)
    write_text(path, model.text, "mjcf")
    result = replay(ready, run, path)
    files += draw(result, path) if plot else []
    remarks = list(model.remarks)
    if distribution is not None:
        # Models with the values at both ends of an interval need equal numbers of tendons.
        most = max((spline.knots for springs in model.splines.values() for spline in springs), default=0)
        files.append(write_ranges(ready, distribution, lambda other: model_with(other, most).text, path, Path(str(fit))))
        if not distribution.fits:
            remarks.append("the model of the fit does not fit its recordings: its intervals are too narrow")
    if at_limit:
        names = ", ".join(at_limit)
        remarks.append(f"motors of {names} reach their speed limit in this scenario, which makes the error large")
    if result.diverged_at is not None:
        remarks.append(f"MuJoCo's motion diverges at {result.diverged_at:g} s: take a smaller --timestep")
    errors = {joint: 1e3 * max(spline.error for spline in springs) for joint, springs in model.splines.items()}
    return Export(files=(path, *files), remarks=tuple(remarks), replay=result, spring_errors=errors)


def _extent(prepared: Prepared, run: Mapping[str, Array]) -> tuple[dict[str, float], dict[str, float], list[str]]:
    """Three results: deflections up to which springs are fitted, rad, by joint; positions of the adjusters at the start, by
    joint; and joints whose motors reach their speed limit.
    """
    reach, adjusters, at_limit = {}, {}, []
    for j, stepped in enumerate(prepared.drives):
        drive, name = stepped.drive, stepped.name
        if drive is None or not drive.mode.spring:
            continue
        count = drive.actuator.motors
        motors = np.array([run[f"motor_{i}_position"][:, j] for i in range(1, count + 1)])
        reach[name] = max(MARGIN * float(np.abs(motors - run["link_position"][:, j]).max()), LEAST_REACH)
        if drive.actuator.adjuster:
            adjusters[name] = float(run[f"motor_{count + 1}_position"][0, j])
        speeds = [np.abs(run[f"motor_{i}_velocity"][:, j]).max() for i in range(1, len(drive.max_velocity) + 1)]
        if any(speed > 0.999 * limit for speed, limit in zip(speeds, drive.max_velocity, strict=True)):
            at_limit.append(name)
    return reach, adjusters, at_limit


def _write_meshes(model: Mjcf, folder: Path) -> list[Path]:
    """Write each mesh as a binary STL. Raises OutputError."""
    from trimesh import Trimesh

    from asrsim.render.mesh_files import read_mesh

    paths = []
    for name, source in model.meshes.items():
        mesh = read_mesh(Path(source))
        path = make_folder(folder) / f"{name}.stl"
        with written(path, "mesh") as stream:
            # The header of the STL file shows that asrsim wrote the file.
            stl: Any = Trimesh(mesh.points, mesh.triangles, process=False).export(file_type="stl")
            stream.write(b"asrsim mesh".ljust(80) + stl[80:])
        paths.append(path)
    return paths
