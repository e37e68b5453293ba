"""What was met in real files of laboratories, each kind in a file of our own making: understood, or refused for its reason."""

from __future__ import annotations

import json
import struct
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lab_files import COUNT, DEGREES, ORDER, TIME, A, B, table, texts

from asrsim.errors import Problem, RecordingError
from asrsim.recordings import Recording, read_recording
from asrsim.recordings.timebase import scale_time

pytestmark = pytest.mark.once

JOINTS = ("joint_1", "joint_2")
SENT = 1_700_000_000_000_000_000 + np.round(TIME * 1e9).astype(np.int64)
GOT = SENT + np.random.default_rng(0).integers(0, 3_000_000, COUNT)
SENT_TEXT = texts(SENT, "%d")
SECONDS, REST = texts(SENT // 10**9, "%d"), texts(SENT % 10**9, "%d")
NONE = [""] * COUNT


def read(folder: Path, content: bytes, name: str = "lab.csv", **options: Any) -> Recording:
    (folder / name).write_bytes(content)
    return read_recording(folder / name, joints=options.pop("joints", JOINTS), **options)


def said(findings: tuple[Problem, ...], code: str) -> str:
    return " ".join(str(one) for one in findings if one.code == code)


def check(recording: Recording, first: str = "joint_1", second: str = "joint_2") -> None:
    """The motion on its time, of the right joints, in rad."""
    for joint, values in ((first, A), (second, B)):
        column = recording.column(joint, "link_position")
        np.testing.assert_allclose(column.time - column.time[0], TIME, atol=1.1e-6)
        np.testing.assert_allclose(column.values, values, atol=1e-6)


LISTS = [f'"[{a:.9f}, {b:.9f}]"' for a, b in zip(A, B, strict=True)]
WORDS = ["\"['joint_2', 'joint_1']\""] * COUNT
UNDERSTOOD: dict[str, tuple[bytes, str, str]] = {
    "an index beside stamps": (
        table([texts(ORDER, "%d"), texts(SENT, "%d"), A, B], before=",stamp,q1,q2\n"), "joint_1", "joint_2",
    ),
    "an index beside two stamps": (
        table([texts(ORDER, "%d"), texts(GOT, "%d"), SECONDS, REST, A, B], before=",rosbagTimestamp,secs,nsecs,q1,q2\n"),
        "joint_1", "joint_2",
    ),
    "rosbag_to_csv": (
        table([texts(GOT, "%d"), NONE, texts(ORDER, "%d"), NONE, SECONDS, REST, ["\"''\""] * COUNT, WORDS, LISTS,
               ["[]"] * COUNT],
              before="rosbagTimestamp,header,seq,stamp,secs,nsecs,frame_id,name,position,velocity\n"), "joint_2", "joint_1",
    ),
    "rostopic echo -p": (
        table([texts(GOT, "%d"), texts(ORDER, "%d"), texts(SENT, "%d"), NONE, ["joint_2"] * COUNT, ["joint_1"] * COUNT, A, B],
              before="%time,field.header.seq,field.header.stamp,field.header.frame_id,field.name0,field.name1,"
              "field.position0,field.position1\n"), "joint_2", "joint_1",
    ),
    "a blank header.stamp": (
        table([NONE, texts(SENT, "%d"), A, B], before="header.stamp,rosbagTimestamp,q1,q2\n"), "joint_1", "joint_2",
    ),
    "a header without the index": (
        table([texts(ORDER, "%d"), TIME, A, B], before="time,q1,q2\n"), "joint_1", "joint_2",
    ),
    "MATLAB's dates": (
        table([[f"06-May-2024 10:00:{t:06.3f}" for t in TIME], A, B], before="Time,q1,q2\n"), "joint_1", "joint_2",
    ),
    "minutes as Excel shows them": (
        table([[f"59:{t:06.3f}" for t in 50 + TIME], A, B], before="Time,q1,q2\n"), "joint_1", "joint_2",
    ),
    "time since the start by pandas": (
        table([[f"0 days 00:00:{t:09.6f}" for t in TIME], A, B], before=",q1,q2\n"), "joint_1", "joint_2",
    ),
    "compact dates": (
        table([[f"20240506T1000{t:06.3f}" for t in TIME], A, B], before="stamp,q1,q2\n"), "joint_1", "joint_2",
    ),
    "called by its unit": (table([TIME * 1e3, A, B], before="ms,q1,q2\n"), "joint_1", "joint_2"),
    "units with spaces between spaces": (
        table([TIME, A, B, A], sep="  ", before="t [s]  q1 [rad]  q2 [rad]  tau1 [N m]\n"), "joint_1", "joint_2",
    ),
    "other signs in units": (
        table([TIME, A * DEGREES, B * DEGREES, A], before="t [sec.],q1 [º],q2 [deg.],dq1 [rad·s⁻¹]\n"), "joint_1", "joint_2",
    ),
    "Unix times under a blank name": (table([texts(SENT, "%d"), A, B], before=",q1,q2\n"), "joint_1", "joint_2"),
    "ts in ms": (table([texts(TIME * 1e3, "%.0f"), A, B], before="ts,q1,q2\n"), "joint_1", "joint_2"),
    "json lines, cut off": (
        ("".join(json.dumps({"t": t, "q1": a, "q2": b}) + "\n" for t, a, b in zip(TIME, A, B, strict=True)) + '{"t":').encode(),
        "joint_1", "joint_2",
    ),
    "json messages": (
        json.dumps([{"header": {"stamp": {"sec": int(n // 10**9), "nanosec": int(n % 10**9)}}, "name": ["joint_2", "joint_1"],
                     "position": [a, b]} for n, a, b in zip(SENT, A, B, strict=True)]).encode(), "joint_2", "joint_1",
    ),
    "json lists": (
        json.dumps({"robot": "arm", "t_ms": list(TIME * 1e3), "q": np.column_stack([A, B]).tolist(), "gains": [1, 2]}).encode(),
        "joint_1", "joint_2",
    ),
    "names above a controller's points": (
        table([SENT_TEXT, ["joint_2"] * COUNT, ["joint_1"] * COUNT, A, B, B, A],
              before="%time,field.joint_names0,field.joint_names1,field.actual.positions0,field.actual.positions1,"
              "field.desired.positions0,field.desired.positions1\n"), "joint_2", "joint_1",
    ),
    "a trajectory in json": (
        json.dumps({"joint_names": ["joint_2", "joint_1"], "points": [
            {"positions": [a, b], "time_from_start": {"secs": int(t), "nsecs": round(t % 1 * 1e9)}}
            for t, a, b in zip(TIME, A, B, strict=True)]}).encode(), "joint_2", "joint_1",
    ),
    "json pairs of time and value": (
        json.dumps({f"joint_{i}": np.column_stack([TIME, v]).tolist() for i, v in ((1, A), (2, B))}).encode(),
        "joint_1", "joint_2",
    ),
    "a timeval": (
        table([SECONDS, texts(SENT % 10**9 // 1000, "%d"), A, B], before="tv_sec,tv_usec,q1,q2\n"), "joint_1", "joint_2",
    ),
    "past midnight": (
        table([[str(datetime(2024, 5, 6, 23, 59, 58) + timedelta(seconds=t))[11:] for t in TIME], A, B], before="time,q1,q2\n"),
        "joint_1", "joint_2",
    ),
    "a time in steps of a quarter of a millisecond": (
        table([texts(TIME * 4000, "%.6f"), A, B], before="time [250us],q1,q2\n"), "joint_1", "joint_2",
    ),
    "actual and desired": (
        table([TIME, A, B, B, A], before="t,actual_joint_1,actual_joint_2,desired_joint_1,desired_joint_2\n"),
        "joint_1", "joint_2",
    ),
    "Ist and Soll": (
        table([TIME, A, B, B, A], before="t,Istwinkel joint_1,Istwinkel joint_2,Sollwinkel joint_1,Sollwinkel joint_2\n"),
        "joint_1", "joint_2",
    ),
    "ActPos and SetPos": (
        table([TIME, A, B, B, A], before="t,Axis1.ActPos,Axis2.ActPos,Axis1.SetPos,Axis2.SetPos\n"),
        "joint_1", "joint_2",
    ),
    "json by pandas": (
        json.dumps({n: {str(i): v for i, v in enumerate(c)} for n, c in (("time", TIME), ("q1", A), ("q2", B))}).encode(),
        "joint_1", "joint_2",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", UNDERSTOOD)
def test_understood(tmp_path: Path, name: str) -> None:
    content, first, second = UNDERSTOOD[name]
    check(read(tmp_path, content), first, second)


REFUSED: dict[str, tuple[bytes, str]] = {
    "ticks of an unknown clock": (table([texts(ORDER * 64, "%d"), A, B], before="ticks,q1,q2\n"), "'ticks' counts something"),
    "two publishers of one topic": (
        table([TIME, ["joint_1", "joint_2"] * (COUNT // 2), A], before="time,name0,position0\n"),
        "other joints from row to row",
    ),
    "an index only": (table([texts(ORDER, "%d"), A, B], before=",q1,q2\n"), "counts the rows.*--rate"),
    "an index by pandas": (table([texts(ORDER + 1, "%d"), A, B], before="Unnamed: 0,q1,q2\n"), "counts the rows.*--rate"),
    "an index by reset_index": (table([texts(ORDER, "%d"), A, B], before="level_0,q1,q2\n"), "'level_0' counts the rows"),
    "an index from 1200 on": (table([texts(ORDER + 1200, "%d"), A, B], before="step,q1,q2\n"), "'step' counts the rows"),
    "an index of every tenth row": (table([texts(10 * ORDER, "%d"), A, B], before=",q1,q2\n"), "column 1, which has no name"),
    "12 names over 13 columns": (
        table([TIME, *[A + i for i in range(12)]], before="time," + ",".join(f"q{i}" for i in range(1, 12)) + "\n"),
        "header has 12 names, its rows have 13 fields",
    ),
    "14 names over 13 columns": (
        table([TIME, *[A + i for i in range(12)]], before="time," + ",".join(f"q{i}" for i in range(1, 14)) + "\n"),
        "header has 14 names, its rows have 13 fields",
    ),
    "5 names, of which the middle ends with a number": (
        table([TIME, A, B], before="time,q1,q2,q3,q4\n"),
        "header has 5 names, its rows have 3 fields",
    ),
    "what is measured in seconds is no time": (table([TIME, A], before="rise_time [s],q1\n"), "no time column found"),
    "a header glued to the first row": (table([TIME, A, B], before="time,q1,q20.0,0.1,0.2\n"), "glued to the header"),
    "a time of another kind of cells": (
        table([texts(TIME, "%.3f XYZT"), A, B], before="datetime,q1,q2\n"),
        "named as a time, but",
    ),
    "marks between thousands of whole numbers": (
        table(
            [texts(TIME * 1e3, "%.0f"), [f"{round(v * 4e4):,}".replace(",", ".") for v in A], B],
            sep=";",
            dec=",",
            before="time_ms;enc1;q2\n",
        ),
        "marks between their thousands",
    ),
    "a command that rises is no time": (table([TIME, A], before="q_ref,q1\n"), "no time column found"),
    "json of another kind": (b'{"name": "arm", "joints": 2}\n', "is JSON with 0 records"),
}


@pytest.mark.parametrize(
    ("unit", "factor"),
    [("N.mm", 1e-3), ("N mm", 1e-3), ("N-m", 1.0), ("lb-ft", 1.3558179), ("lbf in", 0.112984829), ("oz-in", 7.06155e-3)],
)
def test_torques_in_units_of_the_trade(tmp_path: Path, unit: str, factor: float) -> None:
    recording = read(tmp_path, table([TIME, A, B], before=f"t,q1,tau_joint_1 [{unit}]\n"))
    np.testing.assert_allclose(recording.column("joint_1", "link_torque").values, B * factor, rtol=1e-6)


def test_a_second_column_of_one_name_is_no_second_joint(tmp_path: Path) -> None:
    recording = read(tmp_path, table([TIME, A, B], before="t,angle,angle\n"))
    assert recording.joints == ()
    assert "angle, angle#2" in said(recording.findings, "unclear-joint")


@pytest.mark.parametrize("name", REFUSED)
def test_refused(tmp_path: Path, name: str) -> None:
    content, words = REFUSED[name]
    with pytest.raises(RecordingError, match=words) as error:
        read(tmp_path, content)
    assert len(str(error.value).splitlines()) <= 3


def test_a_misfit_header_can_be_replaced_by_numbers(tmp_path: Path) -> None:
    content = table([TIME, A, B, A], before="time,q1,q2\n")
    recording = read(tmp_path, content, mapping=["1=time", "2=joint_1.link_position", "3=joint_2.link_position"])
    check(recording)
    assert "3 names" in said(recording.findings, "header-misfit")


@pytest.mark.parametrize(
    ("header", "scale", "unit"),
    [("Time (s)", 100.0, "ms"), ("Time [s]", 1e5, "us"), ("time_ms", 1.0, "s"), ("t / us", 1.0, "s")],
)
def test_a_stated_unit_of_time_that_cannot_be_is_suspected(tmp_path: Path, header: str, scale: float, unit: str) -> None:
    recording = read(tmp_path, table([TIME * scale, A, B], before=f"{header},q1,q2\n"))
    hint = said(recording.findings, "suspected-time")
    assert f"[{unit}]" in hint
    told = read(tmp_path, table([TIME * scale, A, B], before=f"{header},q1,q2\n"), mapping=[f"{header}=time [{unit}]"])
    assert said(told.findings, "suspected-time") == ""


@pytest.mark.parametrize(("header", "scale"), [("Time (s)", 1.0), ("time_ms", 1e3), ("t [us]", 1e6), ("t [s]", 10.0)])
def test_usual_times_are_not_suspected(tmp_path: Path, header: str, scale: float) -> None:
    recording = read(tmp_path, table([TIME * scale, A, B], before=f"{header},q1,q2\n"))
    assert said(recording.findings, "suspected-time") == ""


def test_stamps_of_two_columns_count_from_the_first_ones_zero(tmp_path: Path) -> None:
    """The second clock is 2 s ahead: its samples come 2 s later, not earlier, and not at 0."""
    dates = [[f"2024-05-06T10:00:{t + late:012.9f}" for t in TIME] for late in (1.0, 3.0)]
    recording = read(tmp_path, table([dates[0], A, dates[1], B], before="time_1,q1,time_2,q2\n"))
    check(recording)
    first, second = (recording.column(joint, "link_position").time[0] for joint in JOINTS)
    assert (first, second) == (pytest.approx(0.0), pytest.approx(0.0))  # the same clock but for its zero: the first is used
    irregular = TIME + 0.3 * TIME**2
    dates[1] = [f"2024-05-06T10:00:{t + 3.0:012.9f}" for t in irregular]
    recording = read(tmp_path, table([dates[0], A, dates[1], B], before="time_1,q1,time_2,q2\n"))
    np.testing.assert_allclose(recording.column("joint_2", "link_position").time, 2.0 + irregular, atol=1e-8)


@pytest.mark.parametrize("unit", [1.0, 1e-3, 1e-9])
def test_a_second_unix_time_counts_from_the_first_ones_zero(tmp_path: Path, unit: float) -> None:
    irregular = TIME + 0.3 * TIME**2
    columns = [texts((1.7e9 + TIME) / unit, "%.6f"), A, texts((1.7e9 + 2.0 + irregular) / unit, "%.6f"), B]
    recording = read(tmp_path, table(columns, before="time_1,q1,time_2,q2\n"))
    np.testing.assert_allclose(recording.column("joint_2", "link_position").time, 2.0 + irregular, atol=2e-6)


def test_absolute_stamps_are_what_was_written() -> None:
    """A float of 1.7e9 s resolves 2.4e-7 s, which must not move a sample off its step."""
    time, zero, _ = scale_time(1_700_000_000.0 + TIME, 1.0, path=Path("x"), name="t")
    np.testing.assert_array_equal(time, np.round(TIME, 2))
    assert zero == 1.7e9


@pytest.mark.parametrize("lost", [1, 2, 3])
def test_every_lost_sample_is_counted(tmp_path: Path, lost: int) -> None:
    kept = np.r_[0:100, 100 + lost : COUNT]
    recording = read(tmp_path, table([TIME[kept], A[kept], B[kept]], before="t,q1,q2\n"))
    assert f"{lost} samples are missing in 1 gaps; the longest is {0.01 * (lost + 1):.4g} s" in said(
        recording.findings, "dropped-samples"
    )


def test_half_a_step_more_is_no_gap(tmp_path: Path) -> None:
    late = np.where(ORDER >= 100, TIME + 0.006, TIME)
    assert said(read(tmp_path, table([late, A, B], before="t,q1,q2\n")).findings, "dropped-samples") == ""


def test_single_glitches_are_flagged_and_kept(tmp_path: Path) -> None:
    spoilt = A.copy()
    spoilt[[50, 120]] += (0.8, -0.9)
    recording = read(tmp_path, table([TIME, spoilt, B], before="t,q1,q2\n"))
    assert "2 single samples" in said(recording.findings, "glitch")
    assert "t = 0.5, 1.2 s" in said(recording.findings, "glitch")
    np.testing.assert_allclose(recording.column("joint_1", "link_position").values, spoilt, atol=1e-8)


@pytest.mark.parametrize("seed", range(3))
def test_steps_and_noise_are_no_glitches(tmp_path: Path, seed: int) -> None:
    noise = np.random.default_rng(seed).normal(0, 0.1, COUNT)
    recording = read(tmp_path, table([TIME, np.where(TIME > 1, 1.0, 0.0), noise], before="t,q1,q2\n"))
    assert said(recording.findings, "glitch") == ""


def test_mapping_items_scale_shift_and_cut(tmp_path: Path) -> None:
    content = table([TIME, 2 + A * DEGREES * 100, B + 0.3], before="t,alpha,beta\n")
    items = ["alpha=0.01*joint_1.link_position [deg] - start", "beta=joint_2.link_position - 0.3", "window=0.5..2"]
    recording = read(tmp_path, content, mapping=items)
    inside = (TIME >= 0.5) & (TIME <= 2.0)
    np.testing.assert_allclose(recording.time, TIME[inside])
    np.testing.assert_allclose(recording.column("joint_1", "link_position").values, (A - A[inside][0])[inside], atol=1e-7)
    np.testing.assert_allclose(recording.column("joint_2", "link_position").values, B[inside], atol=1e-7)
    mean = read(tmp_path, content, mapping=["beta=-2*joint_2.link_position - mean"]).column("joint_2", "link_position")
    np.testing.assert_allclose(mean.values, -2 * (B - np.mean(B)), atol=1e-7)
    assert "(its mean)" in mean.conversion


def test_a_mapping_file_says_the_same_and_is_written_as_items(tmp_path: Path) -> None:
    from asrsim.recordings.mapping import load_mapping, parse_mapping

    (tmp_path / "arm.yaml").write_text(
        "time: {column: t, unit: s}\nwindow: [0.5, 2]\ncolumns:\n  alpha: 0.5*joint_1.link_position [deg]\n"
        "  beta: {joint: joint_2, quantity: link_position, scale: -1, offset: mean}\n"
        "  gamma: {joint: joint_2, quantity: tau_ext, offset: -0.25}\n  delta: ignore\n"
    )
    content = table([TIME, A, B, A, B], before="t,alpha,beta,gamma,delta\n")
    recording = read(tmp_path, content, mapping=[str(tmp_path / "arm.yaml")])
    assert recording.time[0] == pytest.approx(0.5)
    maps = load_mapping(tmp_path / "arm.yaml")
    items = [one.text for one in maps]
    again = [parse_mapping(item, origin="map file") for item in items]
    assert again == list(maps)
    other = read(tmp_path, content, mapping=items)
    for name, column in recording.channels.items():
        np.testing.assert_array_equal(column.values, other.channels[name].values)


@pytest.mark.parametrize("item", ["window=2..1", "window=a..b", "q1=joint_1.link_position + start"])
def test_mapping_items_that_are_none(tmp_path: Path, item: str) -> None:
    with pytest.raises(RecordingError):
        read(tmp_path, table([TIME, A, B], before="t,q1,q2\n"), mapping=[item])


def test_a_window_beside_the_recording_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"it lasts from 0 to 2\.99 s"):
        read(tmp_path, table([TIME, A, B], before="t,q1,q2\n"), mapping=["window=5.."])


def test_files_are_joined_on_one_clock(tmp_path: Path) -> None:
    """One signal a file, named by it, the second begun 0.25 s later by its Unix time."""
    for name, values, late in (("q1", A, 0.0), ("q2", B, 0.25)):
        (tmp_path / f"{name}.csv").write_bytes(table([texts(1.7e9 + late + TIME, "%.4f"), values], before="time,value\n"))
    recording = read_recording(tmp_path / "q1.csv+q2.csv", joints=JOINTS)
    check(recording)
    assert recording.column("joint_2", "link_position").time[0] == pytest.approx(0.25)
    assert recording.column("joint_2", "link_position").part == tmp_path / "q2.csv"
    with pytest.raises(RecordingError, match="no such file"):
        read_recording(tmp_path / "q1.csv+q3.csv")


@pytest.mark.parametrize("joined", [False, True])
def test_a_files_name_tells_what_its_only_column_is(tmp_path: Path, joined: bool) -> None:
    for name, values in (("q2_deg", B * DEGREES), ("q1", A)):
        (tmp_path / f"{name}.csv").write_bytes(table([TIME, values], before="t,data\n"))
    recording = read_recording(tmp_path / ("q1.csv+q2_deg.csv" if joined else "q2_deg.csv"), joints=JOINTS)
    column = recording.column("joint_2", "link_position")
    np.testing.assert_allclose(column.values, B, atol=1e-6)
    assert (column.unit, column.stated, column.label) == ("rad", True, "data")
    # The other column has no unit, and this one's is not SI.
    assert [finding.code for finding in recording.findings] == ["unstated-unit"] * joined
    own = read_recording(tmp_path / "q2_deg.csv", joints=JOINTS, mapping=["data=joint_1.deflection"])
    np.testing.assert_allclose(own.column("joint_1", "deflection").values, B, atol=1e-6)


def test_names_of_a_file_reach_no_terminal_as_commands(tmp_path: Path) -> None:
    recording = read(tmp_path, table([TIME, A, B], before="t,q1\x1b]0;x,q2\n"))
    rows = json.dumps([{"t": t, "q\ud800": a, "q2\x1b[31m": a} for t, a in zip(TIME, A, strict=True)])
    other = read(tmp_path, rows.encode(), "lab.json")
    for name in (*recording.channels, *other.channels):
        assert name.isprintable()
        name.encode()


MATLAB: dict[str, dict[str, Any]] = {
    "an empty label": {"out": {"time": TIME, "signals": {"values": A, "label": np.array([])}, "blockName": "arm/q1"}},
    "two signals without a label": {
        "out": {
            "time": TIME,
            "signals": {"values": np.column_stack([A, B]), "dimensions": 2, "label": np.array([])},
            "blockName": "arm/q",
        },
    },
    "a variable's own name": {"q1": {"time": TIME, "signals": {"values": A, "label": ""}, "blockName": "arm/To Workspace"}},
    "a variable of two joints": {
        "q": {
            "time": TIME,
            "signals": {"values": np.column_stack([A, B]), "label": np.array([])},
            "blockName": "arm/To Workspace",
        }
    },
    "empty labels among others": {"out": {"time": TIME, "signals": [{"values": A, "label": "q1"}, {"values": B, "label": ""}]}},
    "a simulation beside": {"t": TIME, "q1": A, "tsim": np.linspace(0, 3, 500), "xsim": np.zeros((500, 2))},
    "a simulation as long": {"t": TIME, "q1": A, "tsim": 2 * TIME, "xsim": np.column_stack([A, B])},
    "elements": {"logs": np.array([{"Name": "q1", "Values": {"Time": TIME, "Data": A}}], dtype=object)},
    "a time that restarts beside": {"a": {"t": TIME, "q1": A}, "b": {"t": np.r_[TIME[:150], TIME[:150]], "q2": B}},
    "parameters": {"t": TIME, "q1": A, **{f"k{i}": np.zeros(i + 2) for i in range(40)}},
}


@pytest.mark.parametrize("name", MATLAB)
def test_matlab(tmp_path: Path, name: str) -> None:
    from scipy.io import savemat

    savemat(tmp_path / "lab.mat", MATLAB[name])
    recording = read_recording(tmp_path / "lab.mat", joints=JOINTS)
    column = recording.column("joint_1", "link_position")
    np.testing.assert_allclose(column.time, TIME, atol=1e-9)
    np.testing.assert_allclose(column.values, A)
    assert len(recording.findings) <= 3
    assert not any("signals" in str(one.key) for one in recording.findings)  # what is read is not said to be left out
    for name, other in recording.channels.items():
        if name.startswith("xsim"):
            assert other.time[-1] == pytest.approx(3.0 if len(other.time) == 500 else 2 * TIME[-1])


def opaque(name: str, kind: str) -> bytes:
    """An object (timeseries, table, function handle) as MATLAB saves it: class 17 with its name, `MCOS` and its class."""

    def element(number: int, data: bytes) -> bytes:
        return struct.pack("<II", number, len(data)) + data + bytes(-len(data) % 8)

    flags = element(6, struct.pack("<II", 17, 0))
    inner = element(6, struct.pack("<II", 13, 0)) + element(5, struct.pack("<ii", 6, 1)) + element(1, b"")
    inner += element(6, struct.pack("<6I", 0xDD000000, 2, 1, 1, 1, 1))
    return element(14, flags + element(1, name.encode()) + element(1, b"MCOS") + element(1, kind.encode()) + element(14, inner))


@pytest.mark.parametrize("kind", ["timeseries", "table", "function_handle"])
def test_a_workspace_with_objects_is_read_without_them(tmp_path: Path, kind: str) -> None:
    from scipy.io import savemat

    savemat(tmp_path / "lab.mat", {"t": TIME, "q1": A, "q2": B})
    (tmp_path / "lab.mat").write_bytes((tmp_path / "lab.mat").read_bytes() + opaque("ts", kind))
    recording = read_recording(tmp_path / "lab.mat", joints=JOINTS)
    check(recording)
    assert "ts" in said(recording.findings, "mat-object")


def test_objects_of_matlab_are_passed_over(tmp_path: Path) -> None:
    """A function handle beside vectors, as a saved workspace has them: the bytes of its element are put behind theirs."""
    import scipy.io.matlab
    from scipy.io import savemat

    folder = Path(scipy.io.matlab.__file__).parent / "tests" / "data"
    if not folder.is_dir():
        pytest.skip("scipy was installed without its test files")
    objects = [(folder / name).read_bytes()[128:] for name in ("sqr.mat", "testobject_7.4_GLNX86.mat")]
    for i, data in enumerate(objects):
        path = tmp_path / f"lab{i}.mat"
        savemat(path, {"t": TIME, "q1": A, "q2": B})
        path.write_bytes(path.read_bytes() + data)
        recording = read_recording(path, joints=JOINTS)
        check(recording)
    (tmp_path / "only.mat").write_bytes((folder / "sqr.mat").read_bytes())
    with pytest.raises(RecordingError, match="MATLAB object"):
        read_recording(tmp_path / "only.mat")


@pytest.mark.parametrize("count", [3, 40])
def test_refusals_are_short(tmp_path: Path, count: int) -> None:
    from scipy.io import savemat

    savemat(tmp_path / "lab.mat", {f"s{i}": {"a": np.zeros(i + 3), "b": np.zeros(i + 9)} for i in range(count)})
    with pytest.raises(RecordingError, match="no time") as error:
        read_recording(tmp_path / "lab.mat")
    assert len(str(error.value).splitlines()) <= 3


@pytest.mark.parametrize(("share", "refused"), [(0.05, False), (0.2, True)])
def test_a_time_that_stays_behind_is_another_recording(tmp_path: Path, share: float, refused: bool) -> None:
    """A tenth of the samples behind an earlier one is where stray stamps end and a second recording begins."""
    behind = round(share * COUNT)
    time = np.r_[TIME[: COUNT - behind], TIME[100 : 100 + behind]]
    content = table([time, A, B], before="t,q1,q2\n")
    if refused:
        with pytest.raises(RecordingError, match="two recordings"):
            read(tmp_path, content)
    else:
        assert f"{behind} time stamps that go backward" in said(read(tmp_path, content).findings, "backward-time")


@pytest.mark.parametrize("end", [0, -1])
@pytest.mark.parametrize("stamp", [0.0, 1e3, 3e9])
def test_an_end_that_is_of_another_clock_is_left_out(tmp_path: Path, end: int, stamp: float) -> None:
    time = 1.7e9 + TIME
    time[end] = stamp
    (tmp_path / "lab.csv").write_bytes(table([time, A, B], before="t,q1,q2\n", number="%.14g"))
    recording = read_recording(tmp_path / "lab.csv", joints=["joint_1", "joint_2"])
    column = recording.column("joint_1", "link_position")
    kept = slice(1, None) if end == 0 else slice(None, -1)
    assert column.values == pytest.approx(A[kept])
    np.testing.assert_allclose(column.time - column.time[0], TIME[:-1], atol=1e-6)
    assert column.time[0] == 0.0
    assert recording.epoch == pytest.approx(1.7e9 + TIME[kept][0])
    assert [one.code for one in recording.findings] == ["stray-time"]


@pytest.mark.parametrize(("place", "stamp"), [(0, 500.0), (120, 9.0), (120, 1e7), (120, -3.0), (296, 50.0)])
def test_one_bad_stamp_refuses_no_file(tmp_path: Path, place: int, stamp: float) -> None:
    time = TIME.copy()
    time[place] = stamp
    recording = read(tmp_path, table([time, A, B], before="t,q1,q2\n"))
    kept = np.arange(COUNT) != place
    np.testing.assert_allclose(recording.time, TIME[kept], atol=1e-9)
    np.testing.assert_allclose(recording.column("joint_1", "link_position").values, A[kept], atol=1e-6)
    assert f"line {place + 2}" in said(recording.findings, "backward-time") + said(recording.findings, "stray-time")


@pytest.mark.parametrize(("correlation", "suspected"), [(-0.9, True), (-0.8, True), (-0.6, False), (0.9, False)])
def test_a_turned_axis_is_suspected_from_its_correlation(correlation: float, suspected: bool) -> None:
    from asrsim.recordings.checks import suspect_sign

    first, second = np.sin(2 * np.pi * np.arange(400) / 400), np.cos(2 * np.pi * np.arange(400) / 400)
    mixed = correlation * first + np.sqrt(1 - correlation**2) * second
    assert (suspect_sign(first, mixed) is not None) == suspected


@pytest.mark.parametrize(("lost", "bridged"), [(1, True), (4, False)])
def test_short_gaps_are_bridged_and_long_ones_are_not(lost: int, bridged: bool) -> None:
    from asrsim.recordings import resample

    kept = np.r_[0:100, 100 + lost : COUNT]
    middle = resample(TIME[kept], A[kept], TIME[[99, 100, 100 + lost]])
    assert np.isfinite(middle[1]) == bridged
    assert np.isfinite(middle[[0, 2]]).all()
