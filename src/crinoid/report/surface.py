"""Surfaces in space, as facets of four corners, for what no outline is enough."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

AROUND = 24  # facets around what is round

Facets = Float[np.ndarray, "facet corner=4 axis=3"]


def skin(
    spine: Float[np.ndarray, "ring axis=3"],
    radius: Float[np.ndarray, " ring"],
    aside: Float[np.ndarray, "ring axis=3"],
    beside: Float[np.ndarray, "ring axis=3"],
) -> Facets:
    """Facets of the skin over rings, `AROUND` for each gap between two, the first one at `aside`.

    `aside` and `beside` are unit vectors at right angles that span each ring.
    """
    turn = 2 * np.pi * (np.arange(AROUND + 1) - 0.5) / AROUND
    around = np.cos(turn)[:, None] * aside[:, None] + np.sin(turn)[:, None] * beside[:, None]
    rings = spine[:, None] + radius[:, None, None] * around
    near, far = rings[:-1], rings[1:]
    corners = np.stack([near[:, :-1], near[:, 1:], far[:, 1:], far[:, :-1]], axis=2)
    return corners.reshape(-1, 4, 3)


def turned_body(
    start: Float[np.ndarray, "axis=3"],
    direction: Float[np.ndarray, "axis=3"],
    along: Float[np.ndarray, " ring"],
    radius: Float[np.ndarray, " ring"],
) -> Facets:
    """Facets of a body of revolution: its radius along a line."""
    aside = perpendicular(direction)
    rings = np.ones((len(along), 1))
    spine = start + along[:, None] * direction
    return skin(spine, radius, rings * aside, rings * np.cross(direction, aside))


def tube(
    points: Float[np.ndarray, "node axis=3"],
    diameter: Float[np.ndarray, " node"],
    director: Float[np.ndarray, "edge axis=3"] | None,
) -> Facets:
    """Facets of an arm with its two ends, whose rings begin at the director m_1 if it is known."""
    edges = np.diff(points, axis=0)
    edges /= np.linalg.norm(edges, axis=1, keepdims=True)
    ahead = np.concatenate([edges[:1], edges[1:] + edges[:-1], edges[-1:]])
    if director is None:
        first = np.tile(perpendicular(ahead[0]), (len(points), 1))
    else:
        first = np.concatenate([director[:1], director[1:] + director[:-1], director[-1:]])
    aside, beside = np.empty_like(ahead), np.empty_like(ahead)
    for node, forward in enumerate(ahead):
        unit = forward / (np.linalg.norm(forward) or 1.0)
        wish = first[node] if director is not None or node == 0 else aside[node - 1]
        across = wish - (wish @ unit) * unit
        length = float(np.linalg.norm(across))
        aside[node] = across / length if length > 1e-9 else perpendicular(unit)
        beside[node] = np.cross(unit, aside[node])

    def with_ends(values: np.ndarray) -> np.ndarray:
        return np.concatenate([values[:1], values, values[-1:]])

    radius = np.concatenate([[0.0], diameter / 2, [0.0]])
    return skin(*(with_ends(points), radius, with_ends(aside), with_ends(beside)))


def perpendicular(direction: Float[np.ndarray, "axis=3"]) -> Float[np.ndarray, "axis=3"]:
    """Give some unit vector across a direction."""
    other = np.eye(3)[int(np.argmin(np.abs(direction)))]
    across = np.cross(direction, other)
    return np.asarray(across / (np.linalg.norm(across) or 1.0))


def cut_box(
    out: Float[np.ndarray, "axis=3"],
    foot: Float[np.ndarray, "axis=3"],
    low: Float[np.ndarray, "axis=3"],
    high: Float[np.ndarray, "axis=3"],
) -> tuple[Float[np.ndarray, "corner axis=3"], Float[np.ndarray, "point axis=3"]]:
    """Cut a box with a plane: corners of the cut in order, and those of the box behind it."""
    signs = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, -1).T
    corners = low + signs * (high - low)
    height = (corners - foot) @ out
    cut = []
    for a in range(8):
        for b in range(a):
            if np.abs(signs[a] - signs[b]).sum() == 1 and (height[a] > 0) != (height[b] > 0):
                share = height[a] / (height[a] - height[b])
                cut.append(corners[a] + share * (corners[b] - corners[a]))
    behind = corners[height <= 0]
    if not cut:
        return np.empty((0, 3)), behind
    points = np.array(cut)
    aside = perpendicular(out)
    from_middle = points - points.mean(axis=0)
    angle = np.arctan2(from_middle @ np.cross(out, aside), from_middle @ aside)
    return points[np.argsort(angle)], behind
