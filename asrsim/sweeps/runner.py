"""Runs of a study: prepared once, then other numbers; a row of each comes out, whatever happens."""

from __future__ import annotations

import time as clock
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from asrsim.errors import AsrsimError, DivergenceError, InputError
from asrsim.runs.execute import execute, write_summary
from asrsim.samples import Samples, grid
from asrsim.simulation.run import Run, blame_laws, make_run, run_to_end
from asrsim.simulation.simulation import Simulation
from asrsim.simulation.worlds import Worlds
from asrsim.sweeps.base import Base
from asrsim.sweeps.cases import Case, Payload
from asrsim.sweeps.rows import Row, one_line, plain_cells, summary_cells
from asrsim.sweeps.tap import Signals, Tap, name_in

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
        waiting: dict[tuple[str, str], list[_Point]] = {}
        for number, run in items:
            variant, values = self.study.point(run)
            point = _Point(number, run, self.payload.cases[variant], values, clock.perf_counter())
            base = self._shared(point)
            if base is None:
                yield self._row(point, point.began)
                continue
            group = waiting.setdefault(_key(point), [])
            group.append(point)
            if len(group) >= base.together:
                yield from self._together(waiting.pop(_key(point)))
        for points in waiting.values():
            yield from self._together(points)

    def close(self) -> None:
        """Release the engines."""
        while self._bases:
            self._bases.popitem()[1].close()

    # -- several runs -----------------------------------------------------------------------------------------------

    def _shared(self, point: _Point) -> Base | None:
        """What steps the run together with others; None where it is done alone, which also tells what is wrong with it."""
        if self._logs is not None or not point.case.plan.varies_in_place:
            return None
        try:
            base = self._base(point)
        except Exception:
            self._forget(point)
            return None
        return base if base.together > 1 else None

    def _together(self, points: Sequence[_Point]) -> Iterator[tuple[int, Row]]:
        """Rows of runs of one kind; those that cannot be set, or that are not sane, are done alone."""
        began = clock.perf_counter()
        found: dict[int, Callable[[], dict[str, Any]]] = {}
        try:
            base = self._base(points[0])
            worlds, tap = base.worlds()
            ready = [i for i, point in enumerate(points) if self._is_set(base, worlds, i, point.values)]
            runs = step_worlds(worlds, ready, tap) if ready else []
            each = (clock.perf_counter() - began) / len(points)
            for place, (i, run) in enumerate(zip(ready, runs, strict=True)):
                if run is not None:
                    found[i] = partial(tap.cells, replace(run, wall_time=each), place)
        except Exception:
            # A user's law may raise on the numbers of one run: each is done alone.
            self._forget(points[0])
        each = (clock.perf_counter() - began) / len(points)
        for i, point in enumerate(points):
            yield self._row(point, clock.perf_counter() - (each if i in found else 0.0), found.get(i))

    @staticmethod
    def _is_set(base: Base, worlds: Worlds, world: int, values: Mapping[str, Any]) -> bool:
        try:
            return base.set_world(worlds, world, values)
        except AsrsimError:
            return False

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


def step_worlds(worlds: Worlds, numbers: Sequence[int], tap: Tap) -> list[Run | None]:
    """Step worlds that are at their start to the end; their samples, side by side as if they were joints of one robot, go to
    the tap. None for a world whose motion is not sane. No law or sum goes over several joints, so all numbers are those of a
    run alone."""
    names = worlds.selection.names
    found = worlds.record(names, worlds=list(numbers))
    tap.begin(len(numbers))
    scenario = worlds.prepared.scenario
    joints = tuple(name_in(place, joint) for place in range(len(numbers)) for joint in worlds.joints)
    rows = scenario.steps + 1
    values = {name: table.transpose(1, 0, 2).reshape(rows, -1) for name, table in found.items()}
    tap.write(Samples(time=grid(0, rows, scenario.step), joints=joints, values=values))
    more = {
        "wall_time": 0.0,
        "simulated_time": worlds.prepared.last_substep(None) * worlds.prepared.substep,
        "compiled": worlds.compiled,
    }
    return [
        make_run(worlds.prepared_of(world), worlds.counts(world), "complete", **more) if worlds.sane(world) else None
        for world in numbers
    ]


def _to_end(simulation: Simulation) -> Run:
    try:
        return run_to_end(simulation)
    except DivergenceError as error:
        if not isinstance(error.run, Run):
            raise
        return error.run


def _key(point: _Point) -> tuple[str, str]:
    return point.case.variant, repr(point.case.plan.read_again(point.values))
