"""Residuals of a vector of parameters over all recordings, and their derivatives by differences, in parallel if that pays."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from asrsim.identification.data import Channel
from asrsim.identification.layout import Layout
from asrsim.identification.noise import whiten
from asrsim.identification.played import Draw
from asrsim.identification.pool import Pool
from asrsim.identification.track import Track
from asrsim.samples import Array

STEP = 1e-6
"""Of differences, in the vector's units: logarithms, or typical sizes."""
FAR = 1e3
"""Deviations that a motion counts which is not sane."""


@dataclass(frozen=True, eq=False)
class Weights:
    """How the residuals of a channel count."""

    noise: float
    """Its standard deviation."""
    model: Array = field(default_factory=lambda: np.empty(0))
    """Coefficients of the autoregression that whitens it."""

    def weigh(self, values: Array, quantum: float) -> Array:
        """Differences (n,) or (n, k), whitened, in deviations of the noise.

        The zero of an encoder with steps of `quantum` is known within one only: the mean counts as this uncertainty lets it.
        """
        white = whiten(values, self.model) / self.noise
        zero = len(values) * (quantum / self.noise) ** 2 / 12.0
        return white - (1.0 - (1.0 + zero) ** -0.5) * white.mean(axis=0) if zero else white


@dataclass(frozen=True, eq=False)
class Part:
    """One channel among the residuals."""

    rows: slice
    track: int
    channel: Channel
    weights: Weights


@dataclass
class Counter:
    """Of evaluations, and who is told."""

    evaluations: int = 0
    seconds: float = 0.0
    cost: float = np.inf
    """Mean square of the present search's best residuals."""
    tell: Callable[[], None] | None = None


