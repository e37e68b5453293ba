"""Damaged files of every kind, and the commands that read them, each in a process with limited time and memory."""

from __future__ import annotations

import importlib
import io
import json
import math
import os
import random
import re
import resource
import runpy
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from support.damage import VALUES, damaged
from support.tiny import PENDULUM, SCENARIO

TEXTS = (
    *VALUES, "1e-300", "-1e12", "1e6", "true", "null", "[]", "{}", "[[[]]]", "~", "&a", "*a", "!!python/object:os.system x",
    "'", '"', "%", "- 1",
    "a: b", "{step: {at: 0.1, to: 1}}", "0:1:100000000", "nan", ".inf", "-.inf", "time", "elbow", "\t", ";", "\0", "1e400",
)  # fmt: skip
"""Words that replace words of text files."""
WORD = re.compile(r"[-+\w.]+")
NUMBERS = (math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324, 0.0, -1.0, 1e18, 2.0**63)
PATIENCE, AFTERWARDS, CPU = 20.0, 15.0, 45
"""Seconds of processor time after which a command gets Ctrl-C, in which it must then end, and which the system allows it."""
WAITING = 5.0
"""Seconds on the clock, while this process runs, that count as a second of processor time: a command may wait for ever."""
MEMORY = 700e6
"""Largest growth of a command's memory, bytes."""


def in_text(data: bytes, source: random.Random) -> bytes:
    """Text with one to three words or lines that are replaced, removed, moved or repeated."""
    text = data.decode("utf-8", "replace")
    for _ in range(source.randint(1, 3)):
        spots = list(WORD.finditer(text))
        lines = text.split("\n")
        what = source.randrange(6)
        if what < 3 and spots:
            spot = source.choice(spots)
            text = text[: spot.start()] + source.choice(TEXTS) + text[spot.end() :]
        elif what == 3:
            lines.insert(source.randrange(len(lines)), source.choice(lines))
            text = "\n".join(lines)
        elif what == 4:
            del lines[source.randrange(len(lines))]
            text = "\n".join(lines)
        else:
            lines.insert(source.randrange(len(lines)), lines.pop(source.randrange(len(lines))))
            text = "\n".join(lines)
    found = text.encode("utf-8", "replace")
    return in_bytes(found, source) if source.random() < 0.1 else found


def in_bytes(data: bytes, source: random.Random) -> bytes:
    """Bytes with one to three flips, cuts, insertions, repetitions or blanks, or numbers of extreme size."""
    for _ in range(source.randint(1, 3)):
        spot, size = source.randrange(len(data) + 1), source.choice((1, 2, 8, 100, 1000))
        what = source.randrange(6)
        if what == 0:
            data = data[:spot]
        elif what == 1:
            data = data[:spot] + bytes(data[spot : spot + size][::-1]) + data[spot + size :]
        elif what == 2:
            data = data[:spot] + source.randbytes(size) + data[spot + size :]
        elif what == 3:
            data = data[:spot] + data[spot : spot + size] * 2 + data[spot + size :]
        elif what == 4:
            data = data[:spot] + struct.pack("<Q", source.choice((0, 1, 2**31, 2**32 - 1, 2**63, 2**64 - 1))) + data[spot + 8 :]
        else:
            data = data[:spot] + struct.pack("<d", source.choice(NUMBERS)) + data[spot + 8 :]
    return data


def in_archive(data: bytes, source: random.Random) -> bytes:
    """A zip archive with a damaged member, whose checksum is right, or damaged bytes."""
    if source.random() < 0.2:
        return in_bytes(data, source)
    target = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as new:
        hit = source.choice(old.namelist())
        for name in old.namelist():
            content = old.read(name)
            if name == hit:
                content = (in_arrays if name.endswith(".npy") else in_text)(content, source)
            if name != hit or source.random() < 0.95:
                new.writestr(name, content)
    return target.getvalue()


