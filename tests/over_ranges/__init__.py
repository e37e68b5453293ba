"""Functions of numbers and of texts, and what :mod:`test_over_ranges` asks them: ranges that cross every place at which they
decide otherwise, with those places themselves where they are round numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Any

import numpy as np

T = np.linspace(0.0, 2.0, 401)
UNEVEN = 2.0 * np.linspace(0.0, 1.0, 301) ** 1.5
NOISE = np.random.default_rng(5).standard_normal(4000)
SHARES = [
    0.0,
    1e-3,
    0.01,
    0.02,
    0.05,
    0.09,
    0.1,
    0.11,
    0.2,
    0.3,
    0.49,
    0.5,
    0.51,
    0.7,
    0.8,
    0.9,
    0.99,
    1.0,
    1.01,
    1.5,
    2.0,
    5.0,
]

Asked = Iterator[tuple[str, Callable[..., Any], list[tuple[Any, ...]]]]
"""Label, function, and the arguments of its calls."""


def found(path: str) -> Any:
    """`metrics.lag._choose` -> the function."""
    module, name = path.rsplit(".", 1)
    return getattr(import_module(f"asrsim.{module}"), name)


def shapes(time: np.ndarray) -> dict[str, np.ndarray]:
    """Series that measures are asked about."""
    noise = NOISE[: len(time)]
    return {
        "rest": np.full(len(time), 0.3),
        "line": 0.2 + 0.5 * time,
        "step": (time >= 0.5) * 1.0,
        "down": 1.0 - 1.5 * (time >= 0.255),
        "creep": 0.4 - 0.4 * np.exp(-3.0 * time),
        "ring": 1.0 - np.exp(-2.0 * time) * np.cos(20.0 * time),
        "swing": 0.1 + 0.3 * np.sin(2 * np.pi * 3.3 * time + 0.4),
        "beat": np.sin(2 * np.pi * 4.0 * time) + 0.7 * np.sin(2 * np.pi * 7.0 * time),
        "noisy": np.exp(-time) * np.sin(30.0 * time) + 0.05 * noise,
        "drift": time + 0.02 * np.sin(40.0 * time),
        "noise": noise,
    }
