"""One motion of two joints, written to files in the many ways of laboratories."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

COUNT = 300
TIME = np.arange(COUNT) / 100.0
DEGREES = 180 / np.pi


def shoulder(time: Any) -> Any:
    return 0.6 * np.sin(2 * np.pi * 0.5 * time) * np.exp(-0.2 * time) + 0.1 * time


def elbow(time: Any) -> Any:
    return 0.32 * (1 - np.cos(2 * np.pi * 0.7 * time))


def command(time: Any) -> Any:
    return np.where(time > 1, 0.5, 0.0) + 0.05 * np.sin(3 * time)


A, B, R = shoulder(TIME), elbow(TIME), command(TIME)
STAMPS = [datetime(2024, 5, 6, 10) + timedelta(seconds=float(t)) for t in TIME]
ORDER = np.arange(COUNT)
HOLE = np.where((TIME >= 1.0) & (TIME < 1.4), np.nan, A)
JITTER = TIME + np.random.default_rng(0).normal(0, 0.001, COUNT)
KEPT = np.random.default_rng(1).random(COUNT) > 0.1


def table(
    columns: Sequence[Any], *, sep: str = ",", dec: str = ".", number: str = "%.9g", end: str = "\n", tail: str = "",
    before: str = "", encoding: str = "utf-8",
) -> bytes:  # fmt: skip
    """The text before the numbers, and the rows."""
    rows = [
        sep.join(cell if isinstance(cell, str) else (number % cell).replace(".", dec) for cell in row)
        for row in zip(*columns, strict=True)
    ]
    text = "".join(row + tail + end for row in rows)
    return (before.replace("\n", end) + text).encode(encoding)


def swapped(pairs: Sequence[tuple[int, int]]) -> np.ndarray:
    order = ORDER.copy()
    for i, j in pairs:
        order[[i, j]] = order[[j, i]]
    return order


def moved(order: np.ndarray) -> list[np.ndarray]:
    return [TIME[order], A[order], B[order]]


def texts(values: Any, pattern: str) -> list[str]:
    return [pattern % value for value in values]


ABQ = [TIME, A, B]
DEG = [TIME, A * DEGREES, B * DEGREES]
GERMAN = {"sep": ";", "dec": ","}


def echoed(stamp: str, names: str, *, lists: bool, before: str = "") -> bytes:
    """A joint state after the other as `rostopic echo` prints them; `lists`: an entry a line, as ROS 2 does."""
    order = (B, A) if names.startswith("elbow") else (A, B)
    entries = names.split()
    text = before
    for time, *values in zip(TIME, *order, strict=True):
        text += f"header:\n  stamp:\n    {stamp % divmod(round(1.7e9 * 1000 + time * 1000), 1000)}000000\n  frame_id: ''\n"
        for key, cells in ("name", entries), ("position", [f"{value:.9g}" for value in values]), ("effort", []):
            block = "".join(f"\n- {cell}" for cell in cells) or " []"
            text += f"{key}:{block if lists else ' [' + ', '.join(cells) + ']'}\n"
        text += "---\n"
    return text.encode()


READ: dict[str, bytes] = {
    "german excel": table(DEG, **GERMAN, before="\ufeffZeit [s];Winkel1 [°];Winkel2 [°]\n"),
    "german latin-1": table(DEG, **GERMAN, before="Zeit (s);Winkel 1 (°);Winkel 2 (°)\n", encoding="latin-1"),
    "german joints": table([TIME, A * DEGREES, R * DEGREES, B * DEGREES], **GERMAN,
                           before="Zeit;Gelenk1_Ist [Grad];Gelenk1_Soll [Grad];Gelenk2_Ist [Grad]\n"),
    "german values": table([TIME * 1e3, A * DEGREES, B * DEGREES], **GERMAN,
                           before="Zeit [ms];Istwert Achse 1 [°];Istwert Achse 2 [°]\n"),
    "italian": table([*ABQ, R], before="tempo [s],posizione_1 [rad],posizione_2 [rad],riferimento_1 [rad]\n"),
    "italian degrees": table(DEG, **GERMAN, before="Tempo(s);Angolo giunto 1 (gradi);Angolo giunto 2 (gradi)\n"),
    "french": table([*DEG, R * DEGREES], before="temps (s),angle_1 (deg),angle_2 (deg),consigne_1 (deg)\n"),
    "spanish": table(ABQ, before="tiempo,posicion_1,posicion_2\n"),
    "tab, degrees": table(DEG, sep="\t", before="t\tq1 [deg]\tq2 [deg]\n"),
    "units below": table([TIME * 1e3, A * DEGREES, B * DEGREES], before="time,Position_1,Position_2\n[ms],[deg],[deg]\n"),
    "groups, names, units": table(DEG, before="Time,Axis 1,Axis 2\n,Position,Position\ns,deg,deg\n"),
    "groups, names": table([TIME, A, 0 * A, B, 0 * B],
                           before=",Joint 1,,Joint 2,\nTime (s),Position (rad),Flag,Position (rad),Flag\n"),
    "labview": table(ABQ, sep="\t", before="LabVIEW Measurement\t\nDate\t2024/05/06\n***End_of_Header***\t\n\t\n"
                     "Channels\t2\t\nSamples\t400\t400\nX_Value\tq1\tq2\tComment\n"),
    "preamble": table(ABQ, sep=";", before="descriptor\nfile;lab.csv\nrate;100\n\ntime;q_1;q_2\n"),
    "comments": table(ABQ, before="% recorded 2024\n% robot: arm\nt,q_1,q_2\n"),
    "words": table(ABQ, before="Time (s),Joint 1 Position (rad),Joint 2 Position (rad)\n"),
    "joint names": table([*ABQ, R], before="time,shoulder/position,elbow/position,shoulder/command\n"),
    "dots": table(ABQ, before="time,joints.shoulder.q,joints.elbow.q\n"),
    "camels": table([*ABQ, R], before="Time,ShoulderPosition,ElbowPosition,ShoulderSetpoint\n"),
    "plotjuggler": table([TIME + 1.7e9, A, B], number="%.15g",
                         before="__time,/joint_states/shoulder/position,/joint_states/elbow/position\n"),
    "rostopic echo": table([texts(1.7e18 + TIME * 1e9, "%d"), texts(ORDER, "%d"), ["shoulder"] * COUNT, A, B],
                           before="%time,field.header.seq,field.name0,field.position0,field.position1\n"),
    "array columns": table([*ABQ, R], before="t,q[0],q[1],q_ref[0]\n"),
    "milliseconds": table([TIME * 1e3, A, B], before="time_ms,q1,q2\n"),
    "microseconds unsaid": table([TIME * 1e6, A, B], before="timestamp,q1,q2\n"),
    "nanoseconds since 1970": table([texts(1.7e18 + np.round(TIME * 1e9), "%d"), A, B], before="timestamp,q1,q2\n"),
    "iso stamps": table([[s.isoformat(timespec="microseconds") for s in STAMPS], A, B], before="stamp,q1,q2\n"),
    "date and time": table([["06.05.2024"] * COUNT, [s.strftime("%H:%M:%S.%f") for s in STAMPS], A, B], sep=";",
                           before="Datum;Uhrzeit;q1;q2\n"),
    "am and pm": table([[(s + timedelta(hours=1, minutes=59, seconds=58)).strftime("%m/%d/%Y %I:%M:%S.%f %p") for s in STAMPS],
                        A, B], before="Timestamp,q1,q2\n"),
    "seconds and nanoseconds": table([texts(1.7e9 + np.floor(TIME + 1e-9), "%d"),
                                      texts(np.round((TIME + 1e-9) % 1 * 1e9), "%d"), A, B], before="secs,nsecs,q1,q2\n"),
    "jitter": table([JITTER, shoulder(JITTER), elbow(JITTER)], before="t,q1,q2\n"),
    "drops": table(moved(ORDER[KEPT]), before="t,q1,q2\n"),
    "duplicates": table(moved(np.sort(np.r_[ORDER, 50, 51, 200])), before="t,q1,q2\n"),
    "backward": table(moved(swapped([(100, 101), (200, 201)])), before="t,q1,q2\n"),
    "no number": table([TIME, HOLE, B], before="t,q1,q2\n"),
    "empty cells": table([TIME, ["" if np.isnan(v) else f"{v:.9g}" for v in HOLE], B], sep=";", before="t;q1;q2\n"),
    "marked by -9999": table([TIME, np.where(np.isnan(HOLE), -9999, HOLE), B], before="t,q1,q2\n"),
    "trailing commas": table(ABQ, tail=",", before="t,q1,q2,\n"),
    "crlf": table(ABQ, end="\r\n", before="t,q1,q2\n"),
    "cr": table(ABQ, end="\r", before="t,q1,q2\n"),
    "quoted": table([texts(column, '"%.9g"') for column in DEG], before='"Time [s]","q1 [deg]","q2 [deg]"\n'),
    "commas in names": table(DEG, before='"Time, s","Position, joint 1, deg","Position, joint 2, deg"\n'),
    "a thousand columns": table([*ABQ, *(0 * A + i for i in range(1000))],
                                before="t,q1,q2," + ",".join(f"ch{i}" for i in range(1000)) + "\n"),
    "millidegrees": table([TIME, A * DEGREES * 1e3, B * DEGREES * 1e3], before="t,q1 [mdeg],q2 [mdeg]\n"),
    "milliradians": table([TIME, A * 1e3, B * 1e3], before="t,q1 [mrad],q2 [mrad]\n"),
    "fortran": table([[f"{v:.10E}".replace("E", "D") for v in column] for column in ABQ], sep="  ", before="t q1 q2\n"),
    "aligned by spaces": table([texts(column, "%12.6f") for column in ABQ], sep=" ", before="t q1 q2\n"),
    "utf-16": table(ABQ, sep="\t", before="t\tq1\tq2\n", encoding="utf-16"),
    "row numbers": table([texts(ORDER, "%d"), *ABQ], before=",time,q1,q2\n"),
    "actual and desired": table([*ABQ, R, B], before="time,q_actual_1,q_actual_2,q_desired_1,q_desired_2\n"),
    "thetas": table([*ABQ, R], before="t,theta1,theta2,theta1_d\n"),
    "savetxt": table(ABQ, sep=" ", before="# time q1 q2\n"),
    "units among words": table(DEG, before="t,q_deg_1,degQ2\n"),
    "the stamp of a sample": table([1.0 * (ORDER % 7), *ABQ], before="delay time,sample_timestamp,q1,q2\n"),
    "units glued on": table([TIME * 1e3, A * DEGREES, B * DEGREES], before="t/ms,q1deg,q2/deg\n"),
    "hours": table([TIME / 3600, A, B], before="time [h],q1,q2\n", number="%.12g"),
    "MATLAB's days": table([TIME / 86400 + 739378, A, B], before="time,q1,q2\n", number="%.17g"),
    "Excel's days": table([TIME / 86400 + 45418, A, B], before="time,q1,q2\n", number="%.17g"),
    "stamps with slashes": table([[s.strftime("%Y/%m/%d/%H:%M:%S.%f") for s in STAMPS], A, B], before="time,q1,q2\n"),
    "compact stamps": table([[s.strftime("%Y%m%d_%H%M%S.%f") for s in STAMPS], A, B], before="time,q1,q2\n"),
    "milliseconds behind a colon": table([[s.strftime("%H:%M:%S:%f") for s in STAMPS], A, B], before="time,q1,q2\n"),
    "utf-16 without a mark": table(ABQ, before="t,q1,q2\n", encoding="utf-16-le"),
    "zeros at the end": table(ABQ, before="t,q1,q2\n") + bytes(100),
    "a comment of units": table(DEG, before="# units: s, deg, deg\nt,q1,q2\n"),
    "a loop's duration": table([TIME, 0.00101 + 0 * TIME, A, B], before="time,loop_time_ms,q1,q2\n", number="%.12g"),
    "units in JSON": json.dumps({"units": {"q1": "deg", "q2": "deg"}, "t": [*TIME], "q1": [*(A * DEGREES)],
                                 "q2": [*(B * DEGREES)]}).encode(),
    "records by their index": json.dumps(
        {i: {"t": row[0], "q1": row[1], "q2": row[2]} for i, row in enumerate(zip(*ABQ, strict=True))}
    ).encode(),
    "rostopic echo in YAML": echoed("secs: %d\n    nsecs: %d", "shoulder elbow", lists=False),
    "ros2 topic echo": echoed("sec: %d\n    nanosec: %d", "elbow shoulder", lists=True),
    "an echo that was cut off": echoed("secs: %d\n    nsecs: %d", "shoulder elbow", lists=True)[:-40],
    "two clocks": table([TIME, A, TIME + 0.003, elbow(TIME + 0.003)], before="t,q1,time_2,q2\n"),
}  # fmt: skip
"""Name -> file whose motion must come out right with nothing said about it."""

REFUSED: dict[str, tuple[bytes, str]] = {
    "empty": (b"", "the file is empty"),
    "header only": (b"t,q1,q2\n", "no row of numbers found"),
    "one row": (b"t,q1,q2\n0,1,2\n", "at least 2 are needed"),
    "no time": (table([A, B], before="q1,q2\n"), "no time column found among q1, q2.*--rate"),
    "a counter": (table([texts(ORDER, "%d"), A, B], before="sample,q1,q2\n"), "'sample' counts the rows.*--rate"),
    "two bases": (table([np.r_[TIME[:150], TIME[:150] + 1e7], A, B], before="t,q1,q2\n"), "two time bases"),
    "two recordings": (table([np.r_[TIME[:150], TIME[:150]], A, B], before="t,q1,q2\n"), "line 152.*two recordings"),
    "other joints": (table(ABQ, before="t,hip_pos,knee_pos\n"), "has shoulder, elbow.*Columns: hip_pos, knee_pos.*--map"),
    "no header": (table(ABQ), "Columns: column_2, column_3.*--map 'column_2=shoulder.link_position"),
    "unknown names": (table(ABQ, before="t,foo,bar\n"), "Columns: foo, bar"),
    "no overlap": (
        table([TIME + 1000, (-1.0) ** ORDER, (-1.0) ** ORDER], before="t,q1,q2\n"),
        "from 0 to 3 s, the recording from 1000 to 1002.99 s.*--lag",
    ),
    "too few digits": (table([texts(TIME, "%.1f"), A, B], before="t,q1,q2\n"), "269 of 300 rows.*too few digits.*--rate"),
    "a row a host": (
        table([np.repeat(TIME, 2), ["north", "south"] * COUNT, np.c_[A, B].ravel()], before="t,host,q\n"),
        "a row for each of host",
    ),
    "one stamp": (table([0 * TIME, A, A], before="t,q1,q2\n"), "299 of 300 rows"),
    "an unknown time": (table(ABQ, before="t [week],q1,q2\n"), "unit of this time is not known: week"),
    "marks of thousands": (
        table([[f"{t * 1e6:,.0f}" for t in TIME], A, B], sep=";", before="t_us;q1;q2\n"),
        "marks between their thousands: 1,000,000",
    ),
    "an echo without stamps": (b"".join(b"data: %d\n---\n" % i for i in range(9)), "no time column found among data.*--rate"),
    "an echo that is half broken": (
        echoed("secs: %d\n    nsecs: %d", "shoulder elbow", lists=False).replace(b"---\n", b"---\nposition: [0.1\n---\n"),
        "rostopic echo.*at least 2 are needed",
    ),
    "a bomb in an echo": (b"a: &a [1, 1]\nb: &b [*a, *a]\nc: [*b, *b]\n---\n" * 9, "rostopic echo.*has 0 messages"),
    "InfluxDB": (b"arm,lab=1 q1=0.5,q2=0.3 1700000000000000000\n" * 9, "InfluxDB.*Export it as CSV"),
    "a CAN bus": (b"(1700000000.000000) can0 123#0000012C\n" * 9, "CAN bus.*Decode it"),
    "words only": (b"a,b\nx,y\nx,y\n", "no row of numbers"),
    "excel": (b"PK\x03\x04" + bytes(50), "zip archive.*Unpack"),
    "gzip": (b"\x1f\x8b\x08" + bytes(50), "compressed"),
    "one json record": (b'{"time": 0.0, "q1": 1.0}\n', "is JSON with 0 records"),
    "broken json": (b'{"time": 0.0, "q1": 1.0,\n"x"\n', "cannot be read as JSON"),
    "web page": (b"<!DOCTYPE html><html></html>\n", "HTML"),
    "picture": (b"\x89PNG\r\n" + bytes(50), "picture"),
}
"""Name -> file, and what is said of it."""


def struct_array() -> np.ndarray:
    joints = np.zeros((1, 2), dtype=[("time", object), ("position", object), ("name", object)])
    joints[0, 0], joints[0, 1] = (TIME, A, "shoulder"), (TIME, B, "elbow")
    return joints


MATLAB: dict[str, dict[str, Any]] = {
    "vectors": {"t": TIME, "q1": A, "q2": B},
    "rows": {"Time": TIME[None], "pos_1": A[None], "pos_2": B[None]},
    "degrees": {"t_ms": TIME * 1e3, "q1_deg": A * DEGREES, "q2_deg": B * DEGREES},
    "struct": {"data": {"time": TIME, "q": np.column_stack([A, B])}},
    "like a timeseries": {"ts": {"Time": TIME[:, None], "Data": np.column_stack([A, B]), "Name": "q"}},
    "struct array": {"joints": struct_array()},
    "time one level up": {"log": {"t": TIME, "joints": {"shoulder": {"q": A}, "elbow": {"q": B}}}},
    "a stamp in two vectors": {
        "sec": 1.7e9 + np.floor(TIME + 1e-9),
        "nsec": np.round((TIME + 1e-9) % 1 * 1e9),
        "q1": A,
        "q2": B,
    },
    "names beside a matrix": {
        "colheaders": np.array(["t", "q1 [deg]", "q2 [deg]"], dtype=object),
        "data": np.column_stack([TIME, A * DEGREES, B * DEGREES]),
    },
    "a unit beside the data": {
        "shoulder": {"time": TIME, "data": A * DEGREES, "unit": "deg"},
        "elbow": {"time": TIME, "data": B * DEGREES, "DataInfo": {"Units": "deg"}},
    },
    "a trial's number": {"trial_2": {"t": TIME, "q1": A, "q2": B}},
}


def write_bag(path: Path, storage: str, kind: str) -> Path:
    """A ROS 2 bag with the motion in one kind of message."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg("float64[] q\nfloat64[] q_des\n", "lab_msgs/msg/Arm"))
    store.register(get_types_from_msg("float64 position\n", "lab_msgs/msg/Joint"))
    store.register(get_types_from_msg("lab_msgs/Joint shoulder\nlab_msgs/Joint elbow\n", "lab_msgs/msg/Pair"))
    types = store.types
    empty = np.array([])

    def joint_state(a: float, b: float, stamp: int) -> Any:
        time = types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
        header = types["std_msgs/msg/Header"](time, "")
        return types["sensor_msgs/msg/JointState"](header, ["elbow", "shoulder"], np.array([b, a]), empty, empty)

    def array(a: float, b: float, _stamp: int) -> Any:
        layout = types["std_msgs/msg/MultiArrayLayout"]([], 0)
        return types["std_msgs/msg/Float64MultiArray"](layout, np.array([a, b]))

    def own(a: float, b: float, _stamp: int) -> Any:
        return types["lab_msgs/msg/Arm"](np.array([a, b]), np.array([a, b]))

    def nested(a: float, b: float, _stamp: int) -> Any:
        joint = types["lab_msgs/msg/Joint"]
        return types["lab_msgs/msg/Pair"](joint(a), joint(b))

    makers: dict[str, tuple[str, str, Callable[[float, float, int], Any]]] = {
        "joint state": ("/joint_states", "sensor_msgs/msg/JointState", joint_state),
        "array": ("/arm/positions", "std_msgs/msg/Float64MultiArray", array),
        "own": ("/arm_state", "lab_msgs/msg/Arm", own),
        "nested": ("/arm", "lab_msgs/msg/Pair", nested),
    }
    topic, name, make = makers[kind]
    with Writer(path, version=9, storage_plugin=StoragePlugin[storage]) as bag:
        connection = bag.add_connection(topic, name, typestore=store)
        for t, a, b in zip(TIME, A, B, strict=True):
            stamp = 1_700_000_000_000_000_000 + round(t * 1e9)
            bag.write(connection, stamp, store.serialize_cdr(make(a, b, stamp), name))
    return path
