"""Checks and verdicts about what seldom is wrong: recordings that jump, channels that no mode has, chunks that are damaged."""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import lz4.frame
import numpy as np
import zstandard

from over_ranges import NOISE, Asked, T, found, shapes

Fake = SimpleNamespace
HERE = Path("file.csv")


def of_checks() -> Asked:
    yield from _reasons()
    yield from _chunks()
    yield from _references()
    yield from _clocks()
    yield from _limits()
    yield "formats", found("plots.output.check_formats"), [(("png", "pdf", "png"),), (("svgg",),), (("x", "png", "y"),), ((),)]
    yield "kept rows", _kept, [(rate, *chunks) for rate in (1000.0, 300.0, 90.0) for chunks in ((10, 10), (7, 1, 12), (20,))]
    actuators, told = found("actuators.ACTUATORS"), found("cli.actuators._as_dict")
    for name in actuators.names():
        parts = {k: v for k, v in told(actuators.get(name)).items() if k != "parameters"}
        yield f"told of {name}", lambda p=parts: p, [()]
        for one in told(actuators.get(name))["parameters"]:
            yield f"told of {name}", lambda p=one: p, [()]


def _kept(rate: float, *chunks: int) -> list[float]:
    """Times of a study's signals, whose samples come in chunks."""
    kept = found("sweeps.tap.Signals")(Fake(signals=("j.link_position",), rate=rate), Fake(joints=()), 0.001)
    start = 0
    for count in chunks:
        time = 0.001 * np.arange(start, start + count)
        kept.write(Fake(time=time, joints=("j",), values={"link_position": time[:, None]}))
        start += count
    return [round(float(t), 6) for one in kept._kept for t in one.time]


def _all(text: str) -> list[str]:
    """A record shows the beginning of a text: of each of these all."""
    return [text[k : k + 55] for k in range(0, len(text), 55)]


def _reasons() -> Asked:
    modes = found("actuators.MODES")
    names = (
        "motor_1_inertia",
        "controller_1_integral",
        "spring_k",
        "max_deflection",
        "hysteresis_torque",
        "lever_length",
        "mass",
    )

    def reason(mode: Any, name: str, norm: float, owner: str) -> str:
        joints = [Fake(name="j", child="link"), Fake(name="k", child="tip")]
        tracks = [Fake(prepared=Fake(drives=[Fake(name="j", mode=mode)], robot=Fake(joints=joints)))]
        entry = Fake(parameter=Fake(key=f"{owner}.{name}"))
        return str(found("identification.verdicts._reason")(entry, norm, tracks, {"k": "it never moves"}))

    asked = [(mode, name, norm, "j") for mode in modes.values() for name in names for norm in (0.0, 0.123)]
    yield (
        "reasons",
        reason,
        [*asked, (modes[3], "mass", 0.0, "link"), (modes[3], "mass", 0.0, "tip"), (modes[3], "x", 2e-9, "no")],
    )
    quantities = (
        "motor_1_position",
        "friction_torque",
        "equilibrium_position",
        "elastic_torque",
        "deflection",
        "link_position",
    )
    left_out = found("identification.data._left_out")
    yield "left out", left_out, [(q, m, c) for m in (None, *modes.values()) for q in quantities for c in (False, True)]
    for logarithmic in (False, True):
        entry = Fake(start=0.4, parameter=Fake(logarithmic=logarithmic, start=2.0, size=0.5, low=0.1, high=0.9))
        interval = found("identification.verdicts._interval")
        yield (
            f"intervals {logarithmic}",
            lambda x, w, e=entry, f=interval: f(e, x, w),
            [(x, w) for x in (0.0, 0.3) for w in (0.1, 0.9, 99.0)],
        )

    def hysteresis(size: float, quantity: str) -> list[str]:
        values = shapes(T)["swing"]
        channel = Fake(key=f"j.{quantity}", quantity=quantity, joint="j", unit="N m", values=values)
        left = size * np.sign(np.gradient(values)) + 0.1 * NOISE[:401]
        drives = [Fake(name="j", mode=Fake(spring=True))]
        track = Fake(channels=[channel], prepared=Fake(drives=drives), scenario=Fake(engine="mujoco"))
        residuals = Fake(
            tracks=[track, track], raw=lambda x, number, until: [left] if number else None, until=lambda number: None
        )
        return [part for one in found("identification.causes._hysteresis")(residuals, None) for part in _all(one)]

    yield (
        "hysteresis",
        hysteresis,
        [(size, name) for size in (0.0, 0.05, 0.07, 0.2, -0.3) for name in ("link_torque", "position")],
    )


