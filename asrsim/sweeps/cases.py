"""Prepares a study for the workers: reads its scenarios, loads their robots, and plans how each key is set and which columns
the rows have. The prepared study can be pickled.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.document.kinds import key_at
from asrsim.errors import AsrsimError, InputError
from asrsim.metrics import JointSummary
from asrsim.quantities import LIMITS, linear_unit
from asrsim.robot.model import Robot
from asrsim.robot.vary import varied_robot
from asrsim.samples import JointInfo
from asrsim.scenario import Scenario
from asrsim.scenario.data import SCENARIO
from asrsim.scenario.load import scenario_from_data
from asrsim.scenario.overrides import split_path
from asrsim.simulation.examine import Plan, examine_all
from asrsim.simulation.prepare import prepare
from asrsim.simulation.prepared import Prepared
from asrsim.summary.claims import claim_titles, claim_units
from asrsim.sweeps.keys import KeyPlan, plan_keys
from asrsim.sweeps.study import Study

MEASURES = tuple(field.name for field in fields(JointSummary))
UNITS = {
    **dict.fromkeys(("steady_state", "steady_state_error", "peak_deflection", "motion_left"), "rad"),
    "settling": "s",
    "frequency": "Hz",
}
"""Unit of each measure."""
TIP = ("largest", "rms", "last")
PROBES = 4096
"""Largest number of runs of a variant that are searched for extreme values of the varied keys."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """Variant of the scenario, with its robot and the plan of how each varied key is set."""

    name: str
    variant: str
    resolved: Mapping[str, Any]
    base_dir: Path
    files: Mapping[str, Path]
    robot: Robot
    """Robot with the values in its file, without the varied values."""
    plan: KeyPlan
    substeps: Mapping[str, int]
    """`substeps` and `motor_substeps` of every run; a missing number is in the scenario or is determined by each run."""
    joints: tuple[JointInfo, ...]
    claims: tuple[str, ...]
    """Titles of the claims."""
    claim_units: tuple[str, ...]
    """Units of the measured numbers of the claims."""

    def scenario(self, settings: Mapping[str, Any]) -> Scenario:
        """The variant's scenario with these settings, given as value by `--set` key. Raises ScenarioError."""
        return scenario_from_data(
            self.resolved,
            base_dir=self.base_dir,
            files=self.files,
            name=self.name,
            variant=self.variant,
            overrides={**settings, **self.substeps},
        )

    def robot_of(self, values: Mapping[str, Any]) -> Robot | None:
        """Robot with the parameter values of a run; None if the run needs another robot file."""
        if self.plan.reads_robot:
            return None
        changes = self.plan.changes(values, robot_only=True)
        return varied_robot(self.robot, changes) if changes else self.robot

    def prepared(self, values: Mapping[str, Any]) -> Prepared:
        """Scenario prepared with a run's values of the varied keys. Raises AsrsimError."""
        return prepare(self.scenario(self.plan.settings(values)), self.robot_of(values))


@dataclass(frozen=True, kw_only=True)
class Payload:
    """Study prepared for the workers; every worker receives a copy."""

    study: Study
    cases: Mapping[str, Case]
    columns: tuple[tuple[str, str, str], ...]
    """Name, kind and unit of each column; kinds are int, float, bool and text."""

    @cached_property
    def kinds(self) -> dict[str, str]:
        """Kind of each column's cells."""
        return {name: kind for name, kind, _ in self.columns}


def make_payload(study: Study) -> Payload:
    """Study checked and prepared for the workers. Raises InputError or SimulationError if no run of the study can succeed."""
    plans = examine_all(study.scenario, variants=study.variants, overrides=study.overrides, plugins=study.plugins)
    study = replace(study, variants=tuple(plan.scenario.variant for plan in plans))
    numeric = {key: _is_numeric(study, key) for key in study.keys}
    cases = {plan.scenario.variant: _case(study, plan, numeric) for plan in plans}
    task = any(plan.scenario.task is not None for plan in plans)
    return Payload(study=study, cases=cases, columns=tuple(_columns(study, cases, numeric, task=task)))


def _is_numeric(study: Study, key: str) -> bool:
    for axis, law in study.listed:
        if key in axis.keys:
            values = [axis.assign(value)[key] for value in law.values]
            return all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
    return True


def _case(study: Study, plan: Plan, numeric: Mapping[str, bool]) -> Case:
    scenario = plan.scenario
    case = Case(
        name=scenario.name,
        variant=scenario.variant,
        resolved=scenario.resolved,
        base_dir=study.scenario.parent.absolute(),
        files=scenario.attachments,
        robot=plan.source,
        plan=plan_keys(study.keys, numeric, scenario, plan.robot),
        substeps={},
        joints=(),
        claims=(),
        claim_units=(),
    )
    probed, substeps = _probe(study, case)
    return replace(
        case,
        substeps={name: value for name, value in substeps.items() if getattr(scenario, name) is None},
        joints=probed.info.joints,
        claims=tuple(claim_titles(probed.scenario.expect, probed.info.joints)),
        claim_units=tuple(claim_units(probed.scenario.expect, probed.info.joints)),
    )


