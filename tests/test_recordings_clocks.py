"""Clocks, headers and messages: what a number means, over all units, zeros and namespaces, against what was put in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from asrsim.errors import RecordingError
from asrsim.recordings import read_recording, resample
from asrsim.recordings.mapping import load_mapping
from asrsim.recordings.messages import understand
from asrsim.recordings.timebase import clean_time, lines_text, scale_time

pytestmark = pytest.mark.once

UNITS = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
"""Of each in a second."""
PLACE = {"path": Path("lab.csv"), "name": "t"}
UNIX = 1.7e9
"""s since 1970, in 2023."""


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("zero", [0.0, 3.0, 5e4, -5.0, -2e6, UNIX])
@pytest.mark.parametrize("step", [0.001, 0.005, 0.01])
def test_time_without_a_unit_is_that_of_its_steps_or_of_its_date(unit: str, zero: float, step: float) -> None:
    """Also of clocks that count down to an event, whatever they began at."""
    seconds = np.arange(400) * step
    time, origin, findings = scale_time((seconds + zero) * UNITS[unit], None, **PLACE)
    dated = zero == UNIX
    np.testing.assert_allclose(time, seconds if dated else seconds + zero, rtol=1e-12, atol=3e-7 if dated else 1e-9)
    assert origin == (pytest.approx(UNIX, abs=1e-6) if dated else None)
    assert [one.code for one in findings] == ([] if unit == "s" else ["time-unit-assumed"])
    assert all(f"read as {unit}," in str(one) and one.file == PLACE["path"] and one.key == "t" for one in findings)
    again, known, silent = scale_time((seconds + zero) * UNITS[unit], 1.0 / UNITS[unit], **PLACE)
    np.testing.assert_array_equal(again, time)
    assert (known, silent) == (origin, [])


def test_what_is_dropped_of_a_clock_is_counted_and_nothing_else() -> None:
    time = np.arange(200) * 0.01
    bad = time.copy()
    bad[[20, 21]] = np.nan
    bad[50] = bad[49]
    bad[[80, 81, 82]] = bad[70]
    bad[120] = 999.0
    keep, findings = clean_time(bad, np.arange(200) + 2, **PLACE)
    assert np.flatnonzero(~keep).tolist() == [20, 21, 50, 80, 81, 82, 120]
    told = {one.code: (one.line, str(one)) for one in findings}
    assert {code: line for code, (line, _) in told.items()} == {
        "bad-time": 22, "stray-time": 122, "duplicate-time": 52, "backward-time": 82, "dropped-samples": 21,
    }  # fmt: skip
    assert "2 lines without a valid time are dropped: lines 22, 23" in told["bad-time"][1]
    assert "3 time stamps that go backward, dropped: lines 82, 83, 84" in told["backward-time"][1]
    assert "7 samples are missing in 4 gaps; the longest is 0.04 s at t = 0.79 s after line 81" in told["dropped-samples"][1]
    keep, findings = clean_time(time, None, **PLACE)
    assert keep.all()
    assert findings == []


def test_gaps_and_jitter_are_told_from_where_they_are_some() -> None:
    """A step of 1.6 periods is jitter, one of 1.8 a gap of one sample; a hundredth of a period is no jitter."""
    for share, code in ((1.6, "jitter"), (1.8, "dropped-samples")):
        steps = np.full(99, 0.01)
        steps[[30, 60]] *= share
        _, findings = clean_time(np.r_[0.0, np.cumsum(steps)], None, **PLACE)
        assert [one.code for one in findings] == [code]
    for share, codes in ((0.009, []), (0.011, ["jitter"])):
        steps = 0.01 * (1.0 + share * (-1.0) ** np.arange(100))
        _, findings = clean_time(np.r_[0.0, np.cumsum(steps)], None, **PLACE)
        assert [one.code for one in findings] == codes
    assert "0.11 ms" in str(findings[0])


@pytest.mark.parametrize(("count", "words"), [(1, "line 4"), (3, "lines 4, 5, 6"), (8, "lines 4, 5, 6, 7, 8, 9, 10, 11"),
                                              (9, "lines 4, 5, 6, 7, 8, 9, 10, 11, ... (9 in all)")])  # fmt: skip
def test_lines_are_listed_up_to_eight(count: int, words: str) -> None:
    assert lines_text(list(range(4, 4 + count))) == words


ROWS = "\n".join(f"{0.01 * i:.2f},{0.1 * i:.3f},{0.2 * i:.3f},{0.3 * i:.3f}" for i in range(30)) + "\n"


@pytest.mark.parametrize("header", ["t,q1,q2\n", "t,q1,q2,q3,q4,q5\n"])
def test_a_header_of_another_length_is_told(tmp_path: Path, header: str) -> None:
    (tmp_path / "lab.csv").write_text(header + ROWS)
    with pytest.raises(RecordingError, match=f"the header has {header.count(',') + 1} names, its rows have 4 fields"):
        read_recording(tmp_path / "lab.csv")


def test_two_names_over_three_columns_are_a_header_of_another_length(tmp_path: Path) -> None:
    (tmp_path / "lab.csv").write_text("t,q1\n" + "".join(f"{0.01 * i:.2f},{0.1 * i:.3f},{i}.5\n" for i in range(30)))
    with pytest.raises(RecordingError, match="the header has 2 names, its rows have 3 fields"):
        read_recording(tmp_path / "lab.csv")


@pytest.mark.parametrize("above", ["Laboratory\n", "robot,AlterEgo\n", "operator,Ada\nrobot,arm\n", "serial,12,34,5,6\n"])
def test_a_title_and_pairs_of_key_and_value_are_no_header(tmp_path: Path, above: str) -> None:
    (tmp_path / "lab.csv").write_text(above + "t,q1,q2,q3\n" + ROWS)
    recording = read_recording(tmp_path / "lab.csv")
    for number in (1, 2, 3):
        values = recording.column(f"joint_{number}", "link_position").values
        np.testing.assert_allclose(values, 0.1 * number * np.arange(30), atol=1e-9)


@pytest.mark.parametrize("space", ["", "/arm", "/lab/arm"])
def test_topics_name_joint_and_quantity_below_any_namespace(space: str) -> None:
    state, number, real = "asrsim_msgs/msg/LinkState", "std_msgs/msg/Float64", "sensor_msgs/msg/JointState"
    assert understand(f"{space}/elbow/link_state", state, "q", None) == ("elbow", "link_position", "")
    assert understand(f"{space}/elbow/link_state", state, "dq", None) == ("elbow", "link_velocity", "")
    assert understand(f"{space}/elbow/link_state", state, "tau", None) == ("elbow", "link_torque", "")
    assert understand(f"{space}/elbow/link_state", state, "stiff", None) == ("elbow", "stiffness", "")
    assert understand(f"{space}/elbow/link_state", state, "other", None) == (None, None, "")
    assert understand(f"{space}/elbow/torque_el1_state", number, "data", None) == ("elbow", "elastic_torque_1", "")
    assert understand(f"{space}/elbow/motor_2_command", number, "data", None) == ("elbow", "reference_2", "")
    assert understand(f"{space}/reference_2", number, "data[3]", None) == (None, "reference_2", "")
    assert understand(f"{space}/joint_states", real, "position[elbow]", "elbow") == ("elbow", "link_position", "")
    assert understand(f"{space}/motor_1_states", real, "velocity[elbow]", "elbow") == ("elbow", "motor_1_velocity", "")
    assert understand(f"{space}/joint_command", real, "position[elbow]", "elbow") == ("elbow", "reference_1", "")
    assert understand(f"{space}/joint_command", real, "effort[elbow]", "elbow") == ("elbow", None, "")
    point = f"{space}/controller/state"
    assert understand(point, "x", "actual.positions[elbow]", "elbow") == ("elbow", "link_position", "")
    assert understand(point, "x", "feedback.effort[elbow]", "elbow") == ("elbow", "link_torque", "")
    assert understand(point, "x", "desired.positions[elbow]", "elbow") == ("elbow", "reference_1", "")
    assert understand(point, "x", "desired.velocities[elbow]", "elbow") == ("elbow", None, "")
    assert understand(point, "x", "error.positions[elbow]", "elbow") == ("elbow", None, "")


@pytest.mark.parametrize("text", ["columns: [", "- a\n- b\n", "columns: 3\n", "columns: {q1: nonsense}\n", "\ufffe"])
def test_an_error_in_a_mapping_file_names_that_file(tmp_path: Path, text: str) -> None:
    path = tmp_path / "lab.map.yaml"
    path.write_text(text)
    with pytest.raises(RecordingError) as caught:
        load_mapping(path)
    assert {problem.file for problem in caught.value.problems} == {path}
    with pytest.raises(RecordingError) as caught:
        load_mapping(tmp_path / "gone.yaml")
    assert [problem.file for problem in caught.value.problems] == [tmp_path / "gone.yaml"]


@pytest.mark.parametrize("grid_step", [0.001, 0.005, 0.01, 0.02, 0.05])
def test_resampling_ends_half_a_step_beyond_the_ends_and_leaves_out_gaps(grid_step: float) -> None:
    """Half a step of the finer of both; a gap of three steps is bridged, one of four is not."""
    time = np.arange(101) * 0.01
    values = np.sin(4 * time)
    half = 0.5 * min(0.01, grid_step)
    wide = np.arange(-0.1, 1.1, grid_step)
    found = resample(time, values, wide)
    known = (wide >= -half - 1e-12) & (wide <= 1.0 + half + 1e-12)
    assert np.isfinite(found[known]).all()
    assert np.isnan(found[~known]).all()
    np.testing.assert_allclose(found[known], np.sin(4 * np.clip(wide[known], 0.0, 1.0)), atol=2e-4)
    out, within = 1.01 * half, 0.99 * half
    ends = np.array([-out, -within, 1.0 + within, 1.0 + out])
    beyond = np.r_[ends, ends[-1] + grid_step * np.arange(1, 9)]
    assert np.isfinite(resample(time, values, beyond)[:4]).tolist() == [False, True, True, False]
    for missing, bridged in ((2, True), (3, False)):
        keep = np.ones(len(time), dtype=bool)
        keep[50 : 50 + missing] = False
        inside = time[49] + 0.001 + np.arange(missing * 10) * 0.001
        assert np.isfinite(resample(time[keep], values[keep], inside)).all() == bridged
        assert np.isfinite(resample(time[keep], values[keep], time[[49, 50 + missing]])).all()
