"""Simulates runs of a study and returns their rows. Runs that differ only in numbers of the robot or in constant references are
simulated together in shared simulation worlds; other runs are simulated one by one.
"""

from __future__ import annotations

import json
import math
import time as clock
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

from asrsim.errors import AsrsimError, DivergenceError
from asrsim.plain import finite_or_none
from asrsim.plugins import blame_plugins
from asrsim.quantities import LIMITS
from asrsim.runs.execute import collector_of, judged
from asrsim.samples import Samples
from asrsim.scenario.data import for_joint
from asrsim.simulation.drives import EXTERNAL_TORQUE
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.run import Run, make_run, run_to_end
from asrsim.simulation.simulation import Simulation
from asrsim.simulation.start import Start
from asrsim.simulation.worlds import Worlds
from asrsim.summary import Collector
from asrsim.summary.claims import needs_of
from asrsim.sweeps.cases import MEASURES, TIP, Case, Payload
from asrsim.sweeps.study import Study

StudyRow = tuple[Any, ...]
KINDS = 8
"""Largest number of prepared scenarios that a worker keeps for its later runs."""
CACHED = 61_440
"""Number of steps times joints, summed over all worlds, up to which the recorded series fit into the processor's cache."""
LONGEST_RUN = 20 * CACHED
"""Number of values in a run's series above which the run is processed in chunks and not stored as a whole."""


class _Point(NamedTuple):
    """Run of a study: its index, its variant as a `Case`, and its values of the varied keys."""

    run: int
    case: Case
    values: Mapping[str, Any]


class Runner:
    """Task for `asrsim.workers` that computes the rows of a study's runs. A row does not depend on the runs computed before."""

    def __init__(self, payload: Payload) -> None:
        self.payload = payload
        self._kinds: dict[tuple[str, str], _Kind | None] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        return Runner, (self.payload,)

    def __call__(self, run: int) -> StudyRow:
        """Row of a run, with the columns that `Payload.columns` lists."""
        return self.several([run])[0]

    def several(self, runs: Sequence[int]) -> list[StudyRow]:
        """Rows of these runs, in the same order. Short runs with the same prepared scenario are simulated together."""
        groups: dict[tuple[str, str], list[_Point]] = {}
        for run in runs:
            variant, values = self.payload.study.point(run)
            case = self.payload.cases[variant]
            groups.setdefault((variant, repr(case.plan.read_again(values))), []).append(_Point(run, case, values))
        rows: dict[int, StudyRow] = {}
        for key, points in groups.items():
            while points:
                kind = self._kind(key, points[0])
                size = kind.size if kind is not None else 1
                rows |= self._rows(kind, points[:size])
                points = points[size:]
        return [rows[run] for run in runs]

    def close(self) -> None:
        """Close the simulation engines of this worker."""
        for kind in self._kinds.values():
            if kind is not None:
                kind.worlds.close()
        self._kinds.clear()

    def _kind(self, key: tuple[str, str], point: _Point) -> _Kind | None:
        """Shared simulation worlds for a run; None if the run must be simulated alone."""
        if key not in self._kinds:
            if len(self._kinds) == KINDS:
                self.close()
            # If the worlds cannot be made, the run is simulated alone, and its row states the reason.
            self._kinds[key] = None
            with suppress(Exception):
                self._kinds[key] = _make_kind(self.payload.study, point)
        return self._kinds[key]

    def _rows(self, kind: _Kind | None, points: Sequence[_Point]) -> dict[int, StudyRow]:
        """Rows, by index, of runs with the same prepared scenario. Runs that the worlds cannot simulate are simulated alone."""
        began = clock.perf_counter()
        found: dict[int, dict[str, Any]] = {}
        try:
            if kind is not None:
                found = kind.run([point.values for point in points])
        except Exception:
            # User code may raise an error for one of the runs. Discard all worlds, since their states are then unknown.
            self.close()
        each = (clock.perf_counter() - began) / len(points)
        rows = {}
        for place, point in enumerate(points):
            began = clock.perf_counter()
            try:
                cells = found[place] if place in found else alone(point.case, point.values)
            except Exception as error:
                # Actuators and measures may be user code. Add the type of the error, without which its message may be unclear.
                name = "" if isinstance(error, AsrsimError) else f"{type(error).__name__}: "
                cells = {"status": "failed", "reason": name + _one_line(error), "ok": False}
            cells["seconds"] = each + clock.perf_counter() - began
            rows[point.run] = row_of(self.payload, point.run, cells)
        return rows


