"""Ranges for domain randomisation: the intervals of a fit as fields of the MuJoCo model."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.outfile import write_text
from asrsim.simulation.prepared import Prepared
from asrsim.sweeps.fitted import Joint as Fit

FIELDS = {
    "body": ("body_mass", "body_inertia", "body_ipos", "body_iquat"),
    "dof": ("dof_armature", "dof_damping", "dof_frictionloss"),
    "joint": ("jnt_range", "jnt_stiffness"),
    "tendon": ("tendon_stiffness", "tendon_stiffnesspoly", "tendon_lengthspring"),
    "actuator": ("actuator_gainprm", "actuator_biasprm", "actuator_forcerange"),
}
"""Fields of MjModel with one row per element, by kind of element."""
WIDTH = 1.96
"""Half-width of a 95 % interval, in standard deviations."""
HEADING = """\
# Ranges by asrsim export: 95 % intervals of {}, each with the other parameters at their best values.
# fields: fields of MjModel, by element: values at `low` and at `high`; between them the fields are nearly linear.
# Draw one number from 0 to 1 for each parameter, and use it for all of its fields.
"""


def robot_numbers(prepared: Prepared, values: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """Values of the robot's parameters, by joint or link and by name."""
    owners = {*(joint.name for joint in prepared.robot.joints), *(link.name for link in prepared.robot.links)}
    found: dict[str, dict[str, float]] = {}
    for key, value in values.items():
        owner, _, name = key.rpartition(".")
        if owner in owners:
            found.setdefault(owner, {})[name] = value
    return found


def mean_of(fit: Fit) -> dict[str, float]:
    """Estimates of the fit, by key."""
    return fit.assign(fit.from_scores(np.zeros((1, len(fit.keys))))[0])


def write_ranges(prepared: Prepared, fit: Fit, text_of: Callable[[Prepared], str], path: Path, source: Path) -> Path:
    """Write the ranges into the folder of the model at `path`, and return the path of the written file. text_of: function that
    returns the MJCF of the scenario with other parameter values and equal numbers of knots; source: file of the fit. Raises
    OutputError.
    """
    import mujoco
    import yaml

    def compiled(values: dict[str, float]) -> Any:
        spec = mujoco.MjSpec.from_string(text_of(prepared.vary(robot_numbers(prepared, values))))
        # The meshes are in the folder of the model.
        spec.modelfiledir = str(path.parent.absolute())
        return spec.compile()

    widths = WIDTH * np.linalg.norm(fit.root, axis=1)
    ranges: dict[str, Any] = {}
    for i, key in enumerate(fit.keys):
        ends = []
        for sign in (-1.0, 1.0):
            row = fit.mean.copy()
            row[i] += sign * widths[i]
            value = float(np.clip(np.exp(row[i]) if fit.logarithmic[i] else row[i], fit.low[i], fit.high[i]))
            ties = {name: factor * value for name, drawn, factor in fit.ties if drawn == key}
            ends.append((value, compiled({key: value, **ties})))
        (low, below), (high, above) = ends
        ranges[key] = {"low": low, "high": high, "fields": _differences(below, above)}
    target = path.with_suffix(".ranges.yaml")
    body = yaml.safe_dump(ranges, sort_keys=False, default_flow_style=None, allow_unicode=True)
    write_text(target, HEADING.format(source.name) + body, "ranges")
    return target


def _differences(below: Any, above: Any) -> dict[str, dict[str, list[Any]]]:
    """Values that differ between two models: pairs by field and by element."""
    found: dict[str, dict[str, list[Any]]] = {}
    for kind, fields in FIELDS.items():
        for field in fields:
            ours, theirs = getattr(below, field), getattr(above, field)
            for row in np.flatnonzero((ours != theirs).reshape(len(ours), -1).any(axis=1)).tolist():
                element = below.joint(int(below.dof_jntid[row])) if kind == "dof" else getattr(below, kind)(row)
                found.setdefault(field, {})[element.name] = [ours[row].tolist(), theirs[row].tolist()]
    return found
