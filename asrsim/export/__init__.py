"""Export: a scenario's robot, with motors and springs, as a file for other simulators (`asrsim export`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.export.mjcf import Mjcf, model_of
from asrsim.export.replay import Replay, at_speed_limit, deflections, draw, replay, run_of
from asrsim.outfile import make_folder, write_text, written
from asrsim.scenario.overrides import Overrides
from asrsim.simulation.prepare import prepare
from asrsim.simulation.prepared import Prepared

if TYPE_CHECKING:
    from asrsim.scenario import Scenario

__all__ = ["Export", "Replay", "export_mjcf"]

MARGIN = 2.0
"""Times the deflection of the scenario up to which springs are fitted."""
LEAST_REACH = 1.0
"""rad up to which they are fitted at least."""


@dataclass(frozen=True, kw_only=True)
class Export:
    """An exported model, and how far it is from asrsim."""

    files: tuple[Path, ...]
    """The model first."""
    remarks: tuple[str, ...]
    """What of the scenario the file does not have."""
    replay: Replay
    spring_errors: Mapping[str, float]
    """Joint -> mrad, largest difference between its springs' laws and their splines, over the stiffness."""

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        found = self.replay
        return {
            "files": [str(path) for path in self.files],
            "joints": {
                name: {"rms": float(rms), "largest": float(most), "unit": unit, "spring_error": self.spring_errors.get(name)}
                for name, rms, most, unit in zip(
                    found.joints, found.rms, np.abs(found.error).max(axis=0), found.units, strict=True
                )
            },
            "not_in_the_file": list(self.remarks),
            "diverged_at": found.diverged_at,
        }


def export_mjcf(
    scenario: str | Path | Scenario, out: str | Path, *, variant: str | None = None, overrides: Overrides = (), knots: int = 4,
    timestep: float | None = None, fit: str | Path | None = None, plot: bool = True,
) -> Export:  # fmt: skip
    """Write a scenario's robot as MJCF for plain MuJoCo, and replay the scenario there.

    Args:
        scenario: Scenario, in modes that MuJoCo can have (all but 2 and 3).
        out: The file; meshes, picture of the error, and ranges are put beside it.
        variant, overrides: As :func:`asrsim.run` takes them.
        knots: On each side of a spring's spline.
        timestep: s of the model; None: the scenario's step.
        fit: `fit.json` of `asrsim identify`: the model gets its values, and its intervals become ranges for randomisation.
        plot: Draw the error.

    Raises:
        ScenarioError: A mode or a law that MJCF cannot have. SimulationError: MuJoCo cannot load the model. OutputError.
    """
    path = Path(out)
    ready = prepare(scenario, variant=variant, overrides=overrides)
    found_fit = None
    if fit is not None:
        from asrsim.export.ranges import mean_of, robot_numbers
        from asrsim.sweeps.fitted import joint_of, load_fit

        found_fit = joint_of(load_fit(Path(fit)), Path(fit))
        ready = ready.vary(robot_numbers(ready, mean_of(found_fit)))
    run = run_of(ready)
    reach = {joint: max(MARGIN * most, LEAST_REACH) for joint, most in deflections(ready, run).items()}
    folder = f"{path.stem}_meshes"

    def model_with(other: Prepared) -> Mjcf:
        return model_of(other, reach=reach, adjusters=_adjusters(ready, run), knots=knots, timestep=timestep, folder=folder)

    model = model_with(ready)
    make_folder(path.parent)
    files = [*_write_meshes(model, path.parent / folder)]
    write_text(path, model.text, "mjcf")
    result = replay(ready, run, path)
    files += draw(result, path) if plot else []
    if found_fit is not None:
        files.append(_write_ranges(ready, found_fit, model_with, path, Path(str(fit))))
    remarks = list(model.remarks)
    if at_limit := at_speed_limit(ready, run):
        remarks.append(f"this scenario meets the speed limit of the motors of {', '.join(sorted(at_limit))}: hence the error")
    if found_fit is not None and not found_fit.fits:
        remarks.append("the fit says itself that its model does not fit: its intervals say little")
    if result.diverged_at is not None:
        remarks.append(f"MuJoCo's motion diverges at {result.diverged_at:g} s: take a smaller --timestep")
    errors = {joint: 1e3 * max(spline.error for spline in own) for joint, own in model.splines.items()}
    return Export(files=(path, *files), remarks=tuple(remarks), replay=result, spring_errors=errors)


def _adjusters(prepared: Prepared, run: Mapping[str, Any]) -> dict[str, float]:
    """Joint -> position of its adjuster at the start."""
    found = {}
    for j, drive in enumerate(prepared.drives):
        if drive.drive is not None and drive.drive.actuator.adjuster and drive.drive.mode.spring:
            found[drive.name] = float(run[f"motor_{drive.drive.actuator.motors + 1}_position"][0, j])
    return found


def _write_meshes(model: Mjcf, folder: Path) -> list[Path]:
    """Each mesh as a binary STL. Raises OutputError."""
    from asrsim.render.mesh_files import read_mesh

    paths = []
    for name, source in model.meshes.items():
        mesh = read_mesh(Path(source))
        corners = mesh.points[mesh.triangles].astype("<f4")
        table = np.zeros(len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        table["corners"] = corners
        path = make_folder(folder) / f"{name}.stl"
        with written(path, "mesh") as stream:
            stream.write(b"asrsim mesh".ljust(80) + len(table).to_bytes(4, "little") + table.tobytes())
        paths.append(path)
    return paths


def _write_ranges(prepared: Prepared, fit: Any, model_with: Any, path: Path, source: Path) -> Path:
    import mujoco

    from asrsim.export.ranges import ranges_of, text_of

    def compiled(other: Prepared) -> Any:
        # Meshes lie beside the file: they are found from there.
        spec = mujoco.MjSpec.from_string(model_with(other).text)
        spec.modelfiledir = str(path.parent.absolute())
        return spec.compile()

    target = path.with_suffix(".ranges.yaml")
    write_text(target, "\n".join(text_of(ranges_of(prepared, fit, compiled), source)), "ranges")
    return target
