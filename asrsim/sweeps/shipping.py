"""A study for machines that have none of its files: robots with their meshes, recordings and the like go along."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from asrsim.robot.engine_text import collision_meshes
from asrsim.sweeps.cases import Case, Payload
from asrsim.sweeps.rows import Row
from asrsim.sweeps.runner import Runner


@dataclass(frozen=True)
class _Files:
    """Where the files of a case are, by the names that it has for them."""

    scenario: dict[str, Path]
    meshes: dict[str, Path]
    """That the robot collides with."""

    def __iter__(self) -> Iterator[Path]:
        return iter((*self.scenario.values(), *self.meshes.values()))


class Shipped:
    """A task for :mod:`asrsim.workers`: rows of a study's runs, on another machine."""

    def __init__(self, payload: Payload, *, share: int) -> None:
        """share: as for :class:`Runner`. Raises OSError where a file cannot be read."""
        self._payload, self._share = payload, share
        self._cases = {name: _files_of(case) for name, case in payload.cases.items()}
        self._files = {path: path.read_bytes() for files in self._cases.values() for path in files}
        self._runner: Runner | None = None
        self._folder: TemporaryDirectory[str] | None = None

    def __call__(self, run: int) -> Row:
        """The row of a run."""
        return self._unpacked_runner()(run)

    def several(self, items: Iterable[tuple[int, int]]) -> Iterator[tuple[int, Row]]:
        """Rows of runs, each with the number that comes with it."""
        return self._unpacked_runner().several(items)

    def _unpacked_runner(self) -> Runner:
        if self._runner is None:
            self._folder = TemporaryDirectory(prefix="asrsim-sweep-")
            self._runner = Runner(self._unpacked(Path(self._folder.name)), share=self._share)
        return self._runner

    def close(self) -> None:
        """Release engines and files."""
        if self._runner is not None and self._folder is not None:
            self._runner.close()
            self._folder.cleanup()
            self._runner = self._folder = None

    def _unpacked(self, folder: Path) -> Payload:
        places: dict[Path, Path] = {}
        for number, (path, data) in enumerate(self._files.items()):
            places[path] = folder / str(number) / path.name
            places[path].parent.mkdir()
            places[path].write_bytes(data)
        cases = {name: _moved(case, self._cases[name], places, folder) for name, case in self._payload.cases.items()}
        return replace(self._payload, cases=cases)


def _moved(case: Case, files: _Files, places: dict[Path, Path], folder: Path) -> Case:
    """With files where they are now; all are of the robot's own folder, whose meshes it may use."""
    meshes = {mesh: str(places[path]) for mesh, path in files.meshes.items()}
    links = tuple(
        replace(link, collisions=tuple(replace(shape, mesh=meshes.get(shape.mesh, shape.mesh)) for shape in link.collisions))
        for link in case.robot.links
    )
    robot = replace(case.robot, links=links, path=folder / case.robot.path.name)
    return replace(case, robot=robot, files={name: places[path] for name, path in files.scenario.items()})


def _files_of(case: Case) -> _Files:
    if case.plan.reads_robot:
        # Which files they need is not known before they are read: workers must have those robots.
        return _Files(dict(case.files), {})
    given = case.resolved["robot"]
    name = given if isinstance(given, str) else given["file"]
    meshes = collision_meshes(case.robot, case.scenario({}).package_paths)
    return _Files({**case.files, name: case.robot.path}, meshes)