def in_arrays(data: bytes, source: random.Random) -> bytes:
    """A NumPy file with other numbers, another shape or another type."""
    array = np.load(io.BytesIO(data))
    if array.dtype.names:
        return in_bytes(data, source)
    if array.dtype.kind == "U":
        array = np.array(in_json(str(array).encode(), source).decode("utf-8", "replace"))
    else:
        what = source.randrange(5)
        flat = array.ravel().copy()
        if what == 0 and flat.size:
            flat[:: source.choice((1, 2, 50))] = source.choice(NUMBERS)
        array = flat.reshape(array.shape)
        if what == 1:
            array = array[: source.randrange(len(array) + 1)] if array.ndim else array
        elif what == 2:
            array = array.T
        elif what == 3:
            with np.errstate(all="ignore"):
                array = array.astype(source.choice(("f4", "c16", "i1", "M8[s]", "S4")))
        elif what == 4:
            array = array.ravel()
    target = io.BytesIO()
    np.save(target, array)
    return in_bytes(target.getvalue(), source) if source.random() < 0.2 else target.getvalue()


def in_json(data: bytes, source: random.Random) -> bytes:
    """JSON with one to three values or keys that are replaced, removed or repeated."""
    tree = json.loads(data)
    for _ in range(source.randint(1, 3)):
        spots = list(_places(tree))
        if not spots:
            break
        holder, key = source.choice(spots)
        what = source.randrange(4)
        if what == 0:
            del holder[key]
        elif what == 1 and isinstance(holder, dict):
            holder[source.choice(TEXTS)] = holder.pop(key)
        elif what == 2:
            other = source.choice(spots)
            holder[key] = json.loads(json.dumps(other[0].get(other[1]) if isinstance(other[0], dict) else None))
        else:
            holder[key] = source.choice((*NUMBERS, *TEXTS, None, True, [], {}, 10**400, -1, [1.0] * 1000))
    text = json.dumps(tree)
    return in_text(text.encode(), source) if source.random() < 0.15 else text.encode()


def _places(tree: object) -> Iterator[tuple[object, object]]:
    for key, value in tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ():
        yield tree, key
        yield from _places(value)


