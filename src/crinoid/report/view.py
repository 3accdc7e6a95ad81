"""The views that shapes are drawn in: the only place that knows how space meets paper.

Three are parallel projections along an axis, so lengths compare within one; the fourth is in
perspective. A planar arm has y = 0 and lives in the view from the side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.space import AXES

_AXES = AXES[3]


@dataclass(frozen=True)
class View:
    """A way to look at space: where two axes of the paper point, which are of length one."""

    name: str
    across: tuple[float, float, float]
    up: tuple[float, float, float]
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Point that the eye looks at, where lengths across the view are true (m)."""
    far: float = math.inf
    """How far the eye is from there (m); from infinity the projection is parallel."""

    @property
    def axes(self) -> list[int]:
        """Which axes of space are those of the paper; none of an oblique view."""
        return [axis.index(1.0) for axis in (self.across, self.up) if 1.0 in axis]

    @property
    def labels(self) -> list[str]:
        """Labels of the axes of the paper."""
        return [f"{_AXES[axis]} (m)" for axis in self.axes]

    @property
    def toward(self) -> Float[np.ndarray, "axis=3"]:
        """Direction from the centre to the eye."""
        return np.cross(self.across, self.up)

    def paper(self, points: Float[np.ndarray, "*shape axis=3"]) -> Float[np.ndarray, "*shape 2"]:
        """Points of space on paper, across before up; vectors too where the eye is at infinity."""
        plane = np.array([self.across, self.up])
        centre = np.asarray(plane @ self.centre)
        nearer = 1.0 - (points - self.centre) @ self.toward / self.far
        return np.asarray(centre + (points @ plane.T - centre) / nearer[..., None])

    def sight(
        self, points: Float[np.ndarray, "*shape axis=3"]
    ) -> Float[np.ndarray, "*shape axis=3"]:
        """Lines from points to the eye, in units of its distance from the centre."""
        return np.asarray(self.toward - (points - self.centre) / self.far)

    def depth(self, points: Float[np.ndarray, "*shape axis=3"]) -> Float[np.ndarray, "*shape"]:
        """How near points are to the eye (m), in the order of their distances from it.

        That order is the one of the squares, -``far`` / 2 times which, and a constant, is finite
        for an eye at infinity too.
        """
        behind = np.sum((points - self.centre) ** 2, axis=-1) / (2.0 * self.far)
        return np.asarray(points @ self.toward - behind)

    def lift(self, points: Float[np.ndarray, "*shape 2"]) -> Float[np.ndarray, "*shape axis=3"]:
        """Points of the paper as points of space."""
        return np.asarray(points @ np.array([self.across, self.up]))

    def project(self, dataset: xr.Dataset, name: str) -> Float[np.ndarray, "*shape 2"]:
        """Values of a vector variable on paper, the axis last."""
        return self.paper(in_space(dataset, name))


SIDE = View("from the side", (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
ABOVE = View("from above", (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
AHEAD = View("from ahead", (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

_AZIMUTH, _ELEVATION = math.radians(-58.0), math.radians(27.0)
OBLIQUE = View(
    "at an angle",
    (-math.sin(_AZIMUTH), math.cos(_AZIMUTH), 0.0),
    (
        -math.sin(_ELEVATION) * math.cos(_AZIMUTH),
        -math.sin(_ELEVATION) * math.sin(_AZIMUTH),
        math.cos(_ELEVATION),
    ),
)
"""From ahead, starboard and above: x goes to the right, y into the depth."""

_FAR = 4.5  # the eye's distance, of the largest side of what it sees: a gentle perspective


def perspective(low: Float[np.ndarray, "axis=3"], high: Float[np.ndarray, "axis=3"]) -> View:
    """Give the view at an angle of a box from an eye nearby, in true perspective."""
    x, y, z = map(float, (low + high) / 2)
    return replace(
        OBLIQUE, name="in perspective", centre=(x, y, z), far=_FAR * float((high - low).max())
    )


def is_spatial(dataset: xr.Dataset) -> bool:
    """Whether the arm moves in space rather than in a plane."""
    return "y" in {str(label) for label in dataset["axis"].values}


def in_space(dataset: xr.Dataset, name: str) -> Float[np.ndarray, "*shape axis=3"]:
    """Values of a vector variable, the axis last; what is planar has y = 0."""
    vector = np.asarray(dataset[name].transpose(..., "axis").values, dtype=float)
    whole = np.zeros((*vector.shape[:-1], 3))
    whole[..., [_AXES.index(str(label)) for label in dataset["axis"].values]] = vector
    return whole


def arm_length(data: xr.Dataset) -> float:
    """Length of the arm's first recorded shape in m, never zero."""
    steps = np.diff(in_space(data, "position")[0], axis=0)
    return float(np.linalg.norm(steps, axis=-1).sum()) or 1.0


def left_of(vectors: Float[np.ndarray, "*shape 2"]) -> Float[np.ndarray, "*shape 2"]:
    """Give unit vectors turned a quarter from across toward up; zero where a vector is zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    turned = np.stack([-vectors[..., 1], vectors[..., 0]], axis=-1)
    return np.divide(turned, length, out=np.zeros_like(turned), where=length > 0)


def outline(
    points: Float[np.ndarray, "node 2"], diameter: Float[np.ndarray, " node"]
) -> Float[np.ndarray, "corner 2"]:
    """Corners of the band of the given diameter about a line of points, all in m."""
    aside = left_of(np.gradient(points, axis=0)) * diameter[:, None] / 2
    return np.concatenate([points + aside, (points - aside)[::-1]])


def convex_outline(points: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "corner 2"]:
    """Corners of the smallest convex shape around points (Andrew 1979, monotone chains)."""
    ordered = np.unique(points, axis=0)
    chains = []
    for line in (ordered, ordered[::-1]):
        chain: list[np.ndarray] = []
        for point in line:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], point) <= 0.0:
                chain.pop()
            chain.append(point)
        chains += chain[:-1]
    return np.array(chains)


def _turn(first: np.ndarray, middle: np.ndarray, last: np.ndarray) -> float:
    (a, b), (c, d) = middle - first, last - middle
    return float(a * d - b * c)
