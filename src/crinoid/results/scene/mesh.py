"""Tessellations: bodies of revolution, plates and the tube of an arm, as faces of four corners."""

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from crinoid.results.scene.data import SolidShape

AROUND = 24  # corners of a ring
_MOST_RINGS = 200  # most rings along a rod or capsule: one may be far longer than the arm
_ARC = 9  # least number of rings from the pole of a ball to its equator, a quarter of the largest

Vectors = Float[np.ndarray, "... axis=3"]
Rotations = Float[np.ndarray, "... axis=3 axis=3"]
"""Rotation matrices; their columns are the directions of the body's own x, y and z."""
Facets = Float[np.ndarray, "facet corner=4 axis=3"]
Profile = Float[np.ndarray, "ring 4"]
"""For each ring its place along the axis, its radius (m), and both components of its normal."""


@dataclass(frozen=True)
class Mesh:
    """Points, their unit normals, and faces whose corners go counter-clockwise seen from outside.

    At the pole of a body of revolution two corners of a face coincide.
    """

    points: Float[np.ndarray, "point axis=3"]
    normals: Float[np.ndarray, "point axis=3"]
    faces: Int[np.ndarray, "face corner=4"]

    @property
    def triangles(self) -> Int[np.ndarray, "triangle corner=3"]:
        """The faces as triangles of three different points."""
        found = np.concatenate([self.faces[:, [0, 1, 2]], self.faces[:, [0, 2, 3]]])
        corners = self.points[found]
        same = (corners == np.roll(corners, 1, axis=1)).all(axis=2).any(axis=1)
        return found[~same]

    @property
    def facets(self) -> Facets:
        """The corners of the faces (m)."""
        return self.points[self.faces]


@dataclass(frozen=True)
class BodyShape:
    """A rigid body's shape about its origin; x is its axis."""

    kind: Literal["ellipsoid", "capsule", "rod", "plate", "solid"]
    """An ellipsoid of revolution, a cylinder with round or with flat ends, a square, or a solid."""
    half: float  # half of its length along x (m): of a capsule without its ends, of a plate zero
    radius: float  # radius across x (m); of a plate half a side
    solid: SolidShape | None = None

    def mesh(self, longest: float = math.inf) -> Mesh:
        """Return its surface; faces are no longer than a length (m), if possible."""
        if self.solid is not None:
            return _solid_mesh(self.solid)
        if self.kind == "plate":
            corners = self.radius * np.array([[0.0, -1, -1], [0, 1, -1], [0, 1, 1], [0, -1, 1]])
            return Mesh(corners, np.tile([1.0, 0.0, 0.0], (4, 1)), np.arange(4)[None])
        return revolve(self._profile(longest))

    def _profile(self, longest: float) -> Profile:
        straight = 0.0 if self.kind == "ellipsoid" else self.half
        along = np.linspace(-straight, straight, 2 + int(min(2 * straight / longest, _MOST_RINGS)))
        if self.kind == "rod":
            ends = np.array([[-self.half, -1.0], [self.half, 1.0]])
            flat = [[(at, 0.0, out, 0.0), (at, self.radius, out, 0.0)] for at, out in ends]
            side = [(at, self.radius, 0.0, 1.0) for at in along]
            return np.array([*flat[0], *side, *flat[1][::-1]])
        end = self.radius if self.kind == "capsule" else self.half
        rings = int(np.clip(np.pi / 2 * max(end, self.radius) / longest + 1, _ARC, 4 * _ARC))
        turn = np.linspace(0.0, np.pi / 2, rings)
        angle = np.concatenate([turn - np.pi / 2, np.zeros(along.size - 2), turn])
        middle = np.concatenate([np.full(rings, -straight), along[1:-1], np.full(rings, straight)])
        sine, cosine = np.sin(angle), np.cos(angle)
        normal = np.stack([sine * self.radius, cosine * end], axis=1)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        profile = np.column_stack([middle + end * sine, self.radius * cosine, normal])
        profile[[0, -1], 1] = 0.0
        # both halves of an ellipsoid share the ring at its equator
        return profile if straight else np.delete(profile, rings, axis=0)


def _solid_mesh(solid: SolidShape) -> Mesh:
    """Return triangles as faces whose last two corners coincide, with the mean normals of each."""
    points, facets = solid.points, solid.facets
    a, b, c = np.moveaxis(points[facets], 1, 0)
    normals = np.zeros_like(points)
    np.add.at(normals, facets, np.cross(b - a, c - a)[:, None])
    return Mesh(points, unit_vectors(normals), facets[:, [0, 1, 2, 2]])


def revolve(profile: Profile) -> Mesh:
    """Revolve a line about x; a ring begins at +y, and +z is a quarter of a turn on."""
    turn = 2 * np.pi * np.arange(AROUND) / AROUND
    around = np.stack([np.zeros(AROUND), np.cos(turn), np.sin(turn)], axis=1)
    along, radius, forward, outward = profile.T[:, :, None, None]
    axis = np.array([1.0, 0.0, 0.0])
    points = along * axis + radius * around
    normals = forward * axis + outward * around
    apart = (np.diff(profile[:, :2], axis=0) != 0.0).any(axis=1)  # not so at a sharp edge
    return Mesh(points.reshape(-1, 3), normals.reshape(-1, 3), _faces(len(profile), apart))


