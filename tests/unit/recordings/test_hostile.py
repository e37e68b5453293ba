"""Recordings by strangers: damaged files that crash libraries in C, and small files that unpack to all memory."""

from __future__ import annotations

import zipfile

import numpy as np
import pytest
from scipy.io import savemat

from asrsim.confined import ConfinedError, run_confined
from asrsim.errors import RecordingError
from asrsim.recordings import read_recording

TIME = 0.1 * np.arange(6)


@pytest.mark.parametrize(("place", "value"), [(634, 3), (345, 13), (176, 15), (472, 13), (428, 15)])
def test_a_damaged_matlab_file_that_crashes_scipy_is_an_error_and_not_the_end_of_the_process(tmp_path, place, value):
    path = tmp_path / "lab.mat"
    cells = np.array([TIME, "x"], dtype=object)
    savemat(path, {"t": TIME, "s": {"q": TIME, "n": "abc"}, "c": cells})
    data = bytearray(path.read_bytes())
    data[place] = value
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=r"lab\.mat"):
        read_recording(path)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("bytearray(2**28)", "more than 0.25 GiB"),
        ("while True: pass", "did not finish within 1 s"),
        ("os.kill(0, 11)", "crashed"),
    ],
)
def test_a_confined_script_that_takes_memory_or_time_or_crashes_is_ended(tmp_path, line, message):
    script = tmp_path / "script.py"
    script.write_text(f"import os\n{line.replace('os.kill(0', 'os.kill(os.getpid()')}\nprint(1)\n")
    with pytest.raises(ConfinedError, match=message):
        run_confined(script, {}, seconds=1.0 if "while" in line else 20.0, memory=2**28)


def archive(path, name):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as target:
        target.writestr("xl/workbook.xml", "")
        target.writestr(name, bytes(10**7))


def write_mcap(path):
    from mcap.writer import CompressionType, Writer

    for compression in (CompressionType.ZSTD,):
        with path.open("wb") as stream:
            writer = Writer(stream, chunk_size=10**8, compression=compression)
            writer.start()
            channel = writer.register_channel("/q", "json", 0)
            for i in range(100):
                writer.add_message(channel, i, b" " * 10**5, i)
            writer.finish()


@pytest.mark.parametrize("name", ["lab.xlsx", "lab.npz"])
def test_an_archive_that_would_unpack_to_too_much_is_refused_before_it_is_unpacked(tmp_path, monkeypatch, name):
    path = tmp_path / name
    archive(path, "t.npy")
    monkeypatch.setattr("asrsim.recordings.formats.LEAST", 2**20)
    with pytest.raises(RecordingError, match="would unpack to") as caught:
        read_recording(path)
    assert caught.value.problems[0].file == path


def test_a_chunk_that_lies_about_its_size_is_damage(tmp_path):
    path = tmp_path / "lab.mcap"
    write_mcap(path)
    data = path.read_bytes()
    for number in (1, 2**62, 10_000_000):
        place = data.index(b"\x04\0\0\0zstd") - 12  # the chunk's uncompressed size stands before its checksum and compression
        path.write_bytes(data[:place] + number.to_bytes(8, "little") + data[place + 8 :])
        with pytest.raises(RecordingError, match=r"lab\.mcap"):
            read_recording(path)
