"""What moves a result: ranks and swings from any study, Sobol indices from one that is designed for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from asrsim.errors import listed
from asrsim.samples import Array
from asrsim.sweeps.table import Table

FEWEST = 5
"""Runs below which nothing is said."""
RESAMPLES = 200
"""Of a bootstrap."""
FEWEST_SAMPLES = 16
"""Base samples below which Sobol indices say nothing."""


class Index(NamedTuple):
    """Sobol's indices of a key, each with half the width of its 95 % interval by bootstrap over the base samples."""

    first: float
    """Share of the variance that the key has alone."""
    total: float
    """Share with all its interactions."""
    first_error: float
    total_error: float

    def __str__(self) -> str:
        return f"S = {self.first:z.2f} ± {self.first_error:.2f}, total {self.total:z.2f}"


@dataclass(frozen=True)
class Influence:
    """Of one key on one result."""

    key: str
    rank: float
    """Spearman's correlation over all runs that have the result."""
    low: float
    """Mean of the result over the fifth of the runs in which the key is least."""
    high: float
    """Over the fifth in which it is largest."""
    sobol: Index | None = None
    """None where the design is not for it."""


def numeric_keys(table: Table) -> list[str]:
    """Keys with numbers that differ; of tied keys the first."""
    groups = [*table.manifest["listed"], *table.manifest["drawn"]]
    tied = {key for group in groups for key in group[1:]}
    kinds = table.kinds
    return [key for key in table.keys if kinds[key] == "float" and key not in tied and np.ptp(table[key]) > 0.0]


def influences(table: Table, result: str) -> list[Influence]:
    """Of every key on a result, the largest swing first; nothing where too few runs have it."""
    from scipy.stats import rankdata

    values = table[result]
    there = np.isfinite(values)
    if there.sum() < FEWEST or np.ptp(values[there]) == 0.0:
        return []
    ranks = rankdata(values[there])
    sobol_indices = sobol(table, result)
    indices = sobol_indices.indices if sobol_indices else {}
    found = []
    for key in numeric_keys(table):
        numbers = table[key][there]
        if np.ptp(numbers) == 0.0:
            continue
        low, high = np.quantile(numbers, (0.2, 0.8))
        found.append(
            Influence(
                key=key,
                rank=float(np.corrcoef(rankdata(numbers), ranks)[0, 1]),
                low=float(values[there][numbers <= low].mean()),
                high=float(values[there][numbers >= high].mean()),
                sobol=indices.get(key),
            )
        )
    return sorted(found, key=lambda one: -abs(one.high - one.low))


@dataclass(frozen=True)
class SobolIndices:
    """Of all drawn keys on one result."""

    indices: dict[str, Index]
    """By key; of several variants the mean of theirs."""
    samples: int
    """Base samples of all variants."""
    left_out: int
    """Base samples in which some run has no value: none of their runs counts."""
    reason: str = ""
    """Why there are no indices."""

    def __str__(self) -> str:
        if self.reason:
            return f"no Sobol indices: {self.reason}"
        return f"Sobol indices without {self.left_out} of {self.samples} base samples: a run of each has no value"


@lru_cache(maxsize=16)
def sobol(table: Table, result: str) -> SobolIndices | None:
    """Sobol indices of a result; None where the design is not for them.

    First order as in Saltelli et al. (2010), total as in Jansen (1999).
    """
    if table.manifest["design"] != "saltelli":
        return None
    keys = [group[0] for group in table.manifest["drawn"]]
    n, d = int(table.manifest["samples"]), len(keys)
    values = np.full(int(table.manifest["runs"]), np.nan)
    values[table["run"].astype(int)] = table[result]
    blocks = values.reshape(-1, d + 2, n)
    there = np.isfinite(blocks).all(axis=1)
    counts = {"samples": there.size, "left_out": int(np.sum(~there))}
    if table.manifest["grid"]:
        return SobolIndices({}, **counts, reason="listed keys vary beside those that are drawn")
    found = []
    for block, complete in zip(blocks, there, strict=True):
        if complete.sum() < FEWEST_SAMPLES:
            reason = f"{complete.sum()} of {n} base samples have a value in all their {d + 2} runs, {FEWEST_SAMPLES} are needed"
            return SobolIndices({}, **counts, reason=reason)
        used = block[:, complete]
        if not np.ptp(used[:2]):
            return SobolIndices({}, **counts, reason="the result is the same in all runs")
        drawn = np.random.default_rng(0).integers(used.shape[1], size=(RESAMPLES, used.shape[1]))
        spread = np.std([_estimates(used[:, places]) for places in drawn], axis=0)
        found.append(np.concatenate([_estimates(used), 1.96 * spread]))
    indices = np.mean(found, axis=0)
    # The errors of several variants are independent.
    indices[2:] /= np.sqrt(len(found))
    return SobolIndices({key: Index(*column) for key, column in zip(keys, indices.T.tolist(), strict=True)}, **counts)


def _estimates(blocks: Array) -> Array:
    """(2, keys): first-order and total indices of values (2 + keys, samples)."""
    both = blocks[:2]
    blocks, variance = blocks - both.mean(), both.var()
    first = np.mean(blocks[1] * (blocks[2:] - blocks[0]), axis=1) / variance
    total = 0.5 * np.mean((blocks[0] - blocks[2:]) ** 2, axis=1) / variance
    return np.stack([first, total])


def notes(table: Table, results: Sequence[str]) -> list[str]:
    """What stands beside the Sobol indices: results without them and why, and base samples that were left out."""
    grouped: dict[str, list[str]] = {}
    for result in results:
        found = sobol(table, result)
        if found is not None and (found.reason or found.left_out):
            grouped.setdefault(str(found), []).append(result)
    return [f"{listed(names, 4)}: {text}" for text, names in grouped.items()]
