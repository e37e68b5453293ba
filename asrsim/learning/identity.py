"""Which plant is it? A hash of everything that it depends on: scenario, robot, and every file that they name."""

from __future__ import annotations

import hashlib
import inspect
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from asrsim.actuators import ACTUATORS

if TYPE_CHECKING:
    from asrsim.learning.plant import Plant

NOT_OF_THE_PLANT = ("ilc", "expect", "log_rate")
"""Keys of a scenario that may change between resumptions."""


def identity_of(plant: Plant) -> str:
    """A hash of robot and scenario, their files' contents, and the laws of the actuators."""
    scenario = plant.scenario
    kept = {key: value for key, value in scenario.resolved.items() if key not in NOT_OF_THE_PLANT}
    digest = hashlib.sha256(json.dumps(kept, sort_keys=True, default=str).encode())
    digest.update(plant.robot.text.encode())
    for _, path in sorted(_files(plant)):
        digest.update(hashlib.sha256(path.read_bytes()).digest() if path.is_file() else b"missing")
    for actuator in dict.fromkeys(drive.actuator.name for drive in plant.drives):
        source = inspect.getsourcefile(ACTUATORS.get(actuator))
        digest.update(Path(source).read_bytes() if source else b"")
    return digest.hexdigest()


def _files(plant: Plant) -> Iterator[tuple[str, Path]]:
    """Playbacks and the like, objects' meshes, and the robot's meshes that collide."""
    from asrsim.robot import engine_urdf

    scenario = plant.scenario
    named = [*scenario.attachments.items(), *((item.name, item.mesh) for item in scenario.world.objects if item.mesh)]
    text, _ = engine_urdf(plant.robot, package_paths=scenario.package_paths)
    named += [(mesh, Path(mesh)) for mesh in sorted(set(re.findall(r'filename="([^"]*)"', text)))]
    for name, path in named:
        # A ROS 2 bag is a folder.
        yield from ((name, file) for file in (sorted(path.rglob("*")) if path.is_dir() else [path]))
