"""Checks of the toolbox stepping against recorded outputs of the released toolbox's plugin classes."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from asrsim.samples import Array
from validation.check import DATA, Check
from validation.models import read
from validation.toolbox_rows import toolbox_rows

COLUMNS = {
    "joint_force": "link_torque", "tau_el1": "elastic_torque_1", "tau_el2": "elastic_torque_2", "stiffness": "stiffness",
    "mot1_pos": "motor_1_position", "mot1_vel": "motor_1_velocity", "mot1_effort": "motor_1_effort",
    "mot2_pos": "motor_2_position", "mot2_vel": "motor_2_velocity", "mot2_effort": "motor_2_effort",
}  # fmt: skip
"""Names of asrsim's quantities by recorded column."""
URDF = """<robot name="bench"><link name="base"/><link name="link"><inertial><mass value="1"/>
<inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="joint" type="continuous"><parent link="base"/><child link="link"/><axis xyz="0 0 1"/></joint>
<gazebo><plugin name="p" filename="{plugin}"><joint>joint</joint><operation_mode>{mode}</operation_mode>
<pub_eltau>true</pub_eltau><pub_state>true</pub_state><sub_ext_tau>false</sub_ext_tau>{tags}</plugin></gazebo></robot>"""


def oracle() -> Iterator[Check]:
    """Errors of all defined columns of all recorded cases, by actuator and mode."""
    description = json.loads((DATA / "oracle.json").read_text(encoding="utf-8"))
    worst: dict[tuple[str, int], list[float]] = {}
    with np.load(DATA / "oracle.npz") as tables:
        for case in description["cases"]:
            figure = distance(case, tables[case["key"]], description["columns"])
            worst.setdefault((case["plugin"].removeprefix("lib").removesuffix("_plugin.so"), case["mode"]), []).append(figure)
    for (actuator, mode), figures in worst.items():
        name = f"outputs of {actuator}, mode {mode}, {len(figures)} recorded cases"
        yield Check(name=name, figure=max(figures), bound=1e-12, source="oracle.npz, relative error")


def distance(case: Mapping[str, Any], table: Array, columns: list[str]) -> float:
    """Largest relative error of a case. For sums that cancel, the error is relative to the larger term."""
    tags = "".join(f"<{tag}>{value!r}</{tag}>" for tag, value in case["tags"].items())
    robot = read(URDF.format(plugin=case["plugin"], mode=case["mode"], tags=tags))
    found = toolbox_rows(robot, table[:, 1:5], case["dT"], case["t_start"] + case["dT"])
    worst = 0.0
    for name, ours in COLUMNS.items():
        if name in case["undefined_columns"]:
            continue
        expected = table[:, columns.index(name)]
        valid = ~np.isnan(expected)
        if not np.array_equal(valid, ~np.isnan(found[ours])):
            return float("inf")
        size = np.abs(expected[valid])
        if size.size and size.max() > 0.0:
            error = np.abs(found[ours][valid] - expected[valid]) / np.maximum(size, 1e-3 * size.max())
            worst = max(worst, float(error.max()))
    return worst
