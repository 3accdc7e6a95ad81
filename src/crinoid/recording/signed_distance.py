"""Signed distances from triangles, exact near the surface."""

import numpy as np
from jaxtyping import Float
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

_FIRST = 8  # number of triangles that a point is compared with at first
_AT_ONCE = 400_000  # number of pairs of points and triangles that are compared at once
_TIE = 1e-9  # relative difference of squared distances to triangles that share a nearest point

Points = Float[np.ndarray, "point axis=3"]
Distances = Float[np.ndarray, " point"]


class Triangles:
    """Triangles of a closed surface, which may be segments of a closed line.

    Parameters
    ----------
    corners
        Corners (m); the last two of a segment are equal.
    normals
        Outward unit normals; of a segment across it.
    """

    def __init__(
        self,
        corners: Float[np.ndarray, "triangle corner=3 axis=3"],
        normals: Float[np.ndarray, "triangle axis=3"],
    ) -> None:
        self._corners, self._normals = corners, normals
        middles = corners.mean(axis=1)
        self._reach = float(np.linalg.norm(corners - middles[:, None], axis=2).max())
        self._tree = cKDTree(middles)

    def distance(self, points: Points, within: float = np.inf) -> Distances:
        """Return signed distances (m), negative inside, exact up to a distance ``within`` (m)."""
        found, count = np.full(len(points), np.inf), min(_FIRST, len(self._corners))
        left = np.arange(len(points))
        while left.size:
            still = []
            for part in np.array_split(left, 1 + left.size * count // _AT_ONCE):
                apart, near = self._tree.query(points[part], k=count)
                apart, near = apart.reshape(-1, count), near.reshape(-1, count)
                found[part] = best = self._least(points[part], near)
                # one that is left out may be nearer by its size
                unsure = (apart[:, -1] < np.abs(best) + self._reach) & (np.abs(best) < within)
                still.append(part[unsure])
            left = np.concatenate(still) if count < len(self._corners) else left[:0]
            count = min(4 * count, len(self._corners))
        return found

    def _least(self, points: Points, near: np.ndarray) -> Distances:
        from trimesh.triangles import closest_point  # slow to load, and few need it

        pairs = np.repeat(points, near.shape[1], axis=0)
        apart = pairs - closest_point(self._corners[near.ravel()], pairs)
        squared = np.sum(apart**2, axis=1).reshape(near.shape)
        height = np.sum(apart * self._normals[near.ravel()], axis=1).reshape(near.shape)
        least = squared.min(axis=1, keepdims=True)
        # of those that share the nearest point, the one whose plane is farthest knows the side
        shared = squared <= least + _TIE * self._reach**2 + _TIE * least
        chosen = np.argmax(np.where(shared, np.abs(height), -1.0), axis=1)
        side = np.sign(np.take_along_axis(height, chosen[:, None], axis=1)[:, 0])
        return np.where(side < 0, -1.0, 1.0) * np.sqrt(least[:, 0])

    def on_grid(
        self, axes: list[Float[np.ndarray, " _"]], within: float
    ) -> Float[np.ndarray, "..."]:
        """Return signed distances (m) on a grid of x, y and z, exact up to ``within`` (m).

        It must be several spacings, as the sign farther away is that of the nearest point within.
        """
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        found = self.distance(points.reshape(-1, 3), within).reshape(points.shape[:3])
        near = np.abs(found) < within
        nearest = distance_transform_edt(~near, return_distances=False, return_indices=True)
        return np.copysign(found, found[tuple(nearest)])
