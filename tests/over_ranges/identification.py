"""Noise, glitches, and numbers of a fit."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from over_ranges import NOISE, SHARES, Asked, T, found, shapes


class Bent:
    """Residuals that are nearly linear, and how often their slopes were asked for."""

    def __init__(self, unknowns: int, bend: float) -> None:
        self.counter, self.bend, self.asked = SimpleNamespace(cost=np.inf), bend, 0
        self.matrix = NOISE[: 9 * unknowns].reshape(9, unknowns)

    def __call__(self, x: np.ndarray) -> np.ndarray:
        return self.matrix @ x + self.bend * np.sin(self.matrix @ x)

    def jacobian(self, x: np.ndarray, *, base: np.ndarray) -> np.ndarray:
        self.asked += 1
        return self.matrix


def _slopes(unknowns: int, bend: float) -> list[float]:
    """At each of some steps: how often slopes were asked for, and the size of those that are used."""
    bent = Bent(unknowns, bend)
    slopes, told = found("identification.solver._Slopes")(bent, None), []
    for k in range(6):
        x = 0.1 * k * np.ones(unknowns)
        slopes.residuals(x)
        told += [f"{bent.asked} {np.linalg.norm(slopes.jacobian(x)):.6g}"]
    return told


def of_identification() -> Asked:
    yield "slopes", _slopes, [(n, bend) for n in (1, 5, 8) for bend in (0.0, 0.01, 0.1, 1.0)]
    noise = "identification.noise."
    smooth = shapes(T)["ring"]
    yield (
        "fine noise",
        lambda s, q: found(noise + "fine_noise")(smooth + s * NOISE[:401], q),
        [(s, q) for s in (0.0, 1e-8, 1e-5, 1e-2, 1.0) for q in (0.0, 1e-3)],
    )
    yield (
        "quanta",
        lambda q, s: found(noise + "quantum_of")(q * np.round((smooth + s * NOISE[:401]) / q)),
        [(q, s) for q in (1e-4, 1e-3, 3e-3, 0.01, 0.1, 0.5) for s in (0.0, 1e-4, 1e-3, 0.01)],
    )
    yield (
        "quanta of ramps",
        lambda q: found(noise + "quantum_of")(q * np.round(np.linspace(0.0, 1.0, 300) / q)),
        [(q,) for q in (1e-4, 1e-3, 3e-3, 3.9e-3, 4e-3, 5e-3, 0.01, 0.1, 0.5, 1.0)],
    )
    made = {f"{c}": np.convolve(NOISE[:900], c ** np.arange(30.0))[:900] for c in (0.0, 0.05, 0.1, 0.3, 0.7, 0.95)}
    for name in ("lag_correlation", "size_of", "autoregression", "swings"):
        yield name, found(noise + name), [(x[:n],) for x in made.values() for n in (15, 45, 99, 101, 300, 900)]
    yield (
        "swings in noise",
        lambda s, b: found(noise + "swings")(NOISE[:900] + s * np.sin(np.arange(900.0) / 7.0), b),
        [(s, b) for s in (0.1, 0.2, 0.3, 0.4, 0.6, 1.0) for b in (0.0, 0.03, 0.2)],
    )
    yield "clipped", found(noise + "size_of"), [(np.append(NOISE[:99], h),) for h in (0.0, 2.0, 4.0, 5.0, 50.0)]
    yield "white", found(noise + "whiten"), [(NOISE[:60], np.array(c)) for c in ([], [0.5], [0.5, -0.2], [0.9, 0.0, 0.1])]
    for at in (0, 1, 2, 5, 50, 397, 398, 399, 400):
        yield (
            f"glitch {at}",
            lambda h, at=at: np.flatnonzero(
                found(noise + "glitches")(smooth + 1e-4 * NOISE[:401] + h * (np.arange(401) == at))
            ),
            [(h,) for h in (0.05, 0.1, 0.2, 0.4, 0.8, 1.6, -1.0)],
        )
    yield "glitches of few", found(noise + "glitches"), [(np.eye(n)[n // 2],) for n in (5, 8, 9, 10, 20)]
    for name in ("identification.fit._tails", "identification.computed._explained"):
        yield name, found(name), [(x,) if "tails" in name else (x, x + 0.1 * NOISE[900 : 900 + len(x)]) for x in made.values()]
    yield "loud", found("identification.fit.is_loud"), [(s * NOISE[:200], 1.0) for s in SHARES]
    yield "percents", found("identification.told.percent"), [(s, w) for s in (*SHARES, 10.0, 123.4, -0.004) for w in ("", "+")]
    yield (
        "powers",
        found("identification.nulls._whole"),
        [(np.array(p),) for p in ((1.0, 0.5), (1.0, 0.34), (1.0, 0.26), (1.0, 0.99), (1.0, 0.9), (1.0, 0.42))],
    )
    yield (
        "sums",
        lambda a, b, p: found("identification.nulls._shown")(("a", "b"), (a, b), p),
        [(a, b, p) for a, b in ((1.0, 2.0), (3.0, -1.0), (0.1, 5.0)) for p in (-2.0, -1.0, -0.5, 0.3, 0.5, 1.0, 1.5, 1.53)],
    )
