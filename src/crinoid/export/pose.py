"""Attitudes over time: of the arm at its nodes, and of what points along a line."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

Vectors = Float[np.ndarray, "... axis=3"]
Turns = Float[np.ndarray, "... axis=3 axis=3"]
"""Matrices whose columns are where x, y and z of what is turned point to."""


def at_nodes(edges: Float[np.ndarray, "time edge *rest"]) -> Float[np.ndarray, "time node *rest"]:
    """Return what edges have at nodes: the mean of two edges, at an end that of the last one."""
    return np.concatenate([edges[:, :1], (edges[:, 1:] + edges[:, :-1]) / 2, edges[:, -1:]], axis=1)


def attitudes_of(
    position: Float[np.ndarray, "time node axis=3"],
    director: Float[np.ndarray, "time edge axis=3"] | None,
) -> Turns:
    """Return the attitude of the arm at its nodes: columns t, m_1 and m_2.

    Where no director m_1 is known it is +y at the root, as of a planar arm, and goes from node to
    node the shortest way.
    """
    edges = unit_vectors(np.diff(position, axis=1))
    ahead = at_nodes(edges)
    # two edges that point against each other have no mean
    ahead[:, 1:-1][np.linalg.norm(ahead[:, 1:-1], axis=-1) < 1e-9] = np.nan
    ahead[:, :-1] = np.where(np.isnan(ahead[:, :-1]), edges, ahead[:, :-1])
    ahead = unit_vectors(ahead)
    if director is not None:
        return facing(ahead, at_nodes(director))
    found = [facing(ahead[:, 0], np.array([0.0, 1.0, 0.0]))]
    for node in range(1, ahead.shape[1]):
        found.append(facing(ahead[:, node], found[-1][..., 1]))
    return np.stack(found, axis=1)


def facing(ahead: Vectors, aside: Vectors) -> Turns:
    """Return turns that bring x to ``ahead``, of length one, and y as near to ``aside`` as may be.

    Another one across takes the place of an ``aside`` that points along ``ahead``.
    """
    wish = np.broadcast_to(aside, ahead.shape)
    across = wish - np.sum(wish * ahead, axis=-1, keepdims=True) * ahead
    other = np.eye(3)[np.argmin(np.abs(ahead), axis=-1)]
    instead = np.cross(ahead, other)
    along = np.linalg.norm(across, axis=-1, keepdims=True) < 1e-6
    across = unit_vectors(np.where(along, instead, across))
    return np.stack([ahead, across, np.cross(ahead, across)], axis=-1)


def unit_vectors(vectors: Vectors) -> Vectors:
    """Return vectors of length one along others; zero where these are."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0.0)
