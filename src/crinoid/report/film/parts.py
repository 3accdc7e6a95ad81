"""Surfaces of all that is solid in a film: the submarine, the clamp, obstacles, the tool."""

import math
from collections.abc import Iterator

import numpy as np

from crinoid.report.charts.space import Moving, Space
from crinoid.report.film.course import Now, Point
from crinoid.report.solids import Solid
from crinoid.report.surface import AROUND, Facets, perpendicular, turned_body

HULL, STEEL, STONE, TOOL = "#C7D1D6", "#75858F", "#C2B8A8", "#B87399"
SOCKET = "#74848E"
CLAMP = 4.0  # its length, of the arm's radius

_BALL = np.linspace(0.0, np.pi, 13)
_RING = 0.05  # of the arm's length: pieces of what is long, so that all is sorted by distance


def mount_parts(now: Now, moving: Moving, space: Space) -> Iterator[tuple[Facets, str]]:
    """Yield the submarine, the boom that its servos shift, the joint and the clamp.

    They are those of the page: the submarine's size is not that of the user's.
    """
    length, thick = space.length, float(moving.diameter[0]) / 2
    root = now.position[0]
    a, b = min(0.34 * length, 6.0), min(0.075 * length, 1.5)
    out = np.array([a * a, b * b, b * b]) * space.ahead
    out = out / (math.hypot(*(np.array([a, b, b]) * space.ahead)) or 1.0)
    middle = now.anchor - now.frame @ out
    bow, port = now.frame[:, 0], now.frame[:, 1]
    yield turned_body(middle, bow, -a * np.cos(_BALL), b * np.sin(_BALL), port), HULL
    if np.linalg.norm(root - now.anchor) > 0.2 * thick:
        yield rod(now.anchor, root, 0.6 * thick, length), STEEL
    yield ball(root, 1.35 * thick), STEEL
    clamp = rod(root, root + CLAMP * thick * now.ahead, 1.18 * thick, length)
    yield clamp[:-AROUND], STEEL
    yield clamp[-AROUND:], SOCKET  # the end of it, out of which the arm comes


def tool_parts(now: Now, moving: Moving, space: Space) -> Iterator[tuple[Facets, str]]:
    """Yield the tool on its stem, while the tip carries it."""
    if moving.tool is None or not now.held:
        return
    radius, offset = moving.tool
    before, tip = now.position[-2:]
    ahead = (tip - before) / (np.linalg.norm(tip - before) or 1.0)
    if offset > radius:
        yield rod(tip, tip + offset * ahead, 0.2 * radius, space.length), STEEL
    yield ball(tip + offset * ahead, radius), TOOL


def obstacle_surface(solid: Solid, place: Point, size: float, *, spatial: bool) -> Facets:
    """Facets of an obstacle that is round, at a place: no more of it than is to be seen (m)."""
    half = solid.half_axis
    long = float(np.linalg.norm(half))
    if long == 0.0:
        return ball(place, solid.radius)
    unit = half / long
    if not spatial and abs(unit[1]) > 0.9:
        long = min(long, 0.06 * size)
    long = min(long, size)
    if solid.kind == "capsule":
        cap = np.linspace(0.0, np.pi / 2, 7)
        straight = np.linspace(-long, long, 2 + int(2 * long / (_RING * size)))[1:-1]
        along = np.concatenate(
            [-long - solid.radius * np.cos(cap), straight, long + solid.radius * np.sin(cap)]
        )
        around = solid.radius * np.concatenate([np.sin(cap), np.ones(straight.size), np.cos(cap)])
        return turned_body(place, unit, along, around, perpendicular(unit))
    return rod(place - long * unit, place + long * unit, solid.radius, size)


def ball(place: Point, radius: float) -> Facets:
    """Facets of a ball."""
    along, around = -radius * np.cos(_BALL), radius * np.sin(_BALL)
    return turned_body(place, np.array([1.0, 0.0, 0.0]), along, around, np.array([0.0, 1.0, 0.0]))


def rod(begin: Point, end: Point, radius: float, size: float) -> Facets:
    """Facets of a rod with flat ends, in pieces that are short beside a size (m)."""
    way = end - begin
    long = float(np.linalg.norm(way)) or 1e-12
    unit = way / long
    along = np.linspace(0.0, long, 2 + int(long / (_RING * size)))
    around = np.full(along.size, radius)
    along = np.concatenate([along[:1], along, along[-1:]])
    around = np.concatenate([[0.0], around, [0.0]])
    return turned_body(begin, unit, along, around, perpendicular(unit))
