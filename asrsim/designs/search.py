"""The search for a motion. Pieces are scaled so that they keep the limits, varied, and joined. The information of a motion is
the sum of the Fisher matrices of its pieces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from asrsim.designs.motion import Piece, chirp, fresh, step, varied
from asrsim.designs.plant import DesignPlant
from asrsim.progress import Progress, Stop, Tell, never, tell_nobody
from asrsim.samples import Array

LENGTH, MOST = 2.0, 8
"""LENGTH: usual duration of a piece, s.
MOST: largest number of pieces of a motion.
"""
FRESH, BATCH = 100, 40
"""FRESH: number of random pieces at the start of the search.
BATCH: number of variations of pieces in each round.
"""
FREQUENCIES, WHOLE = (0.5, 1.0, 1.7, 2.5, 3.5, 5.0, 7.0, 10.0), 3
"""FREQUENCIES: first and last frequencies of chirps, Hz.
WHOLE: number of the best chirps with each preset that are extended to whole motions.
"""
FULL, ENOUGH = 0.97, 0.93
"""FULL: fraction of each limit to which a motion is scaled.
ENOUGH: a motion is large enough if it uses more than this fraction of its goal.
"""
MARGIN = 0.88
"""Fraction of each limit that a robust design may use on the simulated robots. Other robots may use a larger fraction."""
TRIES, SHRINKING = 8, 4
"""TRIES: largest number of simulations by which a motion is scaled so that it keeps the limits.
SHRINKING: number of the last of these simulations, in which the motion may only become smaller.
"""
FEW = 4
"""Number of further robots on which each piece must keep the limits. The whole motion must keep them on all robots."""
ONE_STEP, CHIRP, DESIGN, PIECE = "one step", "chirp", "design", "piece"
"""Names of the motions."""
SMALL, LARGER, LARGEST, AGREE = (1e-6,), (0.1, 1.0), 1e-3, (0.5, 1.25)
"""SMALL: changes of the parameters for sensitivities, in units of the parameter vector.
LARGER: larger changes, with which the predicted standard deviations are checked. They are fractions of the predicted standard
deviation or of `LARGEST`, whichever is smaller.
AGREE: accepted range of the ratio of two standard deviations: predicted with larger changes, and predicted with small changes.

If joints stick and slip, derivatives from small changes do not hold up to the ends of the intervals. In one case, the two
standard deviations differed by a factor of 1.8, and the results of fits scattered 2.2 times as far as predicted. In another
case, the factor was 9.5, and the results scattered 9.4 times as far as predicted.
"""
ELSEWHERE, CHOSEN = 0.5, 0.2
"""ELSEWHERE: probability that a piece of the library is varied instead of a picked piece.
CHOSEN: parameter of the geometric distribution of this piece's rank in the library.
"""
PRIOR = 1.0 / np.log(10.0) ** 2
"""Information about the logarithm of each parameter before any experiment. It corresponds to a standard deviation of ln 10, a
factor of ten.
"""


@dataclass(frozen=True, eq=False)
class Found:
    """A motion within the limits, with the information that it gives about the parameters."""

    name: str
    pieces: Sequence[Piece]
    motion: Array
    """Motion (references, rows) in the references' units."""
    information: Array
    """Fisher matrices (robots, n, n)."""


