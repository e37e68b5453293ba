"""Parameters drawn jointly from the result of a fit: mean, covariance, bounds and ties."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.document.file import mistaken
from asrsim.document.yaml_reader import read_yaml
from asrsim.errors import InputError
from asrsim.plain import misfit
from asrsim.samples import Array

SHAPE = {
    "keys": [str],
    "mean": [float],
    "covariance": [[float]],
    "logarithmic?": (bool, [bool]),
    "bounds?": [[(float, None)]],
    "ties?": [{"key": str, "to": str, "factor": float, "*": object}],
    "fits?": bool,
    "estimates?": [{"key": str, "verdict": str, "*": object}],
    "*": object,
}
"""Structure of the data in a result file of a fit, in the form that `asrsim.plain.misfit` checks."""


@dataclass(frozen=True, kw_only=True)
class JointDistribution:
    """Multivariate normal distribution of several keys."""

    keys: tuple[str, ...]
    mean: Array
    """Mean (n,) of each key's value, or of the value's logarithm if the key is logarithmic."""
    root: Array
    """Matrix root (n, n) of the covariance: root root' = covariance."""
    logarithmic: Array
    """Whether each key (n,) is logarithmic, so that its mean and covariance refer to the logarithm of its value."""
    low: Array
    high: Array
    """Bounds (n,) of each key's value; a drawn value beyond a bound is moved to the bound."""
    ties: tuple[tuple[str, str, float], ...]
    """Keys that are a multiple of a drawn key, each as (key, drawn key, factor)."""
    fits: bool
    """Whether the result of the fit states that the model fits the recordings."""
    warnings: tuple[str, ...]

    @property
    def groups(self) -> tuple[tuple[str, ...], ...]:
        """Groups of keys: each drawn key, followed by the keys whose values are a multiple of its value."""
        return tuple((key, *(name for name, to, _ in self.ties if to == key)) for key in self.keys)

    def from_scores(self, scores: Array) -> Array:
        """Values (m, n) of the drawn keys, computed from independent standard normal numbers (m, n)."""
        return self._values(self.mean + scores @ self.root.T)

    def interval(self, width: float) -> Array:
        """Ends (2, n) of an interval for each drawn key: its values `width` standard deviations below and above the mean."""
        deviations = np.linalg.norm(self.root, axis=1)
        return self._values(self.mean + width * np.array([[-1.0], [1.0]]) * deviations)

    def _values(self, rows: Array) -> Array:
        """Values (m, n) of the drawn keys, moved into their bounds; rows: values (m, n), or logarithms for logarithmic keys."""
        values = rows.copy()
        values[:, self.logarithmic] = np.exp(rows[:, self.logarithmic])
        return np.clip(values, self.low, self.high)

    def assign(self, row: Array) -> dict[str, float]:
        """Value of each key, including tied keys, from the values (n,) of the drawn keys."""
        values = dict(zip(self.keys, map(float, row), strict=True))
        return values | {key: factor * values[to] for key, to, factor in self.ties}


def load_fit(path: Path) -> Any:
    """Content of a result file of a fit, such as fit.json. Raises InputError for another kind of file."""
    data = read_yaml(path)[0].plain()
    other = mistaken(path, "fit.json of asrsim identify")
    if other is not None and not (isinstance(data, Mapping) and "keys" in data):
        raise InputError([other])
    return data


def joint_of(data: Any, file: Path | None = None) -> JointDistribution:
    """Distribution described by data in the format of `asrsim identify`. Raises InputError."""

    def wrong(message: str) -> InputError:
        hint = "It has `keys` (n names), `mean` (n numbers) and `covariance` (n rows of n numbers)"
        return InputError(message, file=file, key="fit", hint=hint, code="sweep-fit")

    if fault := misfit(data, SHAPE):
        raise wrong(fault)
    keys, n = tuple(data["keys"]), len(data["keys"])
    flags, pairs = data.get("logarithmic", False), data.get("bounds") or [[None, None]] * n
    flags = [flags] * n if isinstance(flags, bool) else flags
    rows = data["covariance"]
    if not n or {len(row) for row in (data["mean"], rows, *rows, flags, pairs)} != {n} or {len(pair) for pair in pairs} != {2}:
        raise wrong(f"{n} keys need {n} means, {n} x {n} covariances, and {n} entries of `logarithmic` and `bounds`")
    mean, covariance = np.array(data["mean"], float), np.array(rows, float)
    low = np.array([-np.inf if pair[0] is None else pair[0] for pair in pairs])
    high = np.array([np.inf if pair[1] is None else pair[1] for pair in pairs])
    scale = float(np.abs(covariance).max())
    if not (np.isfinite(mean).all() and np.isfinite(scale) and (low <= high).all()):
        raise wrong("mean and covariance must be finite, and bounds must be ordered (lower, upper)")
    values, vectors = np.linalg.eigh(covariance)
    if not np.allclose(covariance, covariance.T, atol=1e-9 * scale) or values[0] < -1e-9 * scale:
        raise wrong("is not a covariance matrix: it must be symmetric and positive semidefinite")
    ties = {one["key"]: (one["to"], float(one["factor"])) for one in data.get("ties") or ()}
    return JointDistribution(
        keys=keys,
        mean=mean,
        root=np.asarray(vectors * np.sqrt(np.clip(values, 0.0, None))),
        logarithmic=np.array(flags),
        low=low,
        high=high,
        fits=data.get("fits", True) is True,
        ties=tuple(_followers(keys, ties)),
        warnings=tuple(_warnings(data, keys, covariance)),
    )


def _warnings(data: Mapping[str, Any], keys: tuple[str, ...], covariance: Array) -> Iterator[str]:
    if data.get("fits", True) is not True:
        why = "does not fit its recordings" if data["fits"] is False else "was not compared with its recordings"
        yield f"the model of the fit {why}: the intervals of the draws may be too narrow"
    verdicts = {one["key"]: one["verdict"] for one in data.get("estimates") or ()}
    fixed = {key for key, variance in zip(keys, np.diag(covariance), strict=True) if variance == 0.0}
    kept = [f"{key} ({verdict})" for key, verdict in verdicts.items() if key not in keys]
    constant = [f"{key} ({verdict})" for key, verdict in verdicts.items() if key in fixed]
    if kept:
        yield f"the fit has no distribution of {', '.join(kept)}: every run takes the scenario's value"
    if constant:
        yield f"the fit has no interval of {', '.join(constant)}: every run takes the fitted value"


def _followers(keys: tuple[str, ...], ties: Mapping[str, tuple[str, float]]) -> Iterator[tuple[str, str, float]]:
    """Keys that are a multiple of a drawn key, directly or through other tied keys, each as (key, drawn key, factor)."""
    for key, (to, factor) in ties.items():
        for _ in ties:
            if to in ties:
                to, factor = ties[to][0], factor * ties[to][1]
        if to in keys and key not in keys:
            yield key, to, factor
