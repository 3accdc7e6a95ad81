"""Surfaces of what a scene shows, as points and triangles."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

__all__ = ["Triangles", "capsule", "quaternion", "tube", "tube_triangles", "turned"]

Points = Float[np.ndarray, "point axis=3"]
Triangles = Int[np.ndarray, "triangle corner=3"]

SIDES = 20
"""Corners of a section."""
_FINER = 4
"""Sections for each edge of an arm."""
_CAP = 5
"""Sections of a round end."""


def tube(nodes: Float[np.ndarray, "node axis=3"], radius: Float[np.ndarray, " node"]) -> Points:
    """Return the corners of a tube around a smooth line through nodes, with a round far end.

    ``nodes`` (m), ``radius`` at each (m). The corners of a section follow each other, and sections
    do, as `tube_triangles` has it.
    """
    line, radii = _smooth(nodes, radius)
    tangent = np.gradient(line, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    turn = np.linspace(0.0, np.pi / 2, _CAP + 1)[1:]
    end = line[-1] + radii[-1] * np.outer(np.sin(turn), tangent[-1])
    line = np.concatenate([line, end])
    radii = np.concatenate([radii, radii[-1] * np.cos(turn)])
    tangent = np.concatenate([tangent, np.repeat(tangent[-1:], _CAP, axis=0)])
    first, second = _sides(tangent)
    angle = np.linspace(0.0, 2 * np.pi, SIDES, endpoint=False)
    around = np.cos(angle)[:, None] * first[:, None] + np.sin(angle)[:, None] * second[:, None]
    return (line[:, None] + radii[:, None, None] * around).reshape(-1, 3)


def tube_triangles(nodes: int) -> Triangles:
    """Return the triangles of a tube around so many nodes."""
    return _between((nodes - 1) * _FINER + 1 + _CAP)


def capsule(half_axis: Float[np.ndarray, "axis=3"], radius: float) -> tuple[Points, Triangles]:
    """Return a rod with round ends about the origin; ``half_axis`` and ``radius`` in m."""
    half = np.linalg.norm(half_axis)
    axis = half_axis / half
    turn = np.linspace(-np.pi / 2, np.pi / 2, 2 * (_CAP + 3))
    along = radius * np.sin(turn) + np.where(turn > 0, half, -half)
    first, second = _sides(axis[None])
    angle = np.linspace(0.0, 2 * np.pi, 2 * SIDES, endpoint=False)
    around = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
    sections = along[:, None, None] * axis + radius * np.cos(turn)[:, None, None] * around
    return sections.reshape(-1, 3), _between(len(turn), 2 * SIDES)


def quaternion(axis: Float[np.ndarray, "axis=3"]) -> tuple[float, float, float, float]:
    """Return the turn (w, x, y, z) that brings +z to a direction."""
    x, y, z = axis / np.linalg.norm(axis)
    if z < -1 + 1e-9:
        return 0.0, 1.0, 0.0, 0.0
    found = np.array([1 + z, -y, x, 0.0])
    w, i, j, k = found / np.linalg.norm(found)
    return float(w), float(i), float(j), float(k)


def turned(points: Points, axis: Float[np.ndarray, "axis=3"]) -> Points:
    """Return points turned about the origin, so that +z comes to point along an axis."""
    w, *vector = quaternion(axis)
    across = np.cross(vector, points)
    return points + 2 * w * across + 2 * np.cross(vector, across)


def _between(sections: int, sides: int = SIDES) -> Triangles:
    """Return the triangles between sections that follow each other."""
    start = sides * np.arange(sections - 1)[:, None]
    here = np.arange(sides)
    there = (here + 1) % sides
    one = np.stack([start + here, start + there, start + sides + here], axis=-1)
    other = np.stack([start + there, start + sides + there, start + sides + here], axis=-1)
    return np.concatenate([one.reshape(-1, 3), other.reshape(-1, 3)])


def _smooth(
    nodes: Float[np.ndarray, "node axis=3"], radius: Float[np.ndarray, " node"]
) -> tuple[Points, Float[np.ndarray, " point"]]:
    """Return points on Catmull and Rom's spline through nodes, and the radius at each."""
    slope = np.gradient(nodes, axis=0)
    share = np.arange(_FINER) / _FINER
    weights = np.stack(
        [
            (1 + 2 * share) * (1 - share) ** 2,
            share * (1 - share) ** 2,
            share**2 * (3 - 2 * share),
            share**2 * (share - 1),
        ]
    )
    parts = np.stack([nodes[:-1], slope[:-1], nodes[1:], slope[1:]])
    line = np.einsum("ks,kna->nsa", weights, parts).reshape(-1, 3)
    at = np.arange((len(nodes) - 1) * _FINER + 1) / _FINER
    return np.concatenate([line, nodes[-1:]]), np.interp(at, np.arange(len(nodes)), radius)


def _sides(tangent: Points) -> tuple[Points, Points]:
    """Return two directions across each of some tangents, which turn along with them."""
    helper = np.array([0.0, 1.0, 0.0])
    if abs(tangent[:, 1]).max() > 0.9:  # y is no guide where the arm points along it
        helper = np.eye(3)[np.argmin(np.abs(tangent).max(axis=0))]
    first = np.cross(helper, tangent)
    size = np.linalg.norm(first, axis=1, keepdims=True)
    first = np.where(size > 1e-9, first / np.maximum(size, 1e-9), np.array([1.0, 0.0, 0.0]))
    return first, np.cross(tangent, first)
