"""Delimited text as laboratories write it: every layout gives the same numbers, every oddity a finding with its line."""

import numpy as np
import pytest

from asrsim.errors import RecordingError
from asrsim.recordings import read_recording

N = 50
TIME = np.arange(N) * 0.01
Q1 = np.sin(2 * np.pi * TIME)
Q2 = np.cos(2 * np.pi * TIME)


def rows(time_scale=1.0, scale=1.0, separator=",", decimal=".", zero=0.0):
    lines = []
    for t, a, b in zip(TIME, Q1, Q2, strict=True):
        cells = [f"{(t + zero) * time_scale:.9f}", f"{a * scale:.12f}", f"{b * scale:.12f}"]
        lines.append(separator.join(cell.replace(".", decimal) for cell in cells))
    return lines


def dated(pattern):
    """Rows whose time is written in another way: s of a minute, or ROS's s and ns that begin 0.9 s after a whole second."""
    whole = [divmod(round(t * 1e9) + 1_700_000_000_900_000_000, 10**9) for t in TIME]
    stamps = [pattern.format(*ns) if "{1" in pattern else pattern.format(t) for t, ns in zip(TIME, whole, strict=True)]
    return [f"{stamp},{row.partition(',')[2]}" for stamp, row in zip(stamps, rows(), strict=True)]


def write(path, lines, encoding="utf-8"):
    path.write_bytes(("\n".join(lines) + "\n").encode(encoding))
    return path


def codes(findings):
    return {finding.code for finding in findings}


def finding(findings, code):
    return next(one for one in findings if one.code == code)


def check(path, **options):
    recording = read_recording(path, **options)
    np.testing.assert_allclose(recording.time, TIME, atol=3e-7)  # a float of 1.7e9 s resolves 2.4e-7 s
    np.testing.assert_allclose(recording.column("joint_1", "link_position").values, Q1, atol=1e-9)
    np.testing.assert_allclose(recording.column("joint_2", "link_position").values, Q2, atol=1e-9)


DEGREES = 180 / np.pi
LAYOUTS = {
    "plain": ["time,q1,q2", *rows()],
    "semicolon and decimal comma": ["time;q1;q2", *rows(separator=";", decimal=",")],
    "spaces": ["  time   q1  q2", *rows(separator="   ")],
    "brackets": ["t [s],q1 [deg],q2 [deg]", *rows(scale=DEGREES)],
    "brackets and spaces": ["t [s]  q1 [deg]  q2 [deg]", *rows(scale=DEGREES, separator="  ")],
    "suffixes": ["time_ms,q1_deg,q2_deg", *rows(time_scale=1e3, scale=DEGREES)],
    "comments": ["# recorded on a Monday", "% by hand", "// twice", "time,q1,q2", *rows()],
    "header in a comment": ["# arm, run 3", "# time q1 q2", *rows(separator=" ")],
    "labview": ["%Time (s)\tq1 (rad)\tq2 (rad)", *rows(separator="\t")],
    "labview measurement": [
        "Samples\t400\t400",
        "X0\t0\t0",
        "Delta_X\t.01\t.01",
        "X_Value\tq1\tq2\tComment",
        *rows(separator="\t"),
    ],
    "date and zone": ["when,q1,q2", *dated("2024-05-06T10:00:{:012.9f}+02:00")],
    "date with slashes": ["when,q1,q2", *dated("2024/05/06 10:00:{:06.3f}")],
    "time of day": ["Zeit,q1,q2", *dated("10:00:{:06.3f}")],
    "preamble": ["Laboratory 5", "Operator,Ada,", "Robot,SEA,", "Rate,100,", "time,q1,q2", *rows()],
    "quoted": ['"time","q1","q2"', *['"' + line.replace(",", '","') + '"' for line in rows()]],
    "trailing separator": ["time,q1,q2,", *[line + "," for line in rows()]],
    "trailing separator of rows": ["time,q1,q2", *[line + "," for line in rows()]],
    "blank lines": ["", "time,q1,q2", "", *[line for row in rows() for line in (row, " ", "\t")]],
    "blanks beside separators": [" time , q1 ,\tq2", *rows(separator=" ,\t")],
    "epoch milliseconds": ["unix_time,q1,q2", *rows(zero=1.7e9, time_scale=1e3)],
    "text column": ["time,q1,q2,status", *[line + ",OK" for line in rows()]],
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_gives_the_same_numbers(tmp_path, layout):
    path = write(tmp_path / "lab.csv", LAYOUTS[layout])
    check(path)
    assert codes(read_recording(path).findings) <= {"text-column"}


def test_zero_bytes_after_a_power_failure_are_ignored(tmp_path):
    path = write(tmp_path / "lab.csv", ["time,q1,q2", *rows()])
    path.write_bytes(path.read_bytes() + b"\0\0\0")
    assert not read_recording(path).findings


@pytest.mark.parametrize("cell", ["1_0", '"1,5"'])
def test_digits_joined_by_an_underscore_or_a_comma_are_no_number(tmp_path, cell):
    path = write(tmp_path / "lab.csv", ["time,q1,q2", *rows()[:4], f"0.04,{cell},0", *rows()[5:]])
    assert finding(read_recording(path).findings, "not-a-number").line == 6


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "latin-1"])
def test_encodings(tmp_path, encoding):
    check(write(tmp_path / "lab.csv", ["t [s];q1 [°];q2 [°]", *rows(scale=DEGREES, separator=";")], encoding))