def _probe(study: Study, case: Case) -> tuple[Prepared, dict[str, int]]:
    """Prepared scenario of the first run that can be prepared, and the numbers of substeps that all runs use.

    `substeps` and `motor_substeps` are the largest numbers that any run with an extreme value of a varied key needs. With these
    numbers, `asrsim run` repeats every run of the study bit for bit. If each run determines its own numbers of substeps, no
    numbers are returned. If no run can be prepared, raises the error of the first run.
    """
    found: Prepared | None = None
    first: AsrsimError | None = None
    substeps: dict[str, int] = {}
    for run in extreme_runs(study, case.variant):
        try:
            prepared = case.prepared(study.point(run)[1])
        except AsrsimError as error:
            # Continue with the next run, since the row of this run will report the error.
            first = first or error
            continue
        prepared.make_engine().close()
        found = found or prepared
        if case.plan.own_resolution or prepared.stepping.released:
            return found, {}
        for name in ("substeps", "motor_substeps"):
            substeps[name] = max(substeps.get(name, 0), getattr(prepared.resolution, name))
    if found is None:
        raise first or InputError("the study has no runs", code="sweep-empty")
    return found, substeps


def extreme_runs(study: Study, variant: str) -> list[int]:
    """Indices of a variant's runs with the smallest or largest value of a varied key, and of a few runs in between.

    For a key whose values are not all numbers, the result contains runs with up to 20 different values. At most `PROBES` runs
    are searched.
    """
    per = len(study) // max(1, len(study.variants))
    first = per * study.variants.index(variant)
    runs = np.unique(np.linspace(first, first + per - 1, min(per, PROBES)).round().astype(np.int64)).tolist()
    chosen = [runs[0], runs[-1], *runs[:: max(1, len(runs) // 4)]]
    points = [study.point(run)[1] for run in runs]
    for key in study.keys:
        values = [point[key] for point in points]
        if all(isinstance(value, int | float) for value in values):
            places = [int(np.argmin(values)), int(np.argmax(values))]
        else:
            places = np.unique([repr(value) for value in values], return_index=True)[1][:20].tolist()
        chosen += [runs[place] for place in places]
    return list(dict.fromkeys(chosen))


def _columns(
    study: Study, cases: Mapping[str, Case], numeric: Mapping[str, bool], *, task: bool
) -> Iterator[tuple[str, str, str]]:
    joints = {joint.name: joint for case in cases.values() for joint in case.joints}
    yield from (("run", "int", ""), ("variant", "text", ""))
    for key in study.keys:
        yield key, "float" if numeric[key] else "text", _unit(key, next(iter(cases.values())))
    yield from (("status", "text", ""), ("reason", "text", ""), ("ok", "bool", ""), ("claims_met", "float", ""))
    for joint in joints.values():
        for name in MEASURES:
            unit = UNITS.get(name, "")
            yield f"{joint.name}.{name}", "float", linear_unit(unit) if joint.prismatic else unit
        yield from ((f"{joint.name}.{name}_count", "int", "") for name in LIMITS)
    yield from ((f"tip.{name}", "float", "m") for name in TIP if task)
    for index in range(max(len(case.claims) for case in cases.values())):
        units = {unit for case in cases.values() for unit in case.claim_units[index : index + 1]}
        # If the claims of variants differ, their numbers may have different units.
        unit = units.pop() if len(units) == 1 else ""
        yield from ((f"claim_{index}", "bool", ""), (f"claim_{index}.measured", "float", unit))
    yield from (("warnings", "text", ""), ("substeps", "int", ""), ("motor_substeps", "int", ""))
    yield from (("simulated_time", "float", "s"), ("seconds", "float", "s"))


def _unit(key: str, case: Case) -> str:
    """Unit of a varied key, which sets a number of the robot or a number in the scenario."""
    # Import `parameters_of` here and not at the top, since workers import this module and do not call `_unit`.
    from asrsim.identification.parameters import parameters_of

    numbers = parameters_of(case.robot, (), {})
    for owner, name in case.plan.numbers.get(key, ()):
        if f"{owner}.{name}" in numbers:
            return numbers[f"{owner}.{name}"].unit
    path = split_path(key)
    unit = str(getattr(key_at(SCENARIO, path), "unit", ""))
    return linear_unit(unit) if any(joint.prismatic and joint.name in path for joint in case.joints) else unit
