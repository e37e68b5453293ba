"""Draws a scene as a picture, with light, outlines, ground and shadow."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product

import numpy as np
from numpy.typing import NDArray

from asrsim.render.camera import Camera
from asrsim.render.raster import plane, rasterise
from asrsim.render.scene import RenderScene
from asrsim.samples import Array

Image = NDArray[np.uint8]
"""Picture as an array (height, width, 3) of red, green and blue, with 8 bits each."""
SKY_TOP, SKY_BOTTOM = np.array([0.985, 0.99, 1.0]), np.array([0.90, 0.925, 0.955])
AMBIENT, SUN, FILL = 0.46, 0.46, 0.16
"""Brightness of the ambient light (AMBIENT), of the main lamp (SUN), and of the lamp on the opposite side (FILL); 1 is full
brightness."""
NEARER = 1.002
"""Ratio of the inverse distances of a body and a point from the camera above which the body hides the point, and does not
merely touch it.
"""
INK = np.array([0.13, 0.15, 0.18])
"""Colour of outlines."""
TILE_LIGHT, TILE_DARK = np.array([0.87, 0.875, 0.86]), np.array([0.79, 0.80, 0.785])


class SceneDrawer:
    """Draws the shapes of a scene for given frames of its bodies."""

    def __init__(self, scene: RenderScene) -> None:
        self._scene = scene
        self.bodies = tuple(dict.fromkeys(part.body for part in scene.parts))
        points, triangles, normals = [np.empty((0, 3))], [np.empty((0, 3), np.intp)], [np.empty((0, 3))]
        for part in scene.parts:
            triangles.append(part.mesh.faces + sum(map(len, points)))
            points.append(part.mesh.vertices)
            normals.append(part.mesh.vertex_normals)
        self._points, self._triangles = np.concatenate(points), np.concatenate(triangles)
        self._normals = np.concatenate(normals)[self._triangles]
        counts = [len(part.mesh.faces) for part in scene.parts]
        owners = np.array([self.bodies.index(part.body) for part in scene.parts], dtype=np.intp)
        self._colours = np.repeat([part.colour for part in scene.parts], counts, axis=0)
        self._body = np.repeat(owners, counts)
        self._point_body = np.repeat(owners, [len(part.mesh.vertices) for part in scene.parts])
        self._outer = _outermost(self._points, self._point_body)

    def outer_points(self, frames: Mapping[str, Array]) -> Array:
        """Outermost points (k, 3) of all bodies in the world, m. They suffice to place a camera."""
        return self.points(frames)[self._outer]

    def points(self, frames: Mapping[str, Array]) -> Array:
        """Points (k, 3) of all shapes in the world, m."""
        turn, shift = self._stacked(frames)
        return np.asarray(np.einsum("kij,kj->ki", turn[self._point_body], self._points) + shift[self._point_body])

    def image(
        self,
        frames: Mapping[str, Array],
        camera: Camera,
        width: int,
        height: int,
        *,
        sharpness: int = 2,
        place: Array | None = None,
    ) -> Image:
        """Picture (height, width, 3) from the camera.

        sharpness: factor of oversampling; place: points (k, 3) that determine the position of the ground and the size of its
        tiles, the same for all pictures of a film; None: the points of this picture.
        """
        fine = (width * sharpness, height * sharpness)
        points = self.points(frames)
        seen = _projected(points, camera, *fine)[self._triangles]
        raster = rasterise(seen, *fine)
        picture = self._background(points, points if place is None else place, camera, *fine, raster.depth)
        turn, _ = self._stacked(frames)
        normals = np.einsum("mij,mkj->mki", turn[self._body], self._normals)
        shades = plane(seen, _light(normals, points[self._triangles], camera))[raster.triangles]
        y, x = np.divmod(raster.pixels, fine[0])
        shade = np.clip(shades[:, 0] * (x + 0.5) + shades[:, 1] * (y + 0.5) + shades[:, 2], AMBIENT, 1.12)
        picture[raster.pixels] = self._colours[raster.triangles] * shade[:, None]
        owner = np.full(fine[0] * fine[1], -1, dtype=np.intp)
        owner[raster.pixels] = self._body[raster.triangles]
        _outline(picture, owner.reshape(fine[::-1]), raster.depth)
        return _averaged(picture, width, height, sharpness)

    def hidden(self, frames: Mapping[str, Array], camera: Camera, width: int, height: int) -> dict[str, float]:
        """Fraction of each body's points that other bodies hide from the camera. width, height: width and height in pixels of
        the picture for this test, which may be small.
        """
        seen = _projected(self.points(frames), camera, width, height)
        raster = rasterise(seen[self._triangles], width, height)
        owner = np.full(width * height, -1, dtype=np.intp)
        owner[raster.pixels] = self._body[raster.triangles]
        inside = (seen[:, 2] > 0.0) & (seen[:, :2] >= 0.0).all(axis=1) & (seen[:, :2] < (width, height)).all(axis=1)
        pixel = np.where(inside, seen[:, 1].clip(0).astype(np.intp) * width + seen[:, 0].clip(0).astype(np.intp), 0)
        before = inside & (owner[pixel] != self._point_body) & (raster.depth[pixel] > NEARER * seen[:, 2])
        counts = np.bincount(self._point_body, minlength=len(self.bodies))
        shares = np.bincount(self._point_body, weights=before, minlength=len(self.bodies)) / np.maximum(counts, 1)
        return dict(zip(self.bodies, shares.tolist(), strict=True))

    def _stacked(self, frames: Mapping[str, Array]) -> tuple[Array, Array]:
        stacked = np.array([frames[body] for body in self.bodies]).reshape(-1, 4, 4)
        return stacked[:, :3, :3], stacked[:, :3, 3]

    def _background(self, points: Array, around: Array, camera: Camera, width: int, height: int, depth: Array) -> Array:
        """Colours (height * width, 3) of sky and ground, and of the shadow that the bodies cast vertically on the ground.

        points: points (k, 3) of the bodies; around: points (k, 3) whose middle is the centre of the ground.
        """
        share = np.linspace(0.0, 1.0, height)[:, None]
        sky = ((1 - share) * SKY_TOP + share * SKY_BOTTOM).astype(np.float32)
        picture = np.repeat(sky[:, None], width, axis=1).reshape(-1, 3)
        level = self._scene.ground
        if level is None or not len(points):
            return picture
        ray = _rays(camera, width, height)
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = (level - camera.eye[2]) / ray[:, 2]
        # Each ray has the length 1 along the view direction. Therefore the factor with which a ray reaches the ground is the
        # distance of the ground along the view direction.
        ground = np.flatnonzero((reach > 0) & (1.0 / np.where(reach > 0, reach, 1.0) > depth))
        place = camera.eye[:2] + reach[ground, None] * ray[ground, :2]
        middle = 0.5 * (around.min(axis=0) + around.max(axis=0))[:2]
        size = float(np.linalg.norm(np.ptp(around, axis=0)))
        tile = 10.0 ** np.floor(np.log10(size / 2))
        dark = (np.floor(place / tile).sum(axis=1) % 2)[:, None]
        colour = (1 - dark) * TILE_LIGHT + dark * TILE_DARK
        fallen = points.copy()
        fallen[:, 2] = level
        above = (points[:, 2] >= level)[self._triangles].any(axis=1)
        shadow = rasterise(_projected(fallen, camera, width, height)[self._triangles[above]], width, height).depth[ground] > 0
        colour = np.where(shadow[:, None], 0.72 * colour, colour)
        # Fade the ground out with the distance, so that it has no visible edge.
        fade = np.clip(2.2 - np.linalg.norm(place - middle, axis=1) / size, 0.0, 1.0)[:, None]
        picture[ground] = fade * colour + (1 - fade) * picture[ground]
        return picture


def _outermost(points: Array, body: NDArray[np.intp]) -> NDArray[np.intp]:
    """Indices of the points that, of all points of their body, lie farthest out in one of 26 directions. body: body of each
    point (k,).
    """
    directions = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=3) if any(d)])
    found = []
    for number in np.unique(body):
        mine = np.flatnonzero(body == number)
        found.append(mine[np.argmax(points[mine] @ directions.T, axis=0)])
    return np.unique(np.concatenate(found)) if found else np.empty(0, dtype=np.intp)


def _projected(points: Array, camera: Camera, width: int, height: int) -> Array:
    """Points in the picture (k, 3): x and y in pixels, and 1 / distance along the view, which is not positive for points behind
    the camera. points: points (k, 3) in the world, m.
    """
    right, up, forward = camera.axes
    away = points - camera.eye
    near = away @ forward
    inverse = np.where(near > 1e-9, 1.0 / np.where(near > 1e-9, near, 1.0), -1.0)
    scale = 0.5 * height / np.tan(np.radians(camera.field / 2))
    return np.stack([0.5 * width + scale * (away @ right) * inverse, 0.5 * height - scale * (away @ up) * inverse, inverse], 1)


def _rays(camera: Camera, width: int, height: int) -> Array:
    """Direction of the ray through each pixel, (height * width, 3), with component 1 along the view."""
    right, up, forward = camera.axes
    scale = np.tan(np.radians(camera.field / 2)) / (0.5 * height)
    x = scale * (np.arange(width) + 0.5 - 0.5 * width)
    y = scale * (0.5 * height - 0.5 - np.arange(height))
    return np.asarray(forward + x[None, :, None] * right + y[:, None, None] * up).reshape(-1, 3)


def _light(normals: Array, corners: Array, camera: Camera) -> Array:
    """Brightness (m, 3) at the corners of m triangles, lit by a main lamp behind the camera and a weaker lamp on the opposite
    side.
    """
    right, _, forward = camera.axes
    view = camera.eye - corners
    # Light the side that faces the camera, since in some files the normals of triangles point inwards.
    facing = np.sign(np.einsum("mki,mki->mk", normals, view))
    sun = np.array([0.0, 0.0, 0.9]) - 0.7 * forward - 0.35 * right
    fill = np.array([0.0, 0.0, 0.1]) + 0.9 * right - 0.2 * forward
    bright = AMBIENT * np.ones(normals.shape[:2])
    for direction, strength in ((sun, SUN), (fill, FILL)):
        bright += strength * np.clip(facing * (normals @ (direction / np.linalg.norm(direction))), 0.0, 1.0)
    return bright


def _outline(picture: Array, owner: NDArray[np.intp], depth: Array) -> None:
    """Draw a line along each edge between two bodies, on the body in front."""
    edges = []
    for step, there in ((1, owner[:, 1:] != owner[:, :-1]), (owner.shape[1], owner[1:] != owner[:-1])):
        row, column = np.nonzero(there)
        first = row * owner.shape[1] + column
        edges.append(np.where(depth[first] >= depth[first + step], first, first + step))
    edge = np.unique(np.concatenate(edges))
    picture[edge] = 0.38 * picture[edge] + 0.62 * INK


def _averaged(picture: Array, width: int, height: int, factor: int) -> Image:
    """Picture reduced by `factor`. Each of its pixels is the average of factor x factor pixels."""
    blocks = picture.reshape(height, factor, width, factor, 3)
    total = sum(blocks[:, i, :, j] for i in range(factor) for j in range(factor))
    return np.asarray(np.clip(255.0 / factor**2 * total + 0.5, 0.0, 255.0), dtype=np.uint8)