def tube(position: Vectors, radius: Float[np.ndarray, " node"], attitude: Rotations) -> Mesh:
    """Return the surface of an arm with flat ends, with a ring at each node.

    The first face of a ring is centred on the second column of the attitude, the director m_1.
    """
    turn = 2 * np.pi * (np.arange(AROUND) - 0.5) / AROUND
    circle = np.stack([np.cos(turn), np.sin(turn)])
    around = np.swapaxes(attitude[..., 1:] @ circle, 1, 2)
    rings = position[:, None] + radius[:, None, None] * around
    ends = np.repeat(position[[0, -1], None], AROUND, axis=1)
    out = np.repeat(attitude[[0, -1], None, :, 0], AROUND, axis=1)
    points = np.concatenate([ends[:1], rings, ends[1:]]).reshape(-1, 3)
    normals = np.concatenate([-out[:1], around, out[1:]]).reshape(-1, 3)
    return Mesh(points, normals, _faces(len(position) + 2))


def _faces(rings: int, shown: np.ndarray | slice = np.s_[:]) -> Int[np.ndarray, "face corner=4"]:
    """Return the faces between each two rings, or only those of gaps that are shown."""
    corner = np.arange(rings * AROUND).reshape(rings, AROUND)
    there = np.roll(corner, -1, axis=1)
    faces = np.stack([corner[:-1], there[:-1], there[1:], corner[1:]], axis=-1)
    return faces[shown].reshape(-1, 4)


def at_nodes(edges: Float[np.ndarray, "time edge *rest"]) -> Float[np.ndarray, "time node *rest"]:
    """Return values of edges at nodes: the mean of both edges, at an end that of its edge."""
    return np.concatenate([edges[:, :1], (edges[:, 1:] + edges[:, :-1]) / 2, edges[:, -1:]], axis=1)


def arm_facets(position: Vectors, diameter: Float[np.ndarray, " node"], director: Any) -> Facets:
    """Return the facets of an arm of nodes (m), whose director m_1 is known or None."""
    attitude = arm_attitudes(position[None], None if director is None else director[None])[0]
    return tube(position, diameter / 2, attitude).facets


def arm_attitudes(position: Vectors, director: Vectors | None) -> Rotations:
    """Return the attitude of the arm at its nodes: columns t, m_1 and m_2.

    Where no director m_1 is known it is +y at the root, as of a planar arm, and is carried from
    node to node without twist.
    """
    edges = unit_vectors(np.diff(position, axis=1))
    tangent = at_nodes(edges)
    # two edges that point against each other have no mean
    tangent[:, 1:-1][np.linalg.norm(tangent[:, 1:-1], axis=-1) < 1e-9] = np.nan
    tangent[:, :-1] = np.where(np.isnan(tangent[:, :-1]), edges, tangent[:, :-1])
    tangent = unit_vectors(tangent)
    if director is not None:
        return look_rotation(tangent, at_nodes(director))
    aside = np.broadcast_to([0.0, 1.0, 0.0], tangent.shape)
    if tangent[..., 1].any():  # else all are across +y
        carried = [aside[:, 0]]
        for node in range(tangent.shape[1]):
            carried.append(_across(tangent[:, node], carried[-1]))
        aside = np.stack(carried[1:], axis=1)
    return look_rotation(tangent, aside)


def look_rotation(forward: Vectors, aside: Vectors) -> Rotations:
    """Return rotations that bring x to unit vectors and y as near to others as possible.

    Where these are parallel, y is brought to some direction across.
    """
    across = _across(forward, aside)
    return np.stack([forward, across, np.cross(forward, across)], axis=-1)


def _across(forward: Vectors, aside: Vectors) -> Vectors:
    """Return unit vectors across others, as near to third ones as possible."""
    across = aside - np.sum(aside * forward, axis=-1, keepdims=True) * forward
    length = np.sqrt(np.sum(across**2, axis=-1, keepdims=True))
    parallel = length < 1e-6
    if not parallel.any():
        return across / length
    other = np.eye(3)[np.argmin(np.abs(forward), axis=-1)]
    return unit_vectors(np.where(parallel, np.cross(forward, other), across))


def quaternions(turn: Rotations) -> Float[np.ndarray, "time 4"]:
    """Return quaternions x, y, z, w of rotations over time, without jumps in sign."""
    found = Rotation.from_matrix(turn).as_quat()
    same = np.where(np.sum(found[1:] * found[:-1], axis=1) < 0.0, -1.0, 1.0)
    found[1:] *= np.cumprod(same)[:, None]
    return np.asarray(found)


def unit_vectors(vectors: Vectors) -> Vectors:
    """Return vectors of length one along others; zero where these are."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0.0)
