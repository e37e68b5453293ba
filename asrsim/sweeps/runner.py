"""Runs of a study: prepared once, then other numbers; a row of each comes out, whatever happens."""

from __future__ import annotations

import time as clock
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from asrsim.errors import AsrsimError, DivergenceError, InputError
from asrsim.runs.execute import execute, write_summary
from asrsim.simulation.run import Run, blame_laws, run_to_end
from asrsim.simulation.simulation import Simulation
from asrsim.simulation.together import Track, finish, track
from asrsim.sweeps.base import Base
from asrsim.sweeps.cases import Case, Payload
from asrsim.sweeps.rows import Row, one_line, plain_cells, summary_cells
from asrsim.sweeps.tap import Signals, Tap

BASES = 8
"""Prepared scenarios that are kept: runs that differ in numbers only share one."""


@dataclass(frozen=True)
class _Point:
    """A run that is to be done."""

    number: int
    """Of the item that it is."""
    run: int
    case: Case
    values: Mapping[str, Any]
    began: float


@dataclass(frozen=True)
class _Stepped:
    """A run that is looked at when there are enough of its kind."""

    point: _Point
    track: Track
    tap: Tap
    together: int
    """How many are enough."""
    seconds: float
    """That it took."""


class Runner:
    """A task for :mod:`asrsim.workers`: runs of one study, one after the other; rows do not depend on their order."""

    def __init__(self, payload: Payload, logs: Path | None = None, share: int = 1) -> None:
        """logs: folder for logs, if the study keeps them; share: how many runners share the study's runs."""
        self.payload, self.study = payload, payload.study
        self._logs = logs if payload.study.logs else None
        self._share = share
        self._bases: OrderedDict[tuple[str, str], Base] = OrderedDict()

    def __reduce__(self) -> tuple[Any, ...]:
        return Runner, (self.payload, self._logs, self._share)

    def __call__(self, run: int) -> Row:
        """The row of a run, in the payload's columns."""
        return next(self.several([(run, run)]))[1]

    def several(self, items: Iterable[tuple[int, int]]) -> Iterator[tuple[int, Row]]:
        """Rows of runs, each with the number that comes with it; short runs of one kind are looked at together."""
        waiting: dict[Any, list[_Stepped]] = {}
        for number, run in items:
            variant, values = self.study.point(run)
            point = _Point(number, run, self.payload.cases[variant], values, clock.perf_counter())
            stepped = self._stepped(point)
            if stepped is None:
                yield self._row(point, point.began)
                continue
            key = stepped.tap, stepped.track.quantities
            waiting.setdefault(key, []).append(stepped)
            if len(waiting[key]) >= stepped.together:
                yield from self._rows(waiting.pop(key))
        for group in waiting.values():
            yield from self._rows(group)

    def close(self) -> None:
        """Release the engines."""
        while self._bases:
            self._bases.popitem()[1].close()

    # -- several runs -----------------------------------------------------------------------------------------------

    def _stepped(self, point: _Point) -> _Stepped | None:
        """The run, stepped; None where it is done alone, which also tells what is wrong with it."""
        if self._logs is not None or not point.case.plan.varies_in_place:
            return None
        try:
            base = self._base(point)
            if base.together == 1:
                return None
            simulation, tap = base.simulation(later=True)
            if not base.set(simulation, point.values):
                return None
            return _Stepped(point, track(simulation), tap, base.together, clock.perf_counter() - point.began)
        except DivergenceError:
            return None
        except BaseException as error:
            self._forget(point)
            if not isinstance(error, Exception):
                raise
            return None

    def _rows(self, group: Sequence[_Stepped]) -> Iterator[tuple[int, Row]]:
        began, tap = clock.perf_counter(), group[0].tap
        tap.begin(len(group))
        runs: Sequence[Run | None]
        try:
            runs = finish([one.track for one in group], tap.write)
        except Exception:
            # A user's law may raise on the numbers of one run.
            runs = [None] * len(group)
        each = (clock.perf_counter() - began) / len(group)
        for i, (one, run) in enumerate(zip(group, runs, strict=True)):
            cells = None if run is None else partial(tap.cells, run, i)
            yield self._row(one.point, clock.perf_counter() - one.seconds - each, cells)

    def _row(self, point: _Point, began: float, cells_of: Callable[[], dict[str, Any]] | None = None) -> tuple[int, Row]:
        """The number of the item and its row. began: s; cells_of: of the run, where it is done."""
        cells: dict[str, Any] = {"run": point.run, "variant": point.case.variant, **plain_cells(point.values, self.payload)}
        try:
            with blame_laws():
                cells |= self._cells(point) if cells_of is None else cells_of()
        except AsrsimError as error:
            cells |= {"status": "failed", "reason": one_line(error), "ok": False}
        except Exception as error:
            # Laws and measures may be a user's.
            cells |= {"status": "failed", "reason": f"{type(error).__name__}: {one_line(error)}", "ok": False}
        cells["seconds"] = clock.perf_counter() - began
        return point.number, tuple(map(cells.get, self.payload.names))

    # -- one run ----------------------------------------------------------------------------------------------------

    def _cells(self, point: _Point) -> dict[str, Any]:
        case, values = point.case, point.values
        if self._logs is not None:
            return self._logged(case, values, self._logs / f"run_{point.run:06d}")
        if not case.plan.varies_in_place:
            return self._alone(case, values)
        try:
            base = self._base(point)
            simulation, tap = base.simulation()
            tap.begin()
            if base.set(simulation, values):
                return tap.cells(_to_end(simulation))
        except BaseException as error:
            self._forget(point)
            if not isinstance(error, InputError):
                raise
        # What is wrong with the numbers is said as of a scenario's file.
        return self._alone(case, values)

    def _base(self, point: _Point) -> Base:
        key = _key(point)
        if key in self._bases:
            self._bases.move_to_end(key)
            return self._bases[key]
        self._bases[key] = base = Base(self.study, point.case, point.values, self._share)
        if len(self._bases) > BASES:
            self._bases.popitem(last=False)[1].close()
        return base

    def _forget(self, point: _Point) -> None:
        """What a fault leaves behind is nobody's fresh start."""
        base = self._bases.pop(_key(point), None)
        if base is not None:
            base.close()

    def _alone(self, case: Case, values: Mapping[str, Any]) -> dict[str, Any]:
        prepared = case.prepared(values)
        tap = Tap(prepared, self.study, checked=False)
        with Simulation(prepared, sinks=[tap]) as simulation:
            return tap.cells(_to_end(simulation))

    def _logged(self, case: Case, values: Mapping[str, Any], folder: Path) -> dict[str, Any]:
        scenario = case.scenario(case.plan.settings(values))
        folder.mkdir(parents=True, exist_ok=True)
        executed = execute(scenario, folder, robot=case.robot_of(values), overwrite=True, keep=bool(self.study.signals))
        write_summary(executed)
        kept = {}
        if self.study.signals and executed.run.samples is not None:
            signals = Signals(self.study, executed.run.info, scenario.step * scenario.log_every)
            signals.write(executed.run.samples)
            kept = signals.cells()
        return {**summary_cells(executed.summary), **kept}


def _to_end(simulation: Simulation) -> Run:
    try:
        return run_to_end(simulation)
    except DivergenceError as error:
        if not isinstance(error.run, Run):
            raise
        return error.run


def _key(point: _Point) -> tuple[str, str]:
    return point.case.variant, repr(point.case.plan.read_again(point.values))