def in_log(data: bytes, source: random.Random) -> bytes:
    """A log whose chunks are damaged inside, with right or missing checksums, or damaged bytes."""
    if source.random() < 0.4:
        return in_bytes(data, source)
    import zstandard
    from mcap.data_stream import ReadDataStream, RecordBuilder
    from mcap.opcode import Opcode
    from mcap.records import Attachment, Chunk

    out, position, hit = bytearray(data[:8]), 8, source.choice((Opcode.CHUNK, Opcode.ATTACHMENT))
    while position + 9 <= len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, position)
        body = data[position + 9 : position + 9 + length]
        position += 9 + length
        if opcode in (Opcode.DATA_END, Opcode.FOOTER):
            break
        builder = RecordBuilder()
        if opcode == hit == Opcode.CHUNK:
            chunk = Chunk.read(ReadDataStream(io.BytesIO(body)))
            inner = in_bytes(zstandard.decompress(chunk.data, chunk.uncompressed_size), source)
            chunk.data, chunk.uncompressed_size, chunk.uncompressed_crc = zstandard.compress(inner), len(inner), 0
            if source.random() < 0.3:
                chunk.message_start_time = source.choice((0, 1, 10**9, 2**63, 2**64 - 1))
            chunk.write(builder)
            out += builder.end()
        elif opcode == hit == Opcode.ATTACHMENT and source.random() < 0.6:
            attachment = Attachment.read(ReadDataStream(io.BytesIO(body)))
            try:
                attachment.data = in_json(attachment.data, source)
            except ValueError:
                attachment.data = in_text(attachment.data, source)
            attachment.write(builder)
            out += builder.end()
        else:
            out += struct.pack("<BQ", opcode, length) + body
    # Without a summary, as a killed run leaves it.
    return bytes(out)


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of file: its name in the folder, its damage, and commands that read it."""

    file: str
    damage: Callable[[bytes, random.Random], bytes]
    commands: tuple[str, ...]


def _robot(data: bytes, source: random.Random) -> bytes:
    return damaged(data.decode(), source)


RECORDING = (
    "plot base/log.mcap -e {} --out new",
    "init robot.urdf -e {} --out new.yaml",
    "twin step.yaml -e {} --out new",
    "run {} --no-plot --out new",
)
LOGS = (
    "plot {} --out new",
    "report {} --out new.html",
    "rerun {}",
    "render {} --out new --frames 2",
    "twin step.yaml -e {} --out new",
    "plot base/log.mcap -e {} --out new",
    "plot {} --joint elbow --quantity spring_energy --out new",
)
KINDS = {
    "urdf": Kind(
        file="robot.urdf",
        damage=_robot,
        commands=(
            "check {}",
            "run step.yaml --no-plot --out new",
            "init {} --out new.yaml",
            "export step.yaml --set modes=6 --out new.xml",
        ),
    ),
    "xacro": Kind(
        file="robot.xacro",
        damage=_robot,
        commands=(
            "check {}",
            "init {} --out new.yaml",
        ),
    ),
    "scenario": Kind(
        file="step.yaml",
        damage=in_text,
        commands=(
            "check {}",
            "run {} --no-plot --out new",
            "export {} --set modes=6 --out new.xml",
            "sweep {} --over elbow.damping=[0.1,0.2] --out new --workers 1 --no-plot",
        ),
    ),
    "full": Kind(
        file="full.yaml",
        damage=in_text,
        commands=(
            "check {}",
            "run {} --no-plot -q --out new",
        ),
    ),
    "ilc": Kind(
        file="learn.yaml",
        damage=in_text,
        commands=(
            "ilc {} --out new --no-plot",
            "check {}",
        ),
    ),
    "csv": Kind(file="lab.csv", damage=in_text, commands=RECORDING[:3]),
    "reading": Kind(file="read.csv.yaml", damage=in_text, commands=tuple(one.format("read.csv") for one in RECORDING[:3])),
    "json": Kind(file="lab.json", damage=in_json, commands=RECORDING[:3]),
    "jsonl": Kind(file="lab.jsonl", damage=in_text, commands=RECORDING[:2]),
    "npz": Kind(file="lab.npz", damage=in_archive, commands=RECORDING[:2]),
    "npy": Kind(
        file="lab.npy",
        damage=in_arrays,
        commands=("plot base/log.mcap -e {} --map lab_1=time[s] --map lab_2=elbow.link_position[rad] --out new",),
    ),
    "xlsx": Kind(file="lab.xlsx", damage=in_archive, commands=RECORDING[:2]),
    "ods": Kind(file="lab.ods", damage=in_archive, commands=RECORDING[:2]),
    "mat": Kind(file="lab.mat", damage=in_bytes, commands=RECORDING[:2]),
    "parquet": Kind(file="lab.parquet", damage=in_bytes, commands=RECORDING[:1]),
    "bag": Kind(file="lab.bag", damage=in_bytes, commands=RECORDING[:1]),
    "log": Kind(file="base/log.mcap", damage=in_log, commands=LOGS),
    "signal": Kind(
        file="signal.csv",
        damage=in_text,
        commands=(
            "run played.yaml --no-plot --out new",
            "check played.yaml",
        ),
    ),
    "learning": Kind(
        file="learned/state.npz", damage=in_archive, commands=("ilc learn.yaml --out learned --resume --no-plot",)
    ),
    "study": Kind(
        file="study/study.json",
        damage=in_json,
        commands=(
            "sweep study",
            "sweep step.yaml --over elbow.damping=[0.1,0.2] --out study --resume --workers 1 --no-plot",
        ),
    ),
    "resealed": Kind(
        file="study/study.json",
        damage=lambda data, source: sealed_again(
            in_json(data, source),
        ),
        commands=("sweep study",),
    ),
    "rows": Kind(file="study/rows.parquet", damage=in_bytes, commands=("sweep study",)),
    "draws": Kind(
        file="fit.json",
        damage=in_json,
        commands=("sweep step.yaml --fit fit.json --samples 2 --out new --workers 1 --no-plot",),
    ),
    "summary": Kind(
        file="base/summary.json",
        damage=in_json,
        commands=(
            "run step.yaml --no-plot --overwrite --out base",
            "report base --out new.html",
            "plot base --out new",
        ),
    ),
    "messages": Kind(file="message.json", damage=in_json, commands=("messages",)),
    "trajectory": Kind(file="trajectory.json", damage=in_json, commands=("messages",)),
    "limits": Kind(
        file="limits.yaml",
        damage=in_text,
        commands=("design step.yaml --free elbow.damping --limits limits.yaml --duration 0.5 --no-plot --out new.csv",),
    ),
}


def sealed_again(data: bytes) -> bytes:
    """Description of a study whose checksum is that of its content, as a stranger may write it."""
    from asrsim.sweeps.store import sealed

    try:
        tree = json.loads(data)
        tree.pop("seal", None)
        return sealed(tree).encode()
    except (ValueError, AttributeError, TypeError):
        return data


def made(folder: Path) -> Path:
    """The folder with one whole file of each kind."""
    import pandas as pd
    from scipy.io import savemat

    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robot.urdf").write_text(PENDULUM)
    xacro = PENDULUM.replace("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ', 1)
    xacro = xacro.replace('<link name="world"/>', '<xacro:property name="k" value="10"/><link name="world"/>')
    (folder / "robot.xacro").write_text(xacro.replace("<spring_k>10", "<spring_k>${2*k}"))
    step = SCENARIO.replace("pendulum.urdf", "robot.urdf").replace("1.5", "0.3")
    (folder / "step.yaml").write_text(step)
    (folder / "full.yaml").write_text(
        step + "gravity: [0, 0, -9.81]\nstep: 0.001\nsubsteps: 2\nseed: 3\nlog_rate: 500\ninitial: {elbow: 0.1}\n"
        "parameters: {elbow: {spring_k: 20, mot_J: 0.01}}\nlink_damping: {elbow: {ratio: 0.2, inertia: 0.01}}\n"
        "imperfections: {commands: {elbow: {delay: 0.01, noise: 0.001}}, sensors: {elbow: {rate: 200, quantum: 0.001}}}\n"
        "external_torques: {elbow: {sum: [{pulse_train: {high: 0.5, width: 0.05, period: 0.1}}, "
        "{sinusoid: {amplitude: 0.1, frequency: 2}}]}}\n"
        "world: {ground: {}, objects: {ball: {shape: sphere, size: 0.05, mass: 0.1, position: [0.5, 0.5, 0.5]}}}\n"
        "expect: [{joint: elbow, quantity: link_position, measure: maximum, comparison: <, value: 1}]\n"
        "variants: {soft: {parameters: {elbow: {spring_k: 5}}}, stiff: {}}\n"
    )
    motion = "ilc: {trajectory: {elbow: {minimum_jerk: {duration: 0.2, to: 0.1}}}, tolerance: 6.0e-5, max_iterations: 2}\n"
    (folder / "learn.yaml").write_text("robot: robot.urdf\nduration: 0.25\n" + motion)
    time_s = np.arange(150) / 500.0
    table = pd.DataFrame(
        {"time [s]": time_s, "elbow.link_position [rad]": 0.2 * np.sin(9 * time_s), "elbow.reference_1 [rad]": 0.3 * time_s}
    )
    table.to_csv(folder / "lab.csv", index=False)
    table.to_csv(folder / "signal.csv", index=False)
    table.to_csv(folder / "read.csv", index=False)
    (folder / "read.csv.yaml").write_text(
        "time: {column: 'time [s]', unit: s}\nseparator: ','\nheader: 1\nwindow: [0, 0.25]\nmissing: -9999\n"
        "map: {'elbow.link_position [rad]': '-1*elbow.link_position [rad] - 0.01', "
        "'elbow.reference_1 [rad]': 'elbow.reference_1 [rad]'}\n"
    )
    plain = table.rename(columns=lambda name: name.split(" ")[0])
    (folder / "lab.json").write_text(json.dumps({name: list(plain[name]) for name in plain}))
    plain.to_json(folder / "lab.jsonl", orient="records", lines=True)
    np.savez(folder / "lab.npz", **{name: plain[name].to_numpy() for name in plain})
    np.save(folder / "lab.npy", plain.to_numpy())
    savemat(
        folder / "lab.mat",
        {
            "time": time_s,
            "lab": {"time": time_s, "q1": 0.1 * time_s, "q1_ref": 0.3 * time_s, "position": np.outer(time_s, [1, 2])},
        },
    )
    if_possible(lambda: plain.to_parquet(folder / "lab.parquet"))
    write_books(folder, table)
    if_possible(lambda: write_bag(folder / "lab.bag", time_s))
    (folder / "played.yaml").write_text(
        "robot: robot.urdf\nduration: 0.2\nreferences: {elbow: {equilibrium_position: "
        "{playback: {file: signal.csv, column: 'elbow.reference_1 [rad]'}}}}\n"
    )
    draws = {
        "keys": ["elbow.damping", "elbow.spring_k"],
        "mean": [0.2, 10.0],
        "covariance": [[1e-4, 0.0], [0.0, 0.1]],
        "logarithmic": False,
        "bounds": [[0.1, 0.3], [5.0, 20.0]],
    }
    (folder / "fit.json").write_text(json.dumps(draws))
    (folder / "message.json").write_text(
        '{"data": [0.5], "name": ["elbow"], "position": [0.1], "effort": [0.2], "header": {"stamp": {"sec": 1, "nanosec": 2}}}'
    )
    points = '{"positions": [0.5], "velocities": [0.1], "time_from_start": {"sec": 0, "nanosec": 5000000}}'
    later = points.replace("5000000", "9000000")
    (folder / "trajectory.json").write_text('{"joint_names": ["elbow"], "points": [' + points + ", " + later + "]}")
    (folder / "limits.yaml").write_text("limits: {elbow: {link_position: [-0.5, 0.5], link_velocity: 9, deflection: 0.6}}\n")
    for line in (
        "run step.yaml --no-plot -q --out base",
        "ilc learn.yaml --no-plot -q --out learned",
        "sweep step.yaml --over elbow.damping=[0.1,0.2] --out study --workers 1 --no-plot -q",
    ):
        outcome = tried(folder, line)
        assert "unexpected" not in outcome.text, outcome.text
    return folder


def if_possible(write: Callable[[], object]) -> None:
    """Write a file of a format, unless its library is not installed."""
    try:
        write()
    except ImportError:
        return


def write_books(folder: Path, table: object) -> None:
    """The table as the least workbooks in OOXML and OpenDocument."""
    rows = [list(table.columns), *table.to_numpy().tolist()]
    spaces = " ".join(
        f'xmlns:{n}="urn:oasis:names:tc:opendocument:xmlns:{n}:1.0"' for n in ("office", "table", "text", "manifest")
    )
    with zipfile.ZipFile(folder / "lab.ods", "w", zipfile.ZIP_DEFLATED) as book:
        cells = "".join(
            "<table:table-row>"
            + "".join(
                f'<table:table-cell office:value-type="float" office:value="{cell}"/>'
                if isinstance(cell, float)
                else f'<table:table-cell office:value-type="string"><text:p>{cell}</text:p></table:table-cell>'
                for cell in row
            )
            + "</table:table-row>"
            for row in rows
        )
        book.writestr("mimetype", "application/vnd.oasis.opendocument.spreadsheet")
        book.writestr("META-INF/manifest.xml", f"<manifest:manifest {spaces}/>")
        body = f'<office:spreadsheet><table:table table:name="S">{cells}</table:table></office:spreadsheet>'
        body = f"<office:body>{body}</office:body>"
        book.writestr("content.xml", f"<office:document-content {spaces}>{body}</office:document-content>")
    with zipfile.ZipFile(folder / "lab.xlsx", "w", zipfile.ZIP_DEFLATED) as book:
        main, package = (
            "http://schemas.openxmlformats.org/spreadsheetml/2006/main",
            "http://schemas.openxmlformats.org/package/2006",
        )
        office = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
        cells = "".join(
            f'<row r="{i}">'
            + "".join(
                f'<c r="{"ABC"[j]}{i}"><v>{cell}</v></c>'
                if isinstance(cell, float)
                else f'<c r="{"ABC"[j]}{i}" t="inlineStr"><is><t>{cell}</t></is></c>'
                for j, cell in enumerate(row)
            )
            + "</row>"
            for i, row in enumerate(rows, start=1)
        )
        book.writestr(
            "[Content_Types].xml",
            f'<Types xmlns="{package}/content-types"><Default Extension="xml" ContentType="application/xml"/></Types>',
        )
        one = f'<Relationship Id="r1" Type="{office}/{{}}" Target="{{}}"/>'
        relation = f'<Relationships xmlns="{package}/relationships">{one}</Relationships>'
        book.writestr("_rels/.rels", relation.format("officeDocument", "xl/workbook.xml"))
        book.writestr("xl/_rels/workbook.xml.rels", relation.format("worksheet", "worksheets/sheet1.xml"))
        book.writestr(
            "xl/workbook.xml",
            f'<workbook xmlns="{main}" xmlns:r="{office}"><sheets><sheet name="S" sheetId="1" r:id="r1"/></sheets></workbook>',
        )
        book.writestr(
            "xl/worksheets/sheet1.xml",
            f'<worksheet xmlns="{main}"><dimension ref="A1:C{len(rows)}"/><sheetData>{cells}</sheetData></worksheet>',
        )


def write_bag(path: Path, times: np.ndarray) -> None:
    """A ROS 1 bag with joint states."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    header, stamp, state = (
        store.types[name] for name in ("std_msgs/msg/Header", "builtin_interfaces/msg/Time", "sensor_msgs/msg/JointState")
    )
    with Writer(path) as writer:
        connection = writer.add_connection("/joint_states", state.__msgtype__, typestore=store)
        for number, moment in enumerate(times):
            about = header(seq=number, stamp=stamp(sec=0, nanosec=int(moment * 1e9)), frame_id="")
            message = state(
                header=about, name=["elbow"], position=np.array([moment]), velocity=np.array([1.0]), effort=np.array([0.0])
            )
            writer.write(connection, int(moment * 1e9), store.serialize_ros1(message, state.__msgtype__))


