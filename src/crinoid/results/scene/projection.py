"""The views of the figures: three parallel projections and one in perspective.

Lengths compare within a parallel projection. A planar arm has y = 0 and is drawn from the side.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.foundation.axes import AXES
from crinoid.results.scene.data import in_space

Triple = tuple[float, float, float]
PaperPoint = Float[np.ndarray, "axis=2"]
PaperPoints = Float[np.ndarray, "... axis=2"]


@dataclass(frozen=True)
class View:
    """A projection: the directions of both axes of the paper, unit vectors."""

    name: str
    across: Triple
    up: Triple
    centre: Triple = (0.0, 0.0, 0.0)
    """Point of view, where lengths across the view are true (m)."""
    far: float = math.inf
    """Distance of the eye from there (m); at infinity the projection is parallel."""

    @staticmethod
    def at(name: str, azimuth: float, elevation: float, centre: Triple, far: float) -> "View":
        """Return a view from an azimuth, from ahead toward port, and an elevation (deg)."""
        yaw, pitch = math.radians(azimuth), math.radians(elevation)
        across = (-math.sin(yaw), math.cos(yaw), 0.0)
        toward = math.cos(pitch) * math.cos(yaw), math.cos(pitch) * math.sin(yaw), math.sin(pitch)
        x, y, z = map(float, np.cross(toward, across))
        return View(name, across, (x, y, z), centre, far)

    @property
    def axes(self) -> list[int]:
        """Axes of space along those of the paper; empty for an oblique view."""
        return [axis.index(1.0) for axis in (self.across, self.up) if 1.0 in axis]

    @property
    def labels(self) -> list[str]:
        """Labels of the axes of the paper."""
        return [f"{AXES[3][axis]} (m)" for axis in self.axes]

    @property
    def plane(self) -> Float[np.ndarray, "2 axis=3"]:
        """Directions of both axes of the paper."""
        return np.array([self.across, self.up])

    @property
    def toward(self) -> Float[np.ndarray, "axis=3"]:
        """Direction from the centre to the eye."""
        return np.cross(self.across, self.up)

    def paper(self, points: Float[np.ndarray, "*shape axis=3"]) -> Float[np.ndarray, "*shape 2"]:
        """Points of space on paper, across before up; vectors too where the eye is at infinity."""
        centre = np.asarray(self.plane @ self.centre)
        nearer = 1.0 - (points - self.centre) @ self.toward / self.far
        return np.asarray(centre + (points @ self.plane.T - centre) / nearer[..., None])

    def sight(
        self, points: Float[np.ndarray, "*shape axis=3"]
    ) -> Float[np.ndarray, "*shape axis=3"]:
        """Lines from points to the eye, in units of its distance from the centre."""
        return np.asarray(self.toward - (points - self.centre) / self.far)

    def lit(
        self,
        colours: Float[np.ndarray, "facet 4"],
        normal: Float[np.ndarray, "facet axis=3"],
        dark: float,
    ) -> Float[np.ndarray, "facet 4"]:
        """Colours of facets lit from the upper left, of the brightness ``dark`` in shadow.

        A facet without area, such as a line, has its own colour.
        """
        light = self.toward + 0.8 * np.array(self.up) - 0.6 * np.array(self.across)
        area = np.linalg.norm(normal, axis=1)
        toward = normal @ light / (np.where(area, area, 1.0) * np.linalg.norm(light))
        bright = np.where(area, dark + (1.0 - dark) * np.maximum(toward, 0.0), 1.0)
        return np.column_stack([colours[:, :3] * bright[:, None], colours[:, 3]])

    def depth(self, points: Float[np.ndarray, "*shape axis=3"]) -> Float[np.ndarray, "*shape"]:
        """Nearness of points to the eye (m), in the order of their distances from it.

        That order is the one of the squares, -``far`` / 2 times which, and a constant, is finite
        for an eye at infinity too.
        """
        behind = np.sum((points - self.centre) ** 2, axis=-1) / (2.0 * self.far)
        return np.asarray(points @ self.toward - behind)

    def lift(self, points: Float[np.ndarray, "*shape 2"]) -> Float[np.ndarray, "*shape axis=3"]:
        """Points of the paper as points of space."""
        return np.asarray(points @ self.plane)

    def project(self, dataset: xr.Dataset, name: str) -> Float[np.ndarray, "*shape 2"]:
        """Values of a vector variable on paper, the axis last."""
        return self.paper(in_space(dataset, name))


SIDE = View("from the side", (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
ABOVE = View("from above", (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
AHEAD = View("from ahead", (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

OBLIQUE = View.at("at an angle", -58.0, 27.0, (0.0, 0.0, 0.0), math.inf)
"""From ahead, starboard and above: x goes to the right, y into the depth."""

_FAR = 4.5  # distance of the eye for a gentle perspective, of the largest side of the box


def perspective(low: Float[np.ndarray, "axis=3"], high: Float[np.ndarray, "axis=3"]) -> View:
    """Return the oblique view of a box in true perspective."""
    x, y, z = map(float, (low + high) / 2)
    return replace(
        OBLIQUE, name="in perspective", centre=(x, y, z), far=_FAR * float((high - low).max())
    )


def left_of(vectors: Float[np.ndarray, "*shape 2"]) -> Float[np.ndarray, "*shape 2"]:
    """Return unit vectors a quarter turn to the left; zero where a vector is zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    turned = np.stack([-vectors[..., 1], vectors[..., 0]], axis=-1)
    return np.divide(turned, length, out=np.zeros_like(turned), where=length > 0)
