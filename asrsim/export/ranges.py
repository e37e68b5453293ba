"""Ranges for domain randomisation: what the intervals of a fit are as fields of the MuJoCo model."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.simulation.prepared import Prepared
from asrsim.sweeps.fitted import Joint as Fit

FIELDS = {
    "body_mass": "body", "body_inertia": "body", "body_ipos": "body", "body_iquat": "body", "dof_armature": "dof",
    "dof_damping": "dof", "dof_frictionloss": "dof", "jnt_range": "joint", "jnt_stiffness": "joint",
    "tendon_stiffness": "tendon", "tendon_stiffnesspoly": "tendon", "tendon_lengthspring": "tendon",
    "actuator_gainprm": "actuator", "actuator_biasprm": "actuator", "actuator_forcerange": "actuator",
}  # fmt: skip
"""Field of MjModel -> what its rows belong to."""
WIDTH = 1.96
"""Standard deviations on each side: 95 %."""


def robot_numbers(prepared: Prepared, values: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """Joint or link -> name -> value of those keys that are the robot's."""
    owners = {*(joint.name for joint in prepared.robot.joints), *(link.name for link in prepared.robot.links)}
    found: dict[str, dict[str, float]] = {}
    for key, value in values.items():
        owner, _, name = key.rpartition(".")
        if owner in owners:
            found.setdefault(owner, {})[name] = value
    return found


def mean_of(fit: Fit) -> dict[str, float]:
    """Key -> value that the fit found."""
    return fit.assign(fit.from_scores(np.zeros((1, len(fit.keys))))[0])


def ranges_of(prepared: Prepared, fit: Fit, model_with: Callable[[Prepared], Any]) -> dict[str, Any]:
    """Key -> low, high, and the fields of the model that differ between both ends.

    model_with: compiles the model of a scenario with other numbers, with the same springs' knots.
    """
    widths = WIDTH * np.linalg.norm(fit.root, axis=1)
    found: dict[str, Any] = {}
    for i, key in enumerate(fit.keys):
        ends = []
        for sign in (-1.0, 1.0):
            row = fit.mean.copy()
            row[i] += sign * widths[i]
            value = np.exp(row[i]) if fit.logarithmic[i] else row[i]
            value = float(np.clip(value, fit.low[i], fit.high[i]))
            tied = {name: factor * value for name, to, factor in fit.ties if to == key}
            ends.append((value, model_with(prepared.vary(robot_numbers(prepared, {key: value, **tied})))))
        (low, below), (high, above) = ends
        found[key] = {"low": low, "high": high, "fields": _differences(below, above)}
    return found


def _differences(below: Any, above: Any) -> dict[str, dict[str, list[Any]]]:
    """Field -> element -> its values at both ends."""
    found: dict[str, dict[str, list[Any]]] = {}
    for field, kind in FIELDS.items():
        ours, theirs = getattr(below, field), getattr(above, field)
        for row in np.flatnonzero((ours != theirs).reshape(len(ours), -1).any(axis=1)).tolist():
            found.setdefault(field, {})[_name(below, kind, row)] = [ours[row].tolist(), theirs[row].tolist()]
    return found


def _name(model: Any, kind: str, row: int) -> str:
    if kind == "dof":
        return str(model.joint(int(model.dof_jntid[row])).name)
    return str(getattr(model, kind)(row).name)


def text_of(ranges: Mapping[str, Any], source: Path) -> Iterator[str]:
    """Lines of the file."""
    import yaml

    yield f"# Ranges by asrsim export: 95 % intervals of {source.name}, each with the others at their best values."
    yield "# fields: of MjModel, by element: values at `low` and at `high`, nearly linear between both:"
    yield "# draw one number from 0 to 1 for each parameter, and use it for all its fields."
    yield yaml.safe_dump(dict(ranges), sort_keys=False, default_flow_style=None, allow_unicode=True)