class Residuals:
    """Weighted residuals, (m,), of the samples up to each recording's end of training (or `until`, if that is earlier)."""

    def __init__(
        self, tracks: Sequence[Track], layout: Layout, weights: Sequence[Sequence[Weights]], ends: Sequence[float],
        counter: Counter, pool: Pool | None = None, draws: Sequence[Draw | None] = (),
    ) -> None:  # fmt: skip
        """weights: by recording and channel; draws: noise that is added to each recording's inputs."""
        self.tracks, self.layout, self.weights, self.ends, self.counter = tracks, layout, weights, ends, counter
        self.share = 1.0
        """Of each recording's training part that counts."""
        self.draws = draws or (None,) * len(tracks)
        self._pool = pool

    def under(self, layout: Layout) -> Residuals:
        """Those of the same recordings with other things free."""
        return Residuals(self.tracks, layout, self.weights, self.ends, self.counter, self._pool, self.draws)

    def drawn(self, draws: Sequence[Draw | None]) -> Residuals:
        """Those with noise added to the recordings' inputs."""
        found = Residuals(self.tracks, self.layout, self.weights, self.ends, self.counter, self._pool, draws)
        found.share = self.share
        return found

    def state(self) -> dict[str, Any]:
        """All that :meth:`of_track` depends on beside the recordings, for another process."""
        steps = [(one.prepared.resolution.substeps, one.prepared.resolution.motor_substeps) for one in self.tracks]
        return {
            "layout": self.layout, "weights": self.weights, "ends": self.ends, "share": self.share,
            "held": self.tracks[0].held, "steps": steps, "draws": self.draws,
        }  # fmt: skip

    def take(self, state: Mapping[str, Any]) -> None:
        """Be as those that the state is of."""
        self.layout, self.weights, self.ends, self.share, self.draws = (
            state[name] for name in ("layout", "weights", "ends", "share", "draws")
        )
        self.hold(state["held"])
        for track, steps in zip(self.tracks, state["steps"], strict=True):
            track.resolve(*steps)

    def hold(self, commands: frozenset[str]) -> None:
        """Play these commands (keys) as stairs."""
        for track in self.tracks:
            track.held = commands

    def until(self, track: int) -> float:
        """s, end of what counts."""
        onset = self.tracks[track].onset
        return onset + (self.ends[track] - onset) * self.share

    def raw(self, x: Array, track: int, until: float | None = None) -> list[Array] | None:
        """Predicted less recorded, by channel; until: None for the whole recording."""
        one = self.tracks[track]
        began = clock.perf_counter()
        predicted = one.predict(self.layout.table(x, track), until, self.draws[track])
        self.counter.evaluations += 1
        self.counter.seconds += clock.perf_counter() - began
        if self.counter.tell is not None:
            self.counter.tell()
        if predicted is None:
            return None
        return [a - channel.values[: len(a)] for a, channel in zip(predicted, one.channels, strict=True)]

    def of_track(self, x: Array, track: int) -> Array:
        """Weighted, channels one after the other."""
        until = self.until(track)
        raw = self.raw(x, track, until)
        if raw is None:
            count = sum(int(np.sum(channel.time <= until + 1e-9)) for channel in self.tracks[track].channels)
            return np.full(count, FAR)
        return np.clip(self.weighted(raw, track), -1e8, 1e8)

    def weighted(self, raw: Sequence[Array], track: int) -> Array:
        """Differences (n,) of each channel of a recording, weighted, one after the other."""
        channels = self.tracks[track].channels
        parts = zip(raw, channels, self.weights[track], strict=True)
        return np.concatenate([weights.weigh(one, channel.quantum) for one, channel, weights in parts])

    def parts(self) -> list[Part]:
        """Where each channel's residuals are."""
        found: list[Part] = []
        first = 0
        for track, one in enumerate(self.tracks):
            until = self.until(track) + 1e-9
            for channel, weights in zip(one.channels, self.weights[track], strict=True):
                count = int(np.sum(channel.time <= until))
                found.append(Part(slice(first, first + count), track, channel, weights))
                first += count
        return found

    def __call__(self, x: Array) -> Array:
        """(m,)."""
        return np.concatenate([self.of_track(x, track) for track in range(len(self.tracks))])

    def jacobian(self, x: Array, step: float = STEP, *, base: Array | None = None, central: bool = False) -> Array:
        """(m, n) by differences of one side, that which the bounds allow; central: of both, where they allow it: at a corner,
        where joints stick, columns of different sides would not belong together. base: (m,) residuals at x, if known.
        """
        at = self(x) if base is None else base
        places = self._places()
        matrix = np.zeros((places[-1], len(x)))
        low, high = self.layout.bounds
        above = x + step <= high
        both = above & (x - step >= low) & central
        wanted = [
            (i, track, move)
            for i in range(len(x))
            for track in self.layout.touched(i)[: len(self.tracks)]
            for move in ([step, -step] if both[i] else [step if above[i] else -step])
        ]
        there = self._of_tracks([(_moved(x, i, move), track) for i, track, move in wanted])
        for (i, track, move), found in zip(wanted, there, strict=True):
            rows = slice(places[track], places[track + 1])
            # A step into motions that are not sane tells no slope.
            if not (np.all(found == FAR) or np.all(at[rows] == FAR)):
                matrix[rows, i] += (found - at[rows]) / (2.0 * move if both[i] else move)
        return matrix

    def _of_tracks(self, places: Sequence[tuple[Array, int]]) -> Iterable[Array]:
        """Weighted residuals at several places (vector, recording), by other processes, if that pays."""
        if self._pool is not None and self._pool.pays(self.counter.seconds):
            found = self._pool.of_tracks(self, places)
            if found is not None:
                self.counter.evaluations += len(places)
                if self.counter.tell is not None:
                    self.counter.tell()
                return found
        return (self.of_track(*place) for place in places)

    def _places(self) -> list[int]:
        """Where each recording's residuals begin, and the end of all."""
        counts = [0]
        for track, one in enumerate(self.tracks):
            until = self.until(track) + 1e-9
            counts.append(counts[-1] + sum(int(np.sum(channel.time <= until)) for channel in one.channels))
        return counts

    def blocks(self, count: int) -> Array:
        """(m,) number of the block, of about `count` per recording, that each residual belongs to."""
        numbers: list[Array] = []
        first = 0
        for track, one in enumerate(self.tracks):
            until = self.until(track)
            for channel in one.channels:
                time = channel.time[channel.time <= until + 1e-9]
                numbers.append(first + np.minimum(np.floor(time / until * count), count - 1))
            first += count
        return np.concatenate(numbers).astype(np.intp)


def _moved(x: Array, i: int, step: float) -> Array:
    there = x.copy()
    there[i] += step
    return there
