"""A figure: a robot with its world in the page's 3-D scene. Ghosts are translucent figures of one colour."""

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

Rgb = tuple[int, int, int]
"""Colour as red, green and blue, 0 to 255 each."""
MOVED = 1e-7
"""Change of a coordinate of a position (m) or of a quaternion up to which a body counts as still."""
_NAMES = itertools.count()


class Figure:
    """Shapes of a scene on a page, which `place` moves. The shapes belong to nodes of the page's scene tree.

    Links that fixed joints connect share a node. The node of a link is placed relative to the node of the link before it in the
    chain. A turning joint thus changes the orientation of one node and no position, so that a new picture of the robot needs
    only a few small messages to the page.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        scene: RenderScene,
        *,
        colour: Rgb | None = None,
        opacity: float | None = None,
        objects: bool = True,
    ) -> None:
        """colour: colour of all bodies; None: each body has the colour of its visual. objects: whether the objects of the world
        are also shown.
        """
        self.scene, self._server = scene, server
        root = f"/figure_{next(_NAMES)}"
        self._root = server.scene.add_frame(root, show_axes=False)
        self.nodes: dict[str, viser.FrameHandle] = {}
        """Nodes by the name of their body: the root link, each link that a joint moves, and each object."""
        self.meshes: dict[str, list[tuple[viser.MeshHandle, Rgb]]] = {}
        """Meshes of each body, each with its original colour."""
        self._place_of: dict[str, tuple[Array | None, Array | None]] = {}
        """Position and orientation of each node relative to the preceding node, as they were last sent to the page."""
        self._tints: Mapping[str, Rgb] = {}
        joints = {joint.child: joint for joint in scene.model.robot.outward_joints}
        carrier = {scene.model.robot.root.name: scene.model.robot.root.name}
        self._before: dict[str, str] = {}
        """Body of the preceding node, by the body of the node. The nodes of the root link and of the objects have no preceding
        node."""
        for link, joint in joints.items():
            carrier[link] = link if joint.moves else carrier[joint.parent]
            if joint.moves:
                self._before[link] = carrier[joint.parent]
        carrier |= {name: name for name in scene.objects if objects}
        for body in dict.fromkeys(carrier.values()):
            above = root if body not in self._before else self.nodes[self._before[body]].name
            # Name the nodes by numbers, since names of links may contain the character that separates names of nodes.
            self.nodes[body] = server.scene.add_frame(f"{above}/{len(self.nodes)}", show_axes=False)
        frames = scene.frames({}, {})
        for number, part in enumerate(scene.parts):
            if part.body not in carrier:
                continue
            body = carrier[part.body]
            place = np.linalg.inv(frames[body]) @ frames[part.body]
            own = colour or _bytes(part.colour)
            mesh = server.scene.add_mesh_simple(
                f"{self.nodes[body].name}/mesh_{number}",
                part.mesh.vertices,
                part.mesh.faces,
                color=own,
                opacity=opacity,
                side="double",
                cast_shadow=colour is None,
                receive_shadow=colour is None,
                position=place[:3, 3],
                wxyz=quaternions(place[None])[0],
            )
            self.meshes.setdefault(part.body, []).append((mesh, own))

    def place(self, samples: Samples, positions: Array | None = None) -> dict[str, Array]:
        """Move the bodies to their poses in the last sample; returns the frame (4, 4) of each body in the world.

        positions: positions (joints,) that replace the links' positions in the samples, rad (m).
        """
        frames = frames_of(self.scene, samples, positions)
        world = np.eye(4)
        above = np.array([frames[self._before[name]] if name in self._before else world for name in self.nodes])
        own = np.array([frames[name] for name in self.nodes])
        # The inverse of a rotation matrix is its transpose.
        back = above[:, :3, :3].transpose(0, 2, 1)
        places = (back @ (own[:, :3, 3] - above[:, :3, 3])[:, :, None])[:, :, 0]
        turns = quaternions(back @ own[:, :3, :3])
        for name, node, place, turn in zip(self.nodes, self.nodes.values(), places, turns, strict=True):
            known_place, known_turn = self._place_of.get(name, (None, None))
            if known_place is None or np.abs(known_place - place).max() > MOVED:
                node.position = known_place = place
            if known_turn is None or np.abs(known_turn - turn).max() > MOVED:
                node.wxyz = known_turn = turn
            self._place_of[name] = known_place, known_turn
        return frames

    def tint(self, colours: Mapping[str, Rgb]) -> None:
        """Give each body in `colours` the colour that is stated there, and all other bodies their original colours."""
        if colours == self._tints:
            return
        self._tints = dict(colours)
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
            # Use a coroutine, since viser calls coroutines in the order of the events. It calls functions in threads, whose
            # order may change.
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
        """Remove the figure from the page."""
        self._root.remove()


def frames_of(scene: RenderScene, samples: Samples, positions: Array | None = None) -> dict[str, Array]:
    """Frame (4, 4) of each body in the world at the last sample. positions: positions (joints,) that replace the positions in
    the samples, rad (m); a joint without a position is placed at 0.
    """
    values = samples.values["link_position"][-1] if positions is None else positions
    return scene.frames(
        {name: float(value) for name, value in zip(samples.joints, values, strict=True) if math.isfinite(value)},
        {name: poses[-1] for name, poses in samples.bodies.items() if np.isfinite(poses[-1]).all()},
    )


def quaternions(frames: Array) -> Array:
    """Quaternions (n, 4) as w, x, y, z for the rotations in frames (n, 4, 4) or in rotation matrices (n, 3, 3)."""
    from scipy.spatial.transform import Rotation

    turns: Array = Rotation.from_matrix(frames[:, :3, :3]).as_quat(scalar_first=True)
    return turns


def _bytes(colour: Array) -> Rgb:
    red, green, blue = np.round(255.0 * colour).astype(int).tolist()
    return red, green, blue
