"""The search: trust-region least squares from several starts, over a growing horizon where one shot does not fit."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from asrsim.identification.data import Channel
from asrsim.identification.noise import beyond_steps, is_nothing, lag_correlation, size_of, swings
from asrsim.identification.regression import regressed
from asrsim.identification.residuals import Residuals
from asrsim.identification.solver import ROUNDS, cost_of, solve
from asrsim.samples import Array

SHORT, GROWING = (0.2, 1.0), (0.08, 0.15, 0.25, 0.4, 0.65, 1.0)
"""Shares of the training part, one after the other: swings stay within half a period of each other."""
NEARER = 0.5
"""Share of the start's cost that one from regression may have: where noise is most of it, its bias would lead astray."""
NEARLY = 0.9
"""Share of the cost that another way to play the commands may leave."""
FITS = 1.25
"""Deviations, in those of the noise's fine structure, up to which residuals may be noise."""
TOLD = 2.0
"""Share by which a single sample tells that deviation, times its confidence."""
FAR_OFF = 2.0
"""Deviations of the noise that residuals have of a model that is wrong in more than a detail."""
WHITE = 0.3
"""Correlation of neighbouring residuals below which they may be noise."""
AGREED = 2
"""Searches that end alike, of a model that does not fit."""
LOOKS = 100
"""Evaluations to each side, at most, of a look along a parameter."""


class Stopped(Exception):  # noqa: N818 - no error: the user has seen enough
    """Raised between evaluations when the user asks for the end."""


@dataclass(frozen=True)
class Found:
    """Where a search ended."""

    x: Array
    cost: float
    """Mean square of the residuals, Huber's."""
    how: str
    """Start and horizon, for people."""
    held: frozenset[str] = frozenset()
    """Commands that were played as stairs."""


@dataclass
class Best:
    """What is best so far: kept outside the search, so that it survives its end."""

    x: Array
    cost: float = np.inf
    how: str = "start"
    attempts: int = 0
    successes: int = 0
    """Searches that ended as near as the best."""
    held: frozenset[str] = frozenset()
    """Commands that were played as stairs."""
    substeps: Mapping[str, int] = field(default_factory=dict)
    """As a scenario has them, where recordings are more exact than runs' own."""

    def offer(self, found: Found) -> None:
        """Another end."""
        self.attempts += 1
        if found.cost < self.cost * (1.0 - 1e-4):
            near = np.isfinite(self.cost) and self.cost < found.cost * 1.02
            self.x, self.cost, self.how, self.held = found.x, found.cost, found.how, found.held
            self.successes = self.successes + 1 if near else 1
        elif found.cost < self.cost * 1.02:
            self.successes += 1


def search(
    residuals: Residuals, best: Best, *, loss: str, starts: int, spread: float, seed: int, tell: Callable[[str], None],
    widened: Callable[[], bool],
) -> None:  # fmt: skip
    """Try starts until one fits; `best` has the best of them at any time. widened: asked once, after the first start, where it
    does not fit: whether more that is free, at the vectors' end, is nearer.
    """
    user = best.x.copy()
    for number, (how, x, horizons) in enumerate(_attempts(residuals, user, best, spread, seed)):
        if number >= starts:
            break
        tell(how)
        x = _wide(x, residuals)
        residuals.hold(frozenset())
        for share in horizons:
            residuals.share = share
            last = share == 1.0
            x = solve(residuals, x, loss="linear", tolerance=1e-5 if last else 1e-2, rounds=ROUNDS if last else 12)
            if last and loss != "linear" and _tails(residuals(x)):
                x = solve(residuals, x, loss=loss, tolerance=1e-5)
        residuals.share = 1.0
        found = Found(x, cost_of(residuals(x), loss), how)
        if not fits_noise(left_of(residuals, x)):
            # Only a start's own end tells whether stairs are nearer: beside others that are far off, they seem so by chance.
            found = _as_stairs(residuals, found, loss)
        best.offer(found)
        residuals.hold(best.held)
        if fits_noise(left_of(residuals, best.x)) or (not number and widened() and fits_noise(left_of(residuals, best.x))):
            break


