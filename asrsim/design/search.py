"""The search: whole chirps, and segments whose Fisher matrices add up, within the limits; the best motions are varied."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from asrsim.design.motion import Segment, chirp, fresh, step, varied
from asrsim.design.plant import DesignPlant, MotionOutcome
from asrsim.identification.door import Substeps
from asrsim.samples import Array

SEGMENT, MOST = 2.0, 8
"""Shortest segment, s; largest number of segments of a motion."""
FIRST, BATCH, VARIED = 160, 12, 28
"""Number of segments that are tried before any segment is varied; numbers of segments, and of variations of the whole motion,
in each round.
"""
FREQUENCIES, WHOLE = (0.5, 1.0, 1.7, 2.5, 3.5, 5.0, 7.0, 10.0), 8
"""First and last frequencies of chirps, Hz; number of chirps that are tried as whole motions."""
FULL, NEAR = 0.97, 0.9
"""Fraction of a limit to which a motion is scaled; fraction of a limit above which a motion is not enlarged."""
TRIES = 6
"""Largest number of simulations in which a motion is scaled into the limits."""
SMALL, LARGER, LARGEST, AGREE = (1e-6,), (0.1, 1.0), 1e-3, (0.5, 1.25)
"""Relative changes of the parameters for sensitivities; larger changes with which predicted deviations are checked, as
fractions of the predicted standard deviation or of `LARGEST`, whichever is less; accepted range of the ratio of deviations.

If friction sticks and slips, slopes from small changes do not hold up to the ends of the intervals. For a motion whose
deviations from small and larger changes differed by a factor of 1.8, fits scattered 2.2 times as far as predicted; for a factor
of 9.5, they scattered 9.4 times as far.
"""
PRIOR = 1.0 / np.log(10.0) ** 2
"""Information about the logarithm of each parameter before any experiment, whose order of magnitude is assumed to be known."""


@dataclass(frozen=True, eq=False)
class Found:
    """A motion within the limits, with its information."""

    name: str
    segments: tuple[Segment, ...]
    motion: Array
    """Motion (references, rows) in the references' units."""
    information: Array
    """Fisher matrices (robots, groups, n, n)."""
    score: float
    """Mean logarithm of the standard deviations of the parameters; a smaller score is better."""


