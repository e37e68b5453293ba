"""Recordings that are no text: Excel workbooks, Parquet, Feather, numpy's arrays; and files that only look readable."""

from __future__ import annotations

import ast
import math
import re
import shlex
import zipfile
from pathlib import Path

import numpy as np
import pytest

from asrsim.errors import RecordingError
from asrsim.recordings import read_recording
from asrsim.recordings.foreign import from_hdf5

TIME = np.arange(0.0, 0.4, 0.01)
Q1, Q2 = 0.5 * np.sin(9.0 * TIME), 0.3 * np.cos(7.0 * TIME)
SHEET = '<worksheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"><sheetData>{}</sheetData></worksheet>'
BOOK = '<workbook xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"/>'
STYLES = """<styleSheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main">
<numFmts><numFmt numFmtId="164" formatCode="hh:mm:ss.000"/><numFmt numFmtId="165" formatCode="0.000&quot; s&quot;"/></numFmts>
<cellXfs><xf numFmtId="0"/><xf numFmtId="22"/><xf numFmtId="164"/><xf numFmtId="165"/></cellXfs></styleSheet>"""
GENERAL, DATE, CLOCK, TEXT_BESIDE = range(4)


def workbook(path: Path, *sheets: list[list[object]], style: int = GENERAL) -> Path:
    """A workbook as Excel writes it: texts apart from the sheets, blank cells and rows left out; style: of the first column."""
    shared: list[str] = []

    def cell(value: object, row: int, column: int) -> str:
        place = f"{chr(ord('A') + column)}{row}"
        if isinstance(value, str):
            shared.append(value)
            return f'<c r="{place}" t="s"><v>{len(shared) - 1}</v></c>'
        return f'<c r="{place}" s="{0 if column else style}"><v>{float(value)!r}</v></c>'

    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("xl/workbook.xml", BOOK)
        archive.writestr("xl/styles.xml", STYLES)
        for number, rows in enumerate(sheets, start=1):
            filled = ((n, [cell(v, n, i) for i, v in enumerate(row) if v is not None]) for n, row in enumerate(rows, start=1))
            text = "".join(f'<row r="{n}">{"".join(cells)}</row>' for n, cells in filled if cells)
            archive.writestr(f"xl/worksheets/sheet{number}.xml", SHEET.format(text))
        texts = "".join(f"<si><t>{text}</t></si>" for text in shared)
        archive.writestr("xl/sharedStrings.xml", SHEET.format(texts).replace("worksheet", "sst").replace("sheetData", "x"))
    return path


def rows(first: np.ndarray = TIME) -> list[list[object]]:
    return [list(row) for row in zip(first, np.degrees(Q1), np.degrees(Q2), strict=True)]


HEAD = ["time", "q1 [deg]", "q2 [deg]"]
DAY = 45418.0 + 10 / 24
"""10 o'clock on a day of 2024, as Excel counts."""


@pytest.mark.parametrize(
    ("style", "first"),
    [(GENERAL, TIME), (TEXT_BESIDE, TIME), (DATE, DAY + TIME / 86400), (CLOCK, 10 / 24 + TIME / 86400), (CLOCK, TIME / 86400)],
)
def test_a_workbook_is_read_as_its_text(tmp_path: Path, style: int, first: np.ndarray):
    """Numbers that its cells show as dates or times of day are these."""
    notes: list[list[object]] = [["Notes", 'of the "arm", 3'], ["Operator"]]
    table = [["Trial 3"], [], HEAD, *rows(first)]
    recording = read_recording(workbook(tmp_path / "lab.xlsx", notes, table, style=style), joints=["joint_1", "joint_2"])
    assert recording.time - recording.time[0] == pytest.approx(TIME, abs=2e-6)
    assert recording.column("joint_1", "link_position").values == pytest.approx(Q1, abs=1e-12)
    assert recording.column("joint_2", "link_position").values == pytest.approx(Q2, abs=1e-12)


def test_blank_cells_of_a_workbook_are_missing_numbers(tmp_path: Path):
    table = [HEAD, *rows()]
    table[5][2] = None
    table[7][1] = None
    recording = read_recording(workbook(tmp_path / "lab.xlsx", table))
    assert len(recording.time) == len(TIME)
    assert np.flatnonzero(np.isnan(recording.channels["q2 [deg]"].values)).tolist() == [4]
    assert np.flatnonzero(np.isnan(recording.channels["q1 [deg]"].values)).tolist() == [6]


