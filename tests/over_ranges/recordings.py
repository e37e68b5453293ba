"""What recordings hold."""

from __future__ import annotations

import math

import numpy as np

from over_ranges import NOISE, Asked, T, found, shapes


def of_recordings() -> Asked:
    scale, suspect = found("recordings.timebase.scale_time"), found("recordings.timebase.suspect_time")
    steps = [m * 10.0**e for e in range(-7, 11) for m in (1.0, 1.5, 2.0, 2.01, 3.0, 5.0, 5.01)]
    yield "time units", lambda s: scale(s * np.arange(5.0), None, path=None, name="t"), [(s,) for s in steps]
    yield (
        "epochs",
        lambda z: scale(z + 0.01 * z / 1e9 * np.arange(5.0), None, path=None, name="t"),
        [(z,) for z in steps if z > 1e5],
    )
    yield (
        "days",
        lambda z: scale(z + 1e-7 * np.arange(5.0), None, path=None, name="t"),
        [(float(z),) for z in (19999, 20001, 45000, 69999, 70001, 689999, 690001, 740000, 779999, 780001)],
    )
    yield (
        "given units",
        lambda s, f: scale(s * np.arange(5.0), f, path=None, name="t"),
        [(s, f) for s in (1e-3, 1.0, 1e8) for f in (1.0, 1e-3, 1e-9)],
    )
    yield (
        "suspected time",
        lambda s, f: suspect(s * np.arange(5.0), f, path=None, name="t"),
        [(s, f) for s in (1e-9, 2.9e-5, 3e-5, 0.01, 0.2, 0.5, 0.51, 5.0, 1e3, 1e6) for f in (1.0, 1e-3)],
    )
    names = [f"q{i}" for i in range(14)]
    for name in ("build._shown", "condense._places"):
        yield (
            name,
            lambda n, name=name: str(found(f"recordings.{name}")(names[:n]))[-30:],
            [(n,) for n in (0, 1, 4, 5, 12, 13, 14)],
        )
    yield "lines", found("recordings.timebase.lines_text"), [(list(range(3, 3 + n)),) for n in (1, 2, 7, 8, 9, 30)]
    checks = "recordings.checks."
    a = shapes(T)["ring"]
    factors = [f * w for f in (180 / math.pi, math.pi / 180, 1000.0, 0.001, 8.0) for w in (0.79, 0.81, 0.99, 1.24, 1.26)]
    yield "scales", found(checks + "suspect_scale"), [(a, f * a) for f in factors]
    yield (
        "scales at rest",
        found(checks + "suspect_scale"),
        [(np.full(9, v), np.full(9, 57.0 * v)) for v in (0.0, 1e-13, 1e-11, 1.0)],
    )
    yield (
        "gears",
        found(checks + "suspect_gear"),
        [(a, f * a) for f in (1.0, 7.9, 8.0, 8.1, 30.0, 57.0, 100.0)] + [(1e-10 * a, a)],
    )
    yield (
        "signs",
        found(checks + "suspect_sign"),
        [(a, -a + s * NOISE[:401]) for s in (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)] + [(a[:n], -a[:n]) for n in (9, 10, 11)] + [(a, a)],
    )
    for height in (0.05, 0.1, 0.19, 0.21, 0.3, 0.5, 1.0):
        spiked = a.copy()
        spiked[200] += height * np.ptp(a)
        yield (
            f"lone {height}",
            lambda x: np.flatnonzero(found(checks + "lone")(x)),
            [(spiked,), (spiked + 0.01 * NOISE[:401],), (spiked[195:204],), (spiked[195:205],)],
        )
    yield (
        "units",
        found("recordings.units.parse_unit"),
        [
            (u,)
            for u in (
                "rad",
                "deg",
                "mrad",
                "mm",
                "Nm",
                "N m",
                "ms",
                "rpm",
                "Hz",
                "kN",
                "rad/s",
                "deg/s^2",
                "1/min",
                "",
                "%",
                "V",
                "mA",
                "foo",
                "°",
                "Grad",
                "gon",
                "lbf ft",
                "U/min",
            )
        ],
    )
    yield (
        "headers",
        found("recordings.units.split_header"),
        [
            (h,)
            for h in (
                "q1 [deg]",
                "q1(rad)",
                "q_deg",
                "time_ms",
                "t/s",
                "tau in Nm",
                "q1 [",
                "torque, N m",
                "pos rad",
                "q1",
                "x [m] y",
                "vel (deg/s)",
                "a_mm_s",
            )
        ],
    )
    yield (
        "unknown units",
        found("recordings.units.unknown_unit"),
        [(h,) for h in ("q [foo]", "q (bar)", "q [deg]", "q", "q [1]", "q [V/s]")],
    )
    yield (
        "tokens",
        found("recordings.names.tokens_of"),
        [(h,) for h in ("joint1Position", "q_1", "Q12", "linkPos2", "theta-dot", "desired.q.1", "HTMLTime", "")],
    )
    yield (
        "numbers",
        lambda c, d: found("recordings.cells.number")(c, d),
        [
            (c, d)
            for c in (
                "1",
                "-1,5",
                "1.5",
                "1e3",
                " 2 ",
                "nan",
                "inf",
                "",
                "1.000,5",
                "1,000.5",
                "0x10",
                "+.5",
                "1_0",
                "--",
                "true",
            )
            for d in (".", ",")
        ],
    )
    yield (
        "stamps",
        found("recordings.cells.stamp_ns"),
        [
            (c,)
            for c in (
                "2024-01-02 03:04:05",
                "2024-01-02T03:04:05.5Z",
                "03:04:05",
                "03:04:05.25",
                "25:00:00",
                "01.02.2024 03:04",
                "2024-01-02T03:04:05+02:00",
                "12:34",
                "x",
                "1:02:03",
                "00:00:60",
            )
        ],
    )
    yield (
        "kinds",
        found("recordings.cells.kind_of"),
        [
            (c, ".")
            for c in (["1", "2"], ["1", "x"], ["x", "y"], ["", ""], ["03:04:05", "03:04:06"], ["1", "1", "x"], ["1", "x", "x"])
        ],
    )
    yield (
        "grids",
        lambda s: found("recordings.align.resample")(T, a, np.linspace(-0.1, 2.1, 12) * s),
        [(s,) for s in (0.5, 1.0, 1.1)],
    )
    gapped = np.delete(T, slice(100, 140))
    yield (
        "gapped",
        lambda n: found("recordings.align.resample")(
            np.delete(T, slice(100, 100 + n)), np.delete(a, slice(100, 100 + n)), T[95:145:3]
        ),
        [(n,) for n in (1, 2, 3, 4, 5, 9, 30)],
    )
    yield (
        "overlaps",
        found("recordings.align.require_overlap"),
        [(T, gapped + s, lag) for s in (0.0, 1.5, 1.9, 1.99, 2.0, 2.1) for lag in (0.0, 0.1, -0.1)],
    )


