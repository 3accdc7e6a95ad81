"""Markers along the arm, whose places are measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from pydantic import Field
from scipy.interpolate import CubicSpline

from crinoid.assembly.arrays import array
from crinoid.dynamics import State, System
from crinoid.numerics.frames import cross, dot, rotate_90
from crinoid.scenario import Scenario
from crinoid.scenario.model import Model, entry
from crinoid.scenario.quantity import PER_AXIS, Components, Metres, Quantity

TIP = "tip"  # name of the tip, a marker that needs no table; its direction may be measured too


class Marker(Model):
    """A marker on the arm: a table of a file of experiments."""

    name: str = Field(min_length=1, description="Its name in the column `marker` of a record.")
    s: Metres = Field(ge=0, description="Distance from the root along the arm at rest.")
    offset: Annotated[
        Components | None,
        Quantity("m", "[along the arm, across it]", "[along the arm, toward m_1, toward m_2]"),
        PER_AXIS,
    ] = entry(None, "Distance from the axis, in the frame of the section; 0 by default.")


class MarkerWeights(eqx.Module):
    """Places of markers as sums over nodes and edges: cubic splines along the arm at rest."""

    position: Float[Array, "marker node"]  # weights of the nodes in the place on the axis
    tangent: Float[Array, "marker node"]  # those in the derivative along the arm (1/m)
    director: Float[Array, "marker edge"]  # weights of the edges in the director m_1
    offset: Float[Array, "marker d"]  # offsets along the tangent and the directors (m)

    @staticmethod
    def of(markers: Sequence[Marker], scenario: Scenario) -> MarkerWeights:
        """Return the weights of markers on the arm of a scenario."""
        arm = scenario.arm
        s = np.array([marker.s for marker in markers])
        nodes = np.linspace(0.0, arm.length, arm.nodes)
        along = CubicSpline(nodes, np.eye(arm.nodes))
        across = CubicSpline(nodes[1:] - nodes[1] / 2, np.eye(arm.nodes - 1))
        none = (0.0,) * arm.dimension
        offset = np.array([marker.offset or none for marker in markers])
        arrays = (along(s), along(s, 1), across(s), offset.reshape(-1, arm.dimension))
        return MarkerWeights(*map(array, arrays))

    def places(self, system: System, state: State) -> Float[Array, "place output"]:
        """Return the pose of the tip (m, rad), and below it the place of each marker (m).

        Behind places are zeros, for the directions.
        """
        nodes = state.position[1:]  # the first node is behind the root
        tangent = _unit(jnp.dot(self.tangent, nodes))
        frame = [tangent]
        if state.motion.orientation is None:
            frame.append(rotate_90(tangent))
        else:
            director = jnp.dot(self.director, state.motion.orientation.director[2:])
            first = _unit(director - dot(director, tangent)[:, None] * tangent)
            frame += [first, cross(tangent, first)]
        aside = sum(self.offset[:, k, None] * way for k, way in enumerate(frame))
        place = system.forces.origin + jnp.dot(self.position, nodes) + aside
        tip = system.tip(state)
        behind = tip.size - place.shape[1]
        return jnp.concatenate([tip[None], jnp.pad(place, ((0, 0), (0, behind)))])


def _unit(vectors: Float[Array, "marker d"]) -> Float[Array, "marker d"]:
    return vectors / jnp.linalg.norm(vectors, axis=1, keepdims=True)
