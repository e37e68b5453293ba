"""Export: a scenario's robot, with motors and springs, as a file for other simulators (`asrsim export`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.engines.mujoco_library import exact_xml
from asrsim.exports.mjcf import model_of
from asrsim.exports.programs import PROGRAMS, Program
from asrsim.exports.ranges import own_numbers, write_ranges
from asrsim.exports.replay import Replay, draw_replay, replay, run_of
from asrsim.exports.springs import Spline
from asrsim.outfile import make_folder, write_text, written
from asrsim.plugins import load_plugin_files
from asrsim.registry import result_fault
from asrsim.renamed import renamed
from asrsim.render.meshes import simplified
from asrsim.robot.meshes import mesh_parts
from asrsim.samples import Array
from asrsim.scenario.overrides import Overrides
from asrsim.simulation.prepare import prepare
from asrsim.simulation.prepared import Prepared
from asrsim.sweeps.fitted import JointDistribution, joint_of, load_fit

if TYPE_CHECKING:
    from asrsim.scenario import Scenario

__all__ = ["PROGRAMS", "Export", "Program", "Replay", "export"]

APART = 1.0
"""Largest difference in mrad (mm) between a program and MuJoCo on the same file for which the export counts as good."""


@dataclass(frozen=True, kw_only=True)
class Export:
    """An exported model, and the differences of its motion from the simulation in asrsim."""

    files: tuple[Path, ...]
    """Paths of the written files; the model is the first file."""
    remarks: tuple[str, ...]
    """Sentences about parts of the scenario that the model lacks."""
    made_for: str
    """Name of the program that the files are made for."""
    replay: Replay
    spring_errors: Mapping[str, float]
    """Largest difference between the law and the spline of a joint's springs, divided by the stiffness, mrad (mm), by joint."""

    @property
    def good(self) -> bool:
        """Whether the replayed motion is finite, and the program simulates the file as MuJoCo does."""
        return self.replay.diverged_at is None and self.replay.apart <= APART

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        found = self.replay
        columns = zip(found.joints, found.rms, np.abs(found.error).max(axis=0), found.units, strict=True)
        return {
            "files": [str(path) for path in self.files],
            "for": self.made_for,
            "replayed_in": found.program,
            "not_tried": found.untried or None,
            "from_mujoco": found.apart,
            "joints": {
                name: {"rms": float(rms), "largest": float(largest), "unit": unit, "spring_error": self.spring_errors.get(name)}
                for name, rms, largest, unit in columns
            },
            "not_in_the_file": list(self.remarks),
            "diverged_at": found.diverged_at,
        }


@renamed(timestep="step")
def export(
    scenario: str | Path | Scenario,
    out: str | Path,
    *,
    variant: str | None = None,
    overrides: Overrides = (),
    program: str = "mujoco",
    knots: int | None = None,
    step: float | None = None,
    fit: str | Path | None = None,
    plot: bool = True,
    plugins: Sequence[str | Path] = (),
) -> Export:
    """Write a scenario's robot as MJCF for a program, and replay the scenario there.

    Args:
        scenario: Scenario whose joints have modes that MuJoCo can represent (all but 2 and 3).
        out: Path of the model; meshes, picture of the error, and ranges are written into the folder of the model.
        variant, overrides: As in `asrsim.run`.
        program: Name of the program that the file is made for, in `asrsim.exports.PROGRAMS`. The file has only constructs that
            this program simulates correctly. The replay runs in this program if it is installed, else in MuJoCo.
        knots: Number of knots on each side of the spline of a spring's law; None: the number that keeps the error of the spline
            below 0.1 mrad.
        step: Time step of the model, s; None: half of the scenario's step.
        fit: `fit.json` of `asrsim identify`: the model gets the fitted values, and the intervals of the fit become ranges for
            domain randomisation.
        plot: Whether to draw the error of each joint.
        plugins: Python files with the user's actuators, programs and so on, which are loaded first.

    Raises:
        ScenarioError: A mode or a spring law that MJCF cannot represent, or a part that the program would simulate wrongly.
        SimulationError: MuJoCo cannot load the model.
        OutputError: A file cannot be written.
    """
    load_plugin_files(plugins)
    path, target = Path(out), PROGRAMS.get(program)()
    ready = prepare(scenario, variant=variant, overrides=overrides)
    distribution = None
    if fit is not None:
        distribution = joint_of(load_fit(Path(fit)), Path(fit))
        (best,) = distribution.interval(0.0)[:1]
        ready = ready.vary(own_numbers(ready, distribution.assign(best)))
    run = run_of(ready)
    with removed_on_error() as files:
        remarks, splines = _write(ready, run, path, target, files, knots=knots, step=step, distribution=distribution, fit=fit)
    result = replay(ready, run, path, target)
    drawn = draw_replay(result, path) if plot else []
    if result.diverged_at is not None:
        remarks.append(f"the motion in {result.program} diverges at {result.diverged_at:g} s: take a smaller --step")
    if result.apart > APART:
        remarks.append(
            f"{result.program} differs from MuJoCo by {result.apart:.3g} mrad (mm) on the same file: "
            f"do not use the file in {result.program}"
        )
    if len(result.time) < len(run["link_position"]):
        remarks.append(f"the replay covers only the first {result.time[-1]:g} s of the scenario")
    errors = {joint: 1e3 * max(spline.error for spline in springs) for joint, springs in splines.items()}
    return Export(files=(*files, *drawn), remarks=tuple(remarks), made_for=target.name, replay=result, spring_errors=errors)


