"""Files as thirty more laboratories would write them, drawn at random: the right time and unit, or a refusal; never another."""

from __future__ import annotations

from datetime import datetime, timedelta
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from lab_files import DEGREES

from asrsim.errors import RecordingError
from asrsim.recordings import read_recording

pytestmark = pytest.mark.once

JOINTS = ("joint_1", "joint_2")
STATED = {"rad": 1.0, "deg": DEGREES, "°": DEGREES, "mrad": 1e3, "": 1.0}
CLOCKS = ("s", "ms", "us", "unsaid ms", "unix s", "unix ms", "unix ns", "iso", "date", "clock", "secs nsecs")
FORMS = ("{n} [{u}]", "{n} ({u})", "{n}[{u}]", "[{u}] {n}", "{n}: {u}", "{n}-{u}", "{n} in {u}", "{n} [{u}] filtered",
         "below", "above")  # fmt: skip
"""Where a unit stands; the last two are rows of their own."""
NAMES = (
    ("q1", "q2"),
    ("position_1", "position_2"),
    ("joint_1_pos", "joint_2_pos"),
    ("/arm/joint_1/q", "/arm/joint_2/q"),
    ("q[0]", "q[1]"),
)


class Draw:
    """One laboratory's way of writing, and what it wrote."""

    def __init__(self, seed: int) -> None:
        rng = self.rng = np.random.default_rng(seed)
        self.count = int(rng.integers(60, 400))
        self.step = float(rng.choice([0.001, 0.002, 0.004, 0.01, 0.02]))
        self.time = self.step * np.arange(self.count) + float(rng.choice([0.0, 0.0, 3.7]))
        self.values = [np.sin(7 * self.time + i) for i in range(2)]
        self.clock = str(rng.choice(CLOCKS))
        self.unit = str(rng.choice(list(STATED)))
        self.separator, self.decimal = [
            (",", "."),
            (";", "."),
            (";", ","),
            ("\t", "."),
            ("\t", ","),
            ("  ", "."),
            ("|", "."),
            (", ", "."),
        ][int(rng.integers(8))]
        if self.separator == "  " and self.clock in ("date", "iso"):
            self.separator = ","
        self.index = bool(rng.random() < 0.3)
        self.names = NAMES[int(rng.integers(len(NAMES)))]
        self.form = "{n}[{u}]" if self.separator == "  " else str(rng.choice(FORMS))
        self.torques = bool(rng.random() < 0.4)

    def clocks(self) -> tuple[list[str], list[list[str]]]:
        zero = 1_714_989_600
        t = self.time

        def told(values: np.ndarray, digits: int) -> list[str]:
            return [f"{value:.{digits}f}".replace(".", self.decimal) for value in values]

        match self.clock:
            case "s":
                return ["time [s]"], [told(t, 6)]
            case "ms":
                return ["time_ms"], [told(t * 1e3, 3)]
            case "us":
                return ["t (us)"], [told(t * 1e6, 0)]
            case "unsaid ms":
                return ["time"], [told(t * 1e3, 3)]
            case "unix s":
                return ["timestamp"], [told(zero + t, 6)]
            case "unix ms":
                return ["timestamp"], [told(zero * 1e3 + t * 1e3, 3)]
            case "unix ns":
                return ["stamp"], [[str(zero * 10**9 + round(v * 1e9)) for v in t]]
            case "secs nsecs":
                stamps = [zero * 10**9 + round(v * 1e9) for v in t]
                return ["secs", "nsecs"], [[str(n // 10**9) for n in stamps], [str(n % 10**9) for n in stamps]]
        pattern = {"iso": "%Y-%m-%dT%H:%M:%S.%f", "date": "%d.%m.%Y %H:%M:%S.%f", "clock": "%H:%M:%S.%f"}[self.clock]
        moments = [datetime(2024, 5, 6, 10) + timedelta(microseconds=round(v * 1e6)) for v in t]
        return ["time"], [[moment.strftime(pattern) for moment in moments]]

    def text(self) -> str:
        names, columns = self.clocks()
        units = [""] * len(names)
        apart = self.form in ("below", "above")
        # People count torques from 1 though the positions are an array.
        torques = (("tau_1", "mNm", 1e3), ("tau_2", "mNm", 1e3)) if self.torques else ()
        for (name, unit, scale), values in zip(
            [*((name, self.unit, STATED[self.unit]) for name in self.names), *torques], self.values * 2, strict=False
        ):
            names.append(name if apart or not unit else self.form.format(n=name, u=unit))
            units.append(unit or "-")
            columns.append([f"{v * scale:.8f}".replace(".", self.decimal) for v in values])
        if self.index:
            names.insert(0, "" if self.separator.strip() else "index")
            columns.insert(0, [str(i) for i in range(self.count)])
            units.insert(0, "")
        rows = [self.separator.join(row) for row in zip(*columns, strict=True)]
        rows = self.damage(rows)
        head = ["# a remark", ""] if self.rng.random() < 0.3 else []
        header = [self.separator.join(names)]
        if apart and any(unit not in ("", "-") for unit in units):
            header.insert(self.form == "below", self.separator.join(units))
        return "\n".join([*head, *header, *rows]) + "\n"

    def damage(self, rows: list[str]) -> list[str]:
        if self.rng.random() < 0.3:
            rows.insert(20, rows[19])  # a row twice
        if self.rng.random() < 0.3:
            del rows[30:33]
        if self.rng.random() < 0.2:
            rows[40] = rows[40][: len(rows[40]) // 2]
        if self.rng.random() < 0.2:
            rows.insert(10, "")
        return rows


@pytest.mark.parametrize("seed", range(150))
def test_time_and_unit_are_right(tmp_path: Path, seed: int) -> None:
    draw = Draw(seed)
    encoding = str(draw.rng.choice(["utf-8", "utf-8-sig", "utf-16", "latin-1"]))
    end = "\r\n" if seed % 3 == 0 else "\n"
    (tmp_path / "lab.csv").write_bytes(draw.text().replace("\n", end).encode(encoding))
    recording = read_recording(tmp_path / "lab.csv", joints=JOINTS)
    quantities = ("link_position", "link_torque") if draw.torques else ("link_position",)
    for (joint, values), quantity in product(zip(JOINTS, draw.values, strict=True), quantities):
        column = recording.column(joint, quantity)
        assert len(column.time) >= draw.count - 5
        # At each sample the signal of that time, in rad: neither clock nor unit is another.
        start = draw.time[0] if draw.clock in ("s", "ms", "us", "unsaid ms") else column.time[0]
        shift = draw.time[0] - start
        truth = np.interp(column.time + shift, draw.time, values)
        good = np.isfinite(column.values)
        assert good.mean() > 0.97
        np.testing.assert_allclose(column.values[good], truth[good], atol=2e-4)
        assert column.unit == ("rad" if quantity == "link_position" else "N m")


@pytest.mark.parametrize("seed", range(40))
def test_what_is_cut_anywhere_is_refused_or_right(tmp_path: Path, seed: int) -> None:
    """Any cut of a file's text from either end: an error of its own, or numbers that are of the motion."""
    draw = Draw(1000 + seed)
    text = draw.text()
    cut = int(draw.rng.integers(1, len(text)))
    (tmp_path / "lab.csv").write_text(text[cut:] if seed % 2 else text[:cut])
    try:
        recording = read_recording(tmp_path / "lab.csv", joints=JOINTS)
    except RecordingError:
        return
    for column in recording.channels.values():
        if column.quantity == "link_position":
            steps = np.diff(column.time)
            assert np.median(steps) == pytest.approx(draw.step, rel=0.01)
            assert np.nanmax(np.abs(column.values)) < 1.1
