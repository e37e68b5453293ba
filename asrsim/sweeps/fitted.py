"""Numbers drawn together, as a fit knows them: its keys, their covariance, and what goes with them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.document.mistaken import mistaken
from asrsim.document.yaml_reader import read_yaml
from asrsim.errors import InputError
from asrsim.samples import Array


@dataclass(frozen=True, kw_only=True)
class Joint:
    """Keys drawn together from a multivariate normal distribution: the result of a fit."""

    keys: tuple[str, ...]
    mean: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]
    logarithmic: tuple[bool, ...]
    """Whether mean and covariance are those of the key's logarithm."""
    bounds: tuple[tuple[float, float], ...] = ()
    """Least and largest value of each key; a draw beyond is taken at the bound. Empty: none."""
    ties: tuple[tuple[str, str, float], ...] = ()
    """(key, one of `keys`, factor): what follows a drawn key."""
    left_out: tuple[str, ...] = ()
    """What the fit says nothing of, or no sweep varies, with the verdict."""
    fixed: tuple[str, ...] = ()
    """What is the same in every draw, with the verdict."""
    fits: bool = True
    """Whether the fit says that its model fits."""

    @cached_property
    def groups(self) -> tuple[tuple[str, ...], ...]:
        """Each drawn key with those that follow it."""
        return tuple((key, *(name for name, to, _ in self.ties if to == key)) for key in self.keys)

    @cached_property
    def root(self) -> Array:
        """(n, n) with root root' = covariance; semi-definite ones serve too."""
        values, vectors = np.linalg.eigh(np.array(self.covariance))
        return np.asarray(vectors * np.sqrt(np.clip(values, 0.0, None)))

    def from_scores(self, scores: Array) -> Array:
        """Values (n, keys) at independent standard normal scores (n, keys)."""
        drawn = np.array(self.mean) + scores @ self.root.T
        flags = np.array(self.logarithmic)
        drawn[:, flags] = np.exp(drawn[:, flags])
        return np.clip(drawn, *np.array(self.bounds).T) if self.bounds else drawn

    def assign(self, row: Array) -> dict[str, float]:
        """Key -> value of a draw (keys,)."""
        values = dict(zip(self.keys, map(float, row), strict=True))
        return values | {key: factor * values[to] for key, to, factor in self.ties}


def read_fit(fit: str | Path | Mapping[str, Any]) -> Joint:
    """A multivariate normal distribution from a file or plain data. Raises InputError."""
    file = None if isinstance(fit, Mapping) else Path(fit)
    data = fit if file is None else read_yaml(file)[0].plain()
    if isinstance(data, Mapping) and isinstance(data.get("parameters"), Mapping) and "keys" not in data:
        data = {"keys": list(data["parameters"]), "mean": list(data["parameters"].values()), **data}

    def wrong(message: str) -> InputError:
        hint = "It has `keys` (n names), `mean` (n numbers) and `covariance` (n rows of n numbers)"
        return InputError(message, file=file, key="fit", hint=hint, code="sweep-fit")

    if not isinstance(data, Mapping) or not {"keys", "mean", "covariance"} <= set(data):
        other = mistaken(file, "fit.json of asrsim identify") if file is not None else None
        raise InputError([other]) if other is not None else wrong("lacks keys, mean or covariance")
    if not isinstance(data["keys"], list | tuple) or not data["keys"]:
        raise wrong(f"keys must be a list of names, not {ascii(data['keys'])[:40]}")
    keys = tuple(map(str, data["keys"]))
    try:
        mean, covariance = np.array(data["mean"], float), np.array(data["covariance"], float)
    except (TypeError, ValueError):
        raise wrong("mean and covariance must be numbers") from None
    n = len(keys)
    if mean.shape != (n,) or covariance.shape != (n, n):
        raise wrong(f"{n} keys need {n} means and {n} x {n} covariances")
    if not (np.isfinite(mean).all() and np.isfinite(covariance).all()):
        raise wrong("mean and covariance must be finite")
    scale = float(np.abs(covariance).max(initial=0.0))
    if not np.allclose(covariance, covariance.T, atol=1e-9 * scale) or np.linalg.eigvalsh(covariance)[0] < -1e-9 * scale:
        raise wrong("is no covariance: it must be symmetric and have no negative eigenvalue")
    logarithmic = data.get("logarithmic", False)
    flags = [logarithmic] * n if isinstance(logarithmic, bool) else logarithmic
    if not isinstance(flags, list) or len(flags) != n or not all(isinstance(flag, bool) for flag in flags):
        raise wrong(f"logarithmic must be true, false, or a list of {n} of these")
    try:
        bounds = tuple((_number(low, -math.inf), _number(high, math.inf)) for low, high in data.get("bounds") or ())
        ties = {str(one["key"]): (str(one["to"]), float(one["factor"])) for one in data.get("ties") or ()}
    except (TypeError, ValueError, KeyError):
        raise wrong("bounds must be pairs of numbers or null, ties must have key, to and factor") from None
    if len(bounds) not in (0, n) or any(not low <= high for low, high in bounds):
        raise wrong(f"bounds must be {n} pairs, the least first")
    estimates = data.get("estimates")
    listed = estimates if isinstance(estimates, list | tuple) else ()
    told = {str(one.get("key")): one.get("verdict") for one in listed if isinstance(one, Mapping)}
    sure = [key for key, variance in zip(keys, np.diag(covariance), strict=True) if variance == 0.0]
    return Joint(
        keys=keys,
        mean=tuple(map(float, mean)),
        covariance=tuple(tuple(map(float, row)) for row in covariance),
        logarithmic=tuple(flags),
        bounds=bounds,
        ties=tuple(_followers(keys, ties)),
        left_out=tuple(f"{key} ({verdict})" for key, verdict in told.items() if key not in keys),
        fixed=tuple(f"{key} ({verdict})" for key, verdict in told.items() if key in sure),
        fits=data.get("fits") is not False,
    )


def _number(value: Any, default: float) -> float:
    return default if value is None else float(value)


def _followers(keys: Sequence[str], ties: Mapping[str, tuple[str, float]]) -> Iterator[tuple[str, str, float]]:
    """(key, drawn key, factor) of what follows a drawn key, straight or through others."""
    for key, (to, factor) in ties.items():
        for _ in ties:
            if to in ties:
                to, factor = ties[to][0], factor * ties[to][1]
        if to in keys and key not in keys:
            yield key, to, factor
