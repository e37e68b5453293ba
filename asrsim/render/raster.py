"""Rasteriser with a depth buffer: draws all triangles at once in NumPy, without display or graphics card."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from asrsim.samples import Array

Indices = NDArray[np.intp]


@dataclass(frozen=True, kw_only=True)
class Raster:
    """Pixels that triangles cover, with the front triangle and the depth at each pixel."""

    pixels: Indices
    """Indices (p,) of the covered pixels, row by row from the top left."""
    triangles: Indices
    """Index (p,) of the front triangle at each covered pixel."""
    depth: Array
    """Inverse distance along the view (height * width,); 0 where no triangle covers the pixel."""


def rasterise(corners: Array, width: int, height: int) -> Raster:
    """Triangle in front at each pixel.

    corners: corners of m triangles (m, 3, 3), each with x and y in pixels from the top left, and 1 / distance, which is linear
    in the picture. Triangles with a corner behind the camera (1 / distance not positive) are omitted.

    A triangle is split into rows, and a row into the pixels whose centres it covers, so that only covered pixels are computed.
    """
    ahead = np.flatnonzero((corners[:, :, 2] > 0.0).all(axis=1))
    order = np.argsort(corners[ahead][:, :, 1], axis=1)
    sorted_corners = np.take_along_axis(corners[ahead], order[:, :, None], axis=1)
    first, last = (np.clip(np.ceil(sorted_corners[:, k, 1] - 0.5), 0, height).astype(np.intp) for k in (0, 2))
    tall = last > first
    ahead, sorted_corners, first, last = ahead[tall], sorted_corners[tall], first[tall], last[tall]
    member, row = _expanded(first, last - first)
    low, middle, high = (sorted_corners[:, k].T for k in range(3))
    y = row + 0.5
    along = _along(low, high, member, y)
    upper = y < middle[1][member]
    short = np.where(upper, _along(low, middle, member, y), _along(middle, high, member, y))
    left, right = np.minimum(along, short), np.maximum(along, short)
    begin, end = (np.clip(np.ceil(edge - 0.5), 0, width).astype(np.intp) for edge in (left, right))
    wide = end > begin
    member, row, begin, end = member[wide], row[wide], begin[wide], end[wide]
    slope, rise, offset = plane(sorted_corners, sorted_corners[:, :, 2]).T
    span, column = _expanded(begin, end - begin)
    start = offset[member] + rise[member] * (row + 0.5)
    near = np.maximum(start[span] + slope[member][span] * (column + 0.5), 1e-12)
    pixel = row[span] * width + column
    depth = np.zeros(width * height)
    np.maximum.at(depth, pixel, near)
    front = near >= depth[pixel]
    numbers = np.full(width * height, -1, dtype=np.intp)
    numbers[pixel[front]] = ahead[member[span[front]]]
    pixels = np.flatnonzero(numbers >= 0)
    return Raster(pixels=pixels, triangles=numbers[pixels], depth=depth)


def plane(corners: Array, values: Array) -> Array:
    """Coefficients a, b, c (m, 3) of a function a x + b y + c for each triangle, which equals `values` (m, 3) at the triangle's
    corners. The function of a triangle without area is constant.
    """
    x, y = corners[:, :, 0], corners[:, :, 1]
    x1, y1, x2, y2 = x[:, 1] - x[:, 0], y[:, 1] - y[:, 0], x[:, 2] - x[:, 0], y[:, 2] - y[:, 0]
    v1, v2 = values[:, 1] - values[:, 0], values[:, 2] - values[:, 0]
    area = x1 * y2 - x2 * y1
    # Use a slope of 0 for a very thin triangle, since its computed slope would consist of rounding errors.
    inverse = np.where(np.abs(area) > 1e-3, 1.0 / np.where(area == 0.0, 1.0, area), 0.0)
    a, b = (v1 * y2 - v2 * y1) * inverse, (v2 * x1 - v1 * x2) * inverse
    c = np.where(inverse == 0.0, values.mean(axis=1), values[:, 0] - a * x[:, 0] - b * y[:, 0])
    return np.stack([a, b, c], axis=1)


def _expanded(first: Indices, counts: Indices) -> tuple[Indices, Indices]:
    """All integers from first[k] to first[k] + counts[k] - 1 for every k, as two arrays: k of each integer, and the integer."""
    member = np.repeat(np.arange(len(counts)), counts)
    starts = np.cumsum(counts) - counts
    return member, np.arange(len(member)) - starts[member] + first[member]


def _along(start: Array, end: Array, member: Indices, y: NDArray[np.floating]) -> Array:
    """x at which an edge of triangle `member` crosses the height y; start, end: the ends of this edge in all triangles."""
    rise = end[1] - start[1]
    slope = np.where(rise > 0.0, (end[0] - start[0]) / np.where(rise > 0.0, rise, 1.0), 0.0)
    return np.asarray(start[0][member] + slope[member] * (y - start[1][member]))
