"""What moves a result: ranks and swings from any study, Sobol indices from one that is designed for them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asrsim.sweeps.table import Table

FEWEST = 5
"""Runs below which nothing is said."""


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
    first: float = float("nan")
    """Sobol's first-order index: the share of the variance that the key has alone."""
    total: float = float("nan")
    """Sobol's total index: with all its interactions."""


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
    indices = sobol(table, result)
    found = []
    for key in numeric_keys(table):
        numbers = table[key][there]
        if np.ptp(numbers) == 0.0:
            continue
        low, high = np.quantile(numbers, (0.2, 0.8))
        first, total = indices.get(key, (float("nan"), float("nan")))
        found.append(
            Influence(
                key=key,
                rank=float(np.corrcoef(rankdata(numbers), ranks)[0, 1]),
                low=float(values[there][numbers <= low].mean()),
                high=float(values[there][numbers >= high].mean()),
                first=first,
                total=total,
            )
        )
    return sorted(found, key=lambda one: -abs(one.high - one.low))


def sobol(table: Table, result: str) -> dict[str, tuple[float, float]]:
    """Key -> first-order and total index, of the design `saltelli` in which every run has the result; else nothing. Of several
    variants the mean of theirs."""
    if table.manifest["design"] != "saltelli" or table.missing or table.manifest["grid"]:
        return {}
    from scipy.stats import sobol_indices

    keys = [group[0] for group in table.manifest["drawn"]]
    n, d = int(table.manifest["samples"]), len(keys)
    values = table[result]
    blocks = values.reshape(-1, d + 2, n)
    if not np.isfinite(values).all() or not np.ptp(blocks, axis=(1, 2)).all():
        return {}
    found = sobol_indices(func={"f_A": blocks[:, 0], "f_B": blocks[:, 1], "f_AB": blocks[:, 2:].transpose(1, 0, 2)}, n=n)
    means = [np.reshape(order, (-1, d)).mean(axis=0).tolist() for order in (found.first_order, found.total_order)]
    return dict(zip(keys, zip(*means, strict=True), strict=True))