@dataclass(eq=False)
class Search:
    """A search with given gains. Its results are stored, so that a further call of `run` continues the search."""

    plant: DesignPlant
    gains: Mapping[str, float]
    robots: Sequence[Array]
    """Parameter vectors of the robots for which the motion is designed."""
    checks: Sequence[Array]
    """Parameter vectors of further robots on which the motion must keep the limits."""
    substeps: Substeps
    known: Array
    """Fisher matrix (n, n) of earlier recordings."""
    generator: np.random.Generator
    stop: Callable[[], bool] = lambda: False
    plain: dict[str, Found] = field(default_factory=dict)
    """Best plain motions by name: step and chirps."""
    library: list[Found] = field(default_factory=list)
    """Segments within the limits."""
    picked: list[int] = field(default_factory=list)
    """Indices of the library's segments that make the joined motion."""
    best: Found | None = None
    """Best whole motion whose information is confirmed by larger changes of the parameters."""
    success: tuple[Found, int, Segment] | None = None
    """Motion that the last variation improved, index of the varied segment, and the segment before its variation."""

    @property
    def count(self) -> int:
        """Number of segments of the motion."""
        return min(MOST, max(2, round((self.plant.rows - 1) * self.plant.step / SEGMENT)))

    def deviations(self, information: Array) -> Array:
        """Standard deviations (..., robots, n) for Fisher matrices (..., robots, groups, n, n) of the recorded sensors."""
        matrices = information[..., 0, :, :] + self.known + PRIOR * np.eye(len(self.known))
        variances = np.diagonal(np.linalg.inv(matrices), axis1=-2, axis2=-1)
        return np.asarray(np.sqrt(np.maximum(variances, 1e-30)))

    def score(self, information: Array) -> Array:
        """Mean logarithms (...,) of the deviations, over robots and parameters."""
        return np.asarray(np.log(self.deviations(information)).mean(axis=(-1, -2)))

    def play(self, motion: Array, *, changes: Sequence[Array | float] = (), checked: bool = False) -> MotionOutcome | None:
        """Outcome of a motion on the robots of the design; checked: simulate the further robots, too."""
        robots = [*self.robots, *self.checks] if checked else self.robots
        return self.plant.play(motion, self.gains, robots, self.substeps, changes)

    def fitted(self, segments: Sequence[Segment], rows: int, tries: int = TRIES) -> list[Segment] | None:
        """Segments scaled into the limits; None if no tried size keeps the limits.

        Segments that exceed limits become smaller. A single segment becomes as large as the limits of each joint allow.
        """
        plant, there, best = self.plant, list(segments), None
        edges = np.linspace(0.0, (rows - 1) * plant.step, len(there) + 1)[1:-1]
        single = len(there) == 1
        for _ in range(tries):
            outcome = self.play(plant.motion(there, rows), checked=rows == plant.rows)
            if outcome is None:
                there = [one.scaled(np.where(plant.presets, 1.0, 0.5)) for one in there]
                continue
            own = np.array([outcome.use[mine].max(initial=0.0) for mine in plant.own])
            most = float(outcome.use.max(initial=0.0))
            if most <= 1.0:
                best = list(there)
                if not single or own.min() > NEAR:
                    break
            factors = np.clip(FULL / np.maximum(own, 1e-6), 0.2, 1.6 if single else 1.0)
            if own.max() <= 1.0 < most:
                factors = np.minimum(factors, FULL / most)
            at = int(np.searchsorted(edges, outcome.when, side="right"))
            there[at] = there[at].scaled(np.where(plant.presets, 1.0, factors))
        return best

    def judged(self, name: str, segments: Sequence[Segment], rows: int) -> Found | None:
        """Motion with its Fisher information; None if a robot is near chaos."""
        motion = self.plant.motion(segments, rows)
        outcome = self.play(motion, changes=SMALL)
        if outcome is None or outcome.information is None:
            return None
        return Found(name, tuple(segments), motion, outcome.information, float(self.score(outcome.information)))

    def confirmed(self, found: Found) -> Found | None:
        """Motion with the smaller of two estimates of its information, from small and from larger changes of the parameters.
        None if the two estimates do not agree.
        """
        least, small = found, self.deviations(found.information)
        size = np.minimum(small.min(axis=0), LARGEST)
        for share in LARGER:
            outcome = self.play(found.motion, changes=(share * size, -share * size))
            if outcome is None or outcome.information is None:
                return None
            ratios = self.deviations(outcome.information) / small
            if ratios.min() < AGREE[0] or ratios.max() > AGREE[1]:
                return None
            score = float(self.score(outcome.information))
            least = replace(found, information=outcome.information, score=score) if score > least.score else least
        return least

    def whole(self, name: str, segments: Sequence[Segment], tries: int = TRIES, above: float = np.inf) -> Found | None:
        """Joined motion within the limits on all robots, with confirmed information; None if its score is not below `above`."""
        rows = self.plant.rows
        if self.checks and above < np.inf:
            # Simulating the further robots takes long, so bad motions are rejected first. Scaling down improves no score.
            found = self.judged(name, segments, rows)
            if found is None or found.score >= above:
                return None
        fitting = self.fitted(segments, rows, tries)
        found = None if fitting is None else self.judged(name, fitting, rows)
        return None if found is None or found.score >= above else self.confirmed(found)

    def start(self) -> None:
        """Try usual test motions: one step, and chirps with stiffness presets at rest or at an end of their range.

        Chirps are tried as segments first; the best chirps are then extended to the whole motion.
        """
        presets = self.plant.presets
        chirps = dict[str, list[Found]]()
        for preset, (first, last) in product((0.0, 1.0, -1.0) if presets.any() else (0.0,), product(FREQUENCIES, repeat=2)):
            if first <= last and (found := self.try_segment(chirp(presets, first, last, preset))) is not None:
                chirps.setdefault("chirp, preset moved" if preset else "chirp", []).append(found)
        best = {name: sorted(some, key=lambda one: one.score)[:WHOLE] for name, some in chirps.items()}
        motions = [("one step", step(presets)), *((name, one.segments[0]) for name, some in best.items() for one in some)]
        for name, segment in motions:
            if self.stop() and self.best:
                return
            above = self.plain[name].score if name in self.plain else np.inf
            whole = self.whole(name, [segment], above=above)
            if whole is not None and whole.score < above:
                self.plain[name] = whole
                self.better(whole)

    def try_segment(self, segment: Segment) -> Found | None:
        """Scale a segment into the limits and add it to the library; None if the segment cannot be used, or the search is
        stopped.
        """
        if self.stop() and self.library:
            return None
        rows = (self.plant.rows - 1) // self.count + 1
        fitting = self.fitted([segment], rows)
        found = None if fitting is None else self.judged("segment", fitting, rows)
        self.library += [] if found is None else [found]
        return found

    def extend(self, count: int) -> None:
        """Try more segments: at first new segments, later more often variations of the picked segments."""
        presets = self.plant.presets
        for _ in range(count):
            if self.picked and len(self.library) >= FIRST and self.generator.random() < 0.9:
                base = self.library[int(self.generator.choice(self.picked))].segments[0]
                self.try_segment(varied(base, self.generator, presets))
            else:
                self.try_segment(fresh(self.generator, presets))

    def pick(self) -> None:
        """Choose the segments whose sum scores best; segments whose information is not confirmed leave the library."""
        while self.library:
            matrices = np.array([one.information for one in self.library])
            chosen = [self._exchanged(matrices, begin) for begin in (self.picked, [])]
            self.picked = min(chosen, key=lambda picked: float(self.score(matrices[picked].sum(axis=0))))
            new = sorted({i for i in self.picked if self.library[i].name == "segment"}, reverse=True)
            for i in new:
                found = self.confirmed(self.library[i])
                if found is None:
                    del self.library[i]
                    self.picked = [k - (k > i) for k in self.picked if k != i]
                else:
                    self.library[i] = replace(found, name="confirmed segment")
            if not new:
                return

    def _exchanged(self, matrices: Array, begin: Sequence[int]) -> list[int]:
        """Indices of segments; segments are exchanged until no exchange improves the score."""
        chosen, before = list(begin), np.inf
        while len(chosen) < self.count:
            # While fewer segments are chosen than the motion needs, the chosen segments are scored as if they were repeated.
            total = matrices[chosen].sum(axis=0) + matrices
            chosen.append(int(np.argmin(self.score(total * (self.count / (len(chosen) + 1))))))
        best = float(self.score(matrices[chosen].sum(axis=0)))
        while best < before - 1e-6:
            before = best
            for at in range(self.count):
                scores = self.score(matrices[[*chosen[:at], *chosen[at + 1 :]]].sum(axis=0) + matrices)
                if float(scores.min()) < best - 1e-9:
                    chosen[at], best = int(np.argmin(scores)), float(scores.min())
        return chosen

    def run(self, rounds: int, progress: Callable[[float], None] = lambda _: None) -> Found | None:
        """Best motion after a number of rounds, or when the search is stopped; None if no confirmed motion keeps the limits."""
        if not self.plain:
            self.start()
        for number in range(rounds):
            progress(0.5 * number / rounds)
            self.extend(BATCH)
            self.pick()
        segments = [self.library[i].segments[0] for i in self.picked]
        for _ in range(TRIES if segments else 0):
            found = self.whole("design", segments, 4 * TRIES)
            if found is not None:
                self.better(found)
                break
            # The information of the joined motion is not confirmed, so one of its segments is replaced.
            segments = [*segments[1:], segments[-1]]
        # Each variation is simulated for every robot, so more robots get fewer variations to bound the time.
        count = VARIED * rounds // len(self.robots)
        for number in range(count):
            if self.stop() or self.best is None:
                break
            progress(0.5 + 0.5 * number / count)
            self.vary(self.best)
        return self.best

    def better(self, found: Found) -> bool:
        """Store a motion if it is the best so far; return whether it is."""
        better = self.best is None or found.score < self.best.score
        self.best = found if better else self.best
        return better

    def vary(self, base: Found) -> None:
        """Try a variation of one of the segments of the best motion."""
        segments = list(base.segments)
        if self.success is not None and self.success[0] is base:
            _, at, old = self.success
            segments[at] = segments[at].beyond(old)
        else:
            at = int(self.generator.integers(len(segments)))
            segments[at] = varied(segments[at], self.generator, self.plant.presets)
        found = self.whole("design", segments, above=base.score)
        self.success = (found, at, base.segments[at]) if found is not None and self.better(found) else None