@dataclass(frozen=True)
class Tried:
    """Outcome of a command in a process of its own."""

    code: int
    """Exit code; negative: the signal that ended it."""
    text: str
    memory: float
    """Growth of the largest memory, bytes."""
    seconds: float

    @property
    def fault(self) -> str:
        """What is wrong with the outcome; empty if the command said in words what it did not do."""
        if self.code in (-signal.SIGKILL, -signal.SIGXCPU):
            return f"did not end, also after Ctrl-C ({self.seconds:.0f} s)"
        if self.code < 0:
            return f"ended by signal {-self.code}"
        for word in ("unexpected error", "Traceback", "RuntimeWarning"):
            if word in self.text:
                return next(line for line in self.text.splitlines() if word in line)
        if self.code not in (0, 130) and not self.text.strip():
            return f"failed ({self.code}) without a word"
        return f"took {self.memory / 1e6:.0f} MB" if self.memory > MEMORY else ""


def tried(folder: Path, line: str) -> Tried:
    """Outcome of the command in the folder. This process forks: what it has imported need not be imported again."""
    output = folder / "printed.txt"
    child = os.fork()
    if child == 0:
        _child(folder, line, output)
    ended, interrupted, waited, last = 0, False, 0.0, time.monotonic()
    while not ended:
        ended, status, usage = os.wait4(child, os.WNOHANG)
        time.sleep(0.005)
        # If the machine has stopped this process and its child, they have not waited.
        waited, last = waited + min(time.monotonic() - last, 1.0), time.monotonic()
        passed = 0.0 if ended else max(_processor_time(child), waited / WAITING)
        if passed > PATIENCE + AFTERWARDS:
            os.kill(child, signal.SIGKILL)
        elif passed > PATIENCE and not interrupted:
            interrupted = True
            os.kill(child, signal.SIGINT)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    code = os.waitstatus_to_exitcode(status)
    text = output.read_text(encoding="utf-8", errors="replace")
    return Tried(code, text, 1024.0 * max(usage.ru_maxrss - before, 0), waited)


