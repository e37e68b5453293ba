"""What is registered under the keys `engine` and `stepping`, and which engine a scenario takes that names none."""

from __future__ import annotations


def engines() -> tuple[str, ...]:
    """Names of the registered engines, those of other packages too."""
    from asrsim.engines import ENGINES

    return ENGINES.names()


def steppings() -> tuple[str, ...]:
    """Names of the registered steppings, those of other packages too."""
    from asrsim.simulation.steppings import STEPPINGS

    return STEPPINGS.names()


def default_engine() -> str:
    """The engine of a scenario that names none."""
    from asrsim import engines

    return engines.default_engine()


def prescribes_motion(engine: str) -> bool:
    """Whether the engine prescribes the motion of the links, which `motion` states."""
    from asrsim.engines import ENGINES

    return ENGINES.get(engine).prescribed


def released_order(stepping: str) -> bool:
    """Whether joints step in the released toolbox's own order, with its motors."""
    from asrsim.simulation.steppings import STEPPINGS

    return STEPPINGS.get(stepping).released
