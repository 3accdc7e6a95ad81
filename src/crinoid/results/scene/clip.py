"""Clipping to a box, and outlines on paper."""

import math
from itertools import combinations

import numpy as np
from jaxtyping import Float

from crinoid.results.scene.data import Obstacle, Point
from crinoid.results.scene.mesh import AROUND, Facets, look_rotation
from crinoid.results.scene.projection import PaperPoints, View, left_of

Corners = Float[np.ndarray, "_ axis=3"]

_RINGS = 36  # most rings along an obstacle


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


def obstacle_facets(obstacle: Obstacle, low: Point, high: Point, record: int = -1) -> Facets:
    """Return facets of an obstacle at a record (the end), no wall, as far as a box contains it."""
    if obstacle.solid is not None:
        corners = obstacle.path[record] + obstacle.solid.points
        return within_box(corners[obstacle.solid.facets[:, [0, 1, 2, 2]]], low, high)
    place, half, radius = obstacle.path[record], obstacle.half_axis[record], obstacle.radius
    long = float(np.linalg.norm(half))
    direction = half / long if long else np.array([0.0, 0.0, 1.0])
    if obstacle.kind == "cylinder":
        # to where all of it is outside the box
        wide = radius * np.sqrt(np.maximum(1.0 - direction**2, 0.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            sides = np.stack([low - wide - place, high + wide - place]) / direction
        sides[:, direction == 0.0] = [[-np.inf], [np.inf]]
        begin, end = sides.min(axis=0).max(), sides.max(axis=0).min()
        rim = np.linspace(0.0, radius, 6)
        along = np.concatenate([np.full(6, begin), np.linspace(begin, end, 24), np.full(6, end)])
        around = np.concatenate([rim, np.full(24, radius), rim[::-1]])
    else:
        turn = np.linspace(0.0, np.pi / 2, 48)
        straight = np.linspace(-long, long, 24)[1:-1] if long else np.empty(0)
        cap, rim = radius * np.cos(turn), radius * np.sin(turn)
        along = np.concatenate([-long - cap, straight, long + cap[::-1]])
        around = np.concatenate([rim, np.full(straight.size, radius), rim[::-1]])

    # only near the box, so that facets are small on any obstacle
    middle, reach = (low + high) / 2 - place, float(np.linalg.norm(high - low)) / 2
    outward = middle - (middle @ direction) * direction
    away = float(np.linalg.norm(outward))
    near = np.flatnonzero(np.hypot(along - middle @ direction, around - away) <= reach)
    if not near.size:
        return np.empty((0, 4, 3))
    first, last = max(near[0] - 1, 0), min(near[-1] + 1, along.size - 1)
    rings = np.linspace(first, last, min(_RINGS, last - first + 1)).round().astype(int)
    aside, wedge = look_rotation(direction, direction)[:, 1], math.pi
    if away > reach:
        aside, wedge = outward / away, math.asin(reach / away)
    turn = np.linspace(-wedge, wedge, AROUND + 1)
    circle = np.outer(np.cos(turn), aside) + np.outer(np.sin(turn), np.cross(direction, aside))
    spine = place + along[rings, None] * direction
    skin = spine[:, None] + around[rings, None, None] * circle
    near_ring, far_ring = skin[:-1], skin[1:]
    corners = [near_ring[:, :-1], near_ring[:, 1:], far_ring[:, 1:], far_ring[:, :-1]]
    return within_box(np.stack(corners, axis=2).reshape(-1, 4, 3), low, high)


def arm_outline(points: PaperPoints, diameter: Float[np.ndarray, " node"]) -> PaperPoints:
    """Corners of the band of the given diameter about a line of points, all in m."""
    aside = left_of(np.gradient(points, axis=0)) * diameter[:, None] / 2
    return np.concatenate([points + aside, (points - aside)[::-1]])


def convex_outline(points: PaperPoints) -> PaperPoints:
    """Corners of the smallest convex shape around points (Andrew 1979, monotone chains)."""
    ordered = np.unique(points, axis=0)
    chains = []
    for line in (ordered, ordered[::-1]):
        chain: list[np.ndarray] = []
        for point in line:
            while len(chain) > 1:
                (a, b), (c, d) = chain[-1] - chain[-2], point - chain[-1]
                if a * d - b * c > 0.0:
                    break
                chain.pop()
            chain.append(point)
        chains += chain[:-1]
    return np.array(chains)


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


def clipped_outline(
    obstacle: Obstacle, low: Point, high: Point, view: View, record: int = -1
) -> PaperPoints:
    """Corners of the part of an obstacle that a box contains at a record, in any view."""
    if obstacle.kind == "plane":
        foot = obstacle.nearest(record, (low + high) / 2)
        surface, _ = cut_box(obstacle.normal, foot, low, high)
    else:
        surface = obstacle_facets(obstacle, low, high, record).reshape(-1, 3)
    return convex_outline(view.paper(surface)) if len(surface) else np.empty((0, 2))
