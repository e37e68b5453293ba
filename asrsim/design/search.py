"""The search: Fisher matrices of segments within the limits add up; the best set is picked and joined to a motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from asrsim.design.motion import CHIRP, LEVELS, Segment, beside, fresh
from asrsim.design.plant import Outcome, Plant
from asrsim.identification.door import Substeps
from asrsim.samples import Array

SEGMENT, MOST = 1.0, 12
"""s that a segment lasts, at least; segments of a motion, at most."""
FIRST, BATCH = 60, 20
"""Segments that are tried before any is picked, and in each round afterwards."""
FULL = 0.97
"""Share of a limit that a motion may use."""
TRIES, SHRINKS = 5, 40
"""Runs in which a segment, and a whole motion, are scaled into the limits."""
SECANTS, AGREE = (1e-4, 3e-4, 1e-3), 1.25
"""Relative changes of the numbers for which information is computed again; factor by which deviations may then differ.

Where friction sticks and slips, small changes find slopes that do not last up to the ends of the intervals: fits scattered 2.2
times as far as one motion promised whose deviations differed by a factor of 1.8, and 9.4 times where they differed by 9.5.
"""
PRIOR = 1.0 / np.log(10.0) ** 2
"""Information about each number beforehand: its order of magnitude is known."""


@dataclass(frozen=True, eq=False)
class Found:
    """A motion within the limits."""

    name: str
    segments: tuple[Segment, ...]
    motion: Array
    """(references, rows) in the references' units."""
    information: Array
    """(robots, groups, n, n)."""
    score: float
    """Mean logarithm of the standard deviations; less is better."""


