"""Numbers that cannot be true together are said, with their cure, and never changed; those that can be are not mentioned."""

import math
import re

import numpy as np
import pytest

from asrsim.recordings import compare, read_recording
from asrsim.samples import Samples

DEGREES = 180 / math.pi
TIME = np.arange(0.0, 5.0, 0.005)
Q = 0.6 * np.sin(3 * TIME) + 0.2 * np.sin(11 * TIME) + 0.3
V = 1.8 * np.cos(3 * TIME) + 2.2 * np.cos(11 * TIME)
TURNS = np.arange(len(TIME)) % 3
SUSPECTED = {
    "a velocity in degrees": ("q1,dq1", (Q, V * DEGREES), "dq1: is 57.3 times the slope of 'q1'"),
    "headers that lie": ("q1 [deg],dq1 [rad/s]", (Q, V), r"dq1 \[rad/s\]: is 57.3 times the slope of 'q1 \[deg\]'"),
    "rounds a minute": ("q1,dq1", (Q, V * 30 / math.pi), "9.55 times the slope of 'q1'.*9.55: velocity in rpm"),
    "before the gear": ("q1,dq1", (Q, V * 30), "30 times the slope of 'q1'.*gear"),
    "a turned axis": ("q1,dq1", (Q, -V), "is negative where 'q1' rises.*--map 'dq1=-joint_1.link_velocity'"),
    "a motor's": ("q1,motor1_pos,motor1_vel", (Q, Q, V * DEGREES), "motor1_vel: is 57.3 times the slope of 'motor1_pos'"),
    "a mark for no value": ("q1", (np.where(TIME % 1 < 0.2, -9999.0, Q),), "q1: is -9999 in 201 samples.*`missing: -9999`"),
    "a mark in degrees": (
        "q1 [deg]",
        (np.where(TIME < 0.01, 999.0, Q * DEGREES),),
        "is 999 in 2 samples, the first at t = 0 s",
    ),
    "lost samples": ("q1", (np.where(TIME % 1 < 0.01, 0.0, Q + 1.0),), "falls to exactly 0 and back 4 times.*`missing: 0`"),
    "rows of three joints": ("q1", (Q + TURNS,), "do the samples alternate between 3 joints.*joint: name"),
}
"""Header, columns behind the time, and what is said."""
NOISE = np.random.default_rng(0).normal(size=(2, len(TIME)))
FINE = {
    "what was measured": ("q1,dq1", (Q + 0.002 * NOISE[0], V + 0.3 * NOISE[1] + 0.05)),
    "a slow filter": ("q1,dq1", (Q, np.convolve(V, np.ones(9) / 9, "same"))),
    "numbers missing": ("q1,dq1", (np.where(TIME % 1 < 0.2, np.nan, Q), V)),
    "units that are stated": ("q1 [deg],dq1 [deg/s]", (Q * DEGREES, V * DEGREES)),
    "a link at rest": ("q1,dq1", (0 * Q + 0.3, V)),
    "a motor that moves for itself": ("q1,dq1,theta_m1", (Q, V, DEGREES * Q)),
    "an angle that jumps by turns": ("q1,dq1", ((9 * Q) % math.tau, 9 * V)),
    "an angle through zero": ("q1", (np.round(Q, 1),)),
    "a speed in steps": ("dq1", (np.where(np.arange(len(TIME)) % 3, 0.0, 0.31),)),
    "a torque of contacts": ("tau1", (np.where(TIME % 1 < 0.5, 5.0 + 0.1 * NOISE[0], 0.0),)),
    "a sensor at rest": ("q1", (0.001 * TURNS,)),
    "a few samples": ("q1,dq1", (Q[:15], 50 * V[:15])),
}


def read(folder, header, columns, **options):
    table = np.column_stack([TIME[: len(columns[0])], *columns])
    np.savetxt(folder / "lab.csv", table, delimiter=",", header=f"t,{header}", comments="", fmt="%.12g")
    return read_recording(folder / "lab.csv", joints=("joint_1",), **options)


@pytest.mark.parametrize("kind", SUSPECTED)
def test_columns_that_cannot_be_true_together_are_said(tmp_path, kind):
    header, columns, words = SUSPECTED[kind]
    (said,) = [str(one) for one in read(tmp_path, header, columns).findings if one.code.startswith("suspected-")]
    assert re.search(words, said)


