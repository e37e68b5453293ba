"""The reachable pose that is closest to a wanted pose, found by bounded least squares from several starts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asrsim.engines.base import Point
from asrsim.kinematics.clik import NDArrayBool
from asrsim.kinematics.engine_model import EngineModel
from asrsim.kinematics.trajectory import rotation_between
from asrsim.samples import Array

STARTS = 12
"""Number of additional starts of the search, spread over the joints' ranges."""
FREE_RANGE = float(np.pi)
"""rad, range of the search for a joint without stops."""
ORIENTATION_WEIGHT = 0.1
"""m/rad, weight of the orientation's error for a pose with an orientation."""
MET = 1e-6
"""m: error below which a pose counts as reached."""


@dataclass(frozen=True, kw_only=True)
class Reach:
    """The closest reachable pose to a wanted pose."""

    positions: Array
    """(joints,) rad or m: joint positions of the reachable pose."""
    point: Array
    """(3,) m: position of the tip in the reachable pose."""
    distance: float
    """Distance in m from the reachable position to the wanted position."""
    turn: float
    """Angle in rad between the reachable and the wanted orientation; 0 if the orientation is free."""


def closest(
    model: EngineModel,
    link: str,
    point: Point,
    position: Array,
    rotation: Array | None,
    start: Array,
    *,
    moving: NDArrayBool | None = None,
) -> Reach:
    """The reachable pose closest to `position` (3,) and `rotation` (3, 3) or None; the search begins at `start` (joints,).

    The search ends as soon as the pose is reached. Otherwise it tries every start and returns the best result.
    """
    from scipy.optimize import least_squares

    free = np.ones(len(start), dtype=bool) if moving is None else moving
    low = np.where(np.isfinite(model.lower), model.lower, start - FREE_RANGE)[free]
    high = np.where(np.isfinite(model.upper), model.upper, start + FREE_RANGE)[free]

    def spread(values: Array) -> Array:
        q = np.array(start, dtype=float)
        q[free] = values
        return q

    def residual(values: Array) -> Array:
        reached, turned = model.pose(spread(values), link, point)
        if rotation is None:
            return np.asarray(reached - position)
        return np.concatenate([reached - position, -ORIENTATION_WEIGHT * rotation_between(turned, rotation)])

    def slope(values: Array) -> Array:
        # For small errors the rate of the rotation vector is the angular velocity: accurate enough for the search.
        jacobian = model.jacobian(spread(values), link, point)[:, free]
        return jacobian[:3] if rotation is None else np.vstack([jacobian[:3], ORIENTATION_WEIGHT * jacobian[3:]])

    generator = np.random.default_rng(0)
    starts = [np.clip(start[free], low, high), *(generator.uniform(low, high) for _ in range(STARTS))]
    tried: list[Reach] = []
    for values in starts:
        inside = np.clip(values, low + 1e-9 * (high - low), high - 1e-9 * (high - low))
        found = least_squares(residual, inside, jac=slope, bounds=(low, high), xtol=1e-12, ftol=1e-12, gtol=1e-12)
        tried.append(_reach(model, link, point, spread(found.x), position, rotation))
        if _cost(tried[-1]) <= MET:
            break
    return min(tried, key=_cost)


def _reach(model: EngineModel, link: str, point: Point, positions: Array, position: Array, rotation: Array | None) -> Reach:
    reached, turned = model.pose(positions, link, point)
    return Reach(
        positions=positions,
        point=reached,
        distance=float(np.linalg.norm(reached - position)),
        turn=0.0 if rotation is None else float(np.linalg.norm(rotation_between(turned, rotation))),
    )


def _cost(reach: Reach) -> float:
    return float(np.hypot(reach.distance, ORIENTATION_WEIGHT * reach.turn))
