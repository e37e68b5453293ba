"""A study made ready for workers: scenarios read, robots loaded, keys planned, columns known; all of it can be pickled."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from asrsim.errors import AsrsimError, InputError, Problem, did_you_mean
from asrsim.log.derived import DERIVED_FUNCTIONS
from asrsim.metrics import JointSummary
from asrsim.quantities import LIMITS
from asrsim.robot.model import Robot
from asrsim.robot.vary import varied_robot
from asrsim.samples import JointInfo
from asrsim.scenario import Scenario, apply_to_robot, checked_robot, load_scenario
from asrsim.scenario.load import scenario_from_data
from asrsim.simulation.prepare import prepare
from asrsim.simulation.prepared import Prepared
from asrsim.summary.claims import claim_titles
from asrsim.sweeps.keys import Plan, plan_keys
from asrsim.sweeps.laws import Values
from asrsim.sweeps.study import Study

MEASURES = tuple(field.name for field in fields(JointSummary))
TIP = ("largest", "rms", "last")
PROBES = 4096
"""Runs among which the extreme ones are sought."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """One variant."""

    name: str
    variant: str
    resolved: Mapping[str, Any]
    base_dir: Path
    files: Mapping[str, Path]
    robot: Robot
    """As its file has it."""
    plan: Plan
    substeps: Mapping[str, int]
    """`substeps` and `motor_substeps` of every run; empty: each run finds its own."""
    joints: tuple[str, ...]
    claims: tuple[str, ...]

    def scenario(self, settings: Mapping[str, Any]) -> Scenario:
        """The scenario with keys set. Raises ScenarioError."""
        return scenario_from_data(
            self.resolved, base_dir=self.base_dir, files=self.files, name=self.name, variant=self.variant,
            overrides={**settings, **self.substeps},
        )  # fmt: skip

    def robot_of(self, values: Mapping[str, Any]) -> Robot | None:
        """The robot at a point; None: another file has to be read."""
        if self.plan.reads_robot:
            return None
        changes = self.plan.robot_changes(values)
        return varied_robot(self.robot, changes) if changes else self.robot

    def prepared(self, values: Mapping[str, Any]) -> Prepared:
        """Everything read and made ready at a point."""
        return prepare(self.scenario(self.plan.settings(values)), self.robot_of(values))


@dataclass(frozen=True, kw_only=True)
class Payload:
    """What a worker needs."""

    study: Study
    cases: Mapping[str, Case]
    columns: tuple[tuple[str, str], ...]
    """(name, kind) of a row: int, float, bool, text or floats."""

    @cached_property
    def kinds(self) -> dict[str, str]:
        """Column -> kind."""
        return dict(self.columns)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of the columns."""
        return tuple(self.kinds)


def make_payload(study: Study) -> Payload:
    """Read and check everything. Raises InputError or SimulationError with what would let every run fail."""
    from asrsim.actuators.user import load_plugin_file

    for plugin in study.plugins:
        load_plugin_file(plugin)
    scenarios = load_scenario(study.scenario or "", overrides=study.overrides)
    known = tuple(one.variant for one in scenarios)
    unknown = [name for name in study.variants if name not in known]
    if unknown:
        message = f"there is no variant '{unknown[0]}'"
        problem = Problem(message, file=study.scenario, choices=known, meant=unknown[0], code="unknown-variant")
        raise InputError(problem)
    chosen = [one for one in scenarios if one.variant in (study.variants or known)]
    study = replace(study, variants=tuple(one.variant for one in chosen))
    numeric = {key: _is_numeric(study, key) for key in study.keys}
    cases: dict[str, Case] = {}
    infos: list[tuple[JointInfo, ...]] = []
    for one in chosen:
        robot, _ = checked_robot(one)
        case = Case(
            name=one.name,
            variant=one.variant,
            resolved=one.resolved,
            base_dir=(study.scenario or Path()).parent.absolute(),
            files=one.attachments,
            robot=robot,
            plan=plan_keys(study.keys, numeric, one, apply_to_robot(one, robot)),
            substeps={},
            joints=(),
            claims=(),
        )
        probed = _probe(study, case)
        infos.append(probed.info.joints)
        claims = tuple(claim_titles(probed.scenario.expect, probed.info.joints))
        cases[one.variant] = replace(
            case, substeps=_common(study, case, one), joints=tuple(joint.name for joint in probed.info.joints), claims=claims
        )
    _check_signals(study, infos)
    task = any(one.task is not None for one in chosen)
    return Payload(study=study, cases=cases, columns=_columns(study, cases, numeric, task=task))


