"""Clipping to a box, and outlines on paper."""

from itertools import combinations

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull, QhullError

from crinoid.results.scene.data import Obstacle, Point
from crinoid.results.scene.mesh import Facets, look_rotation
from crinoid.results.scene.projection import PaperPoints, View, left_of

Corners = Float[np.ndarray, "_ axis=3"]


def box_corners(low: Point, high: Point) -> Float[np.ndarray, "corner=8 axis=3"]:
    """Corners of a box."""
    return np.array(np.meshgrid(*np.stack([low, high], axis=1))).reshape(3, -1).T


def cut_box(out: Point, foot: Point, low: Point, high: Point) -> tuple[Corners, Corners]:
    """Cut a box with a plane: corners of the cut in order, and those of the box behind it."""
    corners = box_corners(low, high)
    height = (corners - foot) @ out
    cut = []
    for b, a in combinations(range(8), 2):
        on_one_edge = np.sum(corners[a] != corners[b]) == 1
        if on_one_edge and (height[a] > 0) != (height[b] > 0):
            share = height[a] / (height[a] - height[b])
            cut.append(corners[a] + share * (corners[b] - corners[a]))
    behind = corners[height <= 0]
    if not cut:
        return np.empty((0, 3)), behind
    points = np.array(cut)
    aside = look_rotation(out, out)[:, 1]
    from_middle = points - points.mean(axis=0)
    angle = np.arctan2(from_middle @ np.cross(out, aside), from_middle @ aside)
    return points[np.argsort(angle)], behind


def within_box(facets: Facets, low: Point, high: Point) -> Float[np.ndarray, "_ corner=4 axis=3"]:
    """Facets as far as they lie in a box, cut at its sides (Sutherland and Hodgman 1974)."""
    near = np.all((facets.max(axis=1) >= low) & (facets.min(axis=1) <= high), axis=1)
    facets = facets[near]
    whole = np.all((facets >= low) & (facets <= high), axis=(1, 2))
    pieces = [facets[whole]]
    for polygon in facets[~whole]:
        for axis in range(3):
            polygon = _above(polygon, polygon[:, axis] - low[axis])
            polygon = _above(polygon, high[axis] - polygon[:, axis])
        # polygons of other than four corners become fours about the first corner
        last = len(polygon) - 1
        for corner in range(1, last, 2):
            pieces.append(polygon[None, [0, corner, corner + 1, min(corner + 2, last)]])
    return np.concatenate(pieces)


def _above(polygon: Corners, height: Float[np.ndarray, " corner"]) -> Corners:
    """Part of a polygon where a height at its corners is not negative."""
    found = []
    for corner, up in enumerate(height):
        before = height[corner - 1]
        if (before < 0.0) != (up < 0.0):
            share = before / (before - up)
            found.append(polygon[corner - 1] + share * (polygon[corner] - polygon[corner - 1]))
        if up >= 0.0:
            found.append(polygon[corner])
    return np.array(found).reshape(-1, 3)


def arm_outline(points: PaperPoints, diameter: Float[np.ndarray, " node"]) -> PaperPoints:
    """Corners of the band of the given diameter about a line of points, all in m."""
    aside = left_of(np.gradient(points, axis=0)) * diameter[:, None] / 2
    return np.concatenate([points + aside, (points - aside)[::-1]])


def convex_outline(points: PaperPoints) -> PaperPoints:
    """Corners of the smallest convex shape around points; both ends of points on a line."""
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except (QhullError, ValueError):  # they are on a line, or there are none
        ordered = np.unique(points, axis=0)
        return ordered[:: max(1, len(ordered) - 1)]


def obstacle_outline(
    obstacle: Obstacle, record: int, low: Point, high: Point, view: View
) -> PaperPoints:
    """Corners of an obstacle at a record in a parallel view, of a wall within a window."""
    if obstacle.kind == "plane":
        normal, foot = obstacle.normal, obstacle.nearest(record, (low + high) / 2)
        if not shows_edge(obstacle, view):
            cut, behind = cut_box(normal, foot, low, high)
            return convex_outline(view.paper(np.concatenate([cut, behind])))
        far = 2 * float(np.linalg.norm(view.paper(high - low)))
        normal, foot = view.paper(normal), view.paper(foot)
        side = far * left_of(normal)
        return np.stack(
            [foot + side, foot - side, foot - side - far * normal, foot + side - far * normal]
        )
    place, half = view.paper(obstacle.path[record]), view.paper(obstacle.half_axis[record])
    forward = half / (np.linalg.norm(half) or 1.0)
    if not forward.any():
        forward = np.array([1.0, 0.0])
    turn = np.linspace(-np.pi / 2, np.pi / 2, 129)
    cap = obstacle.radius * np.outer(np.cos(turn), forward)
    cap += obstacle.radius * np.outer(np.sin(turn), left_of(forward))
    return np.concatenate([place + half + cap, place - half - cap])


def shows_edge(obstacle: Obstacle, view: View) -> bool:
    """Whether a view is along a wall, so that its surface is a line on paper."""
    return bool(abs(view.depth(obstacle.normal)) < 1e-9)