def test_only_bad_rows_are_dropped_and_their_lines_are_reported(tmp_path):
    lines = ["time,q1,q2", *rows()]
    lines[4] = "x,y,0.5"
    lines[10] = "0.09,abc,0.5"
    lines[1] = lines[20] = "0.19,1.0"
    lines[30] = "0.29,,0.5"
    recording = read_recording(write(tmp_path / "lab.csv", lines))
    assert "lines 5, 11" in str([one for one in recording.findings if one.code == "not-a-number"])
    assert "lines 2, 21" in str(finding(recording.findings, "ragged-row"))
    values = recording.column("joint_1", "link_position").values
    assert len(recording.time) == N - 3
    assert np.isnan(values).sum() == 2
    assert recording.column("joint_2", "link_position").values[7] == 0.5


@pytest.mark.parametrize(
    ("mapping", "words"),
    [
        (["q1"], "COLUMN=JOINT.QUANTITY"),
        (["q1=elbow.link_positon"], "Did you mean 'link_position'"),
        (["q1=elbow.link_position [degg]"], "not a known unit"),
        (["absent=elbow.link_position"], "no such column"),
        (["q1=elbow.link_position [V]"], "is not a unit of link_position"),
        (["q1=elbow.link_position", "q2=elbow.link_position"], "second column for elbow.link_position"),
        (["absent=time"], "no such time column"),
        (["time=time [rad]"], "rad is not a unit of time"),
    ],
)
def test_bad_mappings_say_what_is_expected(tmp_path, mapping, words):
    path = write(tmp_path / "lab.csv", ["time,q1,q2", *rows()])
    with pytest.raises(RecordingError, match=words.replace(".", r"\.")):
        read_recording(path, mapping=mapping)


class TestRealRecordings:
    """Files of real machines, read as they are."""

    def test_quanser(self, shared):
        recording = read_recording(shared / "recordings" / "quanser_2dsfl_lqr_10deg.csv")
        assert recording.joints == ("joint_1", "joint_2")
        np.testing.assert_allclose(recording.time, 0.002 * np.arange(10_000), atol=1e-6)
        assert recording.column("joint_1", "motor_1_position").source == "hub1_rad"
        assert recording.column("joint_2", "reference_1").source == "hub2_ref_rad"
        assert recording.channels["current1_A"].quantity is None

    def test_hebi(self, shared):
        recording = read_recording(shared / "recordings" / "hebi_sine_1hz.csv")
        # The firmware computes the effort from the deflection, with its stiffness of 40 N m/rad.
        torque, deflection = (recording.column("joint_1", name).values for name in ("link_torque", "deflection"))
        assert np.max(np.abs(torque + 40.0 * deflection)) < 1e-6

    def test_emps(self, shared):
        recording = read_recording(shared / "recordings" / "emps_estimation.csv")
        assert [recording.column("joint_1", name).unit for name in ("link_position", "link_torque")] == ["m", "N"]
        assert len(recording.time) == 24_841


@pytest.mark.parametrize("value", ["1e308", "-1e40"])
@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_what_cannot_have_been_measured_is_no_number(tmp_path, value, unit):
    """Slopes, squares and units of such numbers overflow, wherever they are used."""
    lines = [f"time,q1 [{unit}]", *(f"{0.01 * i},{value if i == 7 else 0.1 * i}" for i in range(20))]
    values = read_recording(write(tmp_path / "a.csv", lines)).column("joint_1", "link_position").values
    assert np.flatnonzero(np.isnan(values)).tolist() == [7]


