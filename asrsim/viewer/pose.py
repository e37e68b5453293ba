"""Page of a robot file without a scenario: sliders move the robot's joints, without physics."""

from __future__ import annotations

import math
import time as clock
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.progress import Stop
from asrsim.quantities import linear_unit
from asrsim.render.scene import RenderScene
from asrsim.render.shapes import drawable
from asrsim.robot import load_robot
from asrsim.samples import JointInfo, Samples
from asrsim.scenario import make_scenario
from asrsim.viewer.history import History
from asrsim.viewer.page import FRAME, Page, by_hand, on_click
from asrsim.viewer.subject import Subject


class PoseView:
    """Sliders for the positions of a robot's joints."""

    def __init__(self, page: Page, path: Path, **reading: Any) -> None:
        """reading: `xacro_arguments` and `package_paths`, as for `asrsim.load_robot`. Raises the errors of
        `asrsim.load_robot`.
        """
        self._page = page
        robot = load_robot(path, **reading)
        key = {"file": str(path.absolute()), "arguments": dict(reading.get("xacro_arguments") or {})}
        scenario = make_scenario(str(path.absolute()), duration=1.0) if not key["arguments"] else None
        scenario = scenario or make_scenario(key, duration=1.0)  # type: ignore[arg-type]
        shown, notes = drawable(robot, reading.get("package_paths"))
        joints = tuple(
            JointInfo(
                name=joint.name, actuator="rigid", mode=None, prismatic=joint.kind == "prismatic", quantities=("link_position",)
            )
            for joint in robot.moving_joints
        )
        self._values = dict.fromkeys((joint.name for joint in joints), 0.0)
        self._began = clock.perf_counter()
        scene = RenderScene(shown, scenario)
        self.subject = Subject(title=robot.name, joints=joints, scene=scene, history=History(joints), notes=notes)
        gui = page.server.gui
        tabs = page.show(self.subject)
        with tabs.add_tab("Joints"):
            zero = gui.add_button("All to 0")
            sliders = []
            for joint in robot.moving_joints:
                low, high = joint.stops
                low, high = max(low, -math.pi) if math.isinf(low) else low, min(high, math.pi) if math.isinf(high) else high
                start = self._values[joint.name] = min(max(0.0, low), high)
                unit = linear_unit("rad") if joint.kind == "prismatic" else "rad"
                step = 10.0 ** math.floor(math.log10(max(high - low, 1e-6) / 200.0))
                slider: Any = gui.add_slider(f"{joint.name}, {unit}", min=low, max=high, step=step, initial_value=start)
                by_hand(slider, partial(self._values.__setitem__, joint.name))
                sliders.append((joint.name, slider, start))
        page.finish()
        page.say("No scenario: joints are moved by hand, without physics. <code>asrsim init</code> writes a scenario.")

        def reset() -> None:
            for name, slider, start in sliders:
                slider.value = self._values[name] = start

        on_click(zero, reset)

    def run(self, stop: Stop) -> None:
        """Show the robot until `stop` returns True."""
        while not stop():
            self.draw()
            clock.sleep(FRAME)

    def draw(self) -> None:
        """Show the robot in the pose that the sliders give."""
        time = np.array([clock.perf_counter() - self._began])
        samples = Samples(time=time, joints=tuple(self._values), values={"link_position": np.array([[*self._values.values()]])})
        self.subject.history.write(samples)
        self._page.draw(samples)
