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
    turn: Float[np.ndarray, " turn"],
) -> Facets:
    """Facets of the skin over rings, one between each two turns for each gap between two rings.

    `aside` and `beside` are unit vectors at right angles that span each ring; turns (rad) go from
    the first to the second.
    """
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
    aside: Float[np.ndarray, "axis=3"],
    wedge: float = np.pi,
) -> Facets:
    """Facets of a body of revolution: its radius along a line, to a wedge (rad) each way of aside.

    There are `AROUND` to a ring. `aside` is a unit vector across the line.
    """
    rings = np.ones((len(along), 1))
    spine = start + along[:, None] * direction
    turn = np.linspace(-wedge, wedge, AROUND + 1)
    return skin(spine, radius, rings * aside, rings * np.cross(direction, aside), turn)


def tube(
    points: Float[np.ndarray, "node axis=3"],
    diameter: Float[np.ndarray, " node"],
    director: Float[np.ndarray, "edge axis=3"] | None,
) -> Facets:
    """Facets of an arm with its two ends, `AROUND` to a ring.

    The first of each lies at the director m_1 if that is known.
    """
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
    turn = 2 * np.pi * (np.arange(AROUND + 1) - 0.5) / AROUND
    return skin(with_ends(points), radius, with_ends(aside), with_ends(beside), turn)


def perpendicular(direction: Float[np.ndarray, "axis=3"]) -> Float[np.ndarray, "axis=3"]:
    """Give some unit vector across a direction."""
    other = np.eye(3)[int(np.argmin(np.abs(direction)))]
    across = np.cross(direction, other)
    return np.asarray(across / (np.linalg.norm(across) or 1.0))


def box_corners(
    low: Float[np.ndarray, "axis=3"], high: Float[np.ndarray, "axis=3"]
) -> Float[np.ndarray, "corner=8 axis=3"]:
    """Corners of a box."""
    return np.array(np.meshgrid(*np.stack([low, high], axis=1))).reshape(3, -1).T


def cut_box(
    out: Float[np.ndarray, "axis=3"],
    foot: Float[np.ndarray, "axis=3"],
    low: Float[np.ndarray, "axis=3"],
    high: Float[np.ndarray, "axis=3"],
) -> tuple[Float[np.ndarray, "corner axis=3"], Float[np.ndarray, "point axis=3"]]:
    """Cut a box with a plane: corners of the cut in order, and those of the box behind it."""
    corners = box_corners(low, high)
    height = (corners - foot) @ out
    cut = []
    for a in range(8):
        for b in range(a):
            on_one_edge = np.sum(corners[a] != corners[b]) == 1
            if on_one_edge and (height[a] > 0) != (height[b] > 0):
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


def within_box(
    facets: Facets, low: Float[np.ndarray, "axis=3"], high: Float[np.ndarray, "axis=3"]
) -> Float[np.ndarray, "_ corner=4 axis=3"]:
    """Facets as far as they lie in a box, cut at its sides (Sutherland and Hodgman 1974)."""
    near = np.all((facets.max(axis=1) >= low) & (facets.min(axis=1) <= high), axis=1)
    facets = facets[near]
    whole = np.all((facets >= low) & (facets <= high), axis=(1, 2))
    pieces = [facets[whole]]
    for polygon in facets[~whole]:
        for axis in range(3):
            polygon = _above(polygon, polygon[:, axis] - low[axis])
            polygon = _above(polygon, high[axis] - polygon[:, axis])
        # what has other than four corners, as fours about the first
        last = len(polygon) - 1
        for corner in range(1, last, 2):
            pieces.append(polygon[None, [0, corner, corner + 1, min(corner + 2, last)]])
    return np.concatenate(pieces)


def _above(
    polygon: Float[np.ndarray, "corner axis=3"], height: Float[np.ndarray, " corner"]
) -> Float[np.ndarray, "_ axis=3"]:
    """Part of a polygon where a height, given at its corners, is not negative."""
    kept = []
    for corner, up in enumerate(height):
        before = height[corner - 1]
        if (before < 0.0) != (up < 0.0):
            share = before / (before - up)
            kept.append(polygon[corner - 1] + share * (polygon[corner] - polygon[corner - 1]))
        if up >= 0.0:
            kept.append(polygon[corner])
    return np.array(kept).reshape(-1, 3)
