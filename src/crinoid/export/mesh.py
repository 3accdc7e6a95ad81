"""Surfaces of triangles: of what is round about an axis, and of a plate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

AROUND = 24
"""Corners of a ring."""
_ARC = 9
"""Rings from the pole of a ball to its waist."""

Profile = Float[np.ndarray, "ring 4"]
"""A row for each ring: its place along the axis, its radius (m), and both parts of its normal."""


@dataclass(frozen=True)
class Mesh:
    """A surface, seen from outside its triangles turn to the left."""

    points: Float[np.ndarray, "point axis=3"]
    normals: Float[np.ndarray, "point axis=3"]
    triangles: Int[np.ndarray, "triangle 3"]


def revolved(profile: Profile) -> Mesh:
    """Return what a line from left to right gives that is turned about +x.

    A ring begins at +y and goes toward +z, which it reaches after a quarter.
    """
    turn = 2 * np.pi * np.arange(AROUND) / AROUND
    around = np.stack([np.zeros(AROUND), np.cos(turn), np.sin(turn)], axis=1)
    along, radius, ahead, outward = profile.T[:, :, None, None]
    axis = np.array([1.0, 0.0, 0.0])
    points = along * axis + radius * around
    normals = ahead * axis + outward * around
    corner = np.arange(points[..., 0].size).reshape(len(profile), AROUND)
    here, beside = corner[:-1], np.roll(corner, -1, axis=1)[:-1]
    there, across = corner[1:], np.roll(corner, -1, axis=1)[1:]
    apart = (np.diff(profile[:, :2], axis=0) != 0.0).any(axis=1)  # not so at a sharp edge
    near = np.stack([here, beside, across], axis=-1)[apart & (profile[:-1, 1] > 0.0)]
    far = np.stack([here, across, there], axis=-1)[apart & (profile[1:, 1] > 0.0)]
    triangles = np.concatenate([near.reshape(-1, 3), far.reshape(-1, 3)])
    return Mesh(points.reshape(-1, 3), normals.reshape(-1, 3), triangles)


def ball(radius: float) -> Mesh:
    """Return a ball about the origin."""
    return capsule(0.0, radius)


def capsule(half: float, radius: float) -> Mesh:
    """Return a rod along x with round ends, about the origin; ``half`` of it is straight (m)."""
    turn = np.linspace(0.0, np.pi / 2, _ARC)
    ends = [(-half, turn - np.pi / 2), (half, turn)]
    if not half:
        ends[1] = (half, turn[1:])
    parts = [
        np.stack([at + radius * np.sin(a), radius * np.cos(a), np.sin(a), np.cos(a)], axis=1)
        for at, a in ends
    ]
    profile = np.concatenate(parts)
    profile[[0, -1], 1] = 0.0
    return revolved(profile)


def rod(begin: float, end: float, radius: float) -> Mesh:
    """Return a rod along x with flat ends, from a place to another (m)."""
    flat, side = [(-1.0, 0.0), (1.0, 0.0)], (0.0, 1.0)
    return revolved(
        np.array(
            [
                (begin, 0.0, *flat[0]),
                (begin, radius, *flat[0]),
                (begin, radius, *side),
                (end, radius, *side),
                (end, radius, *flat[1]),
                (end, 0.0, *flat[1]),
            ]
        )
    )


def plate(half: float) -> Mesh:
    """Return a square across x, ``half`` a side (m) to each side of the origin."""
    corners = half * np.array([[0.0, -1, -1], [0, 1, -1], [0, 1, 1], [0, -1, 1]])
    return Mesh(corners, np.tile([1.0, 0.0, 0.0], (4, 1)), np.array([[0, 1, 2], [0, 2, 3]]))


def joined(meshes: list[Mesh]) -> Mesh:
    """Return several surfaces as one."""
    before = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    return Mesh(
        np.concatenate([mesh.points for mesh in meshes]),
        np.concatenate([mesh.normals for mesh in meshes]),
        np.concatenate([mesh.triangles + at for mesh, at in zip(meshes, before[:-1], strict=True)]),
    )
