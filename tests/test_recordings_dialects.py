"""Dialects of programs and laboratories: the motion comes out on its time, of its joint, in its unit, or it is asked about."""

from __future__ import annotations

import json
import re
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from lab_files import COUNT, DEGREES, GERMAN, ORDER, TIME, A, B, table, texts

from asrsim.errors import RecordingError
from asrsim.quantities import QUANTITIES
from asrsim.recordings import Recording, read_recording
from asrsim.recordings.units import find_unit, split_header

pytestmark = pytest.mark.once

JOINTS = ("joint_1", "joint_2")
ABQ = [TIME, A, B]
DEG = [TIME, A * DEGREES, B * DEGREES]
LVM = (
    "LabVIEW Measurement\t\nX_Columns\tOne\n***End_of_Header***\t\nChannels\t2\t\nY_Unit_Label\tDegrees\tDegrees\t\n"
    "Delta_X\t0.01\t0.01\t\n***End_of_Header***\t\t\t\nX_Value\tq1\tq2\tComment\n"
)


def numpy_file(**arrays: np.ndarray) -> bytes:
    stream = BytesIO()
    np.savez(stream, **arrays)  # type: ignore[arg-type]
    return stream.getvalue()


def matlab_file(**values: object) -> bytes:
    from scipy.io import savemat

    stream = BytesIO()
    savemat(stream, values)
    return stream.getvalue()


def cells(*values: object) -> np.ndarray:
    array = np.empty(len(values), dtype=object)
    array[:] = values
    return array


def dspace(*signals: tuple[str, str, np.ndarray]) -> np.ndarray:
    """Signals of a capture by dSPACE: name, unit and data; the first rate has half of the samples of the second."""
    structs = np.zeros((1, len(signals)), dtype=[(key, object) for key in ("Name", "Unit", "Data", "XIndex")])
    for i, (name, unit, data) in enumerate(signals):
        structs[0, i] = (name, unit, data[None], 2 if len(data) == COUNT else 1)
    return structs


RECORD = np.rec.fromarrays([TIME, A, B], names="t,q1,q2")
LINES = {
    "ROS 1": "[ INFO] [{unix:.9f}]: q1: {a:.9f}, q2: {b:.9f}",
    "ROS 1 with simulated time, in colours": "\x1b[0m[ INFO] [{late:.9f}, {t:.9f}]: q1 = {a:.9f}, q2 = {b:.9f}\x1b[0m",
    "ROS 2": "[INFO] [{unix:.9f}] [arm_node]: q1: {a:.9f} q2: {b:.9f}",
    "roslaunch, with units": "[arm-1] [INFO] [{unix:.9f}] [arm]: q1: {deg_a:.9f} deg, q2: {deg_b:.9f} deg",
    "the journal": "May 06 10:00:{t:09.6f} lab arm[123]: q1={a:.9f} q2={b:.9f}",
    "the journal, dates": "2024-05-06T10:00:{t:09.6f}+0200 lab arm[123]: q1={a:.9f} q2={b:.9f}",
    "Python": "2024-05-06 10:00:{comma} - arm - INFO - q1={a:.9f} q2={b:.9f}",
    "Python, short": "2024-05-06 10:00:{comma} INFO q1={a:.9f}, q2={b:.9f}",
    "loguru": "2024-05-06 10:00:{t:06.3f} | INFO     | arm:loop:42 - q1={a:.9f} q2={b:.9f}",
    "spdlog": "[2024-05-06 10:00:{t:06.3f}] [info] q1={a:.9f} q2={b:.9f}",
    "glog": "I0506 10:00:{t:09.6f} 1234 arm.cc:42] q1={a:.9f} q2={b:.9f}",
    "an ESP32": "I ({ms}) arm: q1={a:.9f} q2={b:.9f}",
    "seconds since 1970": "{unix:.6f} q1={a:.9f} q2={b:.9f}",
    "seconds in brackets": "[{t:.3f}] q1={a:.9f} q2={b:.9f}",
}
"""Name -> what a logger writes a sample."""


def logged(line: str) -> bytes:
    values = ({"t": t, "a": a, "b": b} for t, a, b in zip(*ABQ, strict=True))
    return "".join(
        line.format(**v, unix=1.7e9 + v["t"], late=1.7e9 + 1.5 * v["t"], comma=f"{v['t']:06.3f}".replace(".", ","),
                    ms=round(v["t"] * 1e3), deg_a=v["a"] * DEGREES, deg_b=v["b"] * DEGREES) + "\n"
        for v in values
    ).encode()  # fmt: skip


