"""A run of a study done again, with its log."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from asrsim.actuators.user import check_named
from asrsim.errors import InputError
from asrsim.runs.execute import execute, write_summary
from asrsim.runs.lock import owned
from asrsim.summary import RunSummary
from asrsim.sweeps.cases import make_payload
from asrsim.sweeps.laws import Values
from asrsim.sweeps.study import Axis, Study
from asrsim.sweeps.table import Table


def run_again(table: Table, run: int, folder: Path, plugins: Sequence[Path | str] = ()) -> RunSummary:
    """Do a run of a finished row again, with log and summary in `folder`; plugins: files of users' actuators that it may run.
    Raises InputError where there is no such row.
    """
    wanted = tuple(Path(path) for path in table.manifest["plugins"])
    check_named(wanted, plugins, file=table.folder)
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
        plugins=wanted,
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