def test_rows_and_cells_of_a_workbook_may_leave_out_where_they_are(tmp_path: Path):
    """Each then stands behind the one before it."""
    plain = workbook(tmp_path / "plain.xlsx", rows())
    with zipfile.ZipFile(plain) as archive, zipfile.ZipFile(tmp_path / "bare.xlsx", "w") as bare:
        for name in archive.namelist():
            text = archive.read(name).decode()
            bare.writestr(name, re.sub(r' r="[A-Z]*\d+"', "", text) if "sheet1" in name else text)
    wanted, found = read_recording(plain), read_recording(tmp_path / "bare.xlsx")
    np.testing.assert_array_equal(found.time, wanted.time)
    for joint in wanted.joints:
        own = found.column(joint, "link_position")
        np.testing.assert_array_equal(own.values, wanted.column(joint, "link_position").values)


def test_of_two_sheets_the_first_is_read_and_that_is_said(tmp_path: Path):
    recording = read_recording(workbook(tmp_path / "lab.xlsx", [HEAD, *rows()], [HEAD, *rows()]))
    assert "has 2 sheets with numbers" in str(recording.findings[0])


def test_parquet_and_feather(tmp_path: Path):
    arrow = pytest.importorskip("pyarrow")
    from pyarrow import feather, parquet

    start = np.datetime64("2024-05-06T10:00:00", "ns")
    stamps = start + (TIME * 1e9).round().astype("timedelta64[ns]")
    table = arrow.table({"stamp": stamps, "q1 [deg]": np.degrees(Q1), "name": ["arm"] * len(TIME)})
    parquet.write_table(table, tmp_path / "lab.parquet")
    feather.write_feather(table, tmp_path / "lab.feather")
    # pandas' index of times since the start, which has no name.
    parquet.write_table(table.set_column(0, "__index_level_0__", [stamps - start]), tmp_path / "since.parquet")
    for file in ("lab.parquet", "lab.feather", "since.parquet"):
        recording = read_recording(tmp_path / file, joints=["joint_1"])
        assert recording.time == pytest.approx(TIME, abs=1e-9)
        assert recording.column("joint_1", "link_position").values == pytest.approx(Q1, abs=1e-12)


def test_one_array_of_numpy(tmp_path: Path):
    table = np.array(list(zip(TIME, Q1, strict=True)), dtype=[("t", float), ("q1", float)])
    np.save(tmp_path / "named.npy", table)
    np.save(tmp_path / "plain.npy", np.column_stack([TIME, Q1]))
    for file, mapping in (("named.npy", None), ("plain.npy", ["plain_2=joint_1.link_position"])):
        recording = read_recording(tmp_path / file, joints=["joint_1"], mapping=mapping)
        assert recording.time == pytest.approx(TIME)
        assert recording.column("joint_1", "link_position").values == pytest.approx(Q1)


@pytest.mark.parametrize(
    ("name", "start", "words"),
    [
        ("lab.h5", b"\x89HDF\r\n\x1a\n", "is an HDF5 file"), ("lab.pkl", b"\x80\x04\x95\x00", "is a pickle"),
        ("lab.xls", b"\xd0\xcf\x11\xe0", "is an old Excel workbook"), ("lab.csv", b"PK\x03\x04", "is a zip archive"),
        ("lab.xlsx", b"PK\x03\x04", "is a zip archive"), ("lab.parquet", b"PAR1", "cannot be read"),
        ("lab.feather", b"ARROW1", "cannot be read"), ("lab.npy", b"\x93NUMPY\x01", "cannot be read"),
        ("arm.tdms", b"TDSm", "is a TDMS file"), ("arm.mf4", b"MDF     4.10", "is a measurement file by ASAM"),
        ("walk.c3d", b"\x02P\x01\x00", "is a C3D file.*Export it as CSV"), ("lab.csv.xz", b"\xfd7zXZ\x00", "Unpack it: unxz /"),
    ],
)  # fmt: skip
def test_what_is_not_read_says_what_it_is_and_what_to_do(tmp_path: Path, name: str, start: bytes, words: str):
    (tmp_path / name).write_bytes(start + b"\0" * 600)
    with pytest.raises(RecordingError, match=words) as caught:
        read_recording(tmp_path / name)
    said = str(caught.value)
    assert said.count("\n") == 0
    if "python3 -c " in said:
        (code,) = shlex.split(said.partition("python3 -c ")[2])
        assert ast.parse(code)


def test_the_command_for_hdf5_holds_for_any_name(tmp_path: Path):
    for name in ("lab.mat", "it's $HOME.mat", 'a "b".mat'):
        *_, code = shlex.split(from_hdf5(tmp_path / name))
        assert repr(str(tmp_path / name)) in code
        assert ast.parse(code)


