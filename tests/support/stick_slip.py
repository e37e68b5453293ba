"""Independent event-driven solution of stick-slip motion: a spring pulls a mass whose friction falls with the speed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

Law = Callable[[float, float], float]


def stick_slip(
    time: np.ndarray,
    pull: Callable[[float, float], float],
    friction: Law,
    *,
    mass: float,
    damping: float = 0.0,
    start: float = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities (n,) at `time` (n,) of a mass that starts at rest: m a = pull(t, x) - d v - friction.

    friction: friction level in N m as a function of (|speed|, pull). Stiction is exact; slips begin and end at events.
    """
    places, speeds = np.empty(len(time)), np.empty(len(time))
    now, x, v = float(time[0]), start, 0.0
    direction = 0.0
    while now < time[-1]:
        if direction == 0.0:
            x_held = x

            def free(t: float, y: np.ndarray, x_held: float = x_held) -> float:
                force = pull(t, x_held)
                return abs(force) - friction(0.0, force)

            free.terminal, free.direction = True, 1.0  # type: ignore[attr-defined]
            if free(now, np.zeros(1)) >= 0.0:
                direction = float(np.sign(pull(now, x)))
                continue
            found = solve_ivp(
                lambda t, y: [0.0], (now, time[-1]), [0.0], events=free, max_step=2e-3, rtol=1e-9, atol=1e-12,
            )  # fmt: skip
            end = found.t[-1]
            inside = (time >= now) & (time <= end)
            places[inside], speeds[inside] = x, 0.0
            now, v = end, 0.0
            if found.status != 1:
                break
            direction = float(np.sign(pull(now, x)))
            continue

        def move(t: float, y: np.ndarray, s: float = direction) -> list[float]:
            force = pull(t, y[0])
            return [y[1], (force - damping * y[1] - s * friction(abs(y[1]), force)) / mass]

        def stop(t: float, y: np.ndarray, s: float = direction) -> float:
            return s * y[1]

        stop.terminal, stop.direction = True, -1.0  # type: ignore[attr-defined]
        found = solve_ivp(move, (now, time[-1]), [x, v], events=stop, dense_output=True, rtol=1e-10, atol=1e-12, max_step=2e-3)
        end = found.t[-1]
        inside = (time >= now) & (time <= end)
        places[inside], speeds[inside] = found.sol(time[inside])
        now, (x, v) = end, found.y[:, -1]
        direction, v = 0.0, 0.0
        if found.status != 1:
            break
    return places, speeds
