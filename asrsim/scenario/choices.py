"""Valid values of the keys `engine` and `stepping`, and the default engine."""

from __future__ import annotations


def engines() -> tuple[str, ...]:
    """Names of the registered engines, including engines of other packages."""
    from asrsim.engines import ENGINES

    return ENGINES.names()


def steppings() -> tuple[str, ...]:
    """Names of the registered steppings, including steppings of other packages."""
    from asrsim.simulation.steppings import STEPPINGS

    return STEPPINGS.names()


def default_engine() -> str:
    """Engine of a scenario without the key `engine`."""
    from asrsim import engines

    return engines.default_engine()


def prescribes_motion(engine: str) -> bool:
    """Whether the engine prescribes the motion of the links by the key `motion`."""
    from asrsim.engines import ENGINES

    return ENGINES.get(engine).prescribed


def released_order(stepping: str) -> bool:
    """Whether the stepping is that of the released toolbox, with its motors and its order of updates."""
    from asrsim.simulation.steppings import STEPPINGS

    return STEPPINGS.get(stepping).released