def _chunks() -> Asked:
    """Chunks of logs as they are, and with each of their parts wrong."""
    reader, head = found("log.chunks.read_chunk"), found("log.chunks.CHUNK_HEAD")
    data = bytes(range(200)) * 3
    packings = {
        "": data, "zstd": zstandard.ZstdCompressor().compress(data), "lz4": lz4.frame.compress(data),
        "rot13": data,
    }  # fmt: skip

    def read(name: str, fault: str) -> tuple[int, int]:
        packed, size, crc = packings[name], len(data), zlib.crc32(data)
        if fault == "garbled":
            packed = packed[:20] + bytes([packed[20] ^ 0x55]) + packed[21:]
        size += {"longer": 1, "shorter": -1, "vast": 2**40}.get(fault, 0)
        crc = {"sum": crc ^ 1, "unsummed": 0}.get(fault, crc)
        length = len(packed) + (fault == "other length")
        word = name.encode()
        content = head.pack(0, 1, size, crc) + struct.pack("<I", len(word)) + word + struct.pack("<Q", length) + packed
        file = io.BytesIO(b"before" + content[: -5 if fault == "cut" else None])
        found_data = reader(file, Fake(offset=6, length=len(content)))
        return len(found_data), zlib.crc32(found_data) % 1000

    faults = ("", "garbled", "longer", "shorter", "vast", "sum", "unsummed", "other length", "cut")
    # What the library says of garbled data is its own.
    yield "chunks", read, [(name, fault) for name in packings for fault in faults if (name, fault) != ("lz4", "garbled")]


def _references() -> Asked:
    """References from outside that no joint has, and tables in which those that may be set take their ends."""
    modes, names = found("actuators.MODES"), ("equilibrium_position", "stiffness_preset", "reference_1", "external_torque", "x")

    def ends(mode: Any, ranges: Any) -> list[np.ndarray]:
        tables = tuple(np.zeros((9, 2)) + k for k in range(3))
        drives = [Fake(name="a", mode=mode), Fake(name="b", mode=None)]
        return [table[:6] for table in found("simulation.prepare._with_ranges")(tables, drives, ranges)]

    spans = ({}, {"*": dict.fromkeys(names, (-0.5, 0.7))}, {"a": {"external_torque": (-2.0, 1.0)}})
    yield (
        "ends",
        lambda m, s, k: ends(m, s)[k],
        [(m, s, k) for m in (modes[0], modes[3], modes[6]) for s in spans for k in range(3)],
    )

    def slot(mode: Any, joint: str, reference: str) -> Any:
        drives = [Fake(name="b", mode=None), Fake(name="a", mode=mode)]
        return found("simulation.prepared.Prepared").slot_of(Fake(drives=drives), joint, reference)

    known = (*modes[6].references, *modes[5].references, "external_torque", "x")
    yield "slots", slot, [(modes[m], j, r) for m in (0, 5, 6) for j in ("a", "b", "c") for r in known]

    def unknown(mode: int, joint: str, name: str) -> list[str]:
        block = Fake(joint="a", actuator="qbmove", mode=mode)
        scenario = Fake(reference_ranges={joint: {name: (0.0, 1.0)}})
        return [f"{one}"[:59] for one in found("scenario.check._ranges")(scenario, Fake(actuators=[block]))]

    yield "unknown ranges", unknown, [(mode, joint, name) for mode in (3, 5, 6) for joint in ("*", "a", "z") for name in names]


