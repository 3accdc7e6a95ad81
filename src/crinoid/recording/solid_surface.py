"""Surfaces of solids of files: for contact a spline, for drawing triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import map_coordinates

from crinoid.recording.solid_shapes import Facets, Points


@dataclass(frozen=True)
class SplineOnGrid:
    """Cubic B-spline on a regular grid, as `crinoid.numerics.grid_spline.GridSpline` has it."""

    coefficients: Float[np.ndarray, ...]
    origin: Float[np.ndarray, " axes"]  # place of the first value (m)
    spacing: Float[np.ndarray, " axes"]  # distance of the values along each axis (m)

    def at(self, places: Float[np.ndarray, "... axes"]) -> Float[np.ndarray, ...]:
        """Return the values at places (m); outside of the grid those at its ends."""
        steps = (places - self.origin) / self.spacing
        inside = np.clip(steps, 1, np.array(self.coefficients.shape) - 2)
        found = map_coordinates(
            self.coefficients, np.moveaxis(inside, -1, 0), order=3, prefilter=False
        )
        return np.asarray(found)


@dataclass(frozen=True)
class SolidSurface:
    """Surface of a solid, relative to its position."""

    spline: SplineOnGrid
    heights: bool  # whether the spline is of heights, not of signed distances (m)
    points: Points  # corners of the triangles by which it is drawn (m)
    facets: Facets
    notes: tuple[str, ...]
