"""Runs of a study as rows: runs that differ only in numbers share simulation worlds; other runs are done alone."""

from __future__ import annotations

import json
import math
import time as clock
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from asrsim.errors import AsrsimError, DivergenceError
from asrsim.log.derived import DERIVED_FUNCTIONS, DERIVED_SOURCES
from asrsim.plain import finite_or_none
from asrsim.quantities import LIMITS
from asrsim.samples import Samples, grid
from asrsim.scenario.data import for_joint
from asrsim.simulation.chunks import LONGEST_NUMBERS
from asrsim.simulation.prepared import EXTERNAL_TORQUE, Prepared
from asrsim.simulation.run import Run, blame_laws, make_run, run_to_end
from asrsim.simulation.simulation import Simulation
from asrsim.simulation.worlds import Start, Worlds
from asrsim.summary import Collector, RunSummary, make_summary
from asrsim.summary.claims import Claims, check_claims, needs_of
from asrsim.sweeps.cases import MEASURES, TIP, Case, Payload
from asrsim.sweeps.study import Study

Row = tuple[Any, ...]
KINDS = 8
"""Number of prepared scenarios that a worker keeps."""
LONGEST_RUN = 20 * LONGEST_NUMBERS
"""Size of a run's series (numbers) above which the run is streamed instead of stored."""


@dataclass(frozen=True)
class _Point:
    """Run that is waiting to be done."""

    number: int
    """Number of the run in the worker's list."""
    run: int
    case: Case
    values: Mapping[str, Any]

    @property
    def kind(self) -> tuple[str, str]:
        """Key that is equal for runs of the same prepared scenario."""
        return self.case.variant, repr(self.case.plan.read_again(self.values))


class Runner:
    """Task for `asrsim.workers` that computes the rows of a study's runs. Rows do not depend on their order."""

    def __init__(self, payload: Payload, share: int = 1) -> None:
        """share: number of runners among which the study's runs are divided."""
        self.payload, self._share = payload, share
        self._kinds: OrderedDict[tuple[str, str], _Kind | None] = OrderedDict()

    def __reduce__(self) -> tuple[Any, ...]:
        return Runner, (self.payload, self._share)

    def __call__(self, run: int) -> Row:
        """Row of a run, in the payload's columns."""
        return next(self.several([(run, run)]))[1]

    def several(self, items: Iterable[tuple[int, int]]) -> Iterator[tuple[int, Row]]:
        """Rows of (number, run) pairs with their numbers; short runs of one prepared scenario are simulated together."""
        waiting: dict[tuple[str, str], list[_Point]] = {}
        for number, run in items:
            variant, values = self.payload.study.point(run)
            point = _Point(number, run, self.payload.cases[variant], values)
            group = waiting.setdefault(point.kind, [])
            group.append(point)
            kind = self._kind(point)
            if kind is None or len(group) >= kind.size:
                yield from self._rows(waiting.pop(point.kind))
        for points in waiting.values():
            yield from self._rows(points)

    def close(self) -> None:
        """Release the engines."""
        while self._kinds:
            self._drop(self._kinds.popitem()[1])

    def _drop(self, kind: _Kind | None) -> None:
        if kind is not None:
            kind.worlds.close()

    def _kind(self, point: _Point) -> _Kind | None:
        """Worlds for a run; None for a run that is done alone."""
        if point.kind not in self._kinds:
            try:
                self._kinds[point.kind] = _make_kind(self.payload.study, point, self._share)
            except Exception:
                # The run is then done alone, which finds the reason.
                self._kinds[point.kind] = None
            if len(self._kinds) > KINDS:
                self._drop(self._kinds.popitem(last=False)[1])
        self._kinds.move_to_end(point.kind)
        return self._kinds[point.kind]

    def _rows(self, points: Sequence[_Point]) -> Iterator[tuple[int, Row]]:
        """Rows of runs of one prepared scenario. A run that the shared worlds cannot do is done alone."""
        began = clock.perf_counter()
        kind = self._kind(points[0])
        found: dict[int, dict[str, Any]] = {}
        try:
            if kind is not None:
                found = kind.run([point.values for point in points])
        except Exception:
            # User code may raise an error for one run; the worlds are then in an unknown state: discard them.
            self._drop(self._kinds.pop(points[0].kind))
        each = (clock.perf_counter() - began) / len(points)
        for place, point in enumerate(points):
            began = clock.perf_counter()
            cells: dict[str, Any] = {
                "run": point.run,
                "variant": point.case.variant,
                **varied_cells(point.values, self.payload),
            }
            try:
                cells |= found[place] if place in found else alone(self.payload.study, point.case, point.values)
            except Exception as error:
                # Actuators and measures may be user code, which raises errors of any kind.
                name = "" if isinstance(error, AsrsimError) else f"{type(error).__name__}: "
                cells |= {"status": "failed", "reason": name + _one_line(error), "ok": False}
            cells["seconds"] = each + clock.perf_counter() - began
            yield point.number, tuple(map(cells.get, self.payload.kinds))


