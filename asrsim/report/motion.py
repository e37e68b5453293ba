"""Data of the page's moving view: the shapes of the bodies, and their poses at some hundred times of each run."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np

from asrsim.render import Film
from asrsim.render.meshes import simplified, smooth
from asrsim.render.scene import RenderScene
from asrsim.report.series import pack

FRAMES = 400
"""Largest number of times at which the page has the poses of a run. The page interpolates between these times."""
TRIANGLES = 30_000
"""Number of triangles of all bodies together above which their meshes are simplified."""
DIGITS = 7
"""Number of decimals in a pose. Rounding makes the values of a body at rest equal, so that they are packed as one value."""


def motion_data(films: Sequence[Film], labels: Sequence[str]) -> dict[str, Any]:
    """Data of the page's animation of one or several runs. Runs with the same shapes share the data of these shapes.

    films: the motion of each run, ready to be drawn; labels: the name of each run.
    """
    scenes: list[list[dict[str, Any]]] = []
    runs = []
    for film, label in zip(films, labels, strict=True):
        shapes = _shapes(film.scene)
        if shapes not in scenes:
            scenes.append(shapes)
        runs.append({"label": label, "scene": scenes.index(shapes), "ground": film.scene.ground, **_motion(film)})
    first = films[0]
    camera = {
        "eye": first.camera.eye.tolist(),
        "target": first.camera.target.tolist(),
        "field": first.camera.field,
        "aspect": first.width / first.height,
    }
    return {"scenes": scenes, "runs": runs, "camera": camera}


def _shapes(scene: RenderScene) -> list[dict[str, Any]]:
    """Points (x y z, m, in the frame of the body) and triangles of each part of a scene. Triangles share points where the
    surface is smooth, so that each point has one normal.
    """
    meshes = [smooth(mesh) for mesh in simplified([part.mesh for part in scene.parts], most=TRIANGLES)]
    return [
        {
            "body": part.body,
            "colour": part.colour.tolist(),
            "points": pack(mesh.vertices.ravel()),
            "count": mesh.vertices.size,
            "triangles": _integers(mesh.faces),
        }
        for part, mesh in zip(scene.parts, meshes, strict=True)
    ]


def _integers(faces: Any) -> str:
    return base64.b64encode(np.ascontiguousarray(faces, dtype="<u4").tobytes()).decode("ascii")


def _motion(film: Film) -> dict[str, Any]:
    """Times of a run, and the poses of each body as x y z, quaternion x y z w: in the frame of the body's parent, or in the
    world for a body without parent.
    """
    from scipy.spatial.transform import Rotation

    time = film.samples.time
    rows = np.unique(np.linspace(0, len(time) - 1, FRAMES).round().astype(int))
    frames = [film.frames(int(row)) for row in rows]
    bodies = []
    for name in frames[0]:
        local = np.array([frame[name] for frame in frames])
        parent = film.scene.parents.get(name)
        if parent is not None:
            local = np.linalg.inv([frame[parent] for frame in frames]) @ local
        turn = Rotation.from_matrix(local[:, :3, :3]).as_quat()
        # A quaternion and its negative are the same rotation. Give each quaternion the sign with which it is closer to the
        # quaternion before it, so that the page can interpolate.
        turn[1:] *= np.cumprod(np.where(np.sum(turn[1:] * turn[:-1], axis=1) < 0.0, -1.0, 1.0))[:, None]
        pose = np.round(np.hstack([local[:, :3, 3], turn]), DIGITS)
        bodies.append({"name": name, "parent": parent, "pose": [pack(column) for column in pose.T]})
    return {"count": len(rows), "time": pack(time[rows]), "bodies": bodies}
