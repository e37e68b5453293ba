"""Pictures, pages and sweeps."""

from __future__ import annotations

import math

import numpy as np

from over_ranges import Asked, T, found, shapes

FINE = np.linspace(0.0, 2.0, 2000)


def of_pictures() -> Asked:
    yield (
        "decimated",
        lambda n, b: found("plots.decimate.decimate")(T[:n], shapes(T)["noise"][:n], bins=b),
        [(n, b) for n in (3, 40, 41, 401) for b in (1, 10, 100)],
    )
    style = found("plots.style.RC")
    yield "style", style.get, [(name,) for name in sorted(style)]
    yield "line styles", found("plots.style.line_style"), [(n,) for n in range(7)]
    curve = found("plots.curves.Curve")
    for lines, gone in ((25.0, 0.6), (60.0, 0.0), (90.0, 1.0)):
        yield (
            f"envelope of {lines} Hz",
            lambda pixels, n, f=lines, g=gone: found("plots.view.split")(
                curve(time=FINE[:n], values=np.where(FINE[:n] < g, 0.0, np.sin(2 * np.pi * f * FINE[:n]))), 0.0, 2.0, pixels
            ),
            [(30.0, 2000), (300.0, 2000), (1000.0, 2000), (300.0, 500)],
        )
    yield "shortened", found("plots.figures.shorten"), [("abcdefghijklmnop", n) for n in (3, 8, 15, 16, 17)]
    yield (
        "hulls",
        lambda b: found("plots.pairing._hull")(T, shapes(T)["swing"] - 0.1, shapes(T)["swing"], b),
        [(b,) for b in (5, 50, 500)],
    )
    for name in ("darker", "rgba"):
        yield (
            name,
            found(f"plots.style.{name}"),
            [("#336699",) if name == "darker" else ("#336699", o) for o in (0.0, 0.5, 1.0)],
        )
    for name, sizes in {
        "box": ((np.array((0.1, 0.2, 0.3)),),),
        "sphere": ((0.1,),),
        "cylinder": ((0.1, 0.4),),
        "capsule": ((0.1, 0.4),),
    }.items():
        yield f"solid {name}", found(f"render.solids.{name}"), list(sizes)
    points = np.random.default_rng(2).uniform(-1.0, 1.0, (40, 3))
    for towards in ((1.0, 0.0, 0.0), (0.3, -0.9, 0.2), (0.0, 0.0, -1.0)):
        yield (
            f"camera {towards}",
            lambda a, t=towards: found("render.camera.fit_camera")(points, np.array(t), aspect=a),
            [(a,) for a in (0.5, 1.0, 2.0)],
        )
        yield f"aspect {towards}", found("render.camera.fitting_aspect"), [(points, np.array(towards))]
    corners = np.random.default_rng(3).uniform(-2.0, 12.0, (25, 3, 3))
    yield "raster", lambda w, h: found("render.raster.rasterise")(corners, w, h), [(10, 10), (7, 13), (1, 1)]
    yield (
        "numbers of pages",
        found("report.html.number"),
        [(v, f) for v in (0.0, 1e-9, 0.00123456, 1.0, 999.9, 12345.6, -2.5, None, math.nan) for f in (1.0, 1000.0)],
    )
    yield (
        "packed",
        found("report.series.pack"),
        [(shapes(T)[name],) for name in ("rest", "ring")] + [(np.array([1.0, math.nan, 3.0]),), (np.full(3, math.nan),)],
    )


def of_sweeps() -> Asked:
    texts = (
        "uniform(0, 1)",
        "uniform(1, 0)",
        "loguniform(1e-3, 1)",
        "loguniform(0, 1)",
        "normal(1, 0.1)",
        "normal(1, -1)",
        "lognormal(1, 0.1)",
        "1, 2, 3",
        "linspace(0, 1, 5)",
        "0:1:5",
        "logspace(1, 100, 3)",
        "x",
        "",
        "uniform(1)",
        "1",
    )
    law_of = found("sweeps.laws.law_of")
    yield "laws", lambda v: law_of(v, "key"), [(t,) for t in (*texts, [1, 2], [1, "x"], [], 3.0, {"low": 0, "high": 1})]
    yield (
        "points",
        lambda d, n, k, s: found("sweeps.study.unit_points")(d, n, k, s),
        [
            (d, n, k, s)
            for d in ("random", "sobol", "latin", "halton", "grid")
            for n, k in ((1, 1), (5, 2), (8, 3))
            for s in (0, 1)
        ],
    )
