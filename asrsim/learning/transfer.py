"""Will the learned input work on the hardware? The stand-in: many plants that differ from the learned one.

Each draw perturbs named factors (spring parameters, masses, damping, friction, delay) by stated amounts; the learned
input is played to it, feed-forward. Out come how often the tolerance holds, how the error is distributed, and which
factor matters most.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from asrsim.samples import Array
from asrsim.scenario.learning_keys import Distribution, PlantSet

ADDED = ("delay", "added_friction", "added_damping")
"""Factors that are added, from 0 on, and do not scale: s, N m, N m s/rad."""
CONFIDENCE = 0.95
"""Probability that an interval of a correlation holds it."""
Draw = Mapping[str, float]
"""Factor -> relative change (0.1: a tenth more) or, for `delay`, seconds."""


@dataclass(frozen=True, kw_only=True)
class Spread:
    """How far the factors vary: half-widths of uniform, or standard deviations of normal distributions."""

    factors: Mapping[str, float]
    """Factor -> relative spread; those of :data:`ADDED`: the most that is added, in SI, drawn from 0 on."""
    distribution: Distribution = "uniform"

    @classmethod
    def of(cls, plants: PlantSet, joints: Sequence[str]) -> Spread:
        """That of a scenario's `transfer:` or `plants:`.

        Actuator parameters vary independently in each joint, as `parameters.<joint>.<name>`; mass, damping, friction, and what
        is added to the latter, in each joint too, as `<what>.<joint>`; the delay is common to all.
        """
        spread = plants.spread
        factors: dict[str, float] = {}
        for joint in joints:
            for name, amount in spread.parameters.items():
                factors[f"parameters.{joint}.{name}"] = amount
            for what in ("mass", "damping", "friction", *ADDED[1:]):
                factors[f"{what}.{joint}"] = getattr(spread, what)
        factors["delay"] = spread.delay
        return cls(factors={name: amount for name, amount in factors.items() if amount > 0.0}, distribution=plants.distribution)


@dataclass(frozen=True, kw_only=True)
class Influence:
    """How much one factor decides the error."""

    factor: str
    rank_correlation: float
    """Spearman's, of the factor with the largest error: sign and strength of a monotone influence."""
    interval: tuple[float, float]
    """95 % of it (Fisher's transformation with the variance of Bonett and Wright 2000)."""
    tells: bool
    """Whether the correlation differs from 0 where so many factors are looked at (Bonferroni)."""
    regression: float
    """Standardised regression coefficient, all factors together, of the largest error on the size of the change."""
    signed_regression: float
    """The same on the signed change."""


@dataclass(frozen=True, kw_only=True)
class TransferReport:
    """What became of the learned input on the drawn plants."""

    tolerance: float
    """In `unit`."""
    draws: tuple[Draw, ...]
    largest: Array = field(repr=False)
    """(draws, joints) rad, largest absolute error of each joint."""
    joints: tuple[str, ...]
    influences: tuple[Influence, ...]
    """Highest rank correlation first."""
    unit: str = "rad"
    """Of errors; `rad or m` where joints are of both kinds."""

    @property
    def worst(self) -> Array:
        """(draws,) rad, largest error over the joints."""
        return np.asarray(self.largest.max(axis=1))

    @property
    def within(self) -> float:
        """Share of draws in which every joint stays within the tolerance."""
        return float(np.mean(self.worst <= self.tolerance))

    @property
    def within_interval(self) -> tuple[float, float]:
        """95 % interval of that share (Clopper and Pearson 1934)."""
        from scipy.stats import binomtest

        within = int(np.sum(self.worst <= self.tolerance))
        low, high = binomtest(within, len(self.worst)).proportion_ci(CONFIDENCE)
        return float(low), float(high)

    @property
    def telling(self) -> tuple[Influence, ...]:
        """Influences that are no noise."""
        return tuple(item for item in self.influences if item.tells)

    def quantiles(self, shares: Sequence[float] = (0.05, 0.25, 0.5, 0.75, 0.95)) -> dict[float, float]:
        """Quantiles of the largest error in rad; diverged draws count as infinite."""
        return {share: float(np.quantile(self.worst, share, method="inverted_cdf")) for share in shares}