def test_without_a_header_columns_are_numbered_and_asked_about(tmp_path):
    path = write(tmp_path / "lab.csv", rows())
    with pytest.raises(RecordingError, match=r"none of the columns is a time: column_1, column_2.*--map COLUMN=time"):
        read_recording(path)
    check(path, mapping=["1=time", "2=joint_1.link_position", "3=joint_2.link_position"])


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ([], "file is empty"),
        (["# only", "# comments"], "holds no rows"),
        (["time,q1"], "no row of numbers"),
        (["time,q1", *["13/05/2024,1"] * 9], "(?s)none of the columns is a time.*time: text is not read"),
        (["V,rad.s", *["0.3,0.4", "0.5,0.5"] * 9], "none of the columns is a time"),
        (["time", *[f"{t}" for t in TIME]], "only a time column"),
        (["time,q1", "0.0,1"], "at least 2"),
        (["time,q1", *[f"{0.1 * t},1" for t in [0, 1, 2, 3, 4, 5, 0, 1, 2, 3, 4, 5]]], "lab.csv:8: time: 6 .*two recordings"),
        (["time,q1", *[f"{t},1" for t in [0.0, 0.1, 0.2, 1.7e9, 1.7e9 + 0.1, 1.7e9 + 0.2]]], "may contain two clocks"),
        (["time,q1", *[f"{0.1 * (i // 3)},1" for i in range(30)]], "20 repeated time stamps.*too few digits"),
        (["time,q1", *[f"{738000 + i * 1e-7:.9f},{i}" for i in range(50)]], "1e-07 units apart.*State the unit"),
        (["time,q1", *["1e308,1"] * 9], "time column has no number"),
        (["time,q1,q2", "1,2", "3,4", "5,6"], "header has 3 names, but the rows have 2"),
        (["<html>", "</html>"], "no row of numbers"),
        (["time,q1", '"' * 200_000], "no row of numbers"),
        (["ab\0cd"], "zero bytes"),
    ],
)
def test_what_is_no_recording_is_refused_with_the_reason(tmp_path, lines, message):
    (tmp_path / "lab.csv").write_text("\n".join(lines))
    with pytest.raises(RecordingError, match=message):
        read_recording(tmp_path / "lab.csv")


def test_missing_files_and_folders_without_bags_are_named(tmp_path):
    for path, message in ((tmp_path / "absent.csv", "no such file"), (tmp_path, r"metadata\.yaml")):
        with pytest.raises(RecordingError, match=message):
            read_recording(path)


@pytest.mark.parametrize("odd", ["0.05,9,9", "1e9,9,9"])
def test_samples_with_rising_times_are_kept_and_others_reported(tmp_path, odd):
    """A row that falls back or is far ahead, a repeated row, a stamp that differs by nothing, a stamp that is no number."""
    lines = ["time,q1,q2", *rows()]
    for place, line in ((45, "nan,9,9"), (38, f"{0.36 + 1e-300},9,9"), (30, odd), (12, lines[11])):
        lines.insert(place, line)
    recording = read_recording(write(tmp_path / "lab.csv", lines))
    np.testing.assert_allclose(recording.time, TIME, atol=1e-9)
    np.testing.assert_allclose(recording.column("joint_1", "link_position").values, Q1, atol=1e-9)
    assert finding(recording.findings, "repeated-time").line == 13
    assert finding(recording.findings, "falling-time").line == 32
    assert finding(recording.findings, "bad-time").line == 49
    assert finding(recording.findings, "bad-time").message.startswith("1 non-numeric time stamp, left out")


def test_a_time_of_day_without_seconds_is_asked_about(tmp_path):
    """Excel writes minutes and seconds like this."""
    with pytest.raises(RecordingError, match="time: text is not read"):
        read_recording(write(tmp_path / "lab.csv", ["time,q1,q2", *dated("09:{:05.2f}")]))


def test_a_time_in_two_columns_is_stated(tmp_path):
    path = write(tmp_path / "lab.csv", ["Date,Clock,q1,q2", *dated("2024-05-06,10:00:{:06.3f}")])
    with pytest.raises(RecordingError, match=r"state both: `time: \[sec, nanosec\]`"):
        read_recording(path)
    (tmp_path / "time.yaml").write_text("time: [Date, Clock]\n")
    check(path, mapping=tmp_path / "time.yaml")


STAMPS = ["sec,nanosec", "header.stamp.secs,header.stamp.nsecs", "t_sec,t_nsec", "Secs,Nsecs", "seconds,nanoseconds", "s,ns"]


