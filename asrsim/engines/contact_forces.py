"""Contact forces, summed over all points at which two bodies touch."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from asrsim.samples import Array

GROUND, ROBOT = "ground", "robot"
NOTHING = (0.0, 0.0, 0.0)


def contact_forces(
    objects: Sequence[str], ground: bool, points: Iterable[tuple[str, str, Array]]
) -> dict[str, tuple[float, float, float]]:
    """Contact forces in N, world frame. "object/other": force on the object by the other body; "robot/ground": force of the
    ground on the robot; 0 without contact.

    points: for each contact point, both bodies and the force (3,) on the first body.
    """
    others = [*objects, *([GROUND] if ground else []), ROBOT]
    total: dict[str, Any] = {f"{name}/{other}": NOTHING for name in objects for other in others if other != name}
    if ground:
        total[f"{ROBOT}/{GROUND}"] = NOTHING
    for first, second, force in points:
        for key, sign in ((f"{first}/{second}", 1.0), (f"{second}/{first}", -1.0)):
            if key in total:
                total[key] = np.add(total[key], sign * force)
    return {key: (float(x), float(y), float(z)) for key, (x, y, z) in total.items()}
