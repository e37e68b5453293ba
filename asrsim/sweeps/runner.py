"""Runs of a study: prepared once, then other numbers; a row of each comes out, whatever happens."""

from __future__ import annotations

import time as clock
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from asrsim.errors import AsrsimError, DivergenceError
from asrsim.simulation.run import Run, blame_laws, run_to_end
from asrsim.simulation.simulation import Simulation
from asrsim.sweeps.base import Kind
from asrsim.sweeps.cases import Case, Payload
from asrsim.sweeps.rows import Row, one_line, plain_cells
from asrsim.sweeps.tap import Tap

KINDS = 8
"""Prepared scenarios that are kept: runs that differ in numbers only share one."""


@dataclass(frozen=True)
class _Point:
    """A run that is to be done."""

    number: int
    """Of the item that it is."""
    run: int
    case: Case
    values: Mapping[str, Any]

    @property
    def key(self) -> tuple[str, str]:
        """Of its kind."""
        return self.case.variant, repr(self.case.plan.read_again(self.values))


class Runner:
    """A task for :mod:`asrsim.workers`: runs of one study; rows do not depend on their order."""

    def __init__(self, payload: Payload, share: int = 1) -> None:
        """share: how many runners share the study's runs."""
        self.payload, self.study = payload, payload.study
        self._share = share
        self._kinds: OrderedDict[tuple[str, str], Kind] = OrderedDict()

    def __reduce__(self) -> tuple[Any, ...]:
        return Runner, (self.payload, self._share)

    def __call__(self, run: int) -> Row:
        """The row of a run, in the payload's columns."""
        return next(self.several([(run, run)]))[1]

    def several(self, items: Iterable[tuple[int, int]]) -> Iterator[tuple[int, Row]]:
        """Rows of runs, each with the number that comes with it; short runs of one kind are done together."""
        waiting: dict[tuple[str, str], list[_Point]] = {}
        for number, run in items:
            variant, values = self.study.point(run)
            point = _Point(number, run, self.payload.cases[variant], values)
            group = waiting.setdefault(point.key, [])
            group.append(point)
            kind = self._kind(point)
            if kind is None or len(group) >= kind.size:
                yield from self._rows(waiting.pop(point.key))
        for points in waiting.values():
            yield from self._rows(points)

    def close(self) -> None:
        """Release the engines."""
        while self._kinds:
            self._kinds.popitem()[1].close()

    def _kind(self, point: _Point) -> Kind | None:
        """Of the run; None where it is done alone, which also tells what is wrong with it."""
        if not point.case.plan.varies_in_place:
            return None
        if point.key not in self._kinds:
            try:
                self._kinds[point.key] = Kind(self.study, point.case, point.values, self._share)
            except Exception:
                return None
            if len(self._kinds) > KINDS:
                self._kinds.popitem(last=False)[1].close()
        self._kinds.move_to_end(point.key)
        kind = self._kinds[point.key]
        return kind if kind.size else None

    def _rows(self, points: Sequence[_Point]) -> Iterator[tuple[int, Row]]:
        """Rows of runs of one kind; what its worlds cannot do is done alone."""
        began = clock.perf_counter()
        found: dict[int, Callable[[], dict[str, Any]]] = {}
        try:
            kind = self._kind(points[0])
            if kind is not None:
                found = kind.run([point.values for point in points])
        except Exception:
            # A user's law may raise on the numbers of one run. What a fault leaves behind is nobody's fresh start.
            self._kinds.pop(points[0].key).close()
        each = (clock.perf_counter() - began) / len(points)
        for i, point in enumerate(points):
            began = clock.perf_counter() - (each if i in found else 0.0)
            yield self._row(point, began, found.get(i, partial(self._alone, point)))

    def _row(self, point: _Point, began: float, cells_of: Callable[[], dict[str, Any]]) -> tuple[int, Row]:
        """The number of the item and its row."""
        cells: dict[str, Any] = {"run": point.run, "variant": point.case.variant, **plain_cells(point.values, self.payload)}
        try:
            with blame_laws():
                cells |= cells_of()
        except Exception as error:
            # Laws and measures may be a user's.
            kind = "" if isinstance(error, AsrsimError) else f"{type(error).__name__}: "
            cells |= {"status": "failed", "reason": kind + one_line(error), "ok": False}
        cells["seconds"] = clock.perf_counter() - began
        return point.number, tuple(map(cells.get, self.payload.names))

    def _alone(self, point: _Point) -> dict[str, Any]:
        """Cells of a run that is prepared for itself."""
        prepared = point.case.prepared(point.values)
        tap = Tap(prepared, self.study, checked=False)
        with Simulation(prepared, sinks=[tap]) as simulation:
            try:
                run = run_to_end(simulation)
            except DivergenceError as error:
                if not isinstance(error.run, Run):
                    raise
                run = error.run
            return tap.cells(run)