@pytest.mark.parametrize("kind", FINE)
def test_columns_that_can_be_true_together_are_not_mentioned(tmp_path, kind):
    assert not [one for one in read(tmp_path, *FINE[kind]).findings if one.code.startswith("suspected-")]


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1.1 * DEGREES, "in degrees"),
        (900.0, "in thousandths"),
        (1.1 / DEGREES, "from degrees"),
        (0.001, "from thousandths"),
        *((factor, None) for factor in (1.0, 0.5, 3.0, 10.0, 36.0, 43.0, 75.0, 200.0, 600.0, 1600.0)),
    ],
)
def test_only_factors_of_units_are_suspected(tmp_path, factor, words):
    samples = Samples(time=TIME, joints=("joint_1",), values={"link_position": Q[:, None]})
    found = compare(samples, read(tmp_path, "q1", (factor * Q,)), lag="off").findings
    assert [(one.key, str(words) in one.message) for one in found] == [("joint_1.link_position", True)] * (words is not None)


@pytest.mark.parametrize("bits", [8, 16, 32])
def test_negative_numbers_read_without_their_sign_are_suspected(tmp_path, bits):
    counts = np.round(3 * np.sin(20 * TIME)).astype(int) % 2**bits
    recording = read(tmp_path, "q1", (counts,), mapping=["q1=0.01*joint_1.link_position [rad]"])
    (said,) = (one for one in recording.findings if one.code == "unsigned")
    jumps = np.abs(np.diff(counts)) > 2 ** (bits - 1)
    assert said.key == "q1"
    assert said.message.startswith(f"jumps by {2**bits:.6g} {jumps.sum()} times, first at t = {TIME[1:][jumps][0]:.6g} s: ")
    assert f"subtract {2**bits} from all numbers above {2 ** (bits - 1)}" in said.hint
    np.testing.assert_allclose(recording.column("joint_1", "link_position").values, 0.01 * counts)


@pytest.mark.parametrize(
    ("header", "restart", "factor", "gear"),
    [
        ("q1", math.tau, 1.0, 1.0),
        ("q1 [deg]", 360.0, math.radians(1.0), 0.02),  # the encoder of a motor before its gear
        ("enc", 4096.0, math.tau / 4096, 1.0),
        ("enc", 4096.0, math.tau / 4096, 0.02),
        ("enc", 65536.0, 0.0001, 1.0),
    ],
)
def test_a_sensor_that_restarts_is_suspected_and_can_be_unwrapped(tmp_path, header, restart, factor, gear):
    """factor: from the numbers of the file to rad at the sensor; gear: from there to the joint."""
    turned = 9 * (Q - Q[0])
    scale = gear if "q1" in header else gear * factor
    item = f"{header}={scale:.10g}*joint_1.link_position"
    recording = read(tmp_path, header, (np.mod(turned / factor + 0.3 * restart, restart),), mapping=[item])
    (finding,) = (one for one in recording.findings if one.code == "wrapped")
    cure = re.search("--map '(.*)'", str(finding.hint))[1]
    for unwrapped in [cure] + [f"{item} unwrapped"] * (header != "enc"):
        values = read_recording(recording.path, mapping=[unwrapped]).column("joint_1", "link_position").values
        np.testing.assert_allclose(values - values[0], gear * turned, atol=0.002 * gear * restart * factor)


def test_an_outlier_does_not_keep_an_angle_wrapped(tmp_path):
    wrapped = np.where(np.arange(len(TIME)) == 7, 1e3, (9 * Q) % math.tau)
    recording = read(tmp_path, "q1", (wrapped,), mapping=["q1=-joint_1.link_position unwrapped"])
    values = recording.column("joint_1", "link_position").values[8:]
    np.testing.assert_allclose(values - values[0], -9 * (Q[8:] - Q[8]), atol=1e-6)


def test_a_number_stated_as_missing_is_no_number(tmp_path):
    values = np.where(np.isin(np.arange(len(TIME)), [5, 6, 20]), -999.0, Q)
    (tmp_path / "lab.csv.yaml").write_text("missing: -999\n")
    stated = read(tmp_path, "q1", (values,)).channels["q1"].values
    assert np.flatnonzero(np.isnan(stated)).tolist() == [5, 6, 20]


def test_constant_columns_and_missing_numbers_are_said(tmp_path):
    recording = read(tmp_path, "q1,dq1", (np.where((TIME >= 1.0) & (TIME < 1.05), np.nan, Q), 0 * V + 4.0))
    said = {one.code: one for one in recording.findings}
    assert said["missing-numbers"].message == "10 of 1000 samples have no number, the first at t = 1 s"
    assert said["constant-column"].key == "dq1"


@pytest.mark.parametrize(
    ("header", "item", "told"),
    [
        ("tau1 [cNm]", "2=joint_1.link_torque", True),
        ("tau1 [cNm]", "2=0.01*joint_1.link_torque", False),
        ("tau1 [cNm]", "2=joint_1.link_torque [N m]", False),
        ("q [1]", "2=joint_1.link_position", False),
    ],
)
def test_an_unknown_unit_in_the_header_of_a_mapped_column_is_said(tmp_path, header, item, told):
    said = [one for one in read(tmp_path, header, (Q,), mapping=[item]).findings if one.code == "suspected-unit"]
    assert bool(said) == told