def draw_plants(spread: Spread, count: int, seed: int) -> tuple[Draw, ...]:
    """`count` plants; the same seed gives the same plants, and more draws only add to them."""
    names = sorted(spread.factors)
    draws = []
    for index in range(count):
        generator = np.random.default_rng([seed, index])
        draw = {}
        for name in names:
            amount = spread.factors[name]
            if name.split(".")[0] in ADDED:
                draw[name] = float(generator.uniform(0.0, amount))
            elif spread.distribution == "uniform":
                draw[name] = float(generator.uniform(-amount, amount))
            else:
                # Three standard deviations at most, and never a negative mass.
                draw[name] = float(max(np.clip(generator.normal(0.0, amount), -3.0 * amount, 3.0 * amount), -0.95))
        draws.append(draw)
    return tuple(draws)


def transfer(
    reference: Array,
    draws: Sequence[Draw],
    outputs_of: Callable[[Sequence[Draw]], Sequence[Array]],
    *,
    joints: tuple[str, ...],
    tolerance: float,
    unit: str = "rad",
) -> TransferReport:
    """Play the learned input to every drawn plant and report.

    outputs_of: draws -> link positions (n, joints) of each (so that the caller may share the work among processes);
    reference: (n, joints) rad.
    """
    largest = np.array([np.abs(reference - output).max(axis=0) for output in outputs_of(draws)])
    largest = np.where(np.isfinite(largest), largest, np.inf)
    return TransferReport(
        tolerance=tolerance,
        draws=tuple(draws),
        largest=largest,
        joints=joints,
        unit=unit,
        influences=influences(draws, largest.max(axis=1)),
    )


def influences(draws: Sequence[Draw], worst: Array) -> tuple[Influence, ...]:
    """Which factor decides the error, highest rank correlation first; empty with fewer finite draws than twice the factors."""
    finite = np.isfinite(worst)
    names = sorted(draws[0]) if draws else []
    if not names or finite.sum() < 2 * len(names) + 2:
        return ()
    from scipy.stats import spearmanr

    values = np.array([[draw[name] for name in names] for draw in draws])[finite]
    errors = worst[finite]
    found = []
    signed, unsigned = _standardised(values, errors), _standardised(np.abs(values), errors)
    for column, name in enumerate(names):
        varied = np.ptp(values[:, column]) > 0.0 and np.ptp(errors) > 0.0
        correlation = float(spearmanr(values[:, column], errors).statistic) if varied else 0.0
        found.append(
            Influence(
                factor=name,
                rank_correlation=correlation,
                interval=correlation_interval(correlation, len(errors), CONFIDENCE),
                tells=not _holds_zero(correlation_interval(correlation, len(errors), 1.0 - (1.0 - CONFIDENCE) / len(names))),
                regression=float(unsigned[column]),
                signed_regression=float(signed[column]),
            )
        )
    return tuple(sorted(found, key=lambda item: -abs(item.rank_correlation)))


def correlation_interval(correlation: float, count: int, confidence: float) -> tuple[float, float]:
    """Interval of a rank correlation over `count` pairs."""
    from math import atanh, sqrt, tanh

    from scipy.stats import norm

    if count < 5 or abs(correlation) >= 1.0:
        return (-1.0, 1.0) if count < 5 else (correlation, correlation)
    half = float(norm.ppf(0.5 + 0.5 * confidence)) * sqrt((1.0 + 0.5 * correlation**2) / (count - 3))
    return tanh(atanh(correlation) - half), tanh(atanh(correlation) + half)


def _holds_zero(interval: tuple[float, float]) -> bool:
    return interval[0] <= 0.0 <= interval[1]


def _standardised(values: Array, errors: Array) -> Array:
    """Coefficients of a linear regression in units of standard deviations."""
    spread = values.std(axis=0)
    scaled = (values - values.mean(axis=0)) / np.where(spread > 0.0, spread, 1.0)
    deviation = float(errors.std())
    target = (errors - errors.mean()) / (deviation if deviation > 0.0 else 1.0)
    return np.asarray(np.linalg.lstsq(scaled, target, rcond=None)[0])
