"""The search: segments within the limits whose Fisher matrices add up; those that tell most are picked, varied, and joined."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from asrsim.design.motion import Segment, beside, fresh
from asrsim.design.plant import FULL, Plant, Told
from asrsim.identification.door import Substeps
from asrsim.samples import Array

SEGMENT = 1.0
"""s that a segment lasts, at least; longer experiments have longer ones."""
MOST = 12
"""Segments of a motion."""
FIRST, BATCH = 60, 20
"""Segments that are tried before any is picked, and in each round afterwards."""
TRIES = 5
"""Runs in which a motion is scaled into its limits."""
PRIOR = 1.0 / np.log(10.0) ** 2
"""Information that there is of every number: its order of size."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """Segments within the limits, with what they tell."""

    segments: tuple[Segment, ...]
    information: Array
    """(draws, groups, n, n)."""


@dataclass(frozen=True, eq=False)
class Found:
    """A whole motion."""

    name: str
    motion: Array
    """(references, rows) in the references' units."""
    information: Array
    """(draws, groups, n, n) of all of it."""
    score: float
    """Mean logarithm of the intervals' halves; less is better."""


@dataclass(frozen=True, eq=False)
class Search:
    """What is searched for: on which robots, with which gains, beside what is known already."""

    plant: Plant
    gains: Mapping[str, float]
    draws: Sequence[Array]
    """Numbers on which the motion is to tell much."""
    checks: Sequence[Array]
    """Further numbers on which it must keep its limits."""
    substeps: Substeps
    known: Array
    """(n, n) Fisher matrix of what was recorded before."""
    stop: Callable[[], bool] = lambda: False

    @property
    def count(self) -> int:
        """Segments of the motion."""
        return min(MOST, max(2, round((self.plant.rows - 1) * self.plant.step / SEGMENT)))

    @property
    def rows(self) -> int:
        """Of a segment."""
        return (self.plant.rows - 1) // self.count + 1

    def score(self, information: Array) -> Array:
        """(...,) mean logarithm of the deviations, of matrices (..., draws, groups, n, n), over draws and numbers."""
        matrices = information[..., 0, :, :] + self.known + PRIOR * np.eye(self.known.shape[0])
        variances = np.diagonal(np.linalg.inv(matrices), axis1=-2, axis2=-1)
        return np.asarray(0.5 * np.log(np.maximum(variances, 1e-30)).mean(axis=(-1, -2)))

    def told(self, motion: Array, *, information: bool, everywhere: bool = False) -> Told | None:
        """Of a motion, on the draws; everywhere: on the checks too."""
        draws = [*self.draws, *self.checks] if everywhere else self.draws
        return self.plant.tell(motion, self.gains, draws, self.substeps, information=information)

    def scaled(self, segments: Sequence[Segment], rows: int) -> list[Segment] | None:
        """As large as the limits let them be, each joint by itself; None where that is not found."""
        plant, there, best = self.plant, list(segments), None
        for _ in range(TRIES):
            found = self.told(plant.motion(there, rows), information=False)
            if found is None:
                factor = np.full(len(plant.references), 0.5)
            else:
                if found.use.max() <= 1.0:
                    best = there
                    if found.use[plant.driven].min() > 0.9 * FULL:
                        break
                use = found.use[plant.driven]
                # A joint beyond its limits in a motion of all is brought down with the others.
                factor = np.clip(FULL / np.maximum(use, 1e-6), 0.2, 1.6)
                factor = (
                    np.minimum(factor, FULL / max(1.0, float(found.use.max())))
                    if use.max() <= 1.0 < found.use.max()
                    else factor
                )
            presets = np.array([one.slot == 1 for one in plant.references])
            there = [one.scaled(np.where(presets, 1.0, factor)) for one in there]
        return best

    def candidate(self, segment: Segment) -> Candidate | None:
        """The segment within the limits; None where it cannot be, or tells nothing that is to be believed."""
        fitting = self.scaled([segment], self.rows)
        if fitting is None:
            return None
        found = self.told(self.plant.motion(fitting, self.rows), information=True)
        return None if found is None or found.information is None else Candidate(tuple(fitting), found.information)

    def run(self, rounds: int, seed: int, tell: Callable[[float], None] = lambda _: None) -> Found | None:
        """The best motion found after so many rounds, or when stopped; None where no segment keeps the limits."""
        generator = np.random.default_rng(seed)
        library: list[Candidate] = []
        picked: list[int] = []
        for number in range(rounds + 1):
            for _ in range(FIRST if number == 0 else BATCH):
                if self.stop() and library:
                    break
                base = library[int(generator.choice(picked))].segments[0] if picked and generator.random() < 0.8 else None
                segment = fresh(generator, len(self.plant.references)) if base is None else beside(base, generator)
                if (one := self.candidate(segment)) is not None:
                    library.append(one)
            if not library:
                return None
            picked = self.picked(library, picked)
            tell((number + 1) / (rounds + 1))
            if self.stop():
                break
        return self.whole("design", [library[i].segments[0] for i in picked])

    def picked(self, library: Sequence[Candidate], before: Sequence[int]) -> list[int]:
        """Numbers of the segments whose sum tells most: one after the other is exchanged for a better one."""
        matrices = np.array([one.information for one in library])
        chosen = list(before)
        while len(chosen) < self.count:
            total = matrices[chosen].sum(axis=0)
            # What is picked first is judged as if it were repeated.
            chosen.append(int(np.argmin(self.score((total + matrices) * (self.count / (len(chosen) + 1))))))
        best = float(self.score(matrices[chosen].sum(axis=0)))
        for _ in range(10):
            was = best
            for place in range(self.count):
                others = matrices[[*chosen[:place], *chosen[place + 1 :]]].sum(axis=0)
                scores = self.score(others + matrices)
                if float(scores.min()) < best - 1e-9:
                    chosen[place], best = int(np.argmin(scores)), float(scores.min())
            if best > was - 1e-6:
                break
        return chosen

    def whole(self, name: str, segments: Sequence[Segment]) -> Found | None:
        """The joined motion, within its limits on all numbers; None where that is not found."""
        there, plant = list(segments), self.plant
        edges = np.linspace(0.0, (plant.rows - 1) * plant.step, len(there) + 1)
        for _ in range(40):
            motion = plant.motion(there, plant.rows)
            found = self.told(motion, information=False, everywhere=True)
            if found is None:
                there = [one.scaled(np.full(len(plant.references), 0.9)) for one in there]
                continue
            if found.use.max() <= 1.0:
                told = self.told(motion, information=True)
                if told is None or told.information is None:
                    return None
                return Found(name, motion, told.information, float(self.score(told.information)))
            factor = max(0.5, FULL / float(found.use.max()))
            at = min(int(np.searchsorted(edges, found.when, side="right")) - 1, len(there) - 1)
            there[at] = there[at].scaled(np.full(len(plant.references), factor))
        return None

    def plain(self) -> list[Found]:
        """Motions that people record: one step and chirps, as large as the limits let them be."""
        from asrsim.design.motion import FAMILIES, chirp

        found, count = [], len(self.plant.references)
        presets = np.array([one.slot == 1 for one in self.plant.references])
        once = Segment(
            (0,) * count, np.tile(np.array([0.0, 0.2, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0]), (count, 1)), np.where(presets, 0.0, 1.0)
        )
        sweeps = [
            Segment(
                (FAMILIES.index(chirp),) * count, np.tile(np.array([0.0, last, 0.5, 1.0, 0.0, 0.0, 0.0, 0.0]), (count, 1)),
                np.where(presets, 0.0, 1.0),
            )
            for last in (0.5, 0.7, 0.85)
        ]  # fmt: skip
        for name, one in (("one step", once), *(("chirp", sweep) for sweep in sweeps)):
            fitting = self.scaled([one], self.plant.rows)
            if fitting is not None and (whole := self.whole(name, fitting)) is not None:
                found.append(whole)
        return found
