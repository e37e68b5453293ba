"""A robot with its world in the page's 3-D scene; ghosts are figures of one colour that one sees through."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.render.scene import RenderScene
from asrsim.samples import Array, Samples

if TYPE_CHECKING:
    import viser

Colour = tuple[int, int, int]
"""Red, green and blue, 0 to 255."""
MOVED = 1e-7
"""Change of an entry of a frame below which a body counts as still, m or 1."""
_NAMES = itertools.count()


class Figure:
    """Shapes of a scene on a page, which `place` moves."""

    def __init__(
        self, server: viser.ViserServer, scene: RenderScene, *, colour: Colour | None = None, opacity: float | None = None,
        objects: bool = True,
    ) -> None:  # fmt: skip
        """colour: colour of all bodies; None: their own. objects: whether the objects of the world are shown too."""
        self.scene, self._server = scene, server
        root = f"/figure_{next(_NAMES)}"
        self._root = server.scene.add_frame(root, show_axes=False)
        self.bodies: dict[str, viser.FrameHandle] = {}
        self.meshes: dict[str, list[tuple[viser.MeshHandle, Colour]]] = {}
        """Meshes of each body, with their own colours."""
        self._frames: dict[str, Array] = {}
        for number, part in enumerate(scene.parts):
            if part.body in scene.objects and not objects:
                continue
            if part.body not in self.bodies:
                # Names of links may contain characters that separate names of nodes.
                self.bodies[part.body] = server.scene.add_frame(f"{root}/{len(self.bodies)}", show_axes=False)
            own = colour or _bytes(part.colour)
            mesh = server.scene.add_mesh_simple(
                f"{self.bodies[part.body].name}/{number}", part.mesh.vertices, part.mesh.faces, color=own, opacity=opacity,
                side="double", cast_shadow=colour is None, receive_shadow=colour is None,
            )  # fmt: skip
            self.meshes.setdefault(part.body, []).append((mesh, own))

    def place(self, samples: Samples, positions: Array | None = None) -> dict[str, Array]:
        """Move the bodies to the only sample; returns the frame (4, 4) of each body in the world.

        positions: positions (joints,) instead of the links' positions, rad (m).
        """
        frames = frames_of(self.scene, samples, positions)
        moved = [
            name for name in self.bodies if name not in self._frames or np.abs(frames[name] - self._frames[name]).max() > MOVED
        ]
        if moved:
            for name, turn in zip(moved, quaternions(np.array([frames[name] for name in moved])), strict=True):
                self.bodies[name].position, self.bodies[name].wxyz = frames[name][:3, 3], turn
            self._frames |= {name: frames[name] for name in moved}
        return frames

    def tint(self, colours: Mapping[str, Colour]) -> None:
        """Give bodies a colour; all others get their own colours back."""
        for body, meshes in self.meshes.items():
            for mesh, own in meshes:
                wanted = colours.get(body, own)
                if tuple(mesh.color) != wanted:
                    mesh.color = wanted

    def fade(self, opacity: float | None) -> None:
        """Set the opacity of all bodies; None: opaque."""
        for mesh, _ in itertools.chain(*self.meshes.values()):
            mesh.opacity = opacity

    def on_drag(self, report: Callable[[str, Any], None]) -> None:
        """Call `report` with a body and viser's event while a user drags the body."""

        def listen(body: str, mesh: Any) -> None:
            # Coroutines are called in the order of the events; functions may overtake each other.
            async def on_drag(event: Any) -> None:
                report(body, event)

            mesh.on_drag(on_drag)

        for body, meshes in self.meshes.items():
            for mesh, _ in meshes:
                listen(body, mesh)

    @property
    def visible(self) -> bool:
        """Whether the figure is shown."""
        return bool(self._root.visible)

    @visible.setter
    def visible(self, shown: bool) -> None:
        if shown != self._root.visible:
            self._root.visible = shown

    def remove(self) -> None:
        """Take the figure off the page."""
        self._root.remove()


def frames_of(scene: RenderScene, samples: Samples, positions: Array | None = None) -> dict[str, Array]:
    """Frame (4, 4) of each body in the world at the only sample. Joints without a position are at 0."""
    values = samples.values["link_position"][-1] if positions is None else positions
    return scene.frames(
        {name: float(value) for name, value in zip(samples.joints, values, strict=True) if math.isfinite(value)},
        {name: poses[-1] for name, poses in samples.bodies.items() if np.isfinite(poses[-1]).all()},
    )


def quaternions(frames: Array) -> Array:
    """Quaternions (n, 4) w, x, y, z of frames (n, 4, 4)."""
    from scipy.spatial.transform import Rotation

    turns: Array = Rotation.from_matrix(frames[:, :3, :3]).as_quat(scalar_first=True)
    return turns


def _bytes(colour: Array) -> Colour:
    red, green, blue = np.round(255.0 * colour).astype(int).tolist()
    return red, green, blue