class _Kind:
    """Simulation worlds for runs of one prepared scenario."""

    def __init__(self, study: Study, case: Case, prepared: Prepared, size: int, expected_substeps: int) -> None:
        self._study, self._case, self.size = study, case, size
        self._claims = claims_of(prepared, checked=True)
        names = RowCollector(prepared, study, self._claims).quantities
        self.worlds = Worlds(prepared, size, names=tuple(names), expected_substeps=expected_substeps)

    def run(self, points: Sequence[Mapping[str, Any]]) -> dict[int, dict[str, Any]]:
        """Index of a run -> its cells, for at most `size` runs; invalid and diverged runs are missing."""
        worlds, began = self.worlds, clock.perf_counter()
        ready = [world for world, values in enumerate(points) if self._is_set(world, values)]
        if not ready:
            return {}
        scenario = worlds.prepared.scenario
        record = worlds.record(worlds.selection.names, worlds=ready)
        time = grid(0, scenario.steps + 1, scenario.step)
        cells = {}
        for place, world in enumerate(ready):
            if not worlds.sane(world):
                continue
            prepared = worlds.prepared_of(world)
            collector = RowCollector(prepared, self._study, self._claims)
            values = {name: table[place] for name, table in record.items()}
            collector.write(Samples(time=time, joints=tuple(worlds.joints), values=values))
            run = make_run(
                prepared, worlds.counts(world), "complete", wall_time=(clock.perf_counter() - began) / len(points),
                simulated_time=prepared.last_substep(None) * prepared.substep, compiled=worlds.compiled,
            )  # fmt: skip
            # If a claim cannot be evaluated, the run is done alone and its row gives the reason.
            with suppress(AsrsimError):
                cells[world] = collector.cells(run)
        return cells

    def _is_set(self, world: int, values: Mapping[str, Any]) -> bool:
        """Set a world to the start of a run and return True; return False if a value is invalid or a reference out of range."""
        plan, worlds = self._case.plan, self.worlds
        references: dict[str, dict[str, Any]] = {}
        try:
            if plan.signals:
                scenario = self._case.scenario(plan.settings(values))
                for joint in worlds.joints:
                    references[joint] = dict(scenario.references_of(joint))
                    torque = for_joint(scenario.external_torques, joint)
                    if torque is not None:
                        references[joint][EXTERNAL_TORQUE] = torque
            worlds.reset(Start(parameters=plan.changes(values), references=references), worlds=[world])
            return all(
                worlds.set_reference(joint, reference, float(values[name]), worlds=[world])[0] == float(values[name])
                for name, places in sorted(plan.references.items(), key=lambda item: "*" not in item[0])
                for joint, reference in places
            )
        except AsrsimError:
            return False


