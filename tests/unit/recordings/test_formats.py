"""Formats besides delimited text: one reader each, the same numbers from every one."""

import json
import os
import zipfile
from datetime import datetime, timedelta

import numpy as np
import pytest
from scipy.io import savemat

from asrsim.confined.run import ConfinedError, run_confined
from asrsim.errors import RecordingError
from asrsim.recordings import read_recording
from asrsim.signals import Playback

TIME = np.arange(50) * 0.01
Q1, Q2 = np.sin(5 * TIME), np.cos(5 * TIME)
HEADER = ["time", "q1", "q2 [deg]"]
ROWS = [list(row) for row in zip(TIME.tolist(), Q1.tolist(), np.degrees(Q2).tolist(), strict=True)]


def excel(path):
    book(path, {"notes": [["made on a Monday"]], "data": [["Laboratory 5"], HEADER, *ROWS]})


def parquet(path):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import feather
    from pyarrow import parquet as writer

    columns = [*zip(*ROWS, strict=True)]
    flat = pyarrow.table({"time": columns[0], "q1": columns[1], "q2 [deg]": columns[2]})
    (feather.write_feather if path.suffix == ".feather" else writer.write_table)(flat, str(path))


def hdf5(path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        run = file.create_group("run")
        run["time"], run["q1"] = TIME[None, :], Q1[None, :]
        run["q2_deg"] = np.degrees(Q2)[None, :]
    data = path.read_bytes()
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + data[512:])


WRITERS = {
    "lab.xlsx": excel,
    "lab.parquet": parquet,
    "lab.feather": parquet,
    "vectors.mat": lambda path: savemat(path, {"time": TIME, "q1": Q1[:, None], "q2_deg": np.degrees(Q2)}),
    "struct.mat": lambda path: savemat(path, {"run": {"time": TIME, "gain": 3.0, "q1": Q1, "q2_deg": np.degrees(Q2)}}),
    "ascii.mat": lambda path: np.savetxt(path, ROWS, header="time q1 q2_deg"),
    "lab73.mat": hdf5,
    "lab.npz": lambda path: np.savez(path, time=TIME, q1=Q1, q2_deg=np.degrees(Q2)),
    "lab.jsonl": lambda path: path.write_text("\n".join(json.dumps(dict(zip(HEADER, row, strict=True))) for row in ROWS)),
    "cut.jsonl": lambda path: path.write_text(
        "\n".join(json.dumps(dict(zip(HEADER, row, strict=True))) for row in ROWS) + '\n{"t'
    ),
    "records.json": lambda path: path.write_text(json.dumps([dict(zip(HEADER, row, strict=True)) for row in ROWS])),
    "nested.json": lambda path: path.write_text(
        json.dumps({"run": 3, "rows": [dict(zip(HEADER, row, strict=True)) for row in ROWS]})
    ),
    "lists.json": lambda path: path.write_text(
        json.dumps({"run": 3, **dict(zip(HEADER, zip(*ROWS, strict=True), strict=True))})
    ),
}


def book(path, sheets):
    """A workbook by hand: what it holds is what Excel writes."""
    from xml.sax.saxutils import escape

    def cell(value):
        if isinstance(value, str):
            return f'<c t="inlineStr"><is><t>{escape(value)}</t></is></c>'
        if isinstance(value, datetime):
            return f'<c s="1"><v>{(value - datetime(1899, 12, 30)) / timedelta(days=1)!r}</v></c>'
        return f"<c><v>{value!r}</v></c>"

    space = 'xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"'
    office = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
    package = "http://schemas.openxmlformats.org/package/2006"
    names = list(enumerate(sheets, start=1))
    with zipfile.ZipFile(path, "w") as target:
        listed = "".join(f'<sheet name="{name}" sheetId="{i}" r:id="rId{i}"/>' for i, name in names)
        target.writestr("xl/workbook.xml", f'<workbook {space} xmlns:r="{office}"><sheets>{listed}</sheets></workbook>')
        related = "".join(
            f'<Relationship Id="rId{i}" Type="{office}/worksheet" Target="worksheets/sheet{i}.xml"/>' for i, _ in names
        )
        links = {
            "_rels/.rels": f'<Relationship Id="rId1" Type="{office}/officeDocument" Target="xl/workbook.xml"/>',
            "xl/_rels/workbook.xml.rels": related,
        }
        for place, inner in links.items():
            target.writestr(place, f'<Relationships xmlns="{package}/relationships">{inner}</Relationships>')
        formats = '<cellXfs><xf numFmtId="0"/><xf numFmtId="22"/></cellXfs>'
        target.writestr("xl/styles.xml", f"<styleSheet {space}>{formats}</styleSheet>")
        for i, name in names:
            rows = "".join(f"<row>{''.join(map(cell, row))}</row>" for row in sheets[name])
            target.writestr(f"xl/worksheets/sheet{i}.xml", f"<worksheet {space}><sheetData>{rows}</sheetData></worksheet>")


