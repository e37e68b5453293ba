"""What differs from episode to episode: laws of chance by key, declared as sweeps declare them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.errors import InputError, Problem
from asrsim.sweeps.keys import Plan, plan_keys
from asrsim.sweeps.laws import Distribution, Values, law_of

if TYPE_CHECKING:
    from asrsim.simulation.prepared import Prepared


class Draws:
    """Values of keys, one draw an episode."""

    def __init__(self, laws: Mapping[str, Any]) -> None:
        """laws: key -> list of values, range or distribution, in the forms of sweeps. Raises InputError."""
        self._laws = {key: law_of(value, key) for key, value in laws.items()}
        problems = [
            Problem("takes numbers only", key=key, code="sweep-values")
            for key, law in self._laws.items()
            if isinstance(law, Values) and not all(_is_number(value) for value in law.values)
        ]
        if problems:
            raise InputError(problems)

    @property
    def keys(self) -> tuple[str, ...]:
        """In their order."""
        return tuple(self._laws)

    def draw(self, chance: np.random.Generator) -> dict[str, float]:
        """A value for each key."""
        return {key: _drawn(law, chance) for key, law in self._laws.items()}

    def bounds(self) -> tuple[list[float], list[float]]:
        """Least and largest value of each key; infinite where there is no end."""
        pairs = [_bounds(law) for law in self._laws.values()]
        return [low for low, _ in pairs], [high for _, high in pairs]


def plan(draws: Draws, prepared: Prepared) -> Plan:
    """Where the values go. Raises InputError for keys that need the scenario to be read anew."""
    found = plan_keys(draws.keys, dict.fromkeys(draws.keys, True), prepared.scenario, prepared.robot)
    known = {**found.parameters, **found.references, **found.inertials}
    wrong = [key for key in draws.keys if key not in known]
    if wrong:
        message = "cannot change from episode to episode: the scenario would have to be read anew"
        raise InputError([Problem(message, key=key, code="randomise") for key in wrong])
    return found


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))


def _drawn(law: Values | Distribution, chance: np.random.Generator) -> float:
    if isinstance(law, Values):
        return float(law.values[int(chance.integers(len(law.values)))])
    # Shares of (0, 1): a distribution's ends may be infinite.
    share = np.clip(chance.random(1), 1e-12, 1.0 - 1e-12)
    return float(law.quantile(share)[0])


def _bounds(law: Values | Distribution) -> tuple[float, float]:
    if isinstance(law, Values):
        return float(min(law.values)), float(max(law.values))
    if law.name.endswith("uniform"):
        return law.first, law.second
    return (0.0 if law.name == "lognormal" else -np.inf), np.inf