def test_a_broken_workbook_is_refused_in_one_line(tmp_path: Path):
    path = workbook(tmp_path / "lab.xlsx", [HEAD, *rows()])
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("xl/worksheets/sheet2.xml", "<worksheet><sheetData><row")
    with pytest.raises(RecordingError, match="cannot be read as a workbook"):
        read_recording(path)
    with pytest.raises(RecordingError, match="no sheet with rows of numbers"):
        read_recording(workbook(tmp_path / "text.xlsx", [["a", "b"]]))


@pytest.mark.parametrize(("place", "named"), [("A999999999", "row 999999999"), ("ZZZZZZ2", "column 321272406")])
def test_a_cell_that_no_sheet_has_does_not_fill_the_memory(tmp_path: Path, place: str, named: str):
    path = tmp_path / "far.xlsx"
    row = re.sub(r"\D", "", place)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("xl/workbook.xml", BOOK)
        archive.writestr("xl/worksheets/sheet1.xml", SHEET.format(f'<row r="{row}"><c r="{place}"><v>1</v></c></row>'))
    with pytest.raises(RecordingError, match=f"{named} is none of a sheet"):
        read_recording(path)


SERIAL = [f"10:00:{t:06.3f} -> {{}}{a:.6f},{b:.6f}" for t, a, b in zip(TIME, Q1, Q2, strict=True)]


@pytest.mark.parametrize(
    ("lines", "columns"),
    [
        ([line.format("") for line in SERIAL], ("column_2", "column_3")),
        (["10:00:00.000 -> q1,q2", *(line.format("") for line in SERIAL)], ("q1", "q2")),
        ([line.format("").replace(",", "\t") for line in SERIAL], ("column_2", "column_3")),
        (["10:00:00.000 -> ready", *(line.format("") for line in SERIAL)], ("column_2", "column_3")),
    ],
)
def test_the_serial_monitor_says_when_a_line_came(tmp_path: Path, lines: list[str], columns: tuple[str, str]):
    (tmp_path / "arduino.txt").write_text("\n".join(lines) + "\n")
    recording = read_recording(tmp_path / "arduino.txt")
    assert recording.time == pytest.approx(TIME, abs=1e-9)
    assert recording.channels[columns[0]].values == pytest.approx(Q1, abs=1e-6)
    assert recording.channels[columns[1]].values == pytest.approx(Q2, abs=1e-6)


def test_a_velocity_in_degrees_is_one_per_second(tmp_path: Path):
    names = ["time", "q1_deg", "velocity_deg_1", "omega2 [rad]", "slider_vel_mm"]
    table = [",".join(names), *(f"{t:.3f},{5 * t:.4f},{50 * t:.4f},{t:.4f},{30 * t:.4f}" for t in TIME)]
    (tmp_path / "lab.csv").write_text("\n".join(table) + "\n")
    recording = read_recording(tmp_path / "lab.csv", mapping=["slider_vel_mm=slider.link_velocity"])
    found = {(one.joint, one.quantity): one for one in recording.channels.values() if one.quantity}
    assert found["joint_1", "link_velocity"].values == pytest.approx(50 * TIME * math.pi / 180)
    assert found["joint_1", "link_velocity"].conversion.startswith("deg/s -> rad/s")
    assert found["joint_2", "link_velocity"].values == pytest.approx(TIME)
    assert found["slider", "link_velocity"].values == pytest.approx(0.03 * TIME, abs=1e-7)


def test_a_header_that_comes_again_in_another_order_ends_the_table(tmp_path: Path):
    text = [f"{t:.3f},{a:.5f},{b:.5f}" for t, a, b in zip(TIME, Q1, Q2, strict=True)]
    (tmp_path / "lab.csv").write_text("\n".join(["time,q1,q2", *text[:20], "time,q2,q1", *text[20:]]) + "\n")
    with pytest.raises(RecordingError, match="names in another order: line 22"):
        read_recording(tmp_path / "lab.csv")


@pytest.mark.parametrize("position", ["q{}_filt", "joint_angle_{}", "abs_pos_{}", "q{}"])
def test_numbers_behind_commands_count_the_joints_that_the_positions_count(tmp_path: Path, position: str):
    names = ["time", *(position.format(i) for i in (1, 2)), "commanded_1", "commanded_2"]
    (tmp_path / "lab.csv").write_text("\n".join([",".join(names), *(f"{t:.3f},{t},{2 * t},{3 * t},{4 * t}" for t in TIME)]))
    found = {name: (one.joint, one.quantity) for name, one in read_recording(tmp_path / "lab.csv").channels.items()}
    assert found["commanded_2"] == ("joint_2", "reference_1")
    assert found[position.format(2)] == ("joint_2", "link_position")