def check(recording):
    np.testing.assert_allclose(recording.time, TIME, atol=1e-9)
    np.testing.assert_allclose(recording.column("joint_1", "link_position").values, Q1, atol=1e-9)
    np.testing.assert_allclose(recording.column("joint_2", "link_position").values, Q2, atol=1e-9)


@pytest.mark.parametrize("name", WRITERS)
def test_recordings_have_equal_numbers_in_every_format(tmp_path, name):
    WRITERS[name](tmp_path / name)
    check(read_recording(tmp_path / name))


def test_signals_read_the_same_columns_as_recordings(tmp_path):
    path = tmp_path / "vectors.mat"
    WRITERS[path.name](path)
    times, values = Playback(file=path, column="q2").samples
    np.testing.assert_allclose(times, TIME, atol=1e-9)
    np.testing.assert_allclose(values, Q2, atol=1e-9)


def test_a_document_selects_a_sheet_and_dates_are_times(tmp_path):
    begin = datetime(2024, 5, 6, 10)
    rows = [[begin + timedelta(seconds=0.25 * i), *row[1:]] for i, row in enumerate(ROWS)]
    path = tmp_path / "lab.xlsx"
    book(path, {"first": [HEADER, *[[t, -a, b] for t, a, b in ROWS]], "second": [HEADER, *rows]})
    assert "several-sheets" in [one.code for one in read_recording(path).findings]
    (tmp_path / "lab.xlsx.yaml").write_text("sheet: second\n")
    recording = read_recording(path)
    np.testing.assert_allclose(recording.column("joint_1", "link_position").values, Q1, atol=1e-12)
    np.testing.assert_allclose(recording.time, 0.25 * np.arange(50), atol=2e-3)
    (tmp_path / "lab.xlsx.yaml").write_text("sheet: third\n")
    with pytest.raises(RecordingError, match="no such sheet"):
        read_recording(path)


def test_structs_with_unix_times_keep_the_time_between_them(tmp_path):
    """The second one begins 0.5 s after the first."""
    savemat(tmp_path / "lab.mat", {"a": {"time": 1.7e9 + TIME, "q1": Q1}, "b": {"time": 1.7e9 + 0.5 + TIME, "q2": Q2}})
    recording = read_recording(tmp_path / "lab.mat")
    for column, begin in (("a.q1", 0.0), ("b.q2", 0.5)):
        np.testing.assert_allclose(recording.channels[column].time, begin + TIME, atol=3e-7)
        np.testing.assert_array_equal(Playback(file=recording.path, column=column).samples[0], recording.channels[column].time)


def test_the_time_of_a_matrix_is_stated(tmp_path):
    path = tmp_path / "lab.npz"
    np.savez(path, M=np.column_stack([TIME, Q1, 2 * Q1]), M_2=Q2)
    with pytest.raises(RecordingError, match="none of the columns is a time: M_1, M_2"):
        read_recording(path)
    recording = read_recording(path, mapping=["M_1=time", "M_2=elbow.link_position"])
    np.testing.assert_allclose(recording.column("elbow", "link_position").values, Q1)
    np.testing.assert_array_equal(recording.channels["M_2#2"].values, Q2)
    np.testing.assert_allclose(read_recording(path, rate=500.0).time, 0.002 * np.arange(50))


def test_columns_of_an_array_are_numbered_after_its_file(tmp_path):
    np.save(tmp_path / "lab.npy", np.column_stack([TIME, Q1]))
    recording = read_recording(tmp_path / "lab.npy", mapping=["lab_1=time", "lab_2=elbow.link_position"])
    np.testing.assert_allclose(recording.column("elbow", "link_position").values, Q1)


def test_vectors_of_another_length_are_skipped_with_a_note(tmp_path):
    savemat(tmp_path / "lab.mat", {"a": {"t": TIME, "q1": Q1, "gains": np.arange(2.0)}, "b": {"t": TIME[::2], "q2": Q2[::2]}})
    recording = read_recording(tmp_path / "lab.mat")
    assert ["a.gains" in one.message for one in recording.findings if one.code == "unread"] == [True]
    assert {name: len(one.time) for name, one in recording.channels.items()} == {"a.q1": 50, "b.q2": 25}


