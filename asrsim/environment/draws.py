"""Random values of an episode, drawn from distributions that are written as in sweeps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.errors import InputError, Problem
from asrsim.sweeps.keys import KeyPlan, plan_keys
from asrsim.sweeps.laws import Distribution, Values
from asrsim.sweeps.study import axis_of

if TYPE_CHECKING:
    from asrsim.simulation.prepare import Prepared


class Draws:
    """Laws of random values, from which each episode draws one value per key."""

    def __init__(self, laws: Mapping[str, Any]) -> None:
        """laws: list of values, range or distribution by key, as in sweeps; `key & key`: both keys get the same value. Raises
        InputError."""
        self._axes = [axis_of(name, value) for name, value in laws.items()]
        problems = [
            Problem("must be finite numbers", key=" & ".join(axis.keys), code="sweep-values")
            for axis in self._axes
            if isinstance(axis.law, Values)
            and not all(_is_number(one) for value in axis.law.values for one in axis.assign(value).values())
        ]
        if problems:
            raise InputError(problems)

    @property
    def keys(self) -> tuple[str, ...]:
        """All keys, in the order of the laws."""
        return tuple(key for axis in self._axes for key in axis.keys)

    def draw(self, chance: np.random.Generator) -> dict[str, float]:
        """Random values of an episode by key."""
        return {key: float(value) for axis in self._axes for key, value in axis.assign(_drawn(axis.law, chance)).items()}

    def bounds(self) -> tuple[list[float], list[float]]:
        """Lower and upper bounds of the values, in the order of the keys; infinite for unbounded laws."""
        rows: list[list[float]] = []
        for axis in self._axes:
            ends = axis.law.values if isinstance(axis.law, Values) else axis.law.quantile(np.array([0.0, 1.0])).tolist()
            rows += [[float(axis.assign(value)[key]) for value in ends] for key in axis.keys]
        return [min(row) for row in rows], [max(row) for row in rows]


def plan(keys: Sequence[str], prepared: Prepared) -> KeyPlan:
    """Parts of the scenario that the keys set. Raises InputError for keys that require reading the scenario again."""
    found = plan_keys(keys, dict.fromkeys(keys, True), prepared.scenario, prepared.robot)
    wrong = [key for key in keys if key not in found.numbers and key not in found.references]
    if wrong:
        message = "cannot change from episode to episode: the scenario would have to be read anew"
        raise InputError([Problem(message, key=key, code="randomise") for key in wrong])
    return found


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))


def _drawn(law: Values | Distribution, chance: np.random.Generator) -> Any:
    if isinstance(law, Values):
        return law.values[int(chance.integers(len(law.values)))]
    # The interval is open, since quantiles at 0 and 1 may be infinite.
    share = np.clip(chance.random(1), 1e-12, 1.0 - 1e-12)
    return float(law.quantile(share)[0])
