"""Signals with times of their own, side by side or a row each: every one keeps its name, its unit and when it was measured."""

from __future__ import annotations

import json
from collections.abc import Callable
from itertools import zip_longest
from pathlib import Path

import numpy as np
import pytest
from lab_files import DEGREES, TIME, A, B, elbow, shoulder, table
from scipy.io import savemat

from asrsim.errors import RecordingError
from asrsim.recordings import Recording, read_recording

pytestmark = pytest.mark.once

JOINTS = ("joint_1", "joint_2")
LATER = 0.703 + TIME[: len(TIME) // 2] * 2
"""s: the second joint's own times, half as many, that begin later and between those of the first."""
SIGNALS = (("1", TIME, shoulder), ("2", LATER, elbow))


def pairs(before: str, scale: float = DEGREES) -> str:
    """A time and a value of each signal side by side, the shorter ones filled with blanks."""
    both = [zip(time, of(time) * scale, strict=True) for _, time, of in SIGNALS]
    rows = ("\t".join("\t" if one is None else f"{one[0]:.9g}\t{one[1]:.9g}" for one in row) for row in zip_longest(*both))
    return before + "\n".join(rows) + "\n"


def rows(before: str, line: str, *, sort: bool = False) -> str:
    """A row a signal and time, one signal after the other, or in the order of their times."""
    every = [(t, name, q) for name, time, of in SIGNALS for t, q in zip(time, of(time), strict=True)]
    every = sorted(every) if sort else every
    return before + "".join(
        line.format(t=t, n=name, q=q, deg=q * DEGREES, ms=t * 1e3, unix=1.7e9 + t) + "\n" for t, name, q in every
    )


def objects(of: Callable[[str, np.ndarray, np.ndarray], dict[str, object]]) -> list[dict[str, object]]:
    return [of(name, time, values(time) * DEGREES) for name, time, values in SIGNALS]


LABVIEW = (
    "LabVIEW Measurement\t\nX_Columns\tMulti\n***End_of_Header***\t\n\t\nChannels\t2\t\t\t\t\nSamples\t300\t\t150\t\t\n"
    "Y_Unit_Label\tDegrees\t\tDegrees\t\t\nX_Dimension\tTime\t\tTime\t\t\nX0\t0\t\t0.703\t\t\nDelta_X\t0.01\t\t0.02\t\t\n"
    "***End_of_Header***\t\t\t\t\nX_Value\tq1\tX_Value\tq2\tComment\n"
)
INFLUX = (
    "#group,false,false,true,false,false,true\n#datatype,string,long,dateTime:RFC3339,double,string,string\n#default,_result,,,,,\n"
    ",result,table,_time,_value,_field,joint\n"
)
OWN_TIMES: dict[str, str] = {
    "LabVIEW": pairs(LABVIEW),
    "units in the header": pairs("t1 [s]\tq1 [deg]\tt2 [s]\tq2 [deg]\n"),
    "units in a row": pairs("time\tq1\ttime\tq2\ns\tdeg\ts\tdeg\n"),
    "named series of JSON": json.dumps(
        {"channels": objects(lambda name, t, q: {"name": f"q{name}", "unit": "deg", "time": t.tolist(), "values": q.tolist()})}
    ),
    "series by their name in JSON": json.dumps(
        {f"q{i + 1}": one for i, one in enumerate(objects(lambda _, t, q: {"t": t.tolist(), "q": q.tolist(), "unit": "deg"}))}
    ),
    "a joint a row": rows("time,joint,position\n", "{t},joint_{n},{q}"),
    "a joint a row, by time": rows("time [ms],name,position [deg]\n", "{ms},joint_{n},{deg}", sort=True),
    "a number a row": rows("time,joint_id,q\n", "{t},{n},{q}"),
    "pandas' melt": rows("time,variable,value\n", "{t},q{n}_deg,{deg}"),
    "its index, too": rows(",time,variable,value\n", "7,{t},q{n},{q}"),
    "units of each row": rows("time;name;value;unit\n", "{t};q{n};{deg};deg"),
    "R": rows('"time","name","value"\n', '{t},"q{n}",{q}', sort=True),
    "InfluxDB": rows(INFLUX, ",,0,{unix:.3f},{q},position,joint_{n}"),
    "its tables apart": rows(INFLUX, ",,0,{unix:.3f},{q},position,joint_{n}").replace(
        f",,0,{1.7e9 + LATER[0]:.3f}", f"\n{INFLUX},,1,{1.7e9 + LATER[0]:.3f}"
    ),
    "joint and quantity": rows("time,joint,quantity,value\n", "{t},joint_{n},position,{q}\n{t},joint_{n},velocity,0"),
    "records of JSON": rows("", '{{"t": {t}, "joint": "joint_{n}", "position": {q}}}'),
}


def read(folder: Path, content: str, **options: object) -> Recording:
    (folder / "lab.txt").write_text(content, encoding="utf-8")
    return read_recording(folder / "lab.txt", joints=JOINTS, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", OWN_TIMES)
def test_each_signal_keeps_its_own_time_name_and_unit(tmp_path: Path, name: str) -> None:
    recording = read(tmp_path, OWN_TIMES[name])
    for joint, (_, time, of) in zip(JOINTS, SIGNALS, strict=True):
        column = recording.column(joint, "link_position")
        np.testing.assert_allclose(column.time, time, atol=3e-7)
        np.testing.assert_allclose(column.values, of(time), atol=1e-7)


ORDERS = {
    "times before signals": "q1_time,q2_time,q1,dq1,q2,dq2",
    "times behind signals": "q1,dq1,q1_time,q2,dq2,q2_time",
    "times behind signals, without names": "q1,dq1,time,q2,dq2,time",
    "a time before each joint's": "time,q1,dq1,time,q2,dq2",
    "times behind signals, and a remark": "q1,dq1,time,q2,dq2,time,remark",
    "a date, and times behind signals": "date,q1,dq1,time,q2,dq2,time,",
}
TEXTS = {"remark": "as it was", "date": "2026-11-02", "": ""}
"""Columns that are no signals -> what stands in them."""


@pytest.mark.parametrize("name", [*ORDERS, "arrays of numpy", "variables of MATLAB"])
@pytest.mark.parametrize("slower", [1.0, 1.3])
def test_times_belong_to_the_signals_that_they_are_named_after_or_stand_beside(
    tmp_path: Path, name: str, slower: float
) -> None:
    """Where they are of one length, too, and whether they only begin later or go otherwise."""
    late = slower * TIME + 0.253
    truth = {"1": (TIME, shoulder(TIME), np.cos(TIME)), "2": (late, elbow(late), np.sin(late))}
    if name in ORDERS:
        columns = []
        for label in (label for label in ORDERS[name].split(",") if label not in TEXTS):
            joint = next((word for word in label if word.isdigit()), "2" if len(columns) > 2 else "1")
            columns.append(truth[joint][0 if "time" in label else 2 if label.startswith("d") else 1])
        rows = table(columns).decode().splitlines()
        first, last = (TEXTS.get(ORDERS[name].split(",")[end]) for end in (0, -1))
        rows = [",".join(part for part in (first, row, last) if part is not None) for row in rows]
        recording = read(tmp_path, "\n".join([ORDERS[name], *rows]) + "\n")
    else:
        names = ("q{}_time", "q{}", "dq{}")
        arrays = {what.format(joint): one for joint, own in truth.items() for what, one in zip(names, own, strict=True)}
        path = tmp_path / ("lab.npz" if "numpy" in name else "lab.mat")
        if "numpy" in name:
            np.savez(path, **arrays)
        else:
            savemat(path, arrays)
        recording = read_recording(path, joints=JOINTS)
    for joint, (time, position, velocity) in zip(JOINTS, truth.values(), strict=True):
        for quantity, values in (("link_position", position), ("link_velocity", velocity)):
            column = recording.column(joint, quantity)
            np.testing.assert_allclose(column.time, time, atol=1e-7)
            np.testing.assert_allclose(column.values, values, atol=1e-7)


def test_which_time_a_vector_is_of_is_asked_about_where_no_name_says_it(tmp_path: Path) -> None:
    np.savez(tmp_path / "lab.npz", t_cmd=1.2 * TIME, t_state=TIME, q1=A, q1_cmd=B)
    recording = read_recording(tmp_path / "lab.npz", joints=JOINTS)
    assert [one.key for one in recording.findings if one.code == "second-time-base"] == ["q1"]
    np.testing.assert_allclose(recording.column("joint_1", "reference_1").time, 1.2 * TIME)


def test_lists_and_records_in_cells_of_parquet_are_columns(tmp_path: Path) -> None:
    """As robots that learn record their states."""
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    both = np.c_[A, B].tolist()
    for name, cells in (
        ("list", arrow.array(both)), ("fixed", arrow.array(both, arrow.list_(arrow.float64(), 2))),
        ("record", arrow.array([{"joint_1": a, "joint_2": b} for a, b in both])),
    ):  # fmt: skip
        seen = [[0] * 99] * len(TIME)
        parquet.write_table(arrow.table({"q": cells, "timestamp": TIME, "camera": seen}), tmp_path / f"{name}.parquet")
        recording = read_recording(tmp_path / f"{name}.parquet", joints=JOINTS)
        assert [one.key for one in recording.findings if one.code == "text-column"] == ["camera"]
        for joint, values in zip(JOINTS, (A, B), strict=True):
            np.testing.assert_allclose(recording.column(joint, "link_position").values, values)


def test_rows_of_the_same_instants_share_their_time(tmp_path: Path) -> None:
    content = "t,joint,q\n" + "".join(
        f"{t},joint_{n},{q}\n" for n, of in ((1, A), (2, B)) for t, q in zip(TIME, of, strict=True)
    )
    recording = read(tmp_path, content)
    assert recording.column("joint_1", "link_position").time is recording.column("joint_2", "link_position").time
    assert [str(one.message) for one in recording.findings if one.code == "long-table"] == [
        "has a row for each 'joint' at each 't', 2 in all; each is read as columns of its own"
    ]


@pytest.mark.parametrize("key", ["run", "episode_index", "mode"])
def test_runs_below_each_other_are_no_signals(tmp_path: Path, key: str) -> None:
    content = f"t,{key},q1\n" + "".join(f"{t},{n},{q}\n" for n in (1, 2) for t, q in zip(TIME, A, strict=True))
    with pytest.raises(RecordingError, match="two recordings in one file"):
        read(tmp_path, content)


@pytest.mark.parametrize("told", ["X0\t0\t0.5\t\nDelta_X\t0.01\t0.01\t\n", "X0\t0\t0\t\nDelta_X\t0.01\t0.02\t\n"])
def test_channels_of_labview_that_one_column_of_times_cannot_tell_are_refused(tmp_path: Path, told: str) -> None:
    before = (
        f"X_Columns\tOne\n***End_of_Header***\t\nChannels\t2\t\n{told}***End_of_Header***\t\t\t\nX_Value\tq1\tq2\tComment\n"
    )
    with pytest.raises(RecordingError, match="X_Columns Multi"):
        read(tmp_path, table([TIME, A, B], sep="\t", before=before).decode())


def test_opensim_says_once_that_angles_are_in_degrees(tmp_path: Path) -> None:
    """Torques and what states its unit are not turned."""
    truth = {("joint_1", "link_position"): A, ("joint_2", "link_position"): B, ("joint_1", "link_velocity"): B,
             ("joint_1", "link_torque"): A}  # fmt: skip
    columns = [TIME, A * DEGREES, B, B * DEGREES, A]
    content = table(columns, sep="\t", before="Coordinates\ninDegrees=yes\nendheader\ntime\tq1\tq2 [rad]\tdq1\ttau1\n").decode()
    recording = read(tmp_path, content)
    for (joint, quantity), values in truth.items():
        np.testing.assert_allclose(recording.column(joint, quantity).values, values, atol=1e-8)
    mapped = read(tmp_path, content, mapping=["q1=joint_2.link_position", "q2 [rad]=ignore"])
    np.testing.assert_allclose(mapped.column("joint_2", "link_position").values, A, atol=1e-8)
    turned = read(tmp_path, content.replace("yes", "no"))
    np.testing.assert_allclose(turned.column("joint_1", "link_position").values, A * DEGREES, atol=1e-6)
