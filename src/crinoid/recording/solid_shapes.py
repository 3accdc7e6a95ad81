"""Triangles by which solids of files are drawn."""

from typing import Any

import numpy as np
from jaxtyping import Float, Int

_CELLS = 40  # cells along the longest side of a solid as it is drawn

Points = Float[np.ndarray, "_ axis=3"]
Facets = Int[np.ndarray, "_ corner=3"]
Shape = tuple[Points, Facets]
Places = Float[np.ndarray, " place"]


def clustered(points: Points, facets: Facets) -> Shape:
    """Return a mesh whose points in one cell are one (Rossignac and Borrel 1993)."""
    if len(points) <= _CELLS**2:
        return points, facets
    cell = float(np.ptp(points, axis=0).max()) / _CELLS
    cells = np.floor(points / cell).astype(int)
    _, first, at = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    merged = np.zeros((len(first), 3))
    np.add.at(merged, at.ravel(), points)
    merged /= np.bincount(at.ravel())[:, None]
    found = at.ravel()[facets]
    whole = (found != np.roll(found, 1, axis=1)).all(axis=1)
    return merged, found[whole]


def section(distance: Float[np.ndarray, "x z"], x: Places, z: Places, half: float) -> Shape:
    """Return a slab over the places of a plane whose distance from a solid is negative.

    It is twice ``half`` thick (m).
    """
    from contourpy import contour_generator  # as matplotlib, and few need it

    steps = [slice(None, None, 1 + count // _CELLS) for count in distance.shape]
    x, z, distance = x[steps[0]], z[steps[1]], distance[*steps]
    cells = contour_generator(x, z, distance.T, chunk_size=1)
    lines: Any = cells.filled(-np.inf, 0.0)[0]
    outlines = [line[:-1] for line in lines if line is not None]
    if not outlines:  # thinner than the grid
        return np.zeros((0, 3)), np.zeros((0, 3), int)
    return slab(outlines, half)


def slab(outlines: list[Float[np.ndarray, "_ 2"]], half: float) -> Shape:
    """Return a slab over convex polygons in x and z that share corners (m), with its sides."""
    sizes = [len(each) for each in outlines]
    corners, at = np.unique(np.round(np.concatenate(outlines), 9), axis=0, return_inverse=True)
    rings = np.split(at.ravel(), np.cumsum(sizes)[:-1])
    fans = [(ring[0], *ring[i : i + 2]) for ring in rings for i in range(1, len(ring) - 1)]
    front = np.array(fans)
    edges = np.concatenate([front[:, [0, 1]], front[:, [1, 2]], front[:, [2, 0]]])
    ends = np.sort(edges, axis=1)
    _, first, times = np.unique(ends, axis=0, return_index=True, return_counts=True)
    (begin, end), count = edges[first[times == 1]].T, len(corners)
    sides = [(begin, begin + count, end), (end, begin + count, end + count)]
    # counter-clockwise as seen from outside; the front is at -y
    walls = [np.stack(side, axis=1) for side in sides]
    facets = np.concatenate([front, front[:, ::-1] + count, *walls])
    points = np.zeros((2 * count, 3))
    points[:, [0, 2]] = np.tile(corners, (2, 1))
    points[:, 1] = np.repeat([-half, half], count)
    return points, facets


def sheet(x: Places, y: Places, height: Float[np.ndarray, "x y"]) -> Shape:
    """Return a surface of heights over places of a grid (m)."""
    points = np.stack([*np.meshgrid(x, y, indexing="ij"), height], axis=-1).reshape(-1, 3)
    corner = np.arange(height.size).reshape(height.shape)
    a, b, c, d = corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]
    halves = [np.stack(half, axis=-1).reshape(-1, 3) for half in ((a, b, c), (a, c, d))]
    return points, np.concatenate(halves)


def profile(x: Places, height: Places, foot: float, half: float) -> Shape:
    """Return a slab between heights over x and a foot below (m), twice ``half`` thick."""
    steps = zip(x[:-1], x[1:], height[:-1], height[1:], strict=True)
    outlines = [np.array([(a, foot), (b, foot), (b, q), (a, p)]) for a, b, p, q in steps]
    return slab(outlines, half)