@pytest.mark.parametrize("names", STAMPS)
def test_seconds_and_nanoseconds_of_one_stamp_are_its_time(tmp_path, names):
    path = write(tmp_path / "lab.csv", [f"{names},q1,q2", *dated("{0:.0f},{1:.0f}")])
    check(path)
    assert not read_recording(path).findings


@pytest.mark.parametrize("clock", [lambda t: f"{t // 0.1:.0f}", lambda t: f"2024-05-06 10:00:0{t // 0.1:.0f}"])
def test_a_clock_that_is_coarser_than_its_samples_is_refused_with_their_rate(tmp_path, clock):
    lines = [f"{clock(t + 1e-6)},{q:.9f}" for t, q in zip(TIME, Q1, strict=True)]
    with pytest.raises(RecordingError, match=r"has steps of 1 s, so 45 of 50 samples.*--rate 10;"):
        read_recording(write(tmp_path / "lab.csv", ["time,q1", *lines]))


@pytest.mark.parametrize(
    ("clock", "period"),
    [
        (lambda t: f"{['23:59:59', '00:00:00'][int(t >= 0.2 - 1e-9)]}.{round(800 + 1e3 * t) % 1000:03d}", "86400"),
        (lambda t: f"{(86399.8 + t) % 86400:.3f}", "86400"),
        (lambda t: f"{(2**16 - 200 + round(1e3 * t)) % 2**16}", "65536"),
    ],
)
def test_a_clock_that_restarts_goes_on(tmp_path, clock, period):
    unit = "" if period == "86400" else " [ms]"
    lines = [f"{clock(t)},{q:.12f}" for t, q in zip(TIME, Q1, strict=True)]
    recording = read_recording(write(tmp_path / "lab.csv", [f"time{unit},q1", *lines]))
    np.testing.assert_allclose(recording.time - recording.time[0], TIME, atol=1e-9)
    assert finding(recording.findings, "restarted-clock").message.startswith(f"restarts 1 time after {period}")


def test_a_flag_beside_a_time_is_no_time(tmp_path):
    file = write(tmp_path / "lab.csv", ["clock,t,q1,q2", *[f"{i % 2},{row}" for i, row in enumerate(rows())]])
    check(file)
    (found,) = (one for one in read_recording(file).findings if one.code == "second-time")
    assert (found.key, found.message) == ("clock", "is a second time column; 't' is used")


GROUPED = {
    "comma and points": (";", lambda t: f"{t:.2f}".replace(".", ","), lambda q: f"{q:,.2f}".translate({44: ".", 46: ","})),
    "point and commas": (";", lambda t: f"{t:.2f}", lambda q: f"{q:,.2f}"),
    "quoted": (",", lambda t: f'"{t:.2f}"'.replace(".", ","), lambda q: '"' + f"{q:,.2f}".translate({44: ".", 46: ","}) + '"'),
    "apostrophes": (",", lambda t: f"{t:.2f}", lambda q: f"{q:,.2f}".replace(",", "'")),
    "commas and a column of points": (";", lambda t: f"{t:.2f}".replace(".", ","), lambda q: f"{q:.4f}"),
    "a sign of typesetters": (",", lambda t: f"{t:.2f}", lambda q: f"{q:.2f}".replace("-", "\u2212")),
}
"""Separator, time and numbers of a thousand and more, as programs write them."""


@pytest.mark.parametrize("kind", GROUPED)
def test_groups_of_three_digits_belong_to_their_number(tmp_path, kind):
    separator, time, number = GROUPED[kind]
    lines = [separator.join((time(t), number(1e4 * a - 12345.0))) for t, a in zip(TIME, Q1, strict=True)]
    column = read_recording(write(tmp_path / "lab.csv", [f"t{separator}q1 [mdeg]", *lines])).channels["q1 [mdeg]"]
    np.testing.assert_allclose(np.degrees(column.values) * 1e3, 1e4 * Q1 - 12345.0, atol=0.006)


@pytest.mark.parametrize("mark", [".", ","])
def test_a_mark_that_may_group_or_be_decimal_is_asked_about(tmp_path, mark):
    other = {".": ",", ",": "."}[mark]
    lines = [f"{t:.2f}".replace(".", mark) + f";1{other}{round(500 + 100 * q)}" for t, q in zip(TIME, Q1, strict=True)]
    path = write(tmp_path / "lab.csv", ["t;q1 [mdeg]", *lines])
    with pytest.raises(RecordingError, match=rf"choose from 1500, 1\.5\b.*decimal: '{other}'|lab.csv:2: q1.*1500, 1.5"):
        read_recording(path)
    (tmp_path / "lab.csv.yaml").write_text(f"decimal: '{mark}'\n")
    np.testing.assert_allclose(np.degrees(read_recording(path).channels["q1 [mdeg]"].values[0]), 1.5)