UNDERSTOOD: dict[str, tuple[str, bytes]] = {
    "TwinCAT's scale that is none": (
        "a.csv", table([TIME * 1e3, A * DEGREES, TIME * 1e3, B * DEGREES], sep="\t",
                       before="Name\tScope\tName\tScope\n\nName\tAxis1.ActPos\tName\tAxis2.ActPos\nUnit\t°\tUnit\t°\n"
                       "Offset\t0\tOffset\t0\nScaleFactor\t1\tScaleFactor\t1\n\n"),
    ),
    "LabVIEW with a time for each channel": (
        "a.lvm", table([TIME, A * DEGREES, TIME, B * DEGREES], sep="\t", dec=",",
                       before="***End_of_Header***\t\nChannels\t2\t\t\t\nY_Unit_Label\tdeg\t\tdeg\t\nX_Dimension\tTime\t\tTime\t\n"
                       "***End_of_Header***\t\t\t\t\nX_Value\tq1\tX_Value\tq2\tComment\n"),
    ),
    "units as the third level of pandas' columns": (
        "a.csv", table(DEG, before="joint,joint_1,joint_2\nsignal,q,q\nunit,deg,deg\ntime,,\n"),
    ),
    "units and more below the names": (
        "a.csv", table(DEG, before="time,q1,q2\n,Unit: deg,Unit: deg\n,Interp: linear,Interp: linear\n"),
    ),
    "types below the units": ("a.csv", table(DEG, sep=";", before="Time;q1;q2\ns;deg;deg\nDT_DOUBLE;DT_DOUBLE;DT_DOUBLE\n")),
    "numbers of bodies above the names": (
        "a.csv", table([ORDER, *DEG], before=',,Angle,Angle\n,,"1","2"\n,,Value,Value\n'
                       "Frame,Time (Seconds),q1 (deg),q2 (deg)\n"),
    ),
    "Swiss thousands": (
        "a.csv", table([[f"{t * 1e3:,.1f}".replace(",", "\u2019") for t in TIME], *DEG[1:]], sep=";",
                       before="t [ms];q1 [deg];q2 [deg]\n"),
    ),
    "Swiss thousands without a decimal mark": (
        "a.csv", table([[f"{t * 1e3:,.0f}".replace(",", "'") for t in TIME], *DEG[1:]], sep=";",
                       before="t [ms];q1 [deg];q2 [deg]\n"),
    ),
    "French thousands": (
        "a.csv", table([[f"{t * 1e3:,.2f}".replace(",", "\u202f").replace(".", ",") for t in TIME], *DEG[1:]], sep=";", dec=",",
                       before="temps (ms);angle 1 (deg);angle 2 (deg)\n"),
    ),
    "KUKA's seconds": (
        "a.log", table([np.floor(1.7e9 + TIME), np.round((TIME % 1) * 1e6), A, B], sep=" ", number="%.12g",
                       before="% ZeitSec ZeitMikrosec AxisPosMsr1 AxisPosMsr2\n"),
    ),
    "Chinese in its own encoding": ("a.csv", table(DEG, before="时间(s),关节1角度(°),关节2角度(°)\n", encoding="gb18030")),
    "Chinese units": ("a.csv", table(DEG, before="\ufeff时间 (秒),关节1 位置 (度),关节2 位置 (度)\n")),
    "Japanese in its own encoding": (
        "a.csv", table(DEG, before="時間[s],関節1角度[deg],関節2角度[deg]\n", encoding="shift_jis"),
    ),
    "Korean in its own encoding": ("a.csv", table(DEG, before="시간(s),관절1 각도(deg),관절2 각도(deg)\n", encoding="cp949")),
    "Dutch": ("a.csv", table(DEG, **GERMAN, before="Tijd [s];Hoek 1 [graden];Hoek 2 [graden]\n")),
    "Portuguese": ("a.csv", table(DEG, **GERMAN, before="Tempo (s);Posição 1 (graus);Posição 2 (graus)\n")),
    "Polish": ("a.csv", table(ABQ, **GERMAN, before="Czas [s];Kąt 1 [rad];Kąt 2 [rad]\n")),
    "Czech in its own encoding": (
        "a.csv", table(ABQ, **GERMAN, before="čas [s];úhel 1 [rad];úhel 2 [rad]\n", encoding="cp1250"),
    ),
    "a robot's name before the joint's": ("a.csv", table(ABQ, before="t,UR5_q1,UR5_q2\n")),
    "the only arm, counted": ("a.csv", table(ABQ, before="t,arm2_q1,arm2_q2\n")),
    "measured velocities called qd": ("a.csv", table([*ABQ, A, B], before="t,actual_q_1,actual_q_2,actual_qd_1,actual_qd_2\n")),
    "ports of blocks": ("a.csv", table(ABQ, before='Time,"Arm/q1:1","Arm/q2:1"\n')),
    "outputs of blocks": ("a.csv", table(ABQ, before="time,Model Root/Arm/q1/Out1,Model Root/Arm/q2/Out1\n")),
    "Modelica's angles": ("a.csv", table(ABQ, before='"time","arm.joint_1.phi","arm.joint_2.phi"\n')),
    "LabVIEW with units": ("a.lvm", table(DEG, sep="\t", before=LVM)),
    "TwinCAT's scope": (
        "a.csv", table([TIME * 1e3, A * DEGREES, TIME * 1e3, B * DEGREES], sep="\t", dec=",", encoding="cp1252",
                       before="Name\tScope\tName\tScope\n\nName\tAxis1.ActPos\tName\tAxis2.ActPos\n"
                       "SampleTime[ms]\t10\tSampleTime[ms]\t10\nUnit\t°\tUnit\t°\n"),
    ),
    "pandas' columns in two rows": (
        "a.csv", table([*ABQ, A], before="joint,joint_1,joint_2,joint_2\nsignal,q,q,tau\ntime,,,\n"),
    ),
    "units above the names": ("a.csv", table(DEG, before="s,deg,deg\ntime,q1,q2\n")),
    "no unit for the time": ("a.csv", table(DEG, before="time,q1,q2\n[-],[deg],[deg]\n")),
    "a row that says that it has units": ("a.csv", table(DEG, sep=";", before="Unit;deg;deg\nName;Zeit;x\nt;q1;q2\n")),
    "marks between thousands": (
        "a.csv", table([texts(TIME * 1e3, "%.1f"), *([f"{v * DEGREES * 1e3:,.3f}" for v in column] for column in (A, B))],
                       sep=";", before="t [ms];q1 [mdeg];q2 [mdeg]\n"),
    ),
    "names with blanks between blanks": (
        "a.txt", table([texts(column, "%14.9f") for column in DEG], sep=" ",
                       before="      Time       Joint 1        Joint 2\n      (s)         (deg)          (deg)\n"),
    ),
    "quoted names between blanks": ("a.txt", table(DEG, sep=" ", before='"Time (s)" "Joint 1 (deg)" "Joint 2 (deg)"\n')),
    "a title beside a header in a comment": ("a.txt", table([*ABQ, A], sep=" ", before="*** log ***\n# t q1 q2 tau1\n")),
    "arrays beside names": ("a.csv", table([*ABQ, A, B], before="t,q[0],q[1],J1_torque,J2_torque\n")),
    "names beside arrays": ("a.csv", table([TIME, A, B, A, B], before="t,J1_pos,J2_pos,tau[0],tau[1]\n")),
    "a file's joint_0": ("a.csv", table([*ABQ, A, B], before="t,joint_0_pos,joint_1_pos,joint_0_vel,joint_1_vel\n")),
    "the KUKA's axes": ("a.csv", table([*DEG, A, B], before="t,A1 [deg],A2 [deg],A1_Soll,A2_Soll\n")),
    "theta of a command": ("a.csv", table([*ABQ, B, A], before="t,theta1,theta2,q1_ref,q2_ref\n")),
    "links and motors": ("a.csv", table([TIME, B, A, A, B], before="t,qm1,qm2,ql1,ql2\n")),
    "desired ones first": ("a.csv", table([TIME, B, A, A, B], before="t,q_d[0],q_d[1],q[0],q[1]\n")),
    "units of an array": ("a.json", json.dumps({"t": [*TIME], "q_deg": (np.c_[A, B] * DEGREES).tolist()}).encode()),
    "a unit for each column of JSON": (
        "a.json", json.dumps({"columns": ["time", "q1", "q2"], "units": ["ms", "deg", "deg"],
                              "data": np.c_[TIME * 1e3, A * DEGREES, B * DEGREES].tolist()}).encode(),
    ),
    "names above the rows of JSON": (
        "a.json", json.dumps([["t", "q1", "q2"], *np.c_[TIME, A, B].tolist()]).encode(),
    ),
    "fields and rows of JSON": (
        "a.json", json.dumps({"fields": ["time", "q1", "q2"], "rows": np.c_[TIME, A, B].tolist()}).encode(),
    ),
    "an index that is the time": (
        "a.json", json.dumps({"columns": ["q1", "q2"], "index": TIME.tolist(), "data": np.c_[A, B].tolist()}).encode(),
    ),
    "named series of JSON": (
        "a.json", json.dumps([{"name": "time", "unit": "s", "values": TIME.tolist()},
                              {"name": "q1", "unit": "deg", "values": (A * DEGREES).tolist()},
                              {"name": "q2", "unit": "deg", "values": (B * DEGREES).tolist()}]).encode(),
    ),
    "objects of JSON by their names": (
        "a.jsonl", "\n".join(json.dumps({"t": t, "joints": [{"name": "joint_2", "q": b}, {"name": "joint_1", "q": a}][::turn]})
                             for t, a, b, turn in zip(TIME, A, B, [1, -1] * (COUNT // 2), strict=True)).encode(),
    ),
    "objects of JSON by their numbers": (
        "a.json", json.dumps([{"t": t, "motors": [{"id": 2, "position": b}, {"id": 1, "position": a}]}
                              for t, a, b in zip(TIME, A, B, strict=True)]).encode(),
    ),
    "series in objects of JSON": (
        "a.json", json.dumps({"t": TIME.tolist(), "joints": [{"name": "joint_2", "position": B.tolist()},
                                                             {"name": "joint_1", "position": A.tolist()}]}).encode(),
    ),
    "Simulink's To File": ("a.mat", matlab_file(q=np.vstack([TIME, A, B]))),
    "hundredths as a fraction": ("a.csv", table([ORDER, A, B], before="t [1/100 s],q1,q2\n")),
    "seconds of arc": ("a.csv", table([TIME, A * DEGREES * 3600, B * DEGREES * 3600], before="t,q1 [arcsec],q2 [arcsec]\n")),
    "numpy's arrays": ("a.npz", numpy_file(t=TIME, q1=A, q2=B)),
    "numpy's records": ("a.npz", numpy_file(log=RECORD)),
    "units behind the numbers of one column": (
        "a.csv", table([TIME, [f"{a * DEGREES:.9f}deg" for a in A], B], before="t,q1,q2\n"),
    ),
    "a struct of signals": ("a.mat", matlab_file(run={"signals": {"time": TIME, "q1": A, "q2": B}, "name": "of today"})),
    "MATLAB's cells": ("a.mat", matlab_file(t=TIME, q=cells(A, B))),
    "MATLAB's names and units": (
        "a.mat", matlab_file(t=TIME, data=np.c_[A, B] * DEGREES, names=cells("q1", "q2"), units=cells("deg", "deg")),
    ),
    "complex numbers without imaginary part": ("a.mat", matlab_file(t=TIME, q1=A.astype(complex), q2=B)),
    "Arduino's plotter": ("a.txt", table([texts(TIME, "t:%.2f"), texts(A, "q1:%.9f"), texts(B, "q2:%.9f")])),
    "its monitor's time before it": (
        "a.txt", table([[f"10:00:{t:06.3f} -> q1:{a:.9f}" for t, a in zip(TIME, A, strict=True)],
                        [f"q2:{b:.9f}" for b in B]], sep="\t"),
    ),
    "names and equals": ("a.log", table([[f"t={t:.2f} q1={a:.9f} q2={b:.9f}" for t, a, b in zip(*ABQ, strict=True)]])),
    **{f"a logger's line: {name}": ("a.log", logged(line)) for name, line in LINES.items()},
    "units in the cells": (
        "a.csv", table([texts(TIME * 1e3, "%.0f ms"), texts(A * DEGREES, "%.9fdeg"), texts(B * DEGREES, "%.9f °")],
                       before="time,q1,q2\n"),
    ),
    "minutes": ("a.csv", table([TIME / 60, A, B], number="%.12f", before="t_min,q1,q2\n")),
    "minutes in a struct": ("a.mat", matlab_file(log={"time_min": TIME / 60, "q1": A, "q2": B})),
    "counts that begin anew at 2^32": (
        "a.csv", table([texts((TIME * 1e6 + 2.0**32 - 5e5) % 2**32, "%.0f"), A, B], before="micros,q1,q2\n"),
    ),
    "counts of 32 bits in seconds": (
        "a.csv", table([texts((TIME * 1e6 + 2.0**32 - 5e5) % 2**32 / 1e6, "%.6f"), A, B], before="t,q1,q2\n"),
    ),
    "counts of 16 bits": ("a.csv", table([texts((TIME * 1e3 + 65036) % 65536, "%.0f"), A, B], before="time_ms,q1,q2\n")),
    "a zone by its name": (
        "a.csv", table([texts(TIME, "2024-05-06 10:00:%06.3f CET"), A, B], before="datetime,q1,q2\n"),
    ),
    "a zone by its hours": ("a.csv", table([texts(TIME, "2024-05-06 10:00:%06.3f GMT+1"), A, B], before="time,q1,q2\n")),
    "a date as C prints it": ("a.csv", table([texts(TIME, "Mon May  6 10:00:%06.3f 2024"), A, B], before="time,q1,q2\n")),
    "a date with its month in letters": (
        "a.csv", table([texts(TIME, "6 May 2024 10:00:%06.3f"), A, B], sep=";", before="time;q1;q2\n"),
    ),
    "units in quoted cells": (
        "a.csv", table([texts(TIME, '"%.3f s"'), *(texts(column * DEGREES, '"%.9f deg"') for column in (A, B))],
                       before="Time,q1,q2\n"),
    ),
    "a typographer's minus": (
        "a.csv", table([TIME, *([f"{v:.9f}".replace("-", "\u2212") for v in column] for column in (A, B))], before="t,q1,q2\n"),
    ),
    "thousandths in words": (
        "a.csv", table([TIME * 1e3, A * 1e3, B * 1e3], before="time_milliseconds,q1_millirad,q2_milliradians\n"),
    ),
    "a year of two digits": (
        "a.csv", table([texts(TIME, "06.05.24 10:00:%06.3f"), A, B], sep=";", before="Datum;q1;q2\n"),
    ),
    "a tab at each line's end": (
        "a.txt", table([TIME * 1e3, A, B], sep="\t", tail="\t", before="t [ms]\tWinkel 1\tWinkel 2\t\n"),
    ),
    "switched off between": (
        "a.csv", table([TIME[:99], A[:99], B[:99]], before="t,q1,q2\n") + bytes(40) + b"\n"
        + table([TIME[99:], A[99:], B[99:]]),
    ),
    "stamps of messages in vectors": (
        "a.mat", matlab_file(log={"header_stamp_secs": 1.7e9 + ORDER // 100, "header_stamp_nsecs": ORDER % 100 * 1e7,
                                  "q1_in_deg": A * DEGREES, "q2_in_deg": B * DEGREES}),
    ),
    "a degree sign behind the name": ("a.csv", table(DEG, before="t,q1°,q2°\n")),
    "a degree sign in the wrong encoding": ("a.csv", table(DEG, before="t,q1 [Â°],q2 [Â°]\n")),
    "four bytes a sign": ("a.csv", table(ABQ, before="t,q1,q2\n", encoding="utf-32")),
    "minutes and seconds": (
        "a.csv", table([[f"{int(t // 60)}:{t % 60:06.3f}" for t in TIME + 58], A, B], before="time [min:s],q1,q2\n"),
    ),
    "a year of two digits behind its month": (
        "a.csv", table([texts(TIME, "05/06/24 02:00:%06.3f PM"), A, B], before="Timestamp,q1,q2\n"),
    ),
    "Windows' ticks of 100 ns": (
        "a.csv", table([[str(133521637 * 10**9 + round(t * 1e7)) for t in TIME], A, B], before="time,q1,q2\n"),
    ),
    "hundredths of a second": ("a.csv", table([TIME * 1e2, A, B], before="time_cs,q1,q2\n")),
    "a date that stays, beside a time": ("a.csv", table([["2024-05-06"] * COUNT, *ABQ], before="date,t,q1,q2\n")),
    "units in German words": ("a.csv", table(DEG, sep=";", dec=",", before="Zeit;q1;q2\nSekunden;Grad;Grad\n")),
    "letters of formulas": ("a.csv", table([*ABQ, A, B], before="t,θ₁ [rad],θ₂ [rad],θ̇₁,θ̇₂\n")),
    "slopes by their sign": ("a.csv", table([TIME, B, A, A, B], before="t,q2',q1',q1,q2\n")),
    "dSPACE's paths and rates": (
        "a.mat", matlab_file(lab={
            "X": dspace(("", "", TIME[::2]), ("", "s", TIME + 1)),
            "Y": dspace(("Model Root/Joint1/Position/Out1", "deg", A * DEGREES),
                        ("Model Root/Joint2/Position/Out1", "deg", B * DEGREES), ("Model Root/Mode/Out1", "", A[::2])),
            "Description": {"DateTime": "x"},
        }),
    ),
    "another name of the time": ("a.mat", matlab_file(epoch_ms=1.7e12 + TIME * 1e3, q1=A, q2=B)),
    "numpy's dates": ("a.npz", numpy_file(time=np.datetime64("2024-05-06") + ORDER * np.timedelta64(10, "ms"), q1=A, q2=B)),
}  # fmt: skip


def read(folder: Path, name: str, content: bytes, **options: object) -> Recording:
    (folder / name).write_bytes(content)
    return read_recording(folder / name, **{"joints": JOINTS, **options})  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", UNDERSTOOD)
def test_understood(tmp_path: Path, kind: str) -> None:
    recording = read(tmp_path, *UNDERSTOOD[kind])
    for joint, values in zip(JOINTS, (A, B), strict=True):
        column = recording.column(joint, "link_position")
        np.testing.assert_allclose(column.time - column.time[0], TIME, atol=1.1e-6)
        np.testing.assert_allclose(column.values, values, atol=1e-6)
        for other in {"link_torque", "link_velocity"} & set(recording.quantities(joint)):
            np.testing.assert_allclose(
                recording.column(joint, other).values, A if kind.startswith("pandas") else values, atol=1e-6
            )


@pytest.mark.parametrize(
    "names", ["field.position{} field.ref{}", "log.Angle{} log.Target{}", "Winkel_{}_in_rad Soll_{}_in_rad"]
)
@pytest.mark.parametrize("first", [0, 1])
def test_what_holds_all_columns_hides_no_joint(tmp_path: Path, names: str, first: int) -> None:
    labels = [name.format(first + i) for name in names.split() for i in range(2)]
    recording = read(tmp_path, "a.csv", table([TIME, A, B, 2 * A, 2 * B], before=",".join(["time", *labels]) + "\n"))
    for joint, values in zip(JOINTS, (A, B), strict=True):
        np.testing.assert_allclose(recording.column(joint, "link_position").values, values, atol=1e-6)
        np.testing.assert_allclose(recording.column(joint, "reference_1").values, 2 * values, atol=1e-6)


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [
        ("[deg] q1", "q1", "deg"), ("velocity[0]:deg/sec", "velocity[0]", "deg/s"), ("T1:N.m", "T1", "N.m"),
        ("cmd_1-º", "cmd_1", "°"), ("pos 1-turns", "pos 1", "turns"), ("q1 [°] (measured)", "q1 (measured)", "°"),
        ("q_deg[1]", "q[1]", "deg"), ("Axis 1 Position/turns", "Axis 1 Position", "turns"), ("w1[U/min]", "w1", "rpm"),
        ("v[0]/dps", "v[0]", "dps"), ("time_min", "time", "min"),
        ("elapsed_h", "elapsed", "h"), ("q_1_in_deg", "q_1", "deg"), ("Torque:N m", "Torque", "Nm"),
        ("M1 in newton-metres", "M1", "Nm"), ("tau (ozf.in)", "tau", "ozin"), ("effort[0]:kNm", "effort[0]", "kNm"),
        ("torque1 [kgf·cm]", "torque1", "kgfcm"),
    ],
)  # fmt: skip
def test_where_a_unit_stands(header: str, name: str, unit: str) -> None:
    known = find_unit(unit)
    found = split_header(header)
    assert known is not None
    assert found[1] is not None
    assert (found[0], found[1].si, found[1].factor) == (name, known.si, known.factor)


@pytest.mark.parametrize(
    "header",
    [
        "x.m",
        "theta_m",
        "left_theta_m",
        "arm_q2_s",
        "header.stamp.secs",
        "q1-ref",
        "stats.min",
        "v-max",
        "joint-1",
        "q[1]",
        "a:b",
        "value[joint_1]",
        "q1 [steps of 0.1 deg]",
        "q1 [deg per count]",
    ],
)
def test_what_is_no_unit_stays_with_the_name(header: str) -> None:
    assert split_header(header) == (header, None)


ASKED: dict[str, tuple[bytes, str, str]] = {
    "an unknown unit in a row": (table([*DEG, A], before="t,q1,q2,tau1\ns,deg,deg,foo\n"), "unclear-unit", "is not known"),
    "degrees among JSON's remarks": (
        json.dumps({"meta": {"units": "deg"}, "data": [{"t": t, "q1": a} for t, a in zip(TIME, A, strict=True)]}).encode(),
        "unstated-unit", "units: deg",
    ),
    "ten kilohertz in ms": (table([ORDER * 1.5, A, B], before="time,q1,q2\n"), "time-unit-assumed", "1.5 apart"),
    "samples of 0.1 for half an hour": (
        table([0.1 * np.arange(20 * COUNT), np.tile(A, 20)], before="time,q1\n"), "time-unit-assumed", "0.1 s between samples",
    ),
    "an encoder that begins anew": (
        table([TIME, (np.pi + 7 * A) % (2 * np.pi) - np.pi], before="t,q1 [rad]\n"), "wrapped", "whole turn .* times",
    ),
    "two arms": (table([*ABQ, B, A], before="t,arm1_q1,arm1_q2,arm2_q1,arm2_q2\n"), "unclear-joint", "arm1_q1, arm1_q2"),
    "two trials": (table([*ABQ, B, A], before="t,trial1_q1,trial1_q2,trial2_q1,trial2_q2\n"), "unclear-joint", "trial1_q1"),
    "two sides": (table([*ABQ, B, A], before="t,left_q1,left_q2,right_q1,right_q2\n"), "unclear-joint", "left_q1, left_q2"),
    "one more than there are": (table([*ABQ, B], before="t,q0,q1,q2\n"), "unclear-joint", "q0, q1, q2"),
    "joint_0 beside the others": (table([*ABQ, B], before="t,joint_0_pos,joint_1_pos,joint_2_pos\n"), "unclear-joint",
                                  "unclear: joint_0_pos;"),
    "turns of a drive": (table(ABQ, before="t,axis0.pos_estimate,axis1.pos_estimate\n"), "unclear-unit", "turns"),
    "steps of a drive": (table(ABQ, before="t,present_position_1,present_position_2\n"), "unclear-unit", "Dynamixel"),
    "counted from 0": (table(ABQ, before="t,joint_0_pos,joint_1_pos\n"), "joints-from-zero", "joint_0 is joint_1"),
}  # fmt: skip


@pytest.mark.parametrize("kind", ASKED)
def test_asked_about(tmp_path: Path, kind: str) -> None:
    content, code, said = ASKED[kind]
    recording = read(tmp_path, "lab.csv", content)
    problem = next(one for one in recording.findings if one.code == code)
    assert re.search(said, str(problem))


def test_the_arm_that_the_simulation_names_is_taken(tmp_path: Path) -> None:
    content = table([*ABQ, B, A], before="t,arm1_q1,arm1_q2,arm2_q1,left_q1\n")
    joints = ("arm2_joint1", "arm2_joint2", "left_joint1", "right_joint1")
    recording = read(tmp_path, "lab.csv", content, joints=joints)
    assert recording.column("arm2_joint1", "link_position").source == "arm2_q1"
    assert recording.column("left_joint1", "link_position").source == "left_q1"
    assert recording.channels["arm1_q1"].quantity is None


def test_a_measured_angle_is_of_the_joint_that_its_name_begins_with(tmp_path: Path) -> None:
    names = [f"{joint} {what}" for joint in ("elbow", "wrist") for what in ("Soll", "Ist")]
    content = table([TIME, *[A * DEGREES] * 4], before=f"t [s],{','.join(f'{name} [°]' for name in names)}\n")
    recording = read(tmp_path, "lab.csv", content, joints=None)
    found = {column.source.removesuffix(" [°]"): (column.joint, column.quantity) for column in recording.channels.values()}
    quantity = {"Soll": "reference_1", "Ist": "link_position"}
    assert found == {name: (name.split()[0], quantity[name.split()[1]]) for name in names}


def test_objects_of_python_are_passed_over_and_told(tmp_path: Path) -> None:
    content = numpy_file(t=TIME, q1=A, meta=np.array({"unit": "deg"}, dtype=object))
    recording = read(tmp_path, "lab.npz", content)
    np.testing.assert_allclose(recording.column("joint_1", "link_position").values, A)
    assert "meta: holds objects of Python" in str(next(one for one in recording.findings if one.code == "objects"))


def test_a_scale_that_may_be_in_the_numbers_already_is_asked_about(tmp_path: Path) -> None:
    before = "Name\tScope\tName\tScope\nName\tA.q1\tName\tA.q2\nUnit\t°\tUnit\t°\nScaleFactor\t0.5\tScaleFactor\t1\n"
    content = table([TIME * 1e3, 2 * A * DEGREES, TIME * 1e3, B * DEGREES], sep="\t", before=before)
    with pytest.raises(RecordingError, match=r"A\.q1: its header states factor 0\.5 and offset 0"):
        read(tmp_path, "lab.csv", content)
    recording = read(tmp_path, "lab.csv", content, mapping=["A.q1=0.5*joint_1.link_position"])
    np.testing.assert_allclose(recording.column("joint_1", "link_position").values, A, atol=1e-6)


@pytest.mark.parametrize(
    "says", ["# fs = 100 Hz", "% Ts = 0.01 s", "# Sample time [ms]: 10", "Delta_X,0.01", "# rate: 0.1 kHz"]
)
def test_a_rate_that_the_file_tells_is_offered(tmp_path: Path, says: str) -> None:
    with pytest.raises(RecordingError, match="give --rate 100"):
        read(tmp_path, "lab.csv", table([A, B], before=f"{says}\nq1,q2\n"))


def test_an_angle_is_unwrapped_on_request(tmp_path: Path) -> None:
    content = table([TIME, (7 * A * DEGREES) % 360], before="t,q1 [deg]\n")
    recording = read(tmp_path, "lab.csv", content, mapping=["q1=joint_1.link_position [deg] unwrapped - start"])
    column = recording.column("joint_1", "link_position")
    np.testing.assert_allclose(column.values, 7 * (A - A[0]), atol=1e-6)
    assert "unwrapped" in column.conversion
    assert not [one for one in recording.findings if one.code == "wrapped"]
    # A file of mappings says it, too.
    (tmp_path / "map.yaml").write_text(
        "q1: {joint: joint_1, quantity: link_position, unit: deg, offset: start, unwrapped: true}\n"
    )
    filed = read(tmp_path, "lab.csv", content, mapping=[str(tmp_path / "map.yaml")]).column("joint_1", "link_position")
    np.testing.assert_array_equal(filed.values, column.values)


OTHER = (
    "min max lim limit offset bias zero home init noise fft gain kp ki kd norm rms sum sin cos std raw integral valid code "
    "gravity friction"
)
"""Words beside a q that is none, or not the joint's."""
NEAR = "sim model predicted est prev smooth ff delayed trial"
"""Words beside a q that is one, if there is no other."""


@pytest.mark.parametrize("pattern", ["q1_{}", "{}_q1", "{}Q1"])
def test_words_that_make_another_quantity(tmp_path: Path, pattern: str) -> None:
    names = [pattern.format(word) for word in OTHER.split()]
    recording = read(tmp_path, "lab.csv", table([TIME, *[A] * len(names), B], before=f"t,{','.join(names)},q2\n"))
    assert {name: recording.channels[name].quantity for name in names} == dict.fromkeys(names)
    assert recording.quantities("joint_2") == ("link_position",)


@pytest.mark.parametrize("pattern", ["q1_{}", "{}_q1 [rad]", "{}Q1"])
def test_of_two_columns_of_a_quantity_the_plainest_name_is_taken(tmp_path: Path, pattern: str) -> None:
    names = [pattern.format(word) for word in NEAR.split()]
    content = table([TIME, *[B] * len(names), A * DEGREES], before=f"t,{','.join(names)},q1 [deg]\n")
    recording = read(tmp_path, "lab.csv", content)
    assert recording.column("joint_1", "link_position").source == "q1 [deg]"
    assert [one.code for one in recording.findings if one.code == "second-column"]


@pytest.mark.parametrize(
    ("name", "quantity"),
    [("dQ1", "link_velocity"), ("dTheta1", "link_velocity"), ("ddQ1", None), ("ddtheta1", None), ("d_q1", None),
     ("link1 Roll", None), ("link1_yaw [deg]", None), ("link1 angle", "link_position")],
)  # fmt: skip
def test_rates_and_angles_of_bodies_are_no_positions(tmp_path: Path, name: str, quantity: str | None) -> None:
    recording = read(tmp_path, "lab.csv", table([TIME, A], before=f"t,{name}\n"))
    assert recording.quantities("joint_1") == ((quantity,) if quantity else ())


@pytest.mark.parametrize(
    ("name", "start", "unit", "off"),
    [("Timestamp", 638432e12, 1e-7, 2e-5), ("time", 133521637e9, 1e-7, 2e-6), ("JD", 2460352.1, 86400, 5e-5)],
)
def test_counts_of_clocks_that_began_long_ago(tmp_path: Path, name: str, start: float, unit: float, off: float) -> None:
    """To what a float of them resolves."""
    content = table([start + TIME / unit, A, B], number="%.17g", before=f"{name},q1,q2\n")
    recording = read(tmp_path, "lab.csv", content)
    np.testing.assert_allclose(recording.column("joint_1", "link_position").time, TIME, atol=off)
    assert recording.epoch is not None
    assert 1.7e9 < recording.epoch < 1.71e9


@pytest.mark.parametrize(
    "name",
    ["/forward_position_controller/commands/data[0]", "/arm_controller/joint_trajectory/points[joint_1].positions[0]",
     "position_commands.q1", "q1_setpoints", "joint_1/targets/position"],
)  # fmt: skip
def test_commands_of_controllers_are_no_positions(tmp_path: Path, name: str) -> None:
    content = table([*ABQ, 2 * A], before=f"t,q1,q2,{name}\n")
    recording = read(tmp_path, "lab.csv", content)
    assert recording.column("joint_1", "reference_1").source == name
    assert recording.column("joint_1", "link_position").source == "q1"


def test_a_file_with_its_newest_sample_first_is_told_so(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"the newest sample stands first.*Sort the file"):
        read(tmp_path, "lab.csv", table([column[::-1] for column in ABQ], before="t,q1,q2\n"))


@pytest.mark.parametrize("name", ["dt [ms]", "dt", "period_us", "latency [s]"])
def test_what_takes_time_is_no_time(tmp_path: Path, name: str) -> None:
    with pytest.raises(RecordingError, match="no time column found"):
        read(tmp_path, "lab.csv", table([10 + np.sin(17 * TIME), A, B], before=f"{name},q1,q2\n"))


@pytest.mark.parametrize("name", ["qd1", "q_r1", "motor1_link_angle_x"])
def test_what_may_be_two_things_is_not_taken(tmp_path: Path, name: str) -> None:
    recording = read(tmp_path, "lab.csv", table([TIME, A, B], before=f"t,q1,{name}\n"))
    assert {column.source for column in recording.channels.values() if column.quantity in QUANTITIES} == {"q1"}
