"""`asrsim bench` in toolbox stepping gives what the released code gave, to the last digits."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from asrsim.cli.app import app

ACTUATORS = ("sea", "qbmove", "bavs", "awas")
COLUMNS = {
    "q": "position", "dq": "velocity", "ref1": "reference_1", "ref2": "reference_2", "joint_force": "link_torque",
    "tau_el1": "elastic_torque_1", "tau_el2": "elastic_torque_2", "stiffness": "stiffness",
    "mot1_pos": "motor_1_position", "mot1_vel": "motor_1_velocity", "mot1_effort": "motor_1_effort",
    "mot2_pos": "motor_2_position", "mot2_vel": "motor_2_velocity", "mot2_effort": "motor_2_effort",
}  # fmt: skip

URDF = """<robot name="bench"><link name="base"/><link name="link"><inertial><mass value="1"/>
<inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="joint" type="revolute"><parent link="base"/><child link="link"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="300" velocity="100"/></joint>
<gazebo><plugin name="p" filename="{plugin}"><joint>joint</joint><operation_mode>{mode}</operation_mode>
<pub_eltau>true</pub_eltau><pub_state>true</pub_state><sub_ext_tau>false</sub_ext_tau>{tags}</plugin></gazebo></robot>"""


def run_case(folder: Path, case: dict, table: np.ndarray, columns: list[str]) -> dict[str, np.ndarray]:
    tags = "".join(f"<{tag}>{value!r}</{tag}>" for tag, value in case["tags"].items())
    (folder / "robot.urdf").write_text(URDF.format(plugin=case["plugin"], mode=case["mode"], tags=tags))
    with (folder / "motion.csv").open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(["time", "joint.position", "joint.velocity", "joint.reference_1", "joint.reference_2"])
        writer.writerows([[repr(float(x)) for x in row[:5]] for row in table])
    arguments = ["bench", str(folder / "robot.urdf"), str(folder / "motion.csv"), "-o", str(folder / "out.csv")]
    if case["t_start"]:
        arguments += ["--first-step", repr(case["t_start"] + case["dT"])]
    result = CliRunner().invoke(app, [*arguments, "--stepping", "toolbox"], catch_exceptions=False)
    assert result.exit_code == 0
    with (folder / "out.csv").open() as stream:
        rows = list(csv.reader(stream))
    values = np.array([[float(cell) for cell in row] for row in rows[1:]])
    return dict(zip(rows[0], values.T, strict=True))


@pytest.mark.parametrize("actuator", ACTUATORS)
def test_toolbox_stepping_gives_the_released_codes_numbers(actuator: str, shared: Path, tmp_path: Path) -> None:
    description = json.loads((shared / "data/oracle.json").read_text())
    cases = [case for case in description["cases"] if case["key"].startswith(actuator)]
    assert cases
    with np.load(shared / "data/oracle.npz") as tables:
        for case in cases:
            table = tables[case["key"]]
            compare_case(case, table, description["columns"], run_case(tmp_path, case, table, description["columns"]))


def compare_case(case: dict, table: np.ndarray, recorded: list[str], out: dict[str, np.ndarray]) -> None:
    for name, column in COLUMNS.items():
        if name in case["undefined_columns"]:
            continue
        expected, got = table[:, recorded.index(name)], out[f"joint.{column}"]
        assert np.array_equal(np.isnan(expected), np.isnan(got)), column
        valid = ~np.isnan(expected)
        if not valid.any():
            continue
        # Sums that cancel are judged by their larger term.
        scale = np.maximum(np.abs(expected[valid]), 1e-3 * np.max(np.abs(expected[valid])))
        worst = np.max(np.abs(got[valid] - expected[valid]) / np.where(scale > 0, scale, math.inf))
        assert worst <= 1e-12, f"{case['key']}, {column}: {worst:.2e}"


def test_the_bench_draws_beside_its_table(tmp_path: Path, asrsim_command):
    (tmp_path / "robot.urdf").write_text(URDF.format(plugin="libsea_plugin.so", mode=5, tags=""))
    (tmp_path / "motion.csv").write_text("time,joint.position,joint.velocity\n0,0,0\n0.001,0.001,1\n0.002,0.002,1\n")
    files = ("bench", tmp_path / "robot.urdf", tmp_path / "motion.csv", "-o", tmp_path / "out.csv")
    assert asrsim_command(*files, "--no-plot").code == 0
    assert not (tmp_path / "out.png").exists()
    assert asrsim_command(*files).code == 0
    assert (tmp_path / "out.png").read_bytes().startswith(b"\x89PNG")
