"""A study for machines that have none of its files: the robot is data already, recordings and the like go along."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from asrsim.sweeps.cases import Payload
from asrsim.sweeps.rows import Row
from asrsim.sweeps.runner import Runner


class Shipped:
    """A task for :mod:`asrsim.workers`: rows of a study's runs, on another machine."""

    def __init__(self, payload: Payload, *, share: int) -> None:
        """share: as for :class:`Runner`. Raises OSError where a file cannot be read."""
        self._payload, self._share = payload, share
        files = sorted({path for case in payload.cases.values() for path in case.files.values()})
        self._files = {path: path.read_bytes() for path in files}
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
        cases = {
            name: replace(case, files={key: places[path] for key, path in case.files.items()})
            for name, case in self._payload.cases.items()
        }
        return replace(self._payload, cases=cases)
