"""Ranges for domain randomisation: the intervals of a fit as values of fields of the MuJoCo model."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.outfile import write_text
from asrsim.simulation.prepared import Prepared
from asrsim.sweeps.fitted import JointDistribution

FIELDS = {
    "body": ("body_mass", "body_inertia", "body_ipos", "body_iquat"),
    "dof": ("dof_armature", "dof_damping", "dof_frictionloss"),
    "joint": ("jnt_range", "jnt_stiffness"),
    "tendon": ("tendon_stiffness", "tendon_stiffnesspoly", "tendon_lengthspring"),
    "actuator": ("actuator_gainprm", "actuator_biasprm", "actuator_dynprm", "actuator_forcerange"),
}
"""Fields of MjModel whose values change with the parameters, by the kind of element that each row describes."""
WIDTH = 1.96
"""Half-width of a 95 % interval of a normal distribution, in standard deviations."""
HEADING = """\
# Ranges by asrsim export: 95 % intervals of {}, each with the other parameters at their estimates.
# fields: fields of MjModel, by element: values at `low` and at `high`; between them the fields are nearly linear.
# Draw one number from 0 to 1 for each parameter, and use it for all of its fields.
"""


def own_numbers(prepared: Prepared, values: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """Values of the robot's parameters, by joint or link and by name; other keys of a fit are left out."""
    owners = {joint.name for joint in prepared.robot.joints} | {link.name for link in prepared.robot.links}
    found: dict[str, dict[str, float]] = {}
    for key, value in values.items():
        owner, _, name = key.rpartition(".")
        if owner in owners:
            found.setdefault(owner, {})[name] = value
    return found


def write_ranges(fit: JointDistribution, compiled: Callable[[dict[str, float]], Any], path: Path, source: Path) -> Path:
    """Write the 95 % intervals of a fit as ranges of fields of the model at `path`. Returns the path of the written file.

    compiled: function that returns the MjModel for other values of the robot's parameters; all models have equal numbers of
    knots. source: file of the fit. Raises OutputError.
    """
    import yaml

    ranges: dict[str, Any] = {}
    rows = fit.interval(WIDTH)
    for i, key in enumerate(fit.keys):
        ends = [float(row[i]) for row in rows]
        models = [compiled({name: value for name, value in fit.assign(row).items() if name in fit.groups[i]}) for row in rows]
        model = models[0]
        fields: dict[str, dict[str, list[Any]]] = {}
        for kind, names in FIELDS.items():
            for field in names:
                below, above = (getattr(each, field) for each in models)
                for row in np.flatnonzero((below != above).reshape(len(below), -1).any(axis=1)).tolist():
                    element = model.joint(int(model.dof_jntid[row])) if kind == "dof" else getattr(model, kind)(row)
                    fields.setdefault(field, {})[element.name] = [below[row].tolist(), above[row].tolist()]
        ranges[key] = {"low": ends[0], "high": ends[1], "fields": fields}
    target = path.with_suffix(".ranges.yaml")
    body = yaml.safe_dump(ranges, sort_keys=False, default_flow_style=None, allow_unicode=True)
    write_text(target, HEADING.format(source.name) + body, "ranges")
    return target