def _processor_time(process: int) -> float:
    """Processor time in s of a process of ours and of its ended children."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")


def import_all(folder: Path) -> None:
    """Import what the last command of `tried` in the folder has imported, so that further commands need not."""
    for name in (folder / "imported.txt").read_text().split():
        if name not in sys.modules:
            with suppress(Exception):
                importlib.import_module(name)


def _child(folder: Path, line: str, output: Path) -> None:
    code = 70
    try:
        os.chdir(folder)
        descriptor = os.open(output, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(descriptor, 1)
        os.dup2(descriptor, 2)
        sys.stdout, sys.stderr = os.fdopen(1, "w", closefd=False), os.fdopen(2, "w", closefd=False)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        resource.setrlimit(resource.RLIMIT_CPU, (CPU, CPU))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        if line == "messages":
            code = _messages()
        else:
            import asrsim.confined.run
            from asrsim.cli.app import main

            asrsim.confined.run.subprocess = SimpleNamespace(run=_forked, TimeoutExpired=subprocess.TimeoutExpired)
            sys.argv = ["asrsim", *line.split()]
            try:
                main()
            except SystemExit as end:
                code = int(end.code or 0)
    except BaseException:
        import traceback

        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        with suppress(OSError):
            output.with_name("imported.txt").write_text("\n".join(sys.modules))
        os._exit(code)


def _forked(command: list[str], **request: Any) -> object:
    """Stand-in for `subprocess.run` of a confined script: this process forks instead of importing its libraries anew.

    The script has the limits that it has in a process of its own, beside the memory of this process.
    """
    *_, seconds, memory, script = command
    own = resource.getpagesize() * int(Path("/proc/self/statm").read_text().split()[0])
    with tempfile.TemporaryFile() as question, tempfile.TemporaryFile() as answer:
        question.write(request["input"])
        question.seek(0)
        child = os.fork()
        if child == 0:
            _script(script, int(float(seconds)) + 1, int(memory) + own, question.fileno(), answer.fileno())
        _, status = os.waitpid(child, 0)
        code = os.waitstatus_to_exitcode(status)
        if code == -signal.SIGALRM:
            raise subprocess.TimeoutExpired(command, float(seconds))
        answer.seek(0)
        return SimpleNamespace(returncode=code, stdout=answer.read())


def _script(script: str, seconds: int, memory: int, question: int, answer: int) -> None:
    """Run the confined script in this process, which then ends."""
    code = 1
    try:
        for stream, number in ((question, 0), (answer, 1), (os.open(os.devnull, os.O_WRONLY), 2)):
            os.dup2(stream, number)
        sys.stdin, sys.stdout = os.fdopen(0), os.fdopen(1, "w", closefd=False)
        sys.stderr = os.fdopen(2, "w", closefd=False)
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(seconds)
        resource.setrlimit(resource.RLIMIT_AS, (memory, resource.RLIM_INFINITY))
        runpy.run_path(script, run_name="__main__")
        code = 0
    except SystemExit as end:
        code = int(bool(end.code))
    finally:
        with suppress(BaseException):
            sys.stdout.flush()
        os._exit(code)


def _messages() -> int:
    """Messages of a client, as a live run takes them, on every topic."""
    import asrsim
    from asrsim.live.commands import CommandInput
    from asrsim.live.foxglove import decoded
    from asrsim.live.publisher import Publisher
    from asrsim.simulation.prepare import prepare

    (scenario,) = asrsim.load_scenario("step.yaml")
    with asrsim.Simulation(prepare(scenario, settable=True)) as simulation:
        publisher = Publisher(simulation, namespace="")
        commands = CommandInput(simulation.prepared.info.joints, publisher.ranges)
        simulation.advance(1)
        for file in ("message.json", "trajectory.json"):
            data = Path(file).read_bytes()
            for number in range(len(commands.inlets)):
                values = commands.listen([decoded(number, data)], simulation, simulation.time, 1e-3)
                for _ in range(3):
                    for target, value in values.items():
                        simulation.set_reference(*target, value)
                    try:
                        simulation.advance(2)
                    except asrsim.DivergenceError as error:
                        print(error)
                        return 0
                    values = commands.listen([], simulation, simulation.time, 1e-3)
    return 0


def trials(base: Path, scratch: Path, kinds: tuple[str, ...], count: int, seed: int) -> Iterator[tuple[str, str, int, Tried]]:
    """Kind, command, number and outcome of damaged files, in a fresh copy of the folder each."""
    available = [kind for kind in kinds if (base / KINDS[kind].file).exists()]
    for number in range(count):
        source = random.Random(f"{seed} {number}")
        name = source.choice(available)
        kind = KINDS[name]
        data = kind.damage((base / kind.file).read_bytes(), source)
        line = source.choice(kind.commands).format(kind.file)
        shutil.rmtree(scratch, ignore_errors=True)
        shutil.copytree(base, scratch)
        (scratch / kind.file).write_bytes(data)
        yield name, line, number, tried(scratch, line)
