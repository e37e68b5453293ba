"""Runs of a study: prepared once, then other numbers; a row of each comes out, whatever happens."""

from __future__ import annotations

import json
import time as clock
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from asrsim.errors import AsrsimError, DivergenceError, InputError
from asrsim.metrics import ExpectationResult
from asrsim.runs.execute import execute, write_summary
from asrsim.simulation.run import Run, blame_laws, run_to_end
from asrsim.simulation.simulation import Simulation
from asrsim.simulation.together import Track, finish, track
from asrsim.summary import claim_results, make_summary
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
        waiting: dict[Any, list[tuple[_Point, Track, float]]] = {}
        for number, run in items:
            variant, values = self.study.point(run)
            point = _Point(number, run, self.payload.cases[variant], values, clock.perf_counter())
            stepped = self._stepped(point)
            if stepped is None:
                yield self._row(point, point.began)
                continue
            base, one = stepped
            group = waiting.setdefault((base, one.kind), [])
            group.append((point, one, clock.perf_counter() - point.began))
            if len(group) >= base.together:
                yield from self._rows(waiting.pop((base, one.kind)))
        for group in waiting.values():
            yield from self._rows(group)

    def close(self) -> None:
        """Release the engines."""
        while self._bases:
            self._bases.popitem()[1].close()

    # -- several runs -----------------------------------------------------------------------------------------------

    def _stepped(self, point: _Point) -> tuple[Base, Track] | None:
        """The run, stepped; None where it is done alone, which also tells what is wrong with it."""
        if self._logs is not None or not _varies_in_place(point.case):
            return None
        try:
            base = self._base(point)
            if base.together == 1:
                return None
            simulation = base.simulation(later=True)
            return (base, track(simulation)) if base.set(simulation, point.values) else None
        except DivergenceError:
            return None
        except BaseException as error:
            self._forget(point)
            if not isinstance(error, Exception):
                raise
            return None

    def _rows(self, group: Sequence[tuple[_Point, Track, float]]) -> Iterator[tuple[int, Row]]:
        began = clock.perf_counter()
        taps = [Tap(one.prepared, self.study) for _, one, _ in group]
        runs: Sequence[Run | None]
        try:
            runs = finish([one for _, one, _ in group], taps)
        except Exception:
            # A user's law may raise on the numbers of one run.
            runs = [None] * len(group)
        each = (clock.perf_counter() - began) / len(group)
        for (point, _, seconds), run, tap in zip(group, runs, taps, strict=True):
            yield self._row(point, clock.perf_counter() - seconds - each, None if run is None else (run, tap))

    def _row(self, point: _Point, began: float, seen: tuple[Run, Tap] | None = None) -> tuple[int, Row]:
        """The number of the item and its row. began: s; seen: the run and what its samples left, where it is done."""
        cells: dict[str, Any] = {"run": point.run, "variant": point.case.variant, **plain_cells(point.values, self.payload)}
        try:
            with blame_laws():
                cells |= self._cells(point) if seen is None else _cells_of(*seen, checked=True)
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
        if not _varies_in_place(case):
            return self._alone(case, values)
        try:
            base = self._base(point)
            simulation, tap = base.simulation(), base.tap
            tap.begin()
            if base.set(simulation, values):
                return _finished(simulation, tap, checked=True)
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
        tap = Tap(prepared, self.study)
        with Simulation(prepared, sinks=[tap]) as simulation:
            return _finished(simulation, tap)

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


def _finished(simulation: Simulation, tap: Tap, *, checked: bool = False) -> dict[str, Any]:
    try:
        run = run_to_end(simulation)
    except DivergenceError as error:
        if not isinstance(error.run, Run):
            raise
        run = error.run
    return _cells_of(run, tap, checked=checked)


def _cells_of(run: Run, tap: Tap, *, checked: bool) -> dict[str, Any]:
    scenario = run.scenario
    claims: tuple[ExpectationResult, ...] = ()
    if run.status == "complete":
        claims = claim_results(scenario.expect, run.info.joints, tap.collector.read, file=scenario.path, checked=checked)
    summary = make_summary(run, tap.collector, samples=0, claims=claims)
    return {**summary_cells(summary), **tap.signals.cells()}


def _key(point: _Point) -> tuple[str, str]:
    return point.case.variant, json.dumps(point.case.plan.read_again(point.values), sort_keys=True, default=str)


def _varies_in_place(case: Case) -> bool:
    """Whether other numbers do; where another robot file is read, or a start at equilibrium or a task follows from the robot's
    numbers, they do not."""
    plan = case.plan
    if not (plan.parameters or plan.references or plan.inertials) or plan.reads_robot:
        return False
    follows = case.resolved.get("initial") == "equilibrium" or bool(case.resolved.get("task"))
    return not (plan.inertials and follows)
