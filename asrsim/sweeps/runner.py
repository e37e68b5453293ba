"""One run of a study: prepared once, then other numbers; a row comes out, whatever happens."""

from __future__ import annotations

import json
import math
import time as clock
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.errors import AsrsimError, DivergenceError, InputError
from asrsim.log.derived import DERIVED_FUNCTIONS
from asrsim.metrics import ExpectationResult
from asrsim.runs.execute import execute, steps_of, write_summary
from asrsim.samples import Array, RunInfo, Samples
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.run import Run, blame_laws, run_to_end
from asrsim.simulation.simulation import Simulation
from asrsim.summary import Collector, RunSummary, claim_results, make_summary
from asrsim.summary.claims import check_claims, needs_of
from asrsim.sweeps.cases import LIMITS, MEASURES, TIP, Case, Payload

BASES = 8
"""Prepared simulations that are kept: runs that differ in numbers only share one."""

Row = tuple[Any, ...]


class Runner:
    """A task for :mod:`asrsim.workers`: runs of one study, one after the other; rows do not depend on their order."""

    def __init__(self, payload: Payload, logs: Path | None = None, share: int = 1) -> None:
        """logs: folder for logs, if the study keeps them; share: how many runners share the study's runs."""
        self.payload, self.study = payload, payload.study
        self._logs = logs if payload.study.logs else None
        self._share = share
        self._bases: OrderedDict[tuple[str, str], tuple[Simulation, _Tap]] = OrderedDict()

    def __reduce__(self) -> tuple[Any, ...]:
        return Runner, (self.payload, self._logs, self._share)

    def __call__(self, run: int) -> Row:
        """The row of a run, in the payload's columns."""
        began = clock.perf_counter()
        variant, values = self.study.point(run)
        case = self.payload.cases[variant]
        cells: dict[str, Any] = {"run": run, "variant": variant, **_plain(values, self.payload)}
        try:
            with blame_laws():
                cells |= self._cells(run, case, values)
        except AsrsimError as error:
            cells |= {"status": "failed", "reason": _one_line(error), "ok": False}
        except Exception as error:
            # Laws and measures may be a user's.
            cells |= {"status": "failed", "reason": f"{type(error).__name__}: {_one_line(error)}", "ok": False}
        cells["seconds"] = clock.perf_counter() - began
        return tuple(cells.get(name) for name in self.payload.names)

    def close(self) -> None:
        """Release the engines."""
        while self._bases:
            self._bases.popitem()[1][0].close()

    # -- one run ----------------------------------------------------------------------------------------------------

    def _cells(self, run: int, case: Case, values: Mapping[str, Any]) -> dict[str, Any]:
        if self._logs is not None:
            return self._logged(case, values, self._logs / f"run_{run:06d}")
        plan = case.plan
        again = plan.read_again(values)
        key = (case.variant, json.dumps(again, sort_keys=True, default=str))
        if case.robot_of(values) is None or not _varies_in_place(case):
            return self._alone(case, values)
        try:
            simulation, tap = self._base(key, case, values)
            tap.begin(simulation.prepared)
            simulation.reset(parameters=plan.changes(values))
            for name, places in sorted(plan.references.items(), key=lambda item: "*" not in item[0]):
                for joint, reference in places:
                    if simulation.set_reference(joint, reference, float(values[name])) != float(values[name]):
                        # Ranges are for what comes from outside; a study's values stand in the scenario.
                        return self._alone(case, values)
            return self._finished(simulation, tap, checked=True)
        except BaseException as error:
            # What a fault leaves behind is nobody's fresh start.
            kept = self._bases.pop(key, None)
            if kept is not None:
                kept[0].close()
            if not isinstance(error, InputError):
                raise
        # What is wrong with the numbers is said as of a scenario's file.
        return self._alone(case, values)

    def _base(self, key: tuple[str, str], case: Case, values: Mapping[str, Any]) -> tuple[Simulation, _Tap]:
        if key in self._bases:
            self._bases.move_to_end(key)
            return self._bases[key]
        # The same base whichever run comes first: numbers are those of the study's first point.
        first = self.study.point(0)[1]
        plan = case.plan
        quick = {**plan.parameters, **plan.references, **plan.inertials}
        base = {name: (first if name in quick else values)[name] for name in values}
        prepared = case.prepared(base)
        check_claims(prepared.scenario.expect, prepared.info.joints, file=prepared.scenario.path)
        tap = _Tap(self.study.signals, self.study.rate)
        tap.begin(prepared)
        cells = math.prod(self.study.grid) * self.study.draws if not plan.read_again(values) else 1
        steps = steps_of(prepared.scenario) * prepared.resolution.substeps
        simulation = Simulation(prepared, sinks=[tap], expected_substeps=max(steps, steps * cells // self._share))
        self._bases[key] = simulation, tap
        if len(self._bases) > BASES:
            self._bases.popitem(last=False)[1][0].close()
        return simulation, tap

    def _alone(self, case: Case, values: Mapping[str, Any]) -> dict[str, Any]:
        prepared = case.prepared(values)
        tap = _Tap(self.study.signals, self.study.rate)
        tap.begin(prepared)
        with Simulation(prepared, sinks=[tap]) as simulation:
            return self._finished(simulation, tap)

    def _finished(self, simulation: Simulation, tap: _Tap, *, checked: bool = False) -> dict[str, Any]:
        scenario = simulation.scenario
        try:
            run = run_to_end(simulation)
        except DivergenceError as error:
            if not isinstance(error.run, Run):
                raise
            run = error.run
        claims: tuple[ExpectationResult, ...] = ()
        if run.status == "complete":
            claims = claim_results(scenario.expect, run.info.joints, tap.collector.read, file=scenario.path, checked=checked)
        summary = make_summary(run, tap.collector, samples=0, claims=claims)
        return {**_summary_cells(summary), **tap.cells()}

    def _logged(self, case: Case, values: Mapping[str, Any], folder: Path) -> dict[str, Any]:
        scenario = case.scenario(case.plan.settings(values))
        folder.mkdir(parents=True, exist_ok=True)
        executed = execute(scenario, folder, robot=case.robot_of(values), overwrite=True, keep=bool(self.study.signals))
        write_summary(executed)
        tap = _Tap(self.study.signals, self.study.rate)
        if self.study.signals and executed.run.samples is not None:
            tap.start(executed.run.info, scenario.step * scenario.log_every)
            tap.note(executed.run.samples)
        return {**_summary_cells(executed.summary), **tap.cells()}


def _varies_in_place(case: Case) -> bool:
    plan = case.plan
    return bool(plan.parameters or plan.references or plan.inertials) and not (
        plan.inertials and not _still(case)
    )  # fmt: skip


def _still(case: Case) -> bool:
    """A start at equilibrium and a task follow from the robot's numbers, which then cannot be changed afterwards."""
    initial = case.resolved.get("initial")
    return initial != "equilibrium" and not case.resolved.get("task")


class _Tap:
    """A sink that serves one run after the other: a collector for the summary, and the kept signals."""

    full_rate = True

    def __init__(self, signals: Sequence[str], rate: float) -> None:
        self._signals = [tuple(signal.split(".", 1)) for signal in signals]
        self._rate = rate
        self.bodies = False

    def begin(self, prepared: Prepared) -> None:
        """A run begins."""
        scenario, joints = prepared.scenario, prepared.info.joints
        self.bodies = needs_of(scenario.expect, joints)[1]
        self.collector = Collector(joints, samples=steps_of(scenario) + 1, claims=scenario.expect)
        self.start(prepared.info, scenario.step)

    def start(self, info: RunInfo, step: float) -> None:
        """Signals of samples that come every `step` s."""
        self._joints = info.joints
        self._every = max(1, round(1.0 / (self._rate * step)))
        self._seen = 0
        self._kept: dict[str, list[Array]] = {}

    def write(self, samples: Samples) -> None:
        """The next chunk."""
        self.collector.write(samples)
        if self._signals:
            self.note(samples)

    def note(self, samples: Samples) -> None:
        """Keep the signals of a chunk."""
        rows = slice((-self._seen) % self._every, None, self._every)
        self._seen += len(samples.time)
        for joint, name in self._signals:
            if joint not in samples.joints:
                continue
            column = samples.joints.index(joint)
            table = samples.values.get(name)
            if table is None:
                table = DERIVED_FUNCTIONS[name](samples, self._joints)
            self._kept.setdefault(f"{joint}.{name}", []).append(table[rows, column].astype(np.float32))

    def cells(self) -> dict[str, Any]:
        """Kept signals, float32 at the study's rate."""
        return {f"signal:{name}": np.concatenate(parts).tolist() for name, parts in self._kept.items()} if self._signals else {}


def _summary_cells(summary: RunSummary) -> dict[str, Any]:
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
        cells |= {f"{joint.name}.{name}": _finite(getattr(joint.measures, name)) for name in MEASURES}
        cells |= {f"{joint.name}.{name}_count": getattr(joint, name) for name in LIMITS}
    cells |= {f"tip.{name}": summary.tip[name] for name in TIP if name in summary.tip}
    for index, claim in enumerate(summary.claims):
        cells |= {f"claim_{index}": claim.holds, f"claim_{index}.measured": _finite(claim.measured)}
    return cells


def _plain(values: Mapping[str, Any], payload: Payload) -> dict[str, Any]:
    kinds = dict(payload.columns)
    return {
        key: float(value) if kinds[key] == "float" else (value if isinstance(value, str) else json.dumps(value))
        for key, value in values.items()
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())[:500]


def lost(payload: Payload, run: int, reason: str) -> Row:
    """The row of a run that gave none."""
    variant, values = payload.study.point(run)
    cells = {"run": run, "variant": variant, **_plain(values, payload)}
    cells |= {"status": "crashed", "reason": reason, "ok": False}
    return tuple(cells.get(name) for name in payload.names)