def _wide(x: Array, residuals: Residuals) -> Array:
    """A vector from before more was free."""
    return np.append(x, np.zeros(len(residuals.layout) - len(x)))


def _as_stairs(residuals: Residuals, found: Found, loss: str) -> Found:
    """Play commands as stairs, one after the other, as long as that is nearer to what was recorded."""
    waiting = list(dict.fromkeys(c.key for track in residuals.tracks for c in track.data.commands if not c.hold))
    while waiting:
        base = residuals(found.x)
        slopes = np.linalg.qr(residuals.jacobian(found.x, base=base))[0]
        sizes = []
        for key in waiting:
            residuals.hold(found.held | {key})
            left = residuals(found.x)
            # What the parameters can make good.
            sizes.append(float(np.sum((left - slopes @ (slopes.T @ left)) ** 2)))
        held = found.held | {waiting.pop(int(np.argmin(sizes)))}
        residuals.hold(held)
        x = solve(residuals, found.x, loss=loss, tolerance=1e-5) if min(sizes) < NEARLY * float(base @ base) else found.x
        cost = cost_of(residuals(x), loss)
        if not cost < NEARLY * found.cost:
            break
        found = replace(found, x=x, cost=cost, held=held)
    residuals.hold(found.held)
    return found


def _attempts(
    residuals: Residuals, start: Array, best: Best, spread: float, seed: int
) -> Iterator[tuple[str, Array, tuple[float, ...]]]:
    """Starts, the user's first; then those that a look along each parameter finds, the same with losses divided otherwise, and
    scattered ones.
    """
    generator = np.random.default_rng(seed)
    how, first = _nearest(residuals, start)
    yield how, first, SHORT
    yield f"{how}, horizon growing", first, GROWING
    layout, start = residuals.layout, _wide(start, residuals)
    for place in (start, best.x) if _swinging(residuals, best.x) else ():
        for how, x in _looked_along(residuals, place, float(np.log(spread)), best.cost):
            yield how, x, (1.0,)
    losses = [i for i, entry in enumerate(layout.entries) if any(word in entry.name for word in ("friction", "damping"))]
    number = 1
    # Two ways to one end: others would hardly lead elsewhere.
    while best.successes < AGREED:
        moved = best.x.copy() if number % 2 else start.copy()
        for i, entry in enumerate(layout.entries):
            if i in losses:
                # Friction that sits on the motor may belong to the link, and the other way round.
                size = max(entry.value(float(moved[i])), 0.3 * entry.parameter.size)
                moved[i] = entry.place(size * float(np.exp(generator.uniform(-1.0, 1.0) * np.log(2.0 * spread))))
            elif number % 2 == 0:
                reach = np.log(spread) if entry.parameter.logarithmic else 1.0
                moved[i] += generator.uniform(-reach, reach)
        low, high = layout.bounds
        yield f"scattered start {number}", np.clip(moved, low, high), SHORT if number % 2 else GROWING
        number += 1


def _nearest(residuals: Residuals, start: Array) -> tuple[str, Array]:
    """The user's start, or that from regression, whichever is nearer to the beginning of what was recorded."""
    told = regressed(residuals.tracks, residuals.layout, start)
    residuals.share = SHORT[0]
    nearer = told is not None and cost_of(residuals(told), "huber") < NEARER * cost_of(residuals(start), "huber")
    residuals.share = 1.0
    return ("a start from regression", told) if told is not None and nearer else ("the start", start)


def _swinging(residuals: Residuals, x: Array) -> bool:
    """Whether a swing is left in any channel: its frequency may be in another minimum."""
    rows = [residuals.raw(x, track, residuals.until(track)) for track in range(len(residuals.tracks))]
    return any(swings(left) for row in rows for left in row or ())