@dataclass(eq=False)
class Search:
    """A search with given gains. It keeps its results, so that another call of `run` continues the search."""

    plant: DesignPlant
    robots: int
    """Number of robots for which the motion is designed. The motion must keep the limits on all robots of the plant."""
    known: Array
    """Fisher matrix (n, n) of the earlier recordings."""
    generator: np.random.Generator
    stop: Stop = never
    motions: dict[str, Found] = field(default_factory=dict)
    """Best whole motion of each name: `design`, `chirp` and `one step`."""
    best: Found | None = None
    """Best whole motion so far, with confirmed information."""
    library: list[Found] = field(default_factory=list)
    """Pieces that were tried and that keep the limits."""
    picked: list[Found] = field(default_factory=list)
    """Pieces of which the motion consists. Larger changes of the parameters have confirmed their information."""
    joined: list[Found] = field(default_factory=list)
    """Pieces of the last whole motion whose information has been confirmed."""

    @property
    def count(self) -> int:
        """Number of pieces of which the whole motion consists."""
        return min(MOST, max(1, round((self.plant.rows - 1) * self.plant.step / LENGTH)))

    @property
    def allowed(self) -> float:
        """Fraction of each limit that the motion may use."""
        return MARGIN if len(self.plant.robots) > 1 else 1.0

    def deviations(self, information: Array) -> Array:
        """Predicted standard deviations (..., robots, n) of the parameters, for Fisher matrices (..., robots, n, n)."""
        matrices = information + self.known + PRIOR * np.eye(len(self.known))
        variances = np.diagonal(np.linalg.inv(matrices), axis1=-2, axis2=-1)
        return np.asarray(np.sqrt(np.maximum(variances, 1e-30)))

    def score(self, information: Array) -> Array:
        """Mean (...,) over robots and parameters of the logarithms of the predicted standard deviations. A smaller score is
        better.
        """
        return np.asarray(np.log(self.deviations(information)).mean(axis=(-1, -2)))

    def rank(self, found: Found) -> float:
        """Score of a motion or piece alone."""
        return float(self.score(found.information))

    def fitted(self, pieces: Sequence[Piece], rows: int, robots: int) -> Sequence[Piece] | None:
        """The pieces, scaled so that they keep the limits. None if no tried size keeps the limits.

        A single piece is scaled in each window until each joint uses a fraction of its limits, the goal of the piece. Several
        pieces together are only made smaller. rows: number of rows of the motion; robots: number of robots that must keep the
        limits.
        """
        presets, best, most = self.plant.presets, None, -1.0
        goals = FULL * np.maximum(np.hstack([one.goals for one in pieces]), 0.02)
        for left in reversed(range(TRIES)):
            outcome = self.plant.play(self.plant.motion(pieces, rows), robots, windows=goals.shape[1])
            factors = np.full(goals.shape, 0.5)
            if outcome is not None:
                use = np.maximum(outcome.use / self.allowed, 1e-6)
                own = np.array([use[mine].max(axis=0, initial=1e-6) for mine in self.plant.own])
                filled = float(np.minimum(own / goals, 1.0)[~presets].mean())
                if use.max(initial=0.0) <= 1.0 and filled > most:
                    best, most = pieces, filled
                growing = left >= SHRINKING and len(pieces) == 1
                if best is not None and (most > ENOUGH or not growing):
                    break
                factors[:] = (
                    np.clip(goals / own, 0.3, 2.0) if growing else np.minimum(FULL / use.max(axis=0, initial=1e-6), 1.0)
                )
                # The motion in a window also affects the next window. Therefore also shrink a window if the next window must
                # shrink.
                following = np.hstack([factors[:, 1:], factors[:, -1:]])
                factors = np.minimum(factors, np.where(following < 1.0, np.sqrt(following), np.inf))
            factors[presets] = 1.0
            parts = np.hsplit(factors, len(pieces))
            pieces = [one.scaled(part) for one, part in zip(pieces, parts, strict=True)]
        return best

    def judged(self, name: str, pieces: Sequence[Piece]) -> Found | None:
        """A scaled piece, or a scaled whole motion if `name` is not `PIECE`, with its information. None if no size keeps the
        limits, or if a robot is near chaos.
        """
        rows, robots = self.plant.rows, len(self.plant.robots)
        if name == PIECE:
            rows, robots = (rows - 1) // self.count + 1, self.robots + FEW
        fitting = self.fitted(pieces, rows, robots)
        if fitting is None:
            return None
        motion = self.plant.motion(fitting, rows)
        outcome = self.plant.play(motion, self.robots, changes=SMALL)
        if outcome is None or outcome.information is None:
            return None
        return Found(name, fitting, motion, outcome.information)

    def confirmed(self, found: Found | None, others: Array | float = 0.0, agree: tuple[float, float] = AGREE) -> Found | None:
        """The motion with the smallest of three estimates of its information. One estimate is from small changes of the
        parameters, and two are from larger changes. None if the estimates do not agree. others: information of the other pieces
        of the motion; agree: as `AGREE`.
        """
        if found is None:
            return None
        least, small = found.information, self.deviations(found.information + others)
        size = np.minimum(small.min(axis=0), LARGEST)
        for share in LARGER:
            outcome = self.plant.play(found.motion, self.robots, changes=(share * size, -share * size))
            if outcome is None or outcome.information is None:
                return None
            ratios = self.deviations(outcome.information + others) / small
            if ratios.min() < agree[0] or ratios.max() > agree[1]:
                return None
            least = max(least, outcome.information, key=lambda one: float(self.score(one + others)))
        return replace(found, information=least)

    def start(self) -> None:
        """Try usual test motions: one step, and chirps with stiffness presets at their initial value or at an end of their
        range.

        First, chirps are tried as pieces. Then the best chirps are extended to whole motions.
        """
        presets, stepped = self.plant.presets, step(self.plant.presets)
        chirps = list[Found]()
        for preset in (0.0, 1.0, -1.0) if presets.any() else (0.0,):
            before = len(self.library)
            for first, last in product(FREQUENCIES, repeat=2):
                if first <= last:
                    self.try_piece(chirp(presets, first, last, preset))
            chirps += sorted(self.library[before:], key=self.rank)[:WHOLE]
        self.try_piece(stepped)
        for one in chirps:
            if self.stop() and self.best is not None:
                return
            self.keep(self.confirmed(self.judged(CHIRP, one.pieces)))
        one_step = self.judged(ONE_STEP, [replace(stepped, scales=stepped.scales[:, :1])])
        self.keep(self.confirmed(one_step))
        least = self.confirmed(one_step, agree=(0.0, np.inf))
        if least is not None:
            self.motions.setdefault(ONE_STEP, least)

    def keep(self, found: Found | None) -> None:
        """Store a confirmed whole motion if it is better than all motions so far, or better than the motions with its name."""
        if found is not None:
            self.motions[found.name] = min(found, self.motions.get(found.name, found), key=self.rank)
            self.best = min(found, self.best or found, key=self.rank)

    def try_piece(self, piece: Piece) -> Found | None:
        """Scale a piece so that it keeps the limits, add it to the library, and return it. None if no size can be used, or if
        the search was stopped.
        """
        if self.stop() and self.library:
            return None
        found = self.judged(PIECE, [piece])
        self.library += [] if found is None else [found]
        return found

    def try_fresh(self, count: int) -> None:
        """Try `count` random pieces."""
        for _ in range(count):
            self.try_piece(fresh(self.generator, self.plant.presets))

    def pick(self) -> None:
        """Pick the pieces of the motion one after the other. Each time, pick the piece that has the best score together with
        the pieces that were picked before. Pieces whose information is not confirmed are removed from the library.
        """
        while len(self.picked) < self.count and self.library:
            others = self._others(len(self.picked))
            totals = others + np.array([one.information for one in self.library])
            # Until enough pieces are picked, assume that the picked pieces are repeated over the duration of the motion.
            place = int(np.argmin(self.score(totals * (self.count / (len(self.picked) + 1)))))
            found = self.confirmed(self.library[place], others)
            if found is None:
                del self.library[place]
            else:
                self.picked.append(found)
        self.picked += self.picked[-1:] * (self.count - len(self.picked))

    def _others(self, place: int) -> Array:
        """Information of all picked pieces except the piece at `place`."""
        return np.asarray(sum(one.information for i, one in enumerate(self.picked) if i != place))

    def vary(self) -> None:
        """Try to replace a picked piece by a variation. The variation is of the piece itself, or of a library piece that has a
        good score together with the other picked pieces.
        """
        place = int(self.generator.integers(len(self.picked)))
        old, others = self.picked[place], self._others(place)
        before, base = self.score(old.information + others), old
        if self.generator.random() < ELSEWHERE:
            order = np.argsort(self.score(np.array([one.information for one in self.library]) + others))
            base = self.library[order[min(self.generator.geometric(CHOSEN) - 1, len(order) - 1)]]
        found = self.try_piece(varied(base.pieces[0], self.generator))
        if found is not None and self.score(found.information + others) < before:
            better = self.confirmed(found, others)
            if better is None:
                self.library.remove(found)
            elif self.score(better.information + others) < before:
                self.picked[place] = better

    def join(self) -> None:
        """Join the picked pieces into a whole motion. If the information of this motion is not confirmed, return to the pieces
        of the last confirmed motion.
        """
        found = self.confirmed(self.judged(DESIGN, [one.pieces[0] for one in self.picked]))
        self.keep(found)
        if found is not None:
            self.joined = list(self.picked)
        elif self.joined:
            self.picked = list(self.joined)

    def run(self, rounds: int, progress: Tell = tell_nobody) -> Found | None:
        """Best motion after a number of rounds, or when the search is stopped; None if no confirmed motion keeps the limits."""
        if not self.library:
            self.start()
        if rounds and not self.picked:
            self.try_fresh(FRESH)
            self.pick()
        for number in range(rounds if self.picked else 0):
            for part in range(BATCH):
                if self.stop():
                    break
                progress(Progress(task="search", fraction=(number + part / BATCH) / rounds))
                self.vary()
            self.join()
            if self.stop():
                break
        return self.best