@pytest.mark.parametrize("names", [("joint_1", "joint_2"), ("1", "2")])
def test_rows_of_joints_that_take_turns_become_columns(tmp_path, names):
    values = zip(TIME, Q1, Q2, strict=True)
    lines = [f"{t:.2f},{name},{q:.12f}" for t, *pair in values for name, q in zip(names, pair, strict=True)]
    path = write(tmp_path / "lab.csv", ["time,name,position", *lines])
    (tmp_path / "lab.csv.yaml").write_text("joint: name\n")
    check(path)
    for column, words in (("motor", "no such column"), ("time", "names 50 joints in 100 rows")):
        (tmp_path / "lab.csv.yaml").write_text(f"joint: {column}\n")
        with pytest.raises(RecordingError, match=f"joint: {column}: .*{words}"):
            read_recording(path)


def test_lines_above_a_stated_header_do_not_count(tmp_path):
    path = write(tmp_path / "lab.csv", [*["7;1"] * 180, "time,q1,q2", *rows()])
    (tmp_path / "lab.csv.yaml").write_text("header: 181\n")
    check(path)


def test_a_header_of_numbers_is_stated(tmp_path):
    path = write(tmp_path / "lab.csv", ["time,1,2", *rows()])
    with pytest.raises(RecordingError, match="none of the columns is a time: column_1"):
        read_recording(path)
    (tmp_path / "lab.csv.yaml").write_text("header: 1\nmap: {'1': joint_1.link_position, '2': joint_2.link_position}\n")
    check(path)


@pytest.mark.parametrize("above", [["time,q1,q2", "s,deg,deg"], ["time,q1,q2", "[s],[deg],(deg)"], ["s,deg,deg", "time,q1,q2"]])
def test_a_row_of_units_beside_the_header_states_the_units(tmp_path, above):
    check(write(tmp_path / "lab.csv", [*above, *rows(scale=DEGREES)]))


def test_a_row_of_units_belongs_to_a_stated_header(tmp_path):
    path = write(tmp_path / "lab.csv", ["time,q1,q2", "s,deg,deg", *rows(scale=DEGREES)])
    (tmp_path / "lab.csv.yaml").write_text(
        "header: 1\nmap: {q1: 'joint_1.link_position [deg]', q2: 'joint_2.link_position [deg]'}\n"
    )
    check(path)


@pytest.mark.parametrize(("missing", "words"), [(1, "1 missing sample;"), (5, "5 missing samples;")])
def test_every_missing_sample_is_counted(tmp_path, missing, words):
    time = np.delete(np.arange(100) * 0.01, range(40, 40 + missing))
    found = read_recording(write(tmp_path / "gap.csv", ["time,q1", *[f"{t:.3f},{t * t}" for t in time]])).findings
    assert finding(found, "dropped-samples").message.startswith(words)
    assert finding(found, "dropped-samples").line == 41


def test_a_second_time_among_the_signals_is_asked_about(tmp_path):
    lines = ["time,q1,time,q2", *[f"{0.01 * i:.3f},{0.1 * i},{0.013 * i:.3f},{-0.1 * i}" for i in range(30)]]
    path = write(tmp_path / "lab.csv", lines)
    with pytest.raises(RecordingError, match=r"second time column.*--map 'time#2=time'"):
        read_recording(path)
    second = read_recording(path, mapping=["time#2=time", "q1=ignore"])
    np.testing.assert_allclose(second.column("joint_2", "link_position").time, 0.013 * np.arange(30))


@pytest.mark.parametrize(("scale", "asked"), [(1.0, False), (1e3, True), (1e-4, True)])
def test_implausible_steps_of_time_are_asked_about(tmp_path, scale, asked):
    """In a column that states its unit; without a unit they are an error."""
    path = write(tmp_path / "lab.csv", ["time [s],q1,q2", *rows(time_scale=scale)])
    assert ("suspected-time" in codes(read_recording(path).findings)) == asked
    write(path, ["time,q1,q2", *rows(time_scale=scale)])
    if asked:
        with pytest.raises(RecordingError, match="is the time in another unit than s"):
            read_recording(path)
    else:
        check(path)
