"""Steppings: integration schemes that couple actuators and engine."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NoReturn

from asrsim.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Stepping:
    """An integration scheme and its constants."""

    name: str
    order: int
    """Order of convergence where forces are smooth; 1 with impacts, and with friction in worlds with contacts."""
    doc: str
    implicitness: float = 0.5
    """Weight of the velocity after a kick in the velocity on which damping and derivative action act: 0 for the explicit rule,
    1/2 for the midpoint rule, which has second order, 1 for the implicit rule. For strongly damped links it is increased."""
    first_drift: float = 0.5
    """Fraction of a motor's step before its kick: 1/2 for second order."""
    staggered: bool = True
    """Whether velocities belong to half steps. Then the first kick lasts half a step, damping and controllers use an
    extrapolated velocity, the lag of the Coriolis forces is corrected, kicks are split where an input jumps, and logged
    velocities are converted to whole steps."""
    released: bool = False
    """Whether joints behave as in the released toolbox. The toolbox has its own order of a step (`asrsim.simulation.released`)
    and no substeps, its motors start at 0, and its step is not passive."""

    def __post_init__(self) -> None:
        """Raises InputError for a fraction outside 0 to 1, with which a step would gain energy or use future values."""
        for name in ("implicitness", "first_drift"):
            if not 0.0 <= (value := getattr(self, name)) <= 1.0:
                raise InputError("must be from 0 to 1", key=f"stepping {self.name}.{name}", value=value, code="out-of-range")


OWN_STEPPINGS = "docs/architecture.md, 'A stepping of your own', states what to use instead"
"""Hint for an unknown stepping."""


class _Steppings(Mapping[str, Stepping]):
    """A table that cannot be changed: see `docs/architecture.md`."""

    def __init__(self, *steppings: Stepping) -> None:
        self._table: dict[str, Stepping] = {}
        for stepping in steppings:
            if stepping.name in self._table:
                message = "two steppings have this name; each stepping needs a separate name"
                raise InputError(message, key="stepping", value=stepping.name, code="stepping")
            self._table[stepping.name] = stepping

    def __getitem__(self, name: str) -> Stepping:
        return self._table[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._table)

    def __len__(self) -> int:
        return len(self._table)

    def add(self, name: str, stepping: Stepping) -> NoReturn:
        """Raises InputError, since plugins cannot add a stepping."""
        raise InputError("plugins cannot add a stepping", key="stepping", value=name, hint=OWN_STEPPINGS, code="stepping")

    __setitem__ = add


STEPPINGS = _Steppings(
    Stepping(
        name="leapfrog",
        order=2,
        doc="default: motors and links receive the same torques; second order where forces are smooth",
    ),
    Stepping(
        name="euler",
        order=1,
        implicitness=0.0,
        first_drift=0.0,
        staggered=False,
        doc="motors and links receive the same torques; semi-implicit Euler method, first order",
    ),
    Stepping(
        name="toolbox",
        order=1,
        implicitness=0.0,
        first_drift=0.0,
        staggered=False,
        released=True,
        doc="computes a step in the order of the released toolbox; not passive in modes 5 and 6",
    ),
)
"""Steppings by name."""


def stepping_called(name: str) -> Stepping:
    """The stepping with this name. Raises InputError with the choices."""
    if name not in STEPPINGS:
        raise InputError(
            "is not a time-stepping scheme",
            key="stepping",
            value=name,
            choices=tuple(STEPPINGS),
            hint=OWN_STEPPINGS,
            code="unknown-stepping",
        )
    return STEPPINGS[name]