def _clocks() -> Asked:
    join = found("recordings.join.join")

    def joined(*epochs: float | None) -> Any:
        raws = [Fake(epoch=epoch, findings=(), series=(), names=()) for epoch in epochs]
        return join(HERE, [Path(f"part_{k}.csv") for k in range(len(raws))], raws)

    yield "clocks", joined, [(5.0, 7.0), (5.0, None), (None, None), (None, 3.0, 2.0)]
    node = found("document.node.node_from_data")
    data = [{"a": [1, (2.0, "x")], "b": None, 3: True}, [np.float64(0.5), np.int64(4)], Path("folder/file")]
    yield "nodes", lambda d: f"{node(d).value!r}"[:58], [(one,) for one in data]
    times_of = found("recordings.matlab._times_of")
    even, uneven, back = np.arange(5.0), np.array([0.0, 1.0, 9.0, 9.5, 10.0]), -np.arange(5.0)
    tables: list[dict[str, np.ndarray]] = [
        {"time": even, "q": uneven}, {"t_q": even, "q1": uneven}, {"t_q": back, "q1": uneven}, {"x_1": even, "x_2": back},
        {"x_1": uneven, "x_2": even}, {"x_1": back}, {"x_1": even[:3]}, {"tsim": even, "xsim": back}, {"y_2": even}, {},
    ]  # fmt: skip
    maps = [Fake(role="time", column="q"), Fake(role="value", column="x_2")]
    yield "times", lambda table, mapped: times_of(table, "run_", mapped), [(t, m) for t in tables for m in ([], maps)]
    records = found("recordings.read_json._records")
    texts = (
        '{"a": 1}\n{"a": 2},\n\n{"a": 3',
        '{"a": 1}\nx\ny\n{"a": 2}',
        '{"a": 1}',
        "\n".join(['{"a": {"b": 1}}'] * 30 + ["x", "y", "z"]),
    )
    yield "records", lambda text: records(text, ValueError("bad"), HERE), [(text,) for text in texts]
    documents: list[Any] = [
        {"columns": ["a", 2], "data": [[1, 2], [3, 4], "x"]}, [{"a": 1}, [2], 3], 4, {"0": {"a": 1}, "1": {"a": 2}},
        {"a": [1, 2], "b": [3, 4]}, {"a": {"b": [1, 2]}}, {"0": {"a": 1}},
    ]  # fmt: skip
    yield "documents", found("recordings.read_json._of"), [(one,) for one in documents]


def _limits() -> Asked:
    text = "<robot>{}</robot>"
    joints = (
        "<joint name=' a ' type='revolute'><limit lower='-1' upper='2' effort='3'/></joint>",
        "<joint name='a' type='prismatic'><limit effort='0' upper='1'/></joint>",
        "<joint name='a' type='continuous'><limit lower='-1' effort='5'/></joint>",
        "<joint name='a' type='revolute'/>", "<joint name='a' type='revolute'><limit lower='x'/></joint><joint", "",
    )  # fmt: skip
    yield "limits", found("plots.limits._joint_limits"), [(text.format(joint),) for joint in joints]
    curve = found("plots.curves.Curve")
    one, two = curve(time=T, values=shapes(T)["swing"]), curve(time=T[::2] + 0.1, values=shapes(T[::2])["line"])

    def deflections(limit: float, known: dict[str, Any]) -> Any:
        run = Fake(joints=[Fake(name="j", actuator="qbmove", values={})], get=lambda joint, name: known.get(name), curves=
                   {("j", name): value for name, value in known.items()})  # fmt: skip
        return found("plots.limits._deflection_limits")(run, "j", limit)

    sets = ({}, {"deflection": one}, {"deflection": one, "motor_1_position": one, "motor_2_position": two})
    yield "deflections", deflections, [(limit, known) for limit in (float("nan"), 0.4) for known in sets]
    yield "within", found("plots.overlay._within"), [(one, two), (two, one), (one, one)]
    summaries = found("metrics.summary.summaries")

    def summarised(gaps: str, step: int | None) -> Any:
        positions = np.array([shapes(T)["ring"], shapes(T)["swing"]])
        positions[0, {"start": slice(0, 50), "end": slice(300, 401), "all": slice(None), "none": slice(0, 0)}[gaps]] = np.nan
        return summaries(T, positions, positions - 1.0, [step, 40], np.array([0.2, 0.3]))[0]

    yield "gaps", summarised, [(gaps, step) for gaps in ("none", "start", "end", "all") for step in (None, 0, 60)]
