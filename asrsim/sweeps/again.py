"""A run of a study done again, with its log."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from asrsim.errors import InputError
from asrsim.runs.execute import execute, write_summary
from asrsim.runs.lock import owned
from asrsim.summary import RunSummary
from asrsim.sweeps.cases import make_payload
from asrsim.sweeps.laws import Values
from asrsim.sweeps.study import Axis, Study
from asrsim.sweeps.table import Table


def run_again(table: Table, run: int, folder: Path) -> RunSummary:
    """Do a run of a finished row again, with log and summary in `folder`. Raises InputError where there is no such row."""
    places = (table["run"] == run).nonzero()[0]
    if not len(places):
        raise InputError(f"there is no row of run {run}", file=table.folder, code="no-run")
    place, kinds = int(places[0]), table.kinds
    variant = str(table["variant"][place])
    axes = tuple(Axis((key,), Values((_value(table[key][place], kinds[key]),))) for key in table.keys)
    study = Study(
        scenario=Path(table.manifest["scenario"]),
        axes=axes,
        variants=(variant,),
        overrides=tuple(table.manifest["overrides"]),
        plugins=tuple(Path(path) for path in table.manifest["plugins"]),
    )
    case = replace(make_payload(study).cases[variant], substeps=table.manifest["substeps"][variant])
    values = study.point(0)[1]
    with owned(folder):
        executed = execute(case.scenario(case.plan.settings(values)), folder, robot=case.robot_of(values), overwrite=True)
        return write_summary(executed).summary


def _value(value: Any, kind: str) -> Any:
    if kind == "float":
        return float(value)
    try:
        return json.loads(value)
    except ValueError:
        return str(value)