@dataclass(eq=False)
class Search:
    """A search with given gains. What was found is kept: another run goes on from there."""

    plant: Plant
    gains: Mapping[str, float]
    robots: Sequence[Array]
    """Numbers of the robots on which the motion is to show much."""
    checks: Sequence[Array]
    """Further robots on which it must keep its limits."""
    substeps: Substeps
    known: Array
    """(n, n) Fisher matrix of earlier recordings."""
    generator: np.random.Generator
    stop: Callable[[], bool] = lambda: False
    library: list[Found] = field(default_factory=list)
    picked: list[int] = field(default_factory=list)
    examined: dict[int, bool] = field(default_factory=dict)
    """Segment of the library that was picked -> whether its information is believed."""

    @property
    def count(self) -> int:
        """Segments of the motion."""
        return min(MOST, max(2, round((self.plant.rows - 1) * self.plant.step / SEGMENT)))

    def deviations(self, information: Array) -> Array:
        """(..., robots, n) of matrices (..., robots, groups, n, n) of what is recorded."""
        matrices = information[..., 0, :, :] + self.known + PRIOR * np.eye(len(self.known))
        variances = np.diagonal(np.linalg.inv(matrices), axis1=-2, axis2=-1)
        return np.asarray(np.sqrt(np.maximum(variances, 1e-30)))

    def score(self, information: Array) -> Array:
        """(...,) mean logarithm of the deviations, over robots and numbers, of matrices (..., robots, groups, n, n)."""
        return np.asarray(np.log(self.deviations(information)).mean(axis=(-1, -2)))

    def play(self, motion: Array, *, information: bool = False, checked: bool = False) -> Outcome | None:
        """Of a motion on the robots; checked: on the further ones too."""
        robots = [*self.robots, *self.checks] if checked else self.robots
        return self.plant.play(motion, self.gains, robots, self.substeps, information=information)

    def scaled(self, segments: Sequence[Segment], rows: int) -> list[Segment] | None:
        """As large as the limits allow, each reference by those of its own joint; None where no size keeps them all."""
        plant, there, best = self.plant, list(segments), None
        for _ in range(TRIES):
            outcome = self.play(plant.motion(there, rows))
            if outcome is None:
                factors = np.full(len(plant.references), 0.5)
            else:
                own = np.array([outcome.use[mine].max(initial=0.0) for mine in plant.own])
                most = float(outcome.use.max(initial=0.0))
                if most <= 1.0:
                    best = there
                    if own.min() > 0.9 * FULL:
                        break
                factors = np.clip(FULL / np.maximum(own, 1e-6), 0.2, 1.6)
                if own.max() <= 1.0 < most:
                    factors = np.minimum(factors, FULL / most)
            there = [one.scaled(np.where(plant.presets, 1.0, factors)) for one in there]
        return best

    def segment(self, segment: Segment) -> Found | None:
        """The segment within the limits; None where that is not found, or sensitivities cannot be believed."""
        rows = (self.plant.rows - 1) // self.count + 1
        fitting = self.scaled([segment], rows)
        return None if fitting is None else self.judged("segment", fitting, rows)

    def believed(self, found: Found) -> Found | None:
        """The motion with the least information that any of :data:`SECANTS` finds; None where they do not agree."""
        least, small = found, self.deviations(found.information)
        for secant in SECANTS:
            outcome = self.plant.play(found.motion, self.gains, self.robots, self.substeps, secant=secant)
            if outcome is None or outcome.information is None:
                return None
            if np.abs(np.log(self.deviations(outcome.information) / small)).max() > np.log(AGREE):
                return None
            score = float(self.score(outcome.information))
            least = replace(found, information=outcome.information, score=score) if score > least.score else least
        return least

    def judged(self, name: str, segments: Sequence[Segment], rows: int) -> Found | None:
        """The motion with its information; None where sensitivities cannot be believed."""
        motion = self.plant.motion(segments, rows)
        outcome = self.play(motion, information=True)
        if outcome is None or outcome.information is None:
            return None
        return Found(name, tuple(segments), motion, outcome.information, float(self.score(outcome.information)))

    def whole(self, name: str, segments: Sequence[Segment]) -> Found | None:
        """The joined motion, within the limits on all robots; segments that exceed them are made smaller.

        None where that is not found, or its information is not believed.
        """
        there, plant = list(segments), self.plant
        edges = np.linspace(0.0, (plant.rows - 1) * plant.step, len(there) + 1)[1:-1]
        for _ in range(SHRINKS):
            outcome = self.play(plant.motion(there, plant.rows), checked=True)
            if outcome is None:
                there = [one.scaled(0.9) for one in there]
                continue
            most = float(outcome.use.max(initial=0.0))
            if most <= 1.0:
                found = self.judged(name, there, plant.rows)
                return None if found is None else self.believed(found)
            at = int(np.searchsorted(edges, outcome.when, side="right"))
            there[at] = there[at].scaled(max(0.5, FULL / most))
        return None

    def extend(self, count: int) -> None:
        """Try more segments, until stopped: new ones, and variations of those that are picked."""
        for _ in range(count):
            if self.stop() and self.library:
                return
            base = int(self.generator.choice(self.picked)) if self.picked and self.generator.random() < 0.8 else None
            segment = (
                fresh(self.generator, len(self.plant.references))
                if base is None
                else beside(self.library[base].segments[0], self.generator)
            )
            found = self.segment(segment)
            if found is not None:
                self.library.append(found)

    def run(self, rounds: int, progress: Callable[[float], None] = lambda _: None) -> Found | None:
        """The best motion after so many rounds, or when stopped; None where no segment keeps the limits."""
        for number in range(rounds + 1):
            self.extend(BATCH if self.library else FIRST)
            if not self.library:
                return None
            self.pick()
            progress((number + 1) / (rounds + 1))
            if self.stop():
                break
        for _ in range(TRIES):
            whole = self.whole("design", [self.library[i].segments[0] for i in self.picked]) if self.picked else None
            if whole is not None or not self.picked:
                return whole
            # The joined motion is not believed, though its parts are: do without one of them.
            self.examined[int(self.generator.choice(self.picked))] = False
            self.pick()
        return None

    def pick(self) -> None:
        """Choose the believed segments whose sum scores best, beginning from the last choice, and from nothing."""
        while True:
            usable = [i for i in range(len(self.library)) if self.examined.get(i, True)]
            if not usable:
                self.picked = []
                return
            matrices = np.array([self.library[i].information for i in usable])
            last = [usable.index(i) for i in self.picked if i in usable]
            choices = [self._exchanged(matrices, begin) for begin in (last, [])]
            self.picked = [usable[i] for i in min(choices, key=lambda choice: choice[0])[1]]
            unseen = sorted({*self.picked} - self.examined.keys())
            if not unseen:
                return
            for i in unseen:
                found = self.believed(self.library[i])
                self.examined[i] = found is not None
                self.library[i] = found or self.library[i]

    def _exchanged(self, matrices: Array, begin: Sequence[int]) -> tuple[float, list[int]]:
        """Score and numbers of segments, one after the other exchanged for a better one until none is."""
        chosen = list(begin)
        while len(chosen) < self.count:
            # What is picked first is judged as if it were repeated.
            total = matrices[chosen].sum(axis=0) + matrices
            chosen.append(int(np.argmin(self.score(total * (self.count / (len(chosen) + 1))))))
        best, before = float(self.score(matrices[chosen].sum(axis=0))), np.inf
        while best < before - 1e-6:
            before = best
            for place in range(self.count):
                scores = self.score(matrices[[*chosen[:place], *chosen[place + 1 :]]].sum(axis=0) + matrices)
                if float(scores.min()) < best - 1e-9:
                    chosen[place], best = int(np.argmin(scores)), float(scores.min())
        return best, chosen

    def plain(self) -> list[Found]:
        """What people record, as large as the limits allow: one step, and the best of some chirps; presets rest."""
        plant, found = self.plant, dict[str, Found]()
        step = ("one step", LEVELS, [0.0, 0.2, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0])
        sweeps = (("chirp", CHIRP, [0.0, last, 0.5, 1.0, 0.0, 0.0, 0.0, 0.0]) for last in (0.5, 0.7, 0.85))
        for name, family, numbers in (step, *sweeps):
            count = len(plant.references)
            segment = Segment((family,) * count, np.tile(np.array(numbers), (count, 1)), np.where(plant.presets, 0.0, 1.0))
            fitting = self.scaled([segment], plant.rows)
            one = None if fitting is None else self.whole(name, fitting)
            if one is not None and (name not in found or one.score < found[name].score):
                found[name] = one
        return list(found.values())
