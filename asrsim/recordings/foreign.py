"""Files that laboratories have and that are not read here: what each is, and one line that makes of it what is read."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

from asrsim.errors import RecordingError

READ = "CSV, Excel (.xlsx), MCAP, a ROS bag, a MATLAB or numpy file"
_HDF5 = (
    "import h5py, numpy; "
    "numpy.savez({1!r}, **{{k: v[()].squeeze() for k, v in h5py.File({0!r}).items() if hasattr(v, 'shape')}})"
)
_PICKLE = "import pandas; pandas.DataFrame(pandas.read_pickle({0!r})).to_csv({2!r})"
_TDMS = "import nptdms; nptdms.TdmsFile.read({0!r}).as_dataframe(time_index=True).to_csv({2!r})"
_MDF = "import asammdf; asammdf.MDF({0!r}).to_dataframe().to_csv({2!r})"
_FOREIGN = (
    (b"\x89HDF", "an HDF5 file", _HDF5),
    (b"\x80\x03", "a pickle of Python", _PICKLE), (b"\x80\x04", "a pickle of Python", _PICKLE),
    (b"\x80\x05", "a pickle of Python", _PICKLE),
    (b"\xd0\xcf\x11\xe0", "an old Excel workbook", "Save it as .xlsx"),
    (b"PK\x03\x04", "a zip archive", "Unpack it; an OpenDocument spreadsheet is saved as .xlsx"),
    (b"\x1f\x8b", "compressed by gzip", "Unpack it: gunzip"), (b"BZh", "compressed by bzip2", "Unpack it: bunzip2"),
    (b"\xfd7zXZ", "compressed by xz", "Unpack it: unxz"), (b"7z\xbc\xaf", "a 7z archive", "Unpack it: 7z x"),
    (b"Rar!", "a rar archive", "Unpack it: unrar x"), (b"\x28\xb5\x2f\xfd", "compressed by zstd", "Unpack it: unzstd"),
    (b"\x02P", "a C3D file of markers", "Export it as CSV, with the angles of joints"),
    (b"TDSm", "a TDMS file of LabVIEW", _TDMS), (b"MDF     ", "a measurement file by ASAM (MDF)", _MDF),
    (b"\x93NUMPY", "a numpy array", "Let its name end in .npy"), (b"%PDF", "a PDF document", ""), (b"<", "HTML or XML", ""),
    (b"\x89PNG", "a picture", ""), (b"\xff\xd8\xff", "a picture", ""),
    (b"SQLite format 3", "a database; ROS 2 bags end in .db3", ""),
)  # fmt: skip
"""First bytes, what has them, and what to do: a line of Python with the file, and the .npz or .csv that comes of it."""

_LINES = (
    (r"\S+ \S+=\S+ \d{10,19}", "the line protocol of InfluxDB", "Export it as CSV: influx query --raw"),
    (r"\(\d+\.\d+\) \S+ [0-9A-Fa-f]+##?[0-9A-Fa-f.]*.*", "a log of a CAN bus (candump)",
     "Decode it to CSV with the bus's .dbc file, for example by python-can and cantools"),
)  # fmt: skip
"""Lines of text that hold numbers but no table, what has them, and what to do."""


def refuse_foreign_line(path: Path, line: int, text: str) -> None:
    """Raises RecordingError for a line that is known and not read."""
    for pattern, what, cure in _LINES:
        if re.fullmatch(pattern, text.strip()):
            raise RecordingError(f"is {what}, which is not read here", file=path, line=line, code="foreign-format", hint=cure)


def refuse_foreign(path: Path, start: bytes) -> None:
    """Raises RecordingError for a file that is known by its first bytes and not read."""
    for magic, what, cure in _FOREIGN:
        if start.startswith(magic):
            hint = _command(cure, path) if cure.startswith("import ") else cure or f"Expected {READ}; export it as CSV"
            if cure.startswith("Unpack it: "):
                hint += f" {shlex.quote(str(path))}"
            raise RecordingError(f"is {what}, which is not read here", file=path, code="foreign-format", hint=hint)


def from_hdf5(path: Path) -> str:
    """The command that makes an .npz of an HDF5 file, such as MATLAB's from version 7.3 on."""
    return _command(_HDF5, path)


def _command(line: str, path: Path) -> str:
    code = line.format(*(str(path.with_suffix(suffix)) for suffix in (path.suffix, ".npz", ".csv")))
    quoted = shlex.quote(code) if set(code) & set('"$`\\') else f'"{code}"'
    return f"Convert it where its library is installed: python3 -c {quoted}"
