"""Data of the page's moving view: shapes once, and frames of the bodies at some hundred instants of every run."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np

from asrsim.render.motion import Film
from asrsim.render.scene import ScenePart
from asrsim.render.solids import merged
from asrsim.report.series import pack
from asrsim.samples import Array

FRAMES = 400
"""Largest number of instants per run; the page interpolates between them."""
TRIANGLES = 40_000
"""Largest number of triangles of all shapes together."""
_LEVELS = 32767
"""Number of quantisation steps of a coordinate in the positive and the negative direction (signed 16-bit integers)."""


def motion_data(films: Sequence[Film], labels: Sequence[str]) -> dict[str, Any] | None:
    """Data of the moving view; None if there are no films. Runs with another robot than the first run's are omitted."""
    if not films:
        return None
    first = films[0]
    alike = [(film, label) for film, label in zip(films, labels, strict=True) if film.info.urdf == first.info.urdf]
    scene = first.scene
    share = TRIANGLES / max(sum(len(part.mesh.triangles) for part in scene.parts), TRIANGLES)
    return {
        "parts": [_part(part, share) for part in scene.parts],
        "joints": [
            {"name": j.name, "kind": j.kind, "parent": j.parent, "child": j.child, "origin": _matrix(scene.origins[j.name]),
             "axis": _rounded(np.array(j.axis))}
            for j in scene.joints
        ],
        "root": scene.root,
        "base": _matrix(scene.base),
        "objects": {name: _matrix(frame) for name, frame in scene.objects.items()},
        "ground": scene.ground,
        "camera": {
            "eye": _rounded(first.camera.eye), "target": _rounded(first.camera.target), "field": first.camera.field,
            "aspect": first.width / first.height,
        },
        "runs": [_run(film, label) for film, label in alike],
    }  # fmt: skip


def _run(film: Film, label: str) -> dict[str, Any]:
    samples = film.samples
    count = min(FRAMES, max(2, len(samples.time)))
    time = np.linspace(film.start, film.end, count)

    def at(values: Array) -> dict[str, Any]:
        return pack(np.interp(time, samples.time, np.nan_to_num(values)))

    positions = samples.values["link_position"]
    moving = {joint.name for joint in film.scene.joints}
    poses = {}
    for name, pose in samples.bodies.items():
        if name not in film.scene.objects and name != film.scene.root:
            continue
        turn = np.array(pose[:, 3:7])
        # A quaternion and its negative are the same rotation; choose the signs so that the page interpolates along the shorter
        # rotation.
        flips = np.cumprod(np.where(np.sum(turn[1:] * turn[:-1], axis=1) < 0, -1.0, 1.0))
        turn[1:] *= flips[:, None]
        poses[name] = [at(column) for column in (*pose[:, :3].T, *turn.T)]
    return {
        "label": label, "start": film.start, "end": film.end, "count": count,
        "joints": {name: at(positions[:, i]) for i, name in enumerate(samples.joints) if name in moving}, "poses": poses,
    }  # fmt: skip


def _part(part: ScenePart, share: float) -> dict[str, Any]:
    mesh, colours = part.mesh, part.colours
    most = max(int(share * len(mesh.triangles)), 60)
    if share < 1.0 and len(mesh.triangles) > most:
        mesh = merged(mesh, most=most)
        colours = np.tile(part.colours.mean(axis=0), (len(mesh.triangles), 1))
    used, numbers = np.unique(mesh.triangles, return_inverse=True)
    points = mesh.points[used]
    centre, size = 0.5 * (points.min(axis=0) + points.max(axis=0)), max(float(np.ptp(points, axis=0).max()) / 2, 1e-9)
    palette, kind = np.unique(np.round(255 * colours).astype(int), axis=0, return_inverse=True)
    order = np.argsort(kind.ravel(), kind="stable")
    return {
        "body": part.body,
        "centre": _rounded(centre),
        "size": size,
        "points": _bytes(np.round((points - centre) / size * _LEVELS).astype("<i2")),
        # 16 bits suffice for the indices of points, because larger meshes were simplified before.
        "triangles": _bytes(numbers.reshape(-1, 3)[order].astype("<u2")),
        "colours": [[*colour, int(count)] for colour, count in zip(palette.tolist(), np.bincount(kind.ravel()), strict=True)],
    }


def _bytes(values: Any) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")


def _matrix(frame: Array) -> list[float]:
    return _rounded(frame.ravel())


def _rounded(values: Array) -> list[float]:
    return [float(f"{value:.9g}") for value in values]