def _make_kind(study: Study, point: _Point, share: int) -> _Kind | None:
    """Worlds for runs of the point's kind; None if these runs must be done alone. Raises AsrsimError."""
    case, plan = point.case, point.case.plan
    if not plan.varies_in_place:
        return None
    # Use the study's first point, so that the worlds do not depend on the order of the runs.
    first = study.point(0)[1]
    prepared = case.prepared({name: (first if name in plan.in_place else point.values)[name] for name in point.values})
    scenario = prepared.scenario
    check_claims(scenario.expect, prepared.info.joints, file=scenario.path)
    numbers = scenario.steps * len(prepared.drives)
    # Poses and contacts must be read from the engine during a run: not possible in shared worlds.
    if scenario.task is not None or not (scenario.world.empty and scenario.fixed_base) or numbers > LONGEST_RUN:
        return None
    runs = 1 if plan.read_again(point.values) else math.prod(study.grid) * study.draws
    # Limit the number of worlds so that their records fit into the processor's cache.
    size = min(runs, max(1, LONGEST_NUMBERS // numbers))
    substeps = scenario.steps * prepared.resolution.substeps
    return _Kind(study, case, prepared, size, max(substeps, substeps * runs // share) // size)


def alone(study: Study, case: Case, values: Mapping[str, Any]) -> dict[str, Any]:
    """Cells of a run with its own preparation. Raises AsrsimError."""
    with blame_laws():
        prepared = case.prepared(values)
        collector = RowCollector(prepared, study, claims_of(prepared, checked=False))
        with Simulation(prepared, sinks=[collector]) as simulation:
            try:
                run = run_to_end(simulation)
            except DivergenceError as error:
                if not isinstance(error.run, Run):
                    raise
                run = error.run
        return collector.cells(run)


def claims_of(prepared: Prepared, *, checked: bool) -> Claims:
    """Claims of a scenario; checked: `check_claims` has accepted them already."""
    scenario = prepared.scenario
    return Claims(scenario.expect, prepared.info.joints, file=scenario.path, checked=checked)


class RowCollector:
    """Sink that collects the data of a run's row: measures, claims and recorded signals."""

    full_rate = True

    def __init__(self, prepared: Prepared, study: Study, claims: Claims) -> None:
        scenario = prepared.scenario
        self._joints, self._claims, self._scenario = prepared.info.joints, claims, scenario
        needs = needs_of(scenario.expect, self._joints)
        self._summary = Collector(self._joints, samples=scenario.steps + 1, needs=needs)
        self.bodies = self._summary.bodies
        self._signals: dict[tuple[str, str], list[float]] = {}
        for signal in study.signals:
            joint, _, name = signal.rpartition(".")
            self._signals[joint, name] = []
        self._every = max(1, round(1.0 / (study.rate * scenario.step)))
        self._rows = 0

    @property
    def quantities(self) -> frozenset[str]:
        """Quantities that the row needs from the samples."""
        sources = (source for _, name in self._signals for source in DERIVED_SOURCES.get(name, (name,)))
        return self._summary.quantities | frozenset(sources)

    def write(self, samples: Samples) -> None:
        """Collect the next chunk."""
        self._summary.write(samples)
        rows = slice((-self._rows) % self._every, None, self._every)
        self._rows += len(samples.time)
        for (joint, name), kept in self._signals.items():
            if joint in samples.joints:
                table = samples.values[name] if name in samples.values else DERIVED_FUNCTIONS[name](samples, self._joints)
                kept += table[rows, samples.joints.index(joint)].astype(np.float32).tolist()

    def cells(self, run: Run) -> dict[str, Any]:
        """Cells of the run's row. Raises ScenarioError for claims that cannot be evaluated."""
        claims = self._claims.results(self._summary.read) if run.status == "complete" else ()
        seen = self._summary.seen(self._scenario.desired, balanced=self._scenario.initial_equilibrium)
        signals = {f"signal:{joint}.{name}": kept for (joint, name), kept in self._signals.items() if kept}
        return {**summary_cells(make_summary(run, seen, samples=0, claims=claims)), **signals}


def summary_cells(summary: RunSummary) -> dict[str, Any]:
    """Cells with the results of a run."""
    cells: dict[str, Any] = {
        "status": summary.status,
        "reason": summary.message or None,
        "ok": summary.ok,
        "warnings": ", ".join(dict.fromkeys(w.code + (f":{w.key}" if w.key else "") for w in summary.warnings)) or None,
        "substeps": summary.substeps,
        "motor_substeps": summary.motor_substeps,
        "simulated_time": summary.simulated_time,
    }
    if summary.claims:
        cells["claims_met"] = sum(claim.holds for claim in summary.claims) / len(summary.claims)
    for joint in summary.joints:
        cells |= {f"{joint.name}.{name}": finite_or_none(getattr(joint.measures, name)) for name in MEASURES}
        cells |= {f"{joint.name}.{name}_count": getattr(joint, name) for name in LIMITS}
    cells |= {f"tip.{name}": summary.tip[name] for name in TIP if name in summary.tip}
    for index, claim in enumerate(summary.claims):
        cells |= {f"claim_{index}": claim.holds, f"claim_{index}.measured": finite_or_none(claim.measured)}
    return cells


def varied_cells(values: Mapping[str, Any], payload: Payload) -> dict[str, Any]:
    """Cells of the varied keys: numbers, words, and other values as JSON."""
    kinds = payload.kinds
    return {
        key: float(value) if kinds[key] == "float" else (value if isinstance(value, str) else json.dumps(value))
        for key, value in values.items()
    }


def crashed_row(payload: Payload, run: int, reason: str) -> Row:
    """Row of a run during which its workers crashed."""
    variant, values = payload.study.point(run)
    cells = {"run": run, "variant": variant, **varied_cells(values, payload)}
    cells |= {"status": "crashed", "reason": reason, "ok": False}
    return tuple(map(cells.get, payload.kinds))


def _one_line(error: BaseException) -> str:
    lines = [" ".join(line.split()) for line in str(error).splitlines()]
    return "; ".join(line for line in lines if line)[:500]
