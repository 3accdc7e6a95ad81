"""The plane that shapes are drawn in: the only place that knows how space meets paper.

A planar arm lives in this plane. Of a spatial arm it is the side view.
"""

from __future__ import annotations

import numpy as np
import xarray as xr
from jaxtyping import Float

ACROSS = "x"
UP = "z"
LABELS = (f"{ACROSS} (m)", f"{UP} (m)")


def project(dataset: xr.Dataset, name: str) -> Float[np.ndarray, "*shape axis=2"]:
    """Values of a vector variable in the plane, the axis last, across before up."""
    vector = dataset[name].sel(axis=[ACROSS, UP]).transpose(..., "axis")
    return np.asarray(vector.values, dtype=float)


def direction(angle: float) -> Float[np.ndarray, "axis=2"]:
    """Give the unit vector at an angle in rad, from across toward up."""
    return np.array([np.cos(angle), np.sin(angle)])


def left_of(vectors: Float[np.ndarray, "*shape axis=2"]) -> Float[np.ndarray, "*shape axis=2"]:
    """Give unit vectors turned a quarter from across toward up; zero where a vector is zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    turned = np.stack([-vectors[..., 1], vectors[..., 0]], axis=-1)
    return np.divide(turned, length, out=np.zeros_like(turned), where=length > 0)


def outline(
    points: Float[np.ndarray, "node axis=2"], diameter: Float[np.ndarray, " node"]
) -> Float[np.ndarray, "corner axis=2"]:
    """Corners of the band of the given diameter about a line of points, all in m."""
    aside = left_of(np.gradient(points, axis=0)) * diameter[:, None] / 2
    return np.concatenate([points + aside, (points - aside)[::-1]])