class _Kind:
    """Simulation worlds for runs with the same prepared scenario."""

    def __init__(self, case: Case, prepared: Prepared, size: int, expected_substeps: int) -> None:
        self._case, self.size = case, size
        scenario, joints = prepared.scenario, prepared.info.joints
        self._needs = needs_of(scenario.expect, joints)
        wanted = Collector(joints, samples=scenario.steps + 1, needs=self._needs).quantities
        recorded = dict.fromkeys(name for joint in joints for name in joint.quantities if name in wanted)
        self.worlds = Worlds(prepared, size, names=tuple(recorded), expected_substeps=expected_substeps)

    def run(self, points: Sequence[Mapping[str, Any]]) -> dict[int, dict[str, Any]]:
        """Results of at most `size` runs as cells by column, by position in `points`. Invalid and diverged runs are missing."""
        worlds, began = self.worlds, clock.perf_counter()
        ready = [world for world, values in enumerate(points) if self._is_set(world, values)]
        if not ready:
            return {}
        scenario = worlds.prepared.scenario
        record = worlds.record(worlds.names, worlds=ready)
        time = scenario.step_times()
        cells = {}
        for place, world in enumerate(ready):
            if not worlds.sane(world):
                continue
            prepared = worlds.prepared_of(world)
            collector = Collector(prepared.info.joints, samples=scenario.steps + 1, needs=self._needs)
            values = {name: table[place] for name, table in record.items()}
            collector.write(Samples(time=time, joints=tuple(worlds.joints), values=values))
            run = make_run(
                prepared,
                worlds.counts(world),
                "complete",
                wall_time=(clock.perf_counter() - began) / len(points),
                simulated_time=prepared.last_substep(None) * prepared.substep,
                compiled=worlds.compiled,
            )
            # If a claim cannot be evaluated, the run is simulated alone, and its row states the reason.
            with suppress(AsrsimError):
                cells[world] = result_cells(run, collector)
        return cells

    def _is_set(self, world: int, values: Mapping[str, Any]) -> bool:
        """Set a world to the initial state of a run and return True. Return False if a value is invalid or a reference is out
        of range."""
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
                for name, places in plan.references.items()
                for joint, reference in places
            )
        except AsrsimError:
            return False


def _make_kind(study: Study, point: _Point) -> _Kind | None:
    """Shared worlds for all runs with the same prepared scenario as this point; None if such runs must be simulated alone.
    Raises AsrsimError.
    """
    case, plan = point.case, point.case.plan
    if not plan.varies_in_place:
        return None
    # Prepare the worlds with the values of the study's first run, so that they do not depend on the order of the runs.
    first = study.point(0)[1]
    prepared = case.prepared({name: (first if name in plan.in_place else point.values)[name] for name in point.values})
    scenario = prepared.scenario
    numbers = scenario.steps * len(prepared.drives)
    # Tasks, objects and free bases need poses and contacts from the engine during a run. Shared worlds do not give them.
    if scenario.task is not None or not (scenario.world.empty and scenario.fixed_base) or numbers > LONGEST_RUN:
        return None
    runs = 1 if plan.read_again(point.values) else math.prod(study.grid) * study.draws
    # Limit the number of worlds so that their recorded series fit into the processor's cache.
    size = min(runs, max(1, CACHED // numbers))
    substeps = scenario.steps * prepared.resolution.substeps
    return _Kind(case, prepared, size, substeps * runs // size)


def alone(case: Case, values: Mapping[str, Any]) -> dict[str, Any]:
    """Results, as cells by column, of a run that is prepared and simulated alone. Raises AsrsimError."""
    with blame_plugins():
        prepared = case.prepared(values)
        collector = collector_of(prepared.plan)
        with Simulation(prepared, sinks=[collector]) as simulation:
            try:
                run = run_to_end(simulation)
            except DivergenceError as error:
                if not isinstance(error.run, Run):
                    raise
                run = error.run
        return result_cells(run, collector)


def result_cells(run: Run, collector: Collector) -> dict[str, Any]:
    """Results of a run as cells by column. Raises ScenarioError for claims that cannot be evaluated."""
    summary = judged(run.scenario, run, collector, samples=0)
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


def row_of(payload: Payload, run: int, results: Mapping[str, Any]) -> StudyRow:
    """Row of a run: its values of the varied keys, and its results. Values that are neither number nor text become JSON."""
    kinds, (variant, values) = payload.kinds, payload.study.point(run)
    cells: dict[str, Any] = {"run": run, "variant": variant, **results}
    for key, value in values.items():
        cells[key] = float(value) if kinds[key] == "float" else (value if isinstance(value, str) else json.dumps(value))
    return tuple(map(cells.get, kinds))


def _one_line(error: BaseException) -> str:
    lines = [" ".join(line.split()) for line in str(error).splitlines()]
    return "; ".join(line for line in lines if line)[:500]
