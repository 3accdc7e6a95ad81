"""Laws on their windows of rows: groups that share windows, residuals and Jacobians."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.dynamics.integrator import StepMap
from crinoid.dynamics.rows import Rows
from crinoid.elements import Element, Law, Motion, TangentDirection
from crinoid.numerics import banded, index_array

Points = Float[Array, "rows d"]


class Surroundings(eqx.Module):
    """Flow around given positions: the velocity to first order in position.

    The acceleration too if it has a slope, as in statics.
    """

    position: Points
    velocity: Points
    acceleration: Points
    """Material acceleration Du/Dt (m/s2)."""
    velocity_slope: Float[Array, "rows d d"]
    acceleration_slope: Float[Array, "rows d d"] | None = None

    @staticmethod
    def none(rows: int, axes: int) -> "Surroundings":
        """Return still water."""
        still, slope = jnp.zeros((rows, axes)), jnp.zeros((rows, axes, axes))
        return Surroundings(still, still, still, slope, slope)

    def at(self, position: Rows) -> tuple[Points, Points]:
        """Return velocity and material acceleration near the positions."""
        moved = (position[:, : self.position.shape[1]] - self.position)[:, None, :]
        velocity = self.velocity + jnp.sum(self.velocity_slope * moved, axis=-1)
        if self.acceleration_slope is None:
            return velocity, self.acceleration
        return velocity, self.acceleration + jnp.sum(self.acceleration_slope * moved, axis=-1)


Held = tuple[Any, Array | None] | None
"""Memory of an element, prepared for a step, and the step's length in each window (s)."""
Slopes = tuple[Array, Array | None]

Laws = tuple[tuple[Law, Held], ...]
ArmLaws = tuple[tuple[Element, Held], ...]
"""Elements of an arm, each with its memory."""


@dataclass(frozen=True)
class LawGroup:
    """Laws that share windows of rows: one pass over these is less to compile and to run."""

    laws: tuple[tuple[Any, Held], ...]
    """Laws, each with its memory."""
    index: index_array.Index
    """Rows of each window ``w``."""
    oriented: bool = False
    """Whether they depend on the orientation of the edges in space."""

    @property
    def balanced(self) -> slice:
        """Rows of a window whose forces count as those of the balance."""
        return self.laws[0][0].balanced

    def windows(self, motion: Motion) -> Motion:
        """Return the motion in all windows."""
        axes, number = motion.flow_velocity.shape[1], math.prod(self.index.shape[:-1])
        width = motion.position.shape[1] if self.laws[0][0].spins else axes

        def gather(rows: Array) -> Array:
            return index_array.gather(rows, self.index)

        return motion.windows(gather, (number,), width, oriented=self.oriented)

    def each(self, of: Callable[..., Any], *windows: Any) -> Any:
        """Return a function of the laws and of arrays with their windows, in each window."""
        axes = tuple((law.window_axes, 0) for law, _ in self.laws)
        return jax.vmap(of, (axes, *(0 for _ in windows)))(self.laws, *windows)

    def residuals(
        self, motion: Motion, load_factor: Array | None = None
    ) -> Float[Array, "w law k _"]:
        """Return the residual of each law in each window."""
        return self.each(
            lambda laws, window: residuals(laws, window, load_factor), self.windows(motion)
        )

    def jacobians(
        self, stage: StepMap, motion: Motion, around: Surroundings, load_factor: Array | None
    ) -> Float[Array, "w k _ k _"]:
        """Return d(residual)/d(correction) in each window."""

        def jacobian(laws: Laws, window: Motion, slopes: Slopes) -> Array:
            def residual(window: Motion) -> Array:
                return jnp.sum(residuals(laws, window, load_factor), axis=0)

            relative = all(law.relative for law, _ in laws)
            direction = tangent_direction(stage, slopes)
            return derivative(direction, residual, window, relative=relative)

        slopes = around.velocity_slope, around.acceleration_slope
        along = jax.tree.map(lambda slope: index_array.gather(slope, self.index), slopes)
        return self.each(jacobian, self.windows(motion), along)

    def scatter(self, forces: Float[Array, "w k _"], shape: tuple[int, ...]) -> Rows:
        """Add the forces of the windows to the rows of an array of a shape."""
        rows = index_array.scatter(forces, self.index, shape[0])
        return banded.pad_columns(rows, shape[1])


def groups(laws: ArmLaws, axes: int) -> list[LawGroup]:
    """Return the laws of an arm in groups that share windows."""
    found: dict[tuple[int, int, int, bool], ArmLaws] = {}
    for element, held in laws:
        key = (element.first, element.stencil, count(element), element.spins and axes == 3)
        found[key] = (*found.get(key, ()), (element, held))
    return [LawGroup(some, nodes_of(some[0][0]), some[0][0].spins) for some in found.values()]


def nodes_of(element: Element) -> np.ndarray:
    """Return the index array of the windows of an element of an arm."""
    return element.first + np.arange(count(element))[:, None] + np.arange(element.stencil)


def remembering(window: Motion, held: Held) -> Motion:
    """Return the motion of a window with the memory of its element."""
    return window if held is None else window.remembering(*held)


def motion_windows(element: Element, motion: Motion, held: Held = None) -> Motion:
    """Return the motion in all windows of an element of an arm, with its memory."""
    group = LawGroup(((element, held),), nodes_of(element), element.spins)
    return remembering(group.windows(motion), held)


def count(element: Element) -> int:
    """Return the number of windows of an element."""
    return int(jax.tree.leaves(element)[0].shape[0])


def tangent_direction(stage: StepMap, slopes: Slopes) -> TangentDirection:
    """Return the direction of a window's tangent; ``slopes`` are those of the water there."""
    by = (stage.by_position, stage.by_velocity, stage.by_acceleration)
    return TangentDirection(*by, *slopes, fixed_fields=stage.fixed_fields)


def derivative(
    direction: TangentDirection,
    quantity: Callable[[Motion], Array],
    window: Motion,
    *,
    relative: bool,
) -> Array:
    """Return d(quantity)/d(correction) of one window: ``(..., k, b)``.

    A common translation does not change a ``relative`` quantity. So its derivative by the first
    node follows from the others: a third fewer directions of three nodes.
    """

    def along(correction: Float[Array, "k b"]) -> Array:
        return direction.derivative(quantity, window, correction)

    (nodes, size), axes = window.position.shape, window.flow_velocity.shape[-1]
    basis = jnp.eye(nodes * size)[size if relative else 0 :].reshape(-1, nodes, size)
    found = jax.vmap(along, out_axes=-1)(basis)
    found = found.reshape(*found.shape[:-1], -1, size)
    if not relative:
        return found
    # the edge that spins with the first node is not in the window
    first = -jnp.sum(found[..., :axes], axis=-2, keepdims=True)
    first = jnp.pad(first, [(0, 0)] * (found.ndim - 1) + [(0, size - axes)])
    return jnp.concatenate([first, found], axis=-2)


def residuals(laws: Laws, window: Motion, load_factor: Array | None) -> Array:
    """Return the residual of each law in one window."""
    full = 1.0 if load_factor is None else load_factor
    each = [(full if e.external else 1.0) * e.residual(remembering(window, m)) for e, m in laws]
    return jnp.stack(each)
