"""The arm as one surface that its nodes bend, for programs that animate: a skin and its joints."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Float, Int

from crinoid.export.mesh import AROUND, Mesh, revolved
from crinoid.export.pose import Turns, attitudes_of
from crinoid.pieces import chosen_pieces
from crinoid.report.charts.space import Moving, evenly

_RINGS = 80
"""About how many rings the surface has."""

Numbers = Float[np.ndarray, " ring"]


@dataclass(frozen=True)
class Skin:
    """The straight arm along +x, and how it hangs on its nodes.

    Each point hangs on two nodes: between them it is where both would have it, the nearer one more
    so, which makes a smooth surface through rings that stand at the nodes.
    """

    mesh: Mesh
    rest: Float[np.ndarray, " node"]
    """Where the nodes are along the straight arm (m)."""
    nodes: Int[np.ndarray, "point 2"]
    weights: Float[np.ndarray, "point 2"]


def skin_of(moving: Moving, arc_length: Float[np.ndarray, " node"]) -> Skin:
    """Return the skin of an arm whose nodes are at some lengths along it (m)."""
    edges = arc_length.size - 1
    each = max(1, math.ceil(_RINGS / edges))
    share = np.append(np.tile(np.arange(each) / each, edges), 1.0)
    first = np.append(np.repeat(np.arange(edges), each), edges - 1)
    # weights that begin and end level let the surface pass the nodes without a kink
    second = share**2 * (3.0 - 2.0 * share)
    along = arc_length[first] + share * np.diff(arc_length)[first]
    radius = np.interp(along, arc_length, moving.diameter / 2)
    sides = np.stack([along, radius, np.zeros_like(along), np.ones_like(along)], axis=1)
    ends = [(along[0], 0.0, -1.0, 0.0), (along[0], radius[0], -1.0, 0.0)]
    begins = [(along[-1], radius[-1], 1.0, 0.0), (along[-1], 0.0, 1.0, 0.0)]
    mesh = revolved(np.concatenate([ends, sides, begins]))
    rings = np.concatenate([[0, 0], np.arange(along.size), [along.size - 1] * 2])
    point = np.repeat(rings, AROUND)
    nodes = np.stack([first, first + 1], axis=1)[point]
    return Skin(mesh, arc_length, nodes, np.stack([1.0 - second, second], axis=1)[point])


def attitudes_at(data: xr.Dataset, moving: Moving) -> Turns:
    """Return the attitude of the arm over time at the nodes that are shown."""
    director = None
    if "director" in data:
        pieces = chosen_pieces(data, ["director"], moving.at)
        director = np.concatenate([piece["director"].values for piece in pieces])
    chosen = evenly(data.sizes["node"], moving.diameter.size)
    return attitudes_of(moving.position, None if director is None else director[:, chosen[:-1]])


def arc_length_of(data: xr.Dataset, moving: Moving) -> Float[np.ndarray, " node"]:
    """Return how far along the arm the nodes are that are shown (m)."""
    if "arc_length" in data:
        chosen = evenly(data.sizes["node"], moving.diameter.size)
        return np.asarray(data["arc_length"].values, float)[chosen]
    steps = np.linalg.norm(np.diff(moving.position[0], axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])
