"""Columns of one recording that cannot be true together are told, whatever their headers say; those that can be are not."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from asrsim.recordings import read_recording
from support.lab_files import table

pytestmark = pytest.mark.once

DEGREES = 180 / math.pi
TIME = np.arange(0.0, 5.0, 0.005)
Q = 0.6 * np.sin(3 * TIME) + 0.2 * np.sin(11 * TIME) + 0.3
V = 1.8 * np.cos(3 * TIME) + 2.2 * np.cos(11 * TIME)
FOLLOWED = np.r_[Q[5:], Q[-5:]]
SUSPECTED = {
    "a velocity in degrees": (
        "q1,dq1",
        (Q, V * DEGREES),
        "dq1: is 57.3 times the slope of 'q1': is 'dq1' in degrees a second.*dq1=.*deg/s",
    ),
    "a position in degrees": ("q1,dq1", (Q * DEGREES, V), "dq1: is 0.0175 times .*: is 'q1' in degrees.*q1=.*deg"),
    "rounds a minute": ("q1,dq1", (Q, V * 30 / math.pi), "9.55 times the slope of 'q1': is 'dq1' in rpm.*rpm"),
    "turns": ("q1,dq1", (Q / math.tau, V), "6.28 times the slope of 'q1': is 'q1' in turns.*rev"),
    "turns a second": ("q1,dq1", (Q, V / math.tau), "0.159 times .*: is 'dq1' in turns a second.*rev/s"),
    "thousandths": ("q1,dq1", (Q, V * 1e3), "1e.03 times .*: is 'dq1' in thousandths"),
    "before the gear": ("q1,dq1", (Q, V * 30), "30 times .*: are both in the units that are assumed, of one side of the gear"),
    "headers that lie": ("q1 [deg],dq1 [rad/s]", (Q, V), r"dq1 \[rad/s\]: is 57.3 times the slope of 'q1 \[deg\]'"),
    "a turned axis": ("q1,dq1", (Q, -V), "goes down where 'q1' rises.*--map 'dq1=-joint_1.link_velocity'"),
    "a motor's": ("q1,motor1_pos,motor1_vel", (Q, Q, V * DEGREES), "motor1_vel: is 57.3 times the slope of 'motor1_pos'"),
    "a command in degrees": ("q1,q1_ref", (Q, FOLLOWED * DEGREES), "q1_ref: is 57.3 times as large as 'q1', which follows it"),
    "a followed one in degrees": ("q1,q1_ref", (Q * DEGREES, FOLLOWED), "q1_ref: is 0.0175 times as large as 'q1'"),
}
"""Header, columns behind the time, and what is said."""
NOISE = np.random.default_rng(0).normal(size=(2, len(TIME)))
FINE = {
    "what was measured": ("q1,dq1", (Q + 0.002 * NOISE[0], V + 0.3 * NOISE[1] + 0.05)),
    "a slow filter": ("q1,dq1", (Q, np.convolve(V, np.ones(9) / 9, "same"))),
    "stretches without": ("q1,dq1", (np.where(TIME % 1 < 0.2, np.nan, Q), V)),
    "units that are stated": ("q1 [deg],dq1 [deg/s],q1_ref [rad]", (Q * DEGREES, V * DEGREES, FOLLOWED)),
    "a link at rest": ("q1,dq1", (0 * Q + 0.3, V)),
    "a motor that moves for itself": ("q1,dq1,theta_m1", (Q, V, DEGREES * Q)),
    "an angle that jumps by turns": ("q1,dq1", ((9 * Q) % math.tau, 9 * V)),
    "a few samples": ("q1,dq1", (Q[:15], 50 * V[:15])),
    "a command that is not followed": ("q1,q1_ref", (Q, DEGREES * np.sign(np.sin(TIME)))),
}


def suspected(path: Path, header: str, columns: tuple[np.ndarray, ...]) -> list[str]:
    path.write_bytes(table([TIME[: len(columns[0])], *columns], before=f"t,{header}\n"))
    recording = read_recording(path, joints=("joint_1",))
    return [str(one) for one in recording.findings if one.code in ("suspected-unit", "suspected-sign")]


@pytest.mark.parametrize("kind", SUSPECTED)
def test_what_cannot_be_true_together_is_told(tmp_path: Path, kind: str) -> None:
    header, columns, words = SUSPECTED[kind]
    (said,) = suspected(tmp_path / "lab.csv", header, columns)
    assert re.search(words, said)


@pytest.mark.parametrize("kind", FINE)
def test_what_can_be_true_together_is_not(tmp_path: Path, kind: str) -> None:
    assert suspected(tmp_path / "lab.csv", *FINE[kind]) == []


def test_columns_on_times_of_their_own_are_held_against_each_other(tmp_path: Path) -> None:
    structs = {"a": {"t": TIME, "q1": Q}, "b": {"t": TIME + 0.002, "dq1": V * DEGREES}}
    savemat(tmp_path / "lab.mat", structs)
    recording = read_recording(tmp_path / "lab.mat", joints=("joint_1",))
    assert [one.key for one in recording.findings if one.code == "suspected-unit"] == ["b.dq1"]


def test_a_spring_is_an_elastic_torque_only_beside_a_torque(tmp_path: Path) -> None:
    (tmp_path / "lab.csv").write_bytes(table([TIME, Q, 2 * Q, 3 * Q], before="t,q1 [rad],spring_1,spring_torque_1 [Nm]\n"))
    recording = read_recording(tmp_path / "lab.csv")
    assert recording.column("joint_1", "elastic_torque_1").source == "spring_torque_1 [Nm]"
    assert recording.channels["spring_1"].quantity != "elastic_torque_1"