def test_objects_of_python_are_never_run(tmp_path):
    marker = tmp_path / "ran"

    class Evil:
        def __reduce__(self):
            return os.mkdir, (str(marker),)

    np.savez(tmp_path / "lab.npz", time=TIME, q1=Q1, evil=np.array([Evil()], dtype=object))
    recording = read_recording(tmp_path / "lab.npz")
    assert "objects" in [one.code for one in recording.findings]
    assert not marker.exists()


@pytest.mark.parametrize("head", [b"PK\x03\x04", b"\x80\x04"])
def test_a_format_that_is_not_read_is_refused(tmp_path, head):
    (tmp_path / "lab.bin").write_bytes(head + bytes(40) + b"1")
    with pytest.raises(RecordingError, match="not a text file"):
        read_recording(tmp_path / "lab.bin")


@pytest.mark.parametrize("place", [345, 472])
def test_a_matlab_file_that_crashes_scipy_is_an_error(tmp_path, place):
    path = tmp_path / "lab.mat"
    savemat(path, {"t": TIME[:6], "s": {"q": TIME[:6], "n": "abc"}, "c": np.array([TIME[:6], "x"], dtype=object)})
    data = bytearray(path.read_bytes())
    data[place] = 13
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=r"lab\.mat"):
        read_recording(path)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("bytearray(2**28)", "more than 0.25 GiB"),
        ("while True: pass", "did not finish within 0.3 s"),
        ("os.kill(os.getpid(), 11)", "crashed"),
    ],
)
def test_a_confined_script_ends_at_its_limits(tmp_path, line, message):
    script = tmp_path / "script.py"
    script.write_text(f"import os\n{line}\nprint(1)\n")
    with pytest.raises(ConfinedError, match=message):
        run_confined(script, {}, seconds=0.3 if "while" in line else 20.0, memory=2**28)


def test_an_archive_larger_than_the_memory_is_refused(tmp_path):
    header = b"\x93NUMPY\x01\x00F\x00" + str({"descr": "<f8", "fortran_order": False, "shape": (2**29,)}).encode().ljust(70)
    with zipfile.ZipFile(tmp_path / "lab.npz", "w", zipfile.ZIP_DEFLATED) as target:
        target.writestr("q.npy", header + bytes(10**7))
    with pytest.raises(RecordingError, match=r"lab\.npz: needs far more memory"):
        read_recording(tmp_path / "lab.npz")


@pytest.mark.parametrize("other", [[[1, 2], [1]], [10**400, 1, 2], "text", None])
def test_other_values_of_json_are_left_out(tmp_path, other):
    path = tmp_path / "lab.json"
    path.write_text(json.dumps({"t": [0.0, 0.01, 0.02], "q1": [1, 2, 3], "run": {"other": other}}))
    assert [*read_recording(path).channels] == ["q1"]


@pytest.mark.parametrize("name", ["lab.jsonl", "records.json"])
def test_json_is_found_in_files_with_any_ending(tmp_path, name):
    path = tmp_path / "log.txt"
    WRITERS[name](path)
    path.write_text(path.read_text().replace("[{", "[\n  {\n").replace('{"', '{ "'))
    check(read_recording(path))


def test_records_name_the_joints_of_their_lists(tmp_path):
    path = tmp_path / "lab.jsonl"
    states = [{"t": t, "name": ["arm", "leg"], "position": [q, 0.0], "raw": [q]} for t, q in zip(TIME, Q1, strict=True)]
    path.write_text("\n".join(map(json.dumps, states)))
    recording = read_recording(path, joints=["leg", "arm"])
    np.testing.assert_allclose(recording.column("arm", "link_position").values, Q1)
    np.testing.assert_allclose(recording.channels["raw[0]"].values, Q1)


@pytest.mark.parametrize("text", ['{"a":' * 900 + "1" + "}" * 900, "null", "5", "[]", " \n"])
def test_json_without_records_is_refused(tmp_path, text):
    path = tmp_path / "lab.json"
    path.write_text(text)
    with pytest.raises(RecordingError, match=r"lab\.json"):
        read_recording(path)


@pytest.mark.parametrize("name", ["lab.csv", "lab.bag", "lab.mat", "lab.parquet", "lab"])
def test_a_pointer_of_git_lfs_is_said_to_be_one(tmp_path, name):
    pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:" + 32 * "ab" + "\nsize 123456\n"
    (tmp_path / name).write_text(pointer)
    with pytest.raises(RecordingError, match="pointer of Git LFS") as caught:
        read_recording(tmp_path / name)
    assert "git lfs pull" in str(caught.value.problems[0].hint)