HEADERS = (
    "time;q;v", "t;q;q\ns;rad;rad/s", ";j1;j1\ntime;q;v", ";j1;\nt;q;v\ns;rad;rad/s", ";j1;j2\n;q;q\ntime;;", "1;2;3\ntime;q;v",
    "time;q;v\nindex;;", "Name;a;Name\ntime;q;v", "Y_Unit_Label;rad;V\ntime;q;v\nmore;x;y", "a;b\ntime;q;v",
    "time;q", "time;q;v;w;x", "time;q;v\n1;x;3", "j1;j1;j1\n\ntime;q;q", "time;q;q\n[s];[deg];[deg/s]", "time;;\ns;rad;",
)  # fmt: skip
"""Lines above rows of three numbers."""


def of_headers() -> Asked:
    data = [["0.0", "1.5", "2.5"], ["0.1", "1.6", "2.4"]]
    paired = [["0.0", "1.5", "0.0", "2.5"]]

    def header(text: str, rows: list[list[str]]) -> object:
        lines = [(count, line.split(";")) for count, line in enumerate(text.split("\n"), start=1) if line]
        return found("recordings.header.find_header")(lines, rows, ".")

    yield "headers", header, [(text, data) for text in ("", *HEADERS)]
    for first, second in (("Name", "Name"), ("name", "x"), ("time", "time")):
        for more in ("", "\nUnit;rad;Unit;V", "\nUnit;rad;x;V"):
            yield "pairs", header, [(f"{first};a;{second};b{more}", paired)]
