"""Delimited text as laboratories write it: every layout gives the same numbers, every oddity a finding with its line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from asrsim.errors import Problem, RecordingError
from asrsim.recordings import read_recording

pytestmark = pytest.mark.once


N = 50
TIME = np.arange(N) * 0.01
Q1 = np.sin(2 * np.pi * TIME)
Q2 = np.cos(2 * np.pi * TIME)


def rows(time_scale: float = 1.0, scale: float = 1.0, separator: str = ",", decimal: str = ".", zero: float = 0.0) -> list[str]:
    lines = []
    for t, a, b in zip(TIME, Q1, Q2, strict=True):
        cells = [f"{(t + zero) * time_scale:.9f}", f"{a * scale:.12f}", f"{b * scale:.12f}"]
        lines.append(separator.join(cell.replace(".", decimal) for cell in cells))
    return lines


def write(path: Path, lines: list[str], encoding: str = "utf-8") -> Path:
    path.write_bytes(("\n".join(lines) + "\n").encode(encoding))
    return path


def codes(findings: tuple[Problem, ...]) -> set[str]:
    return {finding.code for finding in findings}


def finding(findings: tuple[Problem, ...], code: str) -> Problem:
    return next(one for one in findings if one.code == code)


def check(path: Path, **options: object) -> None:
    recording = read_recording(path, **options)  # type: ignore[arg-type]
    np.testing.assert_allclose(recording.time, TIME, atol=3e-7)  # a float of 1.7e9 s resolves 2.4e-7 s
    np.testing.assert_allclose(recording.column("joint_1", "link_position").values, Q1, atol=1e-9)
    np.testing.assert_allclose(recording.column("joint_2", "link_position").values, Q2, atol=1e-9)


DEGREES = 180 / np.pi
LAYOUTS: dict[str, list[str]] = {
    "plain": ["time,q1,q2", *rows()],
    "semicolon and decimal comma": ["time;q1;q2", *rows(separator=";", decimal=",")],
    "tab and decimal comma": ["time\tq1\tq2", *rows(separator="\t", decimal=",")],
    "spaces": ["  time   q1  q2", *rows(separator="   ")],
    "comma and space": ["time, q1, q2", *rows(separator=", ")],
    "pipe": ["t|q1|q2", *rows(separator="|")],
    "brackets": ["t [s],q1 [deg],q2 [deg]", *rows(scale=DEGREES)],
    "brackets and spaces": ["t [s]  q1 [deg]  q2 [deg]", *rows(scale=DEGREES, separator="  ")],
    "parentheses": ["t (s),pos_1 (rad),pos_2 (rad)", *rows()],
    "suffixes": ["time_ms,q1_deg,q2_deg", *rows(time_scale=1e3, scale=DEGREES)],
    "slash": ["t / ms,q1 / mrad,q2 / mrad", *rows(time_scale=1e3, scale=1e3)],
    "unit row": ["time,q1,q2", "ms,deg,deg", *rows(time_scale=1e3, scale=DEGREES)],
    "milliseconds unsaid": ["time,q1,q2", *rows(time_scale=1e3)],
    "microseconds unsaid": ["t,q1,q2", *rows(time_scale=1e6)],
    "comments": ["# recorded on a Monday", "% by hand", "// twice", "time,q1,q2", *rows()],
    "header in a comment": ["# arm, run 3", "# time q1 q2", *rows(separator=" ")],
    "preamble": ["Laboratory 5", "Operator,Ada", "time,q1,q2", *rows()],
    "excel": ["sep=;", "time;q1;q2", *rows(separator=";", decimal=",")],
    "quoted": ['"time","q1","q2"', *['"' + line.replace(",", '","') + '"' for line in rows()]],
    "quoted decimal comma": ['"time","q1","q2"', *['"' + '","'.join(line.split(";")) + '"' for line in rows(1, 1, ";", ",")]],
    "trailing separator": ["time,q1,q2,", *[line + "," for line in rows()]],
    "blank lines": ["", "time,q1,q2", "", *[line for row in rows() for line in (row, "")]],
    "epoch seconds": ["stamp,q1,q2", *rows(zero=1.7e9)],
    "epoch milliseconds": ["timestamp,q1,q2", *rows(zero=1.7e9, time_scale=1e3)],
    "capitals": ["Time,Q1,Q2", *rows()],
    "text column": ["time,q1,q2,status", *[line + ",OK" for line in rows()]],
    "windows ends": ["time,q1,q2\r", *[line + "\r" for line in rows()]],
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_gives_the_same_numbers(tmp_path: Path, layout: str) -> None:
    check(write(tmp_path / "lab.csv", LAYOUTS[layout]))


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "latin-1"])
def test_encodings(tmp_path: Path, encoding: str) -> None:
    check(write(tmp_path / "lab.csv", ["t [s];q1 [°];q2 [°]", *rows(scale=DEGREES, separator=";")], encoding))


def test_iso_stamps_count_from_the_first_and_keep_its_date(tmp_path: Path) -> None:
    stamps = [f"2024-05-06T10:00:{t:012.9f}Z" for t in TIME]
    lines = [f"{stamp},{row.partition(',')[2]}" for stamp, row in zip(stamps, rows(), strict=True)]
    path = write(tmp_path / "lab.csv", ["when,q1,q2", *lines])
    check(path)
    assert read_recording(path).epoch == pytest.approx(1714989600.0)


def test_a_ros_stamp_in_two_columns_is_one_time(tmp_path: Path) -> None:
    nanoseconds = [round(t * 1e9) + 1_700_000_000_900_000_000 for t in TIME]
    lines = [f"{ns // 10**9},{ns % 10**9},{row.partition(',')[2]}" for ns, row in zip(nanoseconds, rows(), strict=True)]
    path = write(tmp_path / "lab.csv", ["header.stamp.sec,header.stamp.nanosec,q1,q2", *lines])
    recording = read_recording(path)
    np.testing.assert_allclose(recording.time, TIME, atol=1e-9)
    assert recording.epoch == pytest.approx(1.7e9 + 0.9, abs=1e-6)


@pytest.mark.parametrize("pattern", ["2024-05-06 10:00:{:06.3f}", "10:00:{:06.3f}", "2024-05-06 10:00:{:06.3f}+02:00"])
def test_other_stamps(tmp_path: Path, pattern: str) -> None:
    lines = [f"{pattern.format(t)};{row.partition(';')[2]}" for t, row in zip(TIME, rows(separator=";"), strict=True)]
    check(write(tmp_path / "lab.csv", ["Zeit;q1;q2", *lines]))


def test_without_a_header_columns_are_numbered_and_mapped_by_number(tmp_path: Path) -> None:
    path = write(tmp_path / "lab.csv", rows())
    recording = read_recording(path)
    assert {"no-header", "time-guessed", "nothing-mapped"} <= codes(recording.findings)
    assert list(recording.channels) == ["column_2", "column_3"]
    check(path, mapping=["2=joint_1.link_position", "3=joint_2.link_position"])


def test_the_start_of_time_is_kept(tmp_path: Path) -> None:
    recording = read_recording(write(tmp_path / "lab.csv", ["time,q1,q2", *rows(zero=12.5)]))
    assert recording.time[0] == pytest.approx(12.5)
    assert recording.epoch is None


def test_bad_rows_are_reported_with_their_lines_and_nothing_else_is_lost(tmp_path: Path) -> None:
    lines = ["time,q1,q2", *rows()]
    lines[10] = "0.09,abc,0.5"
    lines[20] = "0.19,1.0"
    lines[30] = "0.29,,0.5"
    recording = read_recording(write(tmp_path / "lab.csv", lines))
    assert finding(recording.findings, "not-a-number").line == 11
    assert "line 11" in str(finding(recording.findings, "not-a-number"))
    assert finding(recording.findings, "ragged-row").line == 21
    values = recording.column("joint_1", "link_position").values
    assert len(recording.time) == N - 1
    assert np.isnan(values).sum() == 2
    assert recording.column("joint_2", "link_position").values[9] == 0.5


def test_bad_rows_far_into_a_file_keep_their_line_numbers(tmp_path: Path) -> None:
    lines = ["time,q1", *[f"{0.001 * i:.3f},{i % 7}" for i in range(45_000)]]
    lines[43_210] = "43.209,broken"
    recording = read_recording(write(tmp_path / "lab.csv", lines))
    assert finding(recording.findings, "not-a-number").line == 43_211
    assert len(recording.time) == 45_000


def test_duplicate_and_backward_stamps_are_dropped_and_reported(tmp_path: Path) -> None:
    lines = ["time,q1,q2", *rows()]
    lines.insert(12, lines[11])
    lines.insert(30, "0.05,9,9")
    recording = read_recording(write(tmp_path / "lab.csv", lines))
    assert finding(recording.findings, "duplicate-time").line == 13
    assert finding(recording.findings, "backward-time").line == 31
    assert len(recording.time) == N
    assert np.all(np.diff(recording.time) > 0)


def test_dropped_samples_and_jitter_are_reported(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    lines = ["time,q1,q2", *rows()]
    gone = read_recording(write(tmp_path / "gap.csv", lines[:20] + lines[25:]))
    assert "5 samples are missing in 1 gaps" in finding(gone.findings, "dropped-samples").message
    shaken = ["time,q1", *[f"{t + rng.uniform(-0.001, 0.001):.6f},{a}" for t, a in zip(TIME, Q1, strict=True)]]
    assert "jitter" in codes(read_recording(write(tmp_path / "jitter.csv", shaken)).findings)


def test_constant_columns_and_stretches_without_numbers_are_reported(tmp_path: Path) -> None:
    lines = ["time,q1,q2", *[f"{t:.2f},{'nan' if 20 <= i < 30 else 0.1 * i},4" for i, t in enumerate(TIME)]]
    findings = read_recording(write(tmp_path / "lab.csv", lines)).findings
    message = finding(findings, "missing-stretch").message
    assert "10 of 50 samples" in message
    assert "the longest from 0.2 s to 0.29 s" in message
    assert finding(findings, "constant-column").key == "q2"


@pytest.mark.parametrize(
    ("lines", "code"),
    [
        ([], "empty"),
        ([" ", ""], "empty"),
        (["# only", "# comments"], "empty"),
        (["time,q1"], "no-numbers"),
        (["some text", "without any number"], "no-numbers"),
        (["q1,q2", *[f"{np.sin(i):.3f},{np.cos(i):.3f}" for i in range(20)]], "no-time"),
        (["time", *[f"{t}" for t in TIME]], "one-column"),
        (["time,q1", "0.0,1"], "too-short"),
        (["time,q1", *[f"{t},1" for t in [0, 1, 2, 3, 4, 5, 0, 1, 2, 3, 4, 5]]], "two-time-bases"),
        (["time,q1", *[f"{t},1" for t in [0.0, 0.1, 0.2, 1.7e9, 1.7e9 + 0.1, 1.7e9 + 0.2, 1.7e9 + 0.3]]], "two-time-bases"),
    ],
)
def test_files_that_are_no_recordings(tmp_path: Path, lines: list[str], code: str) -> None:
    path = tmp_path / "lab.csv"
    path.write_text("\n".join(lines))
    with pytest.raises(RecordingError) as error:
        read_recording(path)
    assert error.value.problems[0].code == code
    assert error.value.problems[0].file == path


def test_missing_and_binary_files(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="no such file"):
        read_recording(tmp_path / "absent.csv")
    (tmp_path / "lab.csv").write_bytes(b"ab\0cd" * 100)
    with pytest.raises(RecordingError, match="not a text file"):
        read_recording(tmp_path / "lab.csv")
    (tmp_path / "folder").mkdir()
    with pytest.raises(RecordingError, match=r"metadata\.yaml"):
        read_recording(tmp_path / "folder")


def test_a_rate_stands_in_for_a_missing_time(tmp_path: Path) -> None:
    path = write(tmp_path / "lab.csv", ["q1,q2", *[line.partition(",")[2] for line in rows()]])
    check(path, rate=100.0)
    with pytest.raises(RecordingError, match="positive"):
        read_recording(path, rate=0.0)


def test_columns_behind_a_second_time_are_not_read_on_the_first(tmp_path: Path) -> None:
    lines = ["time,q1,time,q2", *[f"{0.01 * i:.3f},{0.1 * i},{0.013 * i:.3f},{-0.1 * i}" for i in range(30)]]
    recording = read_recording(write(tmp_path / "lab.csv", lines))
    assert recording.joints == ("joint_1",)
    assert "not read: q2" in finding(recording.findings, "second-time").message
    np.testing.assert_allclose(recording.time, 0.01 * np.arange(30))
    second = read_recording(tmp_path / "lab.csv", mapping=["time#2=time", "q1=ignore"])
    np.testing.assert_allclose(second.column("joint_2", "link_position").time, 0.013 * np.arange(30))


def test_a_mapping_overrides_names_and_units(tmp_path: Path) -> None:
    path = write(tmp_path / "lab.csv", ["time,alpha,beta,gamma", *[line + ",3" for line in rows(scale=DEGREES)]])
    recording = read_recording(path, mapping=["alpha=elbow.link_position [deg]", "beta=elbow.reference [deg]", "gamma=ignore"])
    np.testing.assert_allclose(recording.column("elbow", "link_position").values, Q1, atol=1e-9)
    np.testing.assert_allclose(recording.column("elbow", "reference_1").values, Q2, atol=1e-9)
    assert recording.column("elbow", "link_position").conversion == "deg -> rad, x 0.0174533"
    assert recording.channels["gamma"].quantity is None


@pytest.mark.parametrize(
    ("mapping", "words"),
    [
        (["q1"], "COLUMN=JOINT.QUANTITY"),
        (["q1=elbow.link_positon"], "Did you mean 'link_position'"),
        (["q1=elbow.link_position [degg]"], "not a unit"),
        (["absent=elbow.link_position"], "no such column"),
        (["q1=elbow.link_position [V]"], "cannot be a link_position"),
        (["q1=elbow.link_position", "q2=elbow.link_position"], "second elbow.link_position"),
        (["absent=time"], "no such column for the time"),
        (["time=time [rad]"], "time cannot be in rad"),
    ],
)
def test_bad_mappings_say_what_is_expected(tmp_path: Path, mapping: list[str], words: str) -> None:
    path = write(tmp_path / "lab.csv", ["time,q1,q2", *rows()])
    with pytest.raises(RecordingError, match=words.replace(".", r"\.")):
        read_recording(path, mapping=mapping)


def test_a_second_column_of_one_quantity_is_not_taken_in_silence(tmp_path: Path) -> None:
    recording = read_recording(write(tmp_path / "lab.csv", ["time,q,position", *rows()]))
    np.testing.assert_allclose(recording.column("joint_1", "link_position").values, Q1, atol=1e-9)
    assert finding(recording.findings, "second-column").key == "position"


def test_an_unknown_quantity_names_what_there_is(tmp_path: Path) -> None:
    recording = read_recording(write(tmp_path / "lab.csv", ["time,q1,q2", *rows()]))
    with pytest.raises(RecordingError, match=r"joint_1\.link_position"):
        recording.column("joint_1", "stiffness")


@pytest.mark.parametrize("seed", range(5))
def test_damaged_text_is_read_or_refused_and_nothing_else(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    junk = [b",", b"\n", b";", b'"', b" ", b"nan", b"1e999", b"-", b"2024-01-01", b"12:00", b"\xff", b"inf"]
    path = tmp_path / "lab.csv"
    for _ in range(20):
        data = bytearray("\n".join(LAYOUTS[rng.choice(list(LAYOUTS))]).encode())
        for _ in range(4):
            at = int(rng.integers(len(data)))
            if rng.random() < 0.5:
                del data[at : at + int(rng.integers(1, 40))]
            else:
                data[at:at] = junk[rng.integers(len(junk))]
        path.write_bytes(data)
        try:
            recording = read_recording(path)
        except RecordingError:
            continue
        assert np.all(np.diff(recording.time) > 0)
        assert all(len(column.time) == len(column.values) for column in recording.channels.values())


@pytest.mark.slow
def test_a_hundred_megabytes_are_read_in_seconds(tmp_path: Path) -> None:
    import time

    block = "".join(f"{{t{i}:.4f}}," + ",".join(["0.123456789"] * 9) + "\n" for i in range(1000))
    path = tmp_path / "big.csv"
    with path.open("w") as stream:
        stream.write("time,q1,q2,q3,q4,q5,q6,q7,q8,q9\n")
        for k in range(900):
            stream.write(block.format(**{f"t{i}": (1000 * k + i) * 1e-3 for i in range(1000)}))
    start = time.perf_counter()
    recording = read_recording(path)
    assert len(recording.time) == 900_000
    assert time.perf_counter() - start < 20


class TestRealRecordings:
    """Files of real machines, read as they are."""

    def test_quanser(self, shared: Path) -> None:
        recording = read_recording(shared / "recordings" / "quanser_2dsfl_lqr_10deg.csv")
        assert recording.joints == ("joint_1", "joint_2")
        assert len(recording.time) == 10_000
        assert np.median(np.diff(recording.time)) == pytest.approx(0.002)
        assert recording.column("joint_1", "motor_1_position").source == "hub1_rad"
        assert recording.column("joint_2", "reference_1").source == "hub2_ref_rad"
        assert recording.channels["current1_A"].quantity is None

    def test_hebi(self, shared: Path) -> None:
        recording = read_recording(shared / "recordings" / "hebi_sine_1hz.csv")
        assert "jitter" in codes(recording.findings)
        assert set(recording.quantities("joint_1")) >= {"link_position", "reference_1", "deflection", "link_torque"}
        # The firmware computes the effort from the deflection, so that a fit of stiffness to it finds the firmware's 40.
        torque = recording.column("joint_1", "link_torque").values
        deflection = recording.column("joint_1", "deflection").values
        assert np.max(np.abs(torque + 40.0 * deflection)) < 1e-6

    def test_emps(self, shared: Path) -> None:
        recording = read_recording(shared / "recordings" / "emps_estimation.csv")
        column = recording.column("joint_1", "link_position")
        assert column.unit == "m"
        assert recording.column("joint_1", "link_torque").unit == "N"
        assert len(recording.time) == 24_841


@pytest.mark.parametrize(("largest", "far"), [(15.0, True), (25.0, False), (900.0, False)])
def test_a_number_that_may_stand_for_a_missing_one_is_suspected_and_kept_until_that_is_stated(tmp_path, largest, far) -> None:
    lines = ["time,q1", *[f"{0.01 * i:.2f},{-999.0 if i in (5, 6, 20) else largest * np.sin(0.3 * i)}" for i in range(60)]]
    recording = read_recording(write(tmp_path / "lab.csv", lines))
    assert ("missing-mark" in codes(recording.findings)) == far
    assert np.sum(recording.column("joint_1", "link_position").values == -999.0) == 3
    (tmp_path / "lab.csv.yaml").write_text("missing: -999\n")
    values = read_recording(tmp_path / "lab.csv").column("joint_1", "link_position").values
    assert np.flatnonzero(np.isnan(values)).tolist() == [5, 6, 20]


@pytest.mark.parametrize("value", ["1e308", "-1e40"])
@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_what_cannot_have_been_measured_is_no_number(tmp_path: Path, value: str, unit: str) -> None:
    """Slopes, squares and units of such numbers overflow, wherever they are used."""
    lines = [f"time,elbow.position [{unit}]", *(f"{0.01 * i},{value if i == 7 else 0.1 * i}" for i in range(20))]
    recording = read_recording(
        write(tmp_path / "a.csv", lines), joints=["elbow"], mapping=["elbow.position=elbow.link_position"]
    )
    values = recording.column("elbow", "link_position").values
    assert np.flatnonzero(np.isnan(values)).tolist() == [7]
    assert "1 of 20 samples" in finding(recording.findings, "no-measurement").message


def test_stamps_that_differ_by_nothing_are_one(tmp_path: Path) -> None:
    lines = ["time,elbow.position", "0,0.1", "1e-320,0.2", *(f"{0.01 * i},{0.1 * i}" for i in range(1, 20))]
    recording = read_recording(write(tmp_path / "a.csv", lines), joints=["elbow"])
    assert recording.time[:3] == pytest.approx([0.0, 0.01, 0.02])
    assert "duplicate" in " ".join(sorted(codes(recording.findings)))


@pytest.mark.parametrize("missing", [1, 2, 5])
def test_every_missing_sample_is_counted_and_a_step_of_1_6_is_jitter(tmp_path: Path, missing: int) -> None:
    time = np.delete(np.arange(100) * 0.01, range(40, 40 + missing))
    found = read_recording(write(tmp_path / "gap.csv", ["time,q1", *[f"{t:.3f},{t * t}" for t in time]])).findings
    assert f"{missing} samples are missing in 1 gaps" in finding(found, "dropped-samples").message
    time = np.arange(100) * 0.01 + 0.006 * (np.arange(100) >= 50)
    found = read_recording(write(tmp_path / "step.csv", ["time,q1", *[f"{t:.3f},{t * t}" for t in time]])).findings
    assert codes(found) == {"jitter"}


def test_a_header_in_a_comment_line_with_tabs_is_read_as_labview_writes_it(tmp_path: Path) -> None:
    lines = ["%Time (s)\tHubangle (rad)\tStrain (V)", *[f"{t:.6f}\t{a:.9f}\t0.1" for t, a in zip(TIME, Q1, strict=True)]]
    recording = read_recording(write(tmp_path / "lab.txt", lines))
    np.testing.assert_allclose(recording.time, TIME, atol=1e-9)
    np.testing.assert_allclose(recording.column("joint_1", "motor_1_position").values, Q1, atol=1e-8)


@pytest.mark.parametrize("step", [1e-7, 3e9])
def test_a_time_whose_unit_no_usual_rate_tells_is_asked_about(tmp_path: Path, step: float) -> None:
    path = write(tmp_path / "lab.csv", ["time,q1", *[f"{738000 + i * step:.9f},{i}" for i in range(50)]])
    with pytest.raises(RecordingError, match="unit is not clear"):
        read_recording(path)


def test_numbers_of_fields_that_rostopic_prints_are_asked_about(tmp_path: Path) -> None:
    header = "%time,field.name0,field.name1,field.position0,field.position1"
    rows = [f"{1.7e18 + t * 1e9:.0f},elbow,shoulder,{a},{b}" for t, a, b in zip(TIME, Q1, Q2, strict=True)]
    path = write(tmp_path / "lab.csv", [header, *rows])
    recording = read_recording(path, joints=["shoulder", "elbow"])
    assert [column.source for column in recording.asked] == ["field.position0", "field.position1"]
    assert recording.joints == ()
    mapped = read_recording(path, mapping=["field.position0=elbow.link_position"], joints=["shoulder", "elbow"])
    np.testing.assert_allclose(mapped.column("elbow", "link_position").values, Q1)
