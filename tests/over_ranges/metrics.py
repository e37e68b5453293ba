"""Measures, excitations and lags."""

from __future__ import annotations

import numpy as np

from over_ranges import NOISE, SHARES, UNEVEN, Asked, T, found, shapes


def measures() -> Asked:
    """Every measure of every shape, evenly and unevenly sampled, alone, beside another, and in windows."""
    from asrsim.metrics import MEASURES, measure

    for name in sorted(MEASURES.names()):
        needs = MEASURES.get(name).needs
        # Delays are looked for at many lags: of a few shapes, evenly sampled.
        for time in (T,) if name == "delay" else (T, UNEVEN):
            made = dict(list(shapes(time).items())[-4 if name == "delay" else 0 :])
            if needs == "poses":
                asked = [(name, time, np.column_stack([made["ring"], made["swing"], made[one]])) for one in ("line", "rest")]
            else:
                asked = [(name, time, one, *([0.9 * one + 0.01] if needs != "series" else [])) for one in made.values()]
            yield f"measure {name}", measure, asked
    ring = shapes(T)["ring"]
    for name in ("mean", "frequency", "settling"):
        windows = [(s, e) for s in (None, 0.0, 0.5, 0.503, 1.9) for e in (None, 0.4, 1.0, 1.999, 2.0, 3.0)]
        yield f"window {name}", lambda s, e, name=name: measure(name, T, ring, start=s, end=e), windows


def of_metrics() -> Asked:
    made = shapes(T)
    wave = 2 * np.pi * np.arange(1200) / 100.0
    for name in ("rise", "overshoot", "settling", "peak_time"):
        yield name, found(f"metrics.step.{name}"), [(T, series) for series in made.values()]
        one = found(f"metrics.step.{name}")
        yield (
            f"{name} given",
            lambda a, b, one=one: one(T, made["ring"], initial=a, target=b),
            [(0.0, b) for b in (0.5, 1.0, 1.9)],
        )
    yield (
        "frequency lowest",
        lambda f: found("metrics.oscillation.frequency")(T, made["beat"], lowest=f),
        [(f,) for f in (0.0, 1.0, 3.9, 5.0, 8.0)],
    )
    yield (
        "frequency of few",
        lambda n: found("metrics.oscillation.frequency")(T[:n], made["swing"][:n]),
        [(n,) for n in (7, 8, 30, 60, 61, 90, 120, 150)],
    )
    yield (
        "frequency noise",
        lambda s: found("metrics.oscillation.frequency")(T, made["ring"] + s * NOISE[:401]),
        [(s,) for s in SHARES[:14]],
    )
    for k in (3, 5, 10):
        yield (
            f"lines of {k}",
            lambda p, k=k: found("metrics.excitation.lines_of")(np.sin(wave) + p * np.sin(k * wave), 100, 0.01, None),
            [(10.0 ** (-d),) for d in (0, 1, 1.9, 1.99, 2.01, 2.1, 3)],
        )
    yield (
        "lines in a band",
        lambda a, b: found("metrics.excitation.lines_of")(NOISE[:300], 100, 0.01, (a, b)),
        [(a, b) for a in (0.5, 1.0, 1.01, 44.0) for b in (2.0, 2.99, 3.0, 44.9, 45.0, 50.0)],
    )
    yield (
        "period",
        found("metrics.excitation.period_of"),
        [(np.sin(wave / k),) for k in (0.5, 1.0, 1.01, 2.0, 5.0, 6.0, 6.1, 12.0)]
        + [(np.sin(wave) + s * NOISE[:1200],) for s in (1e-4, 1e-3, 3e-3, 6e-3, 8e-3, 0.01, 0.02, 0.1)],
    )
    time = np.linspace(0.0, 8.0, 1601)
    for law in (
        lambda t: np.sin(2 * np.pi * (1.0 + t) * t),
        lambda t: sum(np.sin(2 * np.pi * k * t + k * k) for k in (1, 2, 4, 8)),
        lambda t: np.sin(3 * t) + 0.1 * t,
    ):
        yield (
            "band",
            lambda b, law=law: found("metrics.excitation.excited_band")(law(time), 0.005, b),
            [(b,) for b in (None, (1.0, 5.0), (0.01, 90.0), (3.0, 4.0))],
        )
    spread = found("metrics.spectra.uniform")
    for gap in (1.0, 3.0, 4.0, 4.49, 4.51, 8.0):
        late = np.where(T > 1.2, T + (gap - 1.0) * 0.005, T)
        yield f"gap {gap}", spread, [(late, made["swing"], made["ring"])]
    for jitter in (0.001, 0.004, 0.006, 0.02, 0.5):
        yield f"jitter {jitter}", spread, [(T + jitter * 0.005 * np.sin(np.arange(401.0)), made["swing"], made["ring"])]
    lag = found("metrics.lag.estimate_lag")
    for shift in (0.0, 0.0023, 0.05, -0.1, 0.3, 0.5, 0.6):
        yield (
            f"lag {shift}",
            lag,
            [(T, made[n], T + shift, made[n] + 0.02 * NOISE[401:802]) for n in ("ring", "swing", "step", "noise", "drift")],
        )
    yield (
        "lag limits",
        lambda x: lag(T, made["ring"], T + 0.1, made["ring"], limit=x),
        [(x,) for x in (0.0, 0.05, 0.1, 0.102, 0.2, 1.0, 2.0)],
    )
    yield (
        "lag of few",
        lambda n: lag(T[:n], made["ring"][:n], T[:n], made["ring"][:n]),
        [(n,) for n in (2, 3, 4, 5, 9, 40, 44, 45, 60)],
    )
    yield "last part", found("metrics.values.last_part"), [(T, made["line"], s) for s in SHARES]
    yield (
        "compares",
        found("metrics.expect.compares"),
        [
            (a, c, b, d)
            for c in ("==", "<", "<=", ">", ">=")
            for a in (0.9, 1.0, 1.1)
            for b in (1.0,)
            for d in (0.0, 0.1, 0.0999999)
        ],
    )
    hills = [
        (np.exp(-(((np.arange(41.0) - p) / w) ** 2)) + r * NOISE[:41], p)
        for p in (1, 20, 38)
        for w in (2.0, 9.0)
        for r in (0.0, 0.02)
    ]
    yield "summits", found("metrics.lag._summit"), hills
    yield "tops", lambda rho, p: found("metrics.lag._refined")(rho, p, 1), hills