def _looked_along(residuals: Residuals, x: Array, reach: float, cost: float) -> Iterator[tuple[str, Array]]:
    """Starts off x along one parameter, where that has many small minima: the frequency of a swing of which there are many.

    One that is already in the widest of them would find it by slopes; the grid is as fine as these hold.
    """
    low, high = residuals.layout.bounds
    base = residuals(x)
    least = cost_of(base, "huber")
    found: list[tuple[float, str, Array]] = []
    for i, entry in enumerate(residuals.layout.entries):
        width = _straight(residuals, x, i, base, reach)
        if width >= reach or entry.parameter.own:
            continue
        count = min(int(np.ceil(reach / width)), LOOKS)
        places = x[i] + np.linspace(-reach, reach, 2 * count + 1)
        places = places[(places > low[i]) & (places < high[i])]
        moved = [np.concatenate([x[:i], [place], x[i + 1 :]]) for place in places.tolist()]
        costs = [cost_of(residuals(one), "huber") for one in moved]
        if costs and min(costs) < max(least, cost):
            best = int(np.argmin(costs))
            found.append((costs[best], f"a look along {entry.name}", moved[best]))
    for _, how, there in sorted(found, key=lambda one: one[0])[:2]:
        yield how, there


def _straight(residuals: Residuals, x: Array, i: int, base: Array, reach: float) -> float:
    """How far along entry i residuals change in proportion."""
    width = reach
    far = residuals(_at(x, i, width)) - base
    while width > reach / LOOKS:
        half = residuals(_at(x, i, 0.5 * width)) - base
        if float(np.linalg.norm(far - 2.0 * half)) < 0.5 * float(np.linalg.norm(far)) or not np.any(far):
            return width
        width, far = 0.5 * width, half
    return width


def _at(x: Array, i: int, move: float) -> Array:
    there = x.copy()
    there[i] += move
    return there


def _tails(residuals: Array) -> bool:
    """Whether single samples are far off: neighbours that are off together are the model's fault."""
    size = np.abs(residuals - np.median(residuals))
    far = size > 5.0 * np.median(size) / 0.6745
    alone = far[1:-1] & ~far[:-2] & ~far[2:]
    return float(np.mean(alone)) > 1e-3


Left = Sequence[tuple[Channel, Array | None]]
"""Channels with what is left of each; None where the motion is not sane."""


def left_of(residuals: Residuals, x: Array) -> Left:
    """What is left of each channel of each recording, up to the end of what counts."""
    found: list[tuple[Channel, Array | None]] = []
    for number, track in enumerate(residuals.tracks):
        raw = residuals.raw(x, number, residuals.until(number))
        found += [(channel, None if raw is None else raw[i]) for i, channel in enumerate(track.channels)]
    return found


def fits_noise(found: Left) -> bool:
    """Whether what is left looks like noise in every channel of every recording, or nothing is left."""
    for channel, left in found:
        if left is None:
            return False
        # Steps of an encoder swing with the motion.
        ringing = not channel.quantum and swings(left)
        beyond, borne = beyond_steps(left, channel.values[: len(left)], channel.quantum)
        odd = ringing or is_loud(beyond, channel.floor) or abs(lag_correlation(beyond) - borne) > WHITE
        if odd and not is_nothing(size_of(left), channel.noise):
            return False
    return True


def is_explained(found: Left) -> bool:
    """Whether nothing is left of any channel, as of a simulation's own log."""
    return all(left is not None and is_nothing(size_of(left), channel.noise) for channel, left in found)


def is_far(found: Left) -> bool:
    """Whether much more than noise is left of any channel."""
    return any(left is None or size_of(left) > FAR_OFF * channel.floor for channel, left in found)


def is_loud(residuals: Array, noise: float) -> bool:
    """Whether residuals (n,) are more than a noise that as many samples told."""
    return bool(size_of(residuals) > (FITS + TOLD / max(len(residuals), 1) ** 0.5) * noise)


def globally(residuals: Residuals, best: Best, *, seed: int, tell: Callable[[str], None]) -> None:
    """Differential evolution over the bounds, or two decades about the start; its end becomes the start."""
    from scipy.optimize import differential_evolution

    tell("global search")
    low, high = residuals.layout.bounds
    box = [(max(a, x - 2.3), min(b, x + 2.3)) for a, b, x in zip(low.tolist(), high.tolist(), best.x.tolist(), strict=True)]
    found = differential_evolution(
        lambda x: cost_of(residuals(x), "huber"), box, seed=seed, maxiter=60, popsize=8, tol=1e-3, polish=False, x0=best.x
    )
    best.x = np.asarray(found.x, dtype=np.float64)
