"""The released toolbox's own plugin classes, recorded step by step, against the toolbox stepping."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.simulation.drives import make_drives
from asrsim.simulation.joint import advance
from asrsim.simulation.laws import plain_law
from asrsim.simulation.layout import (
    DRIVE_TORQUE,
    JOINT_STEP,
    KICK_POSITION,
    LAGGING,
    LOAD,
    MEAN_VELOCITY,
    MOTOR_POSITION,
    OWN,
    PER_MOTOR,
    POSITION,
    SPRING_LAW,
    TORQUE,
)
from asrsim.simulation.rows import positions_of, shape_of, start_of, tables
from asrsim.simulation.steppings import STEPPINGS
from validation.check import DATA, Check
from validation.models import read

COLUMNS = {
    "joint_force": "link_torque", "tau_el1": "elastic_torque_1", "tau_el2": "elastic_torque_2", "stiffness": "stiffness",
    "mot1_pos": "motor_1_position", "mot1_vel": "motor_1_velocity", "mot1_effort": "motor_1_effort",
    "mot2_pos": "motor_2_position", "mot2_vel": "motor_2_velocity", "mot2_effort": "motor_2_effort",
}  # fmt: skip
"""Recorded column -> ours."""
URDF = """<robot name="bench"><link name="base"/><link name="link"><inertial><mass value="1"/>
<inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="joint" type="continuous"><parent link="base"/><child link="link"/><axis xyz="0 0 1"/></joint>
<gazebo><plugin name="p" filename="{plugin}"><joint>joint</joint><operation_mode>{mode}</operation_mode>
<pub_eltau>true</pub_eltau><pub_state>true</pub_state><sub_ext_tau>false</sub_ext_tau>{tags}</plugin></gazebo></robot>"""


def oracle() -> Iterator[Check]:
    """Every defined column of every recorded case, by actuator and mode."""
    description = json.loads((DATA / "oracle.json").read_text(encoding="utf-8"))
    worst: dict[tuple[str, int], list[float]] = {}
    with np.load(DATA / "oracle.npz") as tables:
        for case in description["cases"]:
            figure = distance(case, tables[case["key"]], description["columns"])
            worst.setdefault((case["plugin"].removeprefix("lib").removesuffix("_plugin.so"), case["mode"]), []).append(figure)
    for (actuator, mode), figures in worst.items():
        name = f"{actuator}, mode {mode}, {len(figures)} recorded cases"
        yield Check(name=name, figure=max(figures), bound=1e-12, source="oracle.npz, relative error")


def distance(case: Mapping[str, Any], table: Array, columns: list[str]) -> float:
    """Largest relative error of a case; sums that cancel are judged by their larger term."""
    tags = "".join(f"<{tag}>{value!r}</{tag}>" for tag, value in case["tags"].items())
    robot = read(URDF.format(plugin=case["plugin"], mode=case["mode"], tags=tags))
    time, position, velocity, first, second = table[:, :5].T
    # The first step is as long as the second, or the whole time before a late start.
    first_step = case["t_start"] + case["dT"] if case["t_start"] else case["dT"]
    steps = [first_step, *[case["dT"]] * (len(time) - 1)]
    found = _driven(robot, steps, position.tolist(), velocity.tolist(), np.array([first, second]))
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


def _driven(robot: Robot, steps: list[float], places: list[float], speeds: list[float], references: Array) -> dict[str, Array]:
    """Columns of :data:`COLUMNS` of the only joint, whose link is moved row by row, as the released code publishes them."""
    stepping = STEPPINGS.get("toolbox")
    (drive,) = make_drives(robot, stepping, initial_positions={}, link_damping={})
    shape = shape_of([drive], [None])
    kinds, constants = tables([drive], [None], shape, motor_substeps=1, cutoff=False)
    k: list[Any] = kinds[0].tolist()
    k[JOINT_STEP] = stepping.joint_step
    actuator: Any = drive.actuator
    mode: Any = drive.mode
    springs = mode is not None and mode.spring
    if springs:
        k[SPRING_LAW] = plain_law(actuator, positions_of(drive))
    p, s = constants[0].tolist(), start_of(drive, None, shape, drive.initial_position, 0.0)
    rows = []
    for step, q, v, goals in zip(steps, places, speeds, drive.goals(references).T.tolist(), strict=True):
        s[POSITION], s[LAGGING] = q, v
        before = [s[OWN + i * PER_MOTOR + MOTOR_POSITION] for i in range(2)]
        advance(s, p, k, (step, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0), [0.0, *goals], step, DRIVE_TORQUE, False)
        if not springs:
            rows.append([s[TORQUE], np.nan, np.nan, np.nan, *[0.0] * 6])
            continue
        load, place, speed, torque = (
            [s[OWN + i * PER_MOTOR + column] for i in range(2)] for column in (LOAD, KICK_POSITION, MEAN_VELOCITY, DRIVE_TORQUE)
        )
        # In mode 4 stiffness is that of the motors' old positions; ideal motors are published as 0.
        stiffness = actuator.stiffness(q, *(before if mode.number == 4 else place), drive.elastic)
        place = place if mode.motor else [0.0, 0.0]
        rows.append([s[TORQUE], *load, stiffness, place[0], speed[0], torque[0], place[1], speed[1], torque[1]])
    return dict(zip(COLUMNS.values(), np.array(rows).T, strict=True))
