"""Workers of a Dask scheduler."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

from asrsim.engines.libraries import numeric_versions
from asrsim.errors import SimulationError, listed
from asrsim.extras import library
from asrsim.progress import Stop
from asrsim.workers import Numbered, Pool, Work, do_items

PATIENCE = 10.0
"""Time in which a scheduler and its first worker must answer, s."""
PIECE, SHARE = 2.0, 0.01
"""PIECE: smallest intended duration of a piece of work, s; SHARE: intended duration per worker thread, s. The longer of the two
durations applies. Scheduler and client need about 4 ms for each piece, also with a thousand threads, so that threads would wait
with short pieces.
"""
AHEAD = 3
"""Largest number of pieces in progress per worker thread. The limit bounds the memory of scheduler and client."""
COMPARED = ("python", "asrsim", "numpy", "mujoco", "pybullet")
"""Packages whose versions must be the same on all machines, so that all machines compute the same results."""


class Cluster(Pool):
    """Workers of a Dask scheduler. The workers read the study's files at the same paths as this machine."""

    again = (CancelledError,)

    def __init__(self, address: str, plugins: Sequence[Path] = ()) -> None:
        """address: address of a scheduler, such as tcp://host:8786; plugins: files that the workers load first. Raises
        InputError without Dask."""
        super().__init__(plugins)
        self._distributed = library("distributed", "cluster")
        self.died = (self._distributed.KilledWorker,)
        self._address = address
        self._client: Any = None
        self._data: Any = None

    def __enter__(self) -> Self:
        try:
            self._client = self._distributed.Client(self._address, timeout=PATIENCE, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            text = str(error) or type(error).__name__
            raise SimulationError(f"no scheduler answers at {self._address} within {PATIENCE:g} s: {text}") from error
        try:
            self._compare()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(Exception):
            self._client.close()

    def _compare(self) -> None:
        """Raise SimulationError if the scheduler has no workers, or if a worker has another version of a compared package."""
        try:
            self._client.wait_for_workers(1, timeout=PATIENCE)
        except Exception as error:
            hint = f"start workers with: dask worker {self._address}"
            raise SimulationError(f"the scheduler at {self._address} has no workers: {hint}") from error
        mine = numeric_versions()
        try:
            theirs = self._client.run(numeric_versions)
        except Exception as error:
            message = f"the workers cannot import asrsim of this version: {type(error).__name__}: {error}"
            raise SimulationError(message) from error
        faults = [
            f"worker {worker} has {name} {found.get(name)}, here it is {mine[name]}"
            for worker, found in sorted(theirs.items())
            for name in COMPARED
            if found.get(name) != mine[name]
        ]
        if faults:
            raise SimulationError(f"rows would differ between machines: {listed(faults, 5, '; ')}")

    def slots(self, sent: bytes) -> int:
        """Number of pieces that may be in progress; see `Pool.slots`."""
        threads = sum(self._client.nthreads().values())
        self.piece = max(PIECE, SHARE * threads)
        if self._data is None and threads:
            with suppress(OSError):
                self._data = self._client.scatter(sent, broadcast=True, hash=False)
        return 0 if self._data is None else AHEAD * threads

    def submit(self, sent: bytes, items: Sequence[Any]) -> Any:
        """Submit a piece of work; see `Pool.submit`."""
        return self._client.submit(do_items, self._data, items, pure=False, retries=0)

    def abandon(self, futures: Sequence[Any]) -> None:
        """Cancel pieces of work; see `Pool.abandon`."""
        with suppress(Exception):
            self._client.cancel(list(futures))

    def renew(self) -> None:
        """Send the task again; see `Pool.renew`. If all workers that hold a piece or the task are lost, the scheduler cancels
        the piece."""
        self._data = None

    def results(self, task: Work, items: Sequence[Any], *, stop: Stop | None = None) -> Iterator[Numbered]:
        """Results of the items; see `Pool.results`."""
        self._data = None
        try:
            yield from super().results(task, items, stop=stop)
        except OSError as error:
            message = f"the scheduler at {self._address} has stopped; rows received are kept, continue with --resume"
            raise SimulationError(message) from error