@contextmanager
def removed_on_error() -> Iterator[list[Path]]:
    """Context that gives a list, to which paths of written files are added: after an error these files are removed."""
    files: list[Path] = []
    try:
        yield files
    except BaseException:
        for file in files:
            with suppress(OSError):
                file.unlink()
        raise


def _write(
    ready: Prepared,
    run: Mapping[str, Array],
    path: Path,
    target: Program,
    files: list[Path],
    *,
    knots: int | None,
    step: float | None,
    distribution: JointDistribution | None,
    fit: str | Path | None,
) -> tuple[list[str], Mapping[str, Sequence[Spline]]]:
    """Write the model and the files beside it, and add their paths to `files`. Returns sentences about parts of the scenario
    that the model lacks, and the splines of the springs, by joint.
    """

    @cache
    def mesh_file(source: str) -> str:
        """Write a mesh as a binary STL beside the model."""
        from trimesh.util import concatenate

        folder = make_folder(path.parent / f"{path.stem}_meshes")
        file = folder / f"mesh_{len(files)}.stl"
        mesh: Any = concatenate(simplified(mesh_parts(Path(source))))
        with written(file, "mesh") as stream:
            # The header of the STL file marks the file as written by asrsim.
            stl = mesh.export(file_type="stl")
            stream.write(b"asrsim mesh".ljust(80) + stl[80:])
        files.append(file)
        return f"{folder.name}/{file.name}"

    made = partial(model_of, run=run, path=path, mesh_file=mesh_file, timestep=step, program=target)
    model = made(ready, knots=knots)
    make_folder(path.parent)
    write_text(path, exact_xml(model.spec), "mjcf")
    files.insert(0, path)
    remarks, ranges = list(model.remarks), None
    if distribution is not None:
        # The models for the two ends of an interval are compared, so they must have equal numbers of tendons and therefore of
        # knots.
        most = max((spline.knots for springs in model.splines.values() for spline in springs), default=0)

        def compiled(values: dict[str, float]) -> Any:
            varied = ready.vary(own_numbers(ready, values))
            return made(varied, knots=most).spec.compile()

        ranges = write_ranges(distribution, compiled, path, Path(str(fit)))
        files.append(ranges)
        if not distribution.fits:
            remarks.append("the fit did not show that its model explains the recordings: its intervals may be too narrow")
    beside = target.write(path, ready, model.spec.option.timestep, ranges, remarks)
    if not isinstance(beside, list) or not all(isinstance(file, Path) for file in beside):
        message = f"`write` must return the list of the paths that it wrote; it returns {beside!r}"
        raise result_fault(target.write, message)
    if missing := [file for file in beside if not file.is_file()]:
        message = f"`write` must return the paths of the files that it wrote; there is no file {missing[0]}"
        raise result_fault(target.write, message)
    if odd := [text for text in remarks if not isinstance(text, str)]:
        raise result_fault(target.write, f"`write` must add texts to `remarks`; it adds {odd[0]!r}")
    files += beside
    return remarks, model.splines
