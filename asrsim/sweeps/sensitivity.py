"""Influence of the varied keys on a result: changes of the result's mean for any study, and Sobol indices for a study with the
sampler `saltelli`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from asrsim.errors import listed
from asrsim.samples import Array
from asrsim.sweeps.samplers import SAMPLERS
from asrsim.sweeps.table import Table

FEWEST = 5
"""Smallest number of runs with a result for which the influences on this result are computed."""
RESAMPLES = 200
"""Number of bootstrap resamples for the errors of Sobol indices."""
FEWEST_SAMPLES = 16
"""Smallest number of base samples for which Sobol indices are computed; all runs of these samples have the result."""


class Index(NamedTuple):
    """Sobol indices of a key, each with the half-width of its 95 % interval (bootstrap over the base samples)."""

    first: float
    """First-order index: fraction of the result's variance due to the key alone."""
    total: float
    """Total index: fraction of the variance due to the key alone and to its interactions with other keys."""
    first_error: float
    total_error: float

    def __str__(self) -> str:
        return f"S = {self.first:z.2f} ± {self.first_error:.2f}, total {self.total:z.2f}"


@dataclass(frozen=True)
class Influence:
    """Influence of one key on one result."""

    key: str
    low: float
    """Mean of the result over the fifth of the runs with the smallest values of the key."""
    high: float
    """Mean of the result over the fifth of the runs with the largest values of the key."""
    sobol: Index | None = None


def numeric_keys(table: Table) -> list[str]:
    """Varied keys with numerical values that differ between runs; of keys that are tied to each other, only the first is
    returned."""
    study = table.study
    tied = {key for group in (*(axis.keys for axis in study.axes), *study.groups) for key in group[1:]}
    return [key for key in table.keys if table.kinds[key] == "float" and key not in tied and np.ptp(table[key]) > 0.0]


def influences(table: Table, result: str) -> list[Influence]:
    """Influence of every key on a result; the key with the largest change of the result's mean comes first. The list is empty
    if too few runs have the result, or if the result is the same in all runs.
    """
    there = np.isfinite(table[result])
    values = table[result][there]
    if len(values) < FEWEST or np.ptp(values) == 0.0:
        return []
    indices = found.indices if (found := sobol(table, result)) else {}
    found_influences = []
    for key in numeric_keys(table):
        numbers = table[key][there]
        if np.ptp(numbers):
            low, high = np.quantile(numbers, (0.2, 0.8))
            ends = float(values[numbers <= low].mean()), float(values[numbers >= high].mean())
            found_influences.append(Influence(key, *ends, indices.get(key)))
    return sorted(found_influences, key=lambda one: -abs(one.high - one.low))


@dataclass(frozen=True)
class SobolIndices:
    """Sobol indices of all drawn keys for one result."""

    indices: dict[str, Index]
    """Sobol indices by key, averaged over the variants."""
    samples: int
    """Number of base samples from which the indices are computed, of all variants together."""
    left_out: int
    """Number of base samples that are left out because one of their runs has no value of the result."""
    reason: str = ""
    """Reason why there are no indices; empty if there are indices."""

    def __str__(self) -> str:
        if self.reason:
            return f"no Sobol indices: {self.reason}"
        return (
            f"Sobol indices without {self.left_out} of {self.samples} base samples: each of these samples has a run without "
            "a value"
        )


@lru_cache(maxsize=16)
def sobol(table: Table, result: str) -> SobolIndices | None:
    """Sobol indices of the drawn keys for a result; None for a study whose sampler does not draw blocks (`Sampler.blocks`).

    The first-order index follows Saltelli et al. (2010), and the total index follows Jansen (1999). SciPy's `sobol_indices`
    gives the same indices, but only if the number of samples is a power of two. If one run had no value, SciPy would give no
    indices.
    """
    study = table.study
    if not study.groups or not table.manifest.get("blocks", True):
        return None
    if study.sampler not in SAMPLERS:
        files = ", ".join(map(str, study.plugins))
        where = f". The study used {files}: name your copy with --plugin" if files else ""
        return SobolIndices({}, samples=0, left_out=0, reason=f"the sampler '{study.sampler}' is not known here{where}")
    if not SAMPLERS.get(study.sampler).blocks:
        return None
    n, d = study.base_samples, len(study.groups)
    values = np.full(table.manifest["runs"], np.nan)
    values[table["run"]] = table[result]
    blocks = values.reshape(-1, d + 2, n)
    there: Any = np.isfinite(blocks).all(axis=1)
    counts: Any = {"samples": there.size, "left_out": int(np.sum(~there))}
    found = []
    for block, complete in zip(blocks, there, strict=True):
        if complete.sum() < FEWEST_SAMPLES:
            reason = f"{complete.sum()} of {n} base samples have a value in all their {d + 2} runs, {FEWEST_SAMPLES} are needed"
            return SobolIndices({}, **counts, reason=reason)
        used = block[:, complete]
        if not np.ptp(used[:2]):
            return SobolIndices({}, **counts, reason="the result is the same in all runs")
        # In a resample without variation, the indices are undefined.
        drawn = np.random.default_rng(0).integers(used.shape[1], size=(RESAMPLES, used.shape[1]))
        if not all(np.ptp(used[:2, places]) for places in drawn):
            return SobolIndices({}, **counts, reason="the result is the same in the runs of most base samples")
        spread = np.std([_estimates(used[:, places]) for places in drawn], axis=0, ddof=1)
        found.append(np.concatenate([_estimates(used), 1.96 * spread]))
    indices = np.mean(found, axis=0)
    # The errors of the variants are independent of each other, so the error of their mean falls with the root of their number.
    indices[2:] /= np.sqrt(len(found))
    return SobolIndices(
        {group[0]: Index(*column) for group, column in zip(study.groups, indices.T.tolist(), strict=True)}, **counts
    )


def _estimates(blocks: Array) -> Array:
    """First-order and total indices (2, keys) from a result's values (2 + keys, samples) in the blocks of the draws."""
    both = blocks[:2]
    blocks, variance = blocks - both.mean(), both.var()
    first = np.mean(blocks[1] * (blocks[2:] - blocks[0]), axis=1) / variance
    total = 0.5 * np.mean((blocks[0] - blocks[2:]) ** 2, axis=1) / variance
    return np.stack([first, total])


def notes(table: Table, results: Sequence[str]) -> list[str]:
    """Notes on results that have no Sobol indices, and on base samples that are left out."""
    grouped: dict[str, list[str]] = {}
    for result in results:
        found = sobol(table, result)
        if found is not None and (found.reason or found.left_out):
            grouped.setdefault(str(found), []).append(result)
    return [f"{listed(names, 4)}: {text}" for text, names in grouped.items()]