def _is_numeric(study: Study, key: str) -> bool:
    for axis in study.axes:
        if key in axis.keys and isinstance(axis.law, Values):
            taken = [axis.assign(value)[key] for value in axis.law.values]
            return all(isinstance(value, int | float) and not isinstance(value, bool) for value in taken)
    return True


def _columns(
    study: Study, cases: Mapping[str, Case], numeric: Mapping[str, bool], *, task: bool
) -> tuple[tuple[str, str], ...]:
    columns = [("run", "int"), ("variant", "text")]
    columns += [(key, "float" if numeric[key] else "text") for key in study.keys]
    columns += [("status", "text"), ("reason", "text"), ("ok", "bool"), ("claims_met", "float")]
    for joint in dict.fromkeys(joint for case in cases.values() for joint in case.joints):
        columns += [(f"{joint}.{name}", "float") for name in MEASURES]
        columns += [(f"{joint}.{name}_count", "int") for name in LIMITS]
    columns += [(f"tip.{name}", "float") for name in TIP] if task else []
    for index in range(max(len(case.claims) for case in cases.values())):
        columns += [(f"claim_{index}", "bool"), (f"claim_{index}.measured", "float")]
    columns += [(f"signal:{signal}", "floats") for signal in study.signals]
    columns += [("warnings", "text"), ("substeps", "int"), ("motor_substeps", "int"), ("simulated_time", "float")]
    return (*columns, ("seconds", "float"))


def _check_signals(study: Study, infos: Sequence[tuple[JointInfo, ...]]) -> None:
    known = {f"{j.name}.{name}" for joints in infos for j in joints for name in (*j.quantities, *DERIVED_FUNCTIONS)}
    unknown = [name for name in study.signals if name not in known]
    if unknown:
        raise InputError(
            Problem("no joint has this signal", key=name, hint=did_you_mean(name, tuple(known)), code="signal")
            for name in unknown
        )


def extreme_runs(study: Study, variant: str) -> list[int]:
    """Runs of a variant at the ends of every key, and some between: of studies of any size, in no time."""
    import numpy as np

    per = len(study) // max(1, len(study.variants))
    first = per * study.variants.index(variant)
    runs = np.unique(np.linspace(first, first + per - 1, min(per, PROBES)).round().astype(np.int64))
    chosen = [int(runs[0]), int(runs[-1]), *map(int, runs[:: max(1, len(runs) // 4)])]
    for key in study.keys:
        taken = [study.point(int(run))[1][key] for run in runs]
        if all(isinstance(value, int | float) for value in taken):
            chosen += [int(runs[np.argmin(taken)]), int(runs[np.argmax(taken)])]
        else:
            places: dict[str, int] = {}
            for run, value in zip(runs.tolist(), taken, strict=True):
                places.setdefault(repr(value), run)
            chosen += list(places.values())[:20]
    return list(dict.fromkeys(chosen))


def _probe(study: Study, case: Case) -> Prepared:
    """One point that can be prepared. Raises the first point's error where none can."""
    first: AsrsimError | None = None
    for run in extreme_runs(study, case.variant):
        try:
            prepared = case.prepared(study.point(run)[1])
        except AsrsimError as error:
            first = first or error
            continue
        prepared.make_engine().close()
        return prepared
    assert first is not None
    raise first


def _common(study: Study, case: Case, scenario: Scenario) -> dict[str, int]:
    """Substeps for all runs alike, enough for the most demanding; `asrsim run` with these `--set` has the same bits."""
    if case.plan.own_resolution:
        return {}
    most = {"substeps": 0, "motor_substeps": 0}
    for run in extreme_runs(study, case.variant):
        try:
            prepared = case.prepared(study.point(run)[1])
        except AsrsimError:
            # Such a run becomes a row that says so.
            continue
        prepared.make_engine().close()
        if prepared.stepping.released:
            return {}
        most = {name: max(value, getattr(prepared.resolution, name)) for name, value in most.items()}
    wanted = {"substeps": scenario.substeps, "motor_substeps": scenario.motor_substeps}
    return {name: value for name, value in most.items() if value and wanted[name] is None}
