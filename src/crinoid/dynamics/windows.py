"""The elements of an arm on their windows: what acts on the same ones together, and its slopes."""

from collections.abc import Iterable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid import chain
from crinoid.dynamics.integrator import Stage
from crinoid.elements import Course, Element, Linearised, Motion

Elements = tuple[Element, ...]
Slopes = tuple[Array, Array | None]


def groups(elements: Iterable[Element], axes: int) -> list[tuple[int, Elements]]:
    """Return the elements that act on the same windows together, by their first node.

    One pass over the windows then serves all of them: less to compile and to run. Those that
    bring a Jacobian of their own gain nothing from that.
    """
    found: dict[tuple[int, int, int, bool, bool], Elements] = {}
    for element in elements:
        spins = element.spins and axes == 3
        own = isinstance(element, Linearised)
        key = (element.first, element.stencil, count(element), spins, own)
        found[key] = (*found.get(key, ()), element)
    return [(first, some) for (first, *_), some in found.items()]


def gathered(element: Element, motion: Motion) -> Motion:
    """Return the motion in all windows of an element."""
    axes, number = motion.flow_velocity.shape[1], count(element)
    width = motion.position.shape[1] if element.spins else axes

    def gather(rows: Array) -> Array:
        return chain.gather(rows, element.first, number, element.stencil)

    return motion.windows(gather, (number,), width, turned=element.spins)


def count(element: Element) -> int:
    """Return the number of windows of an element."""
    return int(jax.tree.leaves(element)[0].shape[0])


def course(stage: Stage, slopes: Slopes) -> Course:
    """Return how a window follows a correction; ``slopes`` are those of the water there."""
    by = (stage.by_position, stage.by_velocity, stage.by_acceleration)
    return Course(*by, *slopes, stays=stage.stays)


def jacobian(
    course: Course, elements: Elements, window: Motion, load_factor: Array | None
) -> Array:
    """Return d(residual)/d(correction) of one window: ``(k, b, k, b)``."""
    known = [e for e in elements if isinstance(e, Linearised)]  # all of a group, or none
    if known and "position" not in course.stays:
        return jnp.sum(jnp.stack([e.jacobian(window, course) for e in known]), axis=0)

    def residual(window: Motion) -> Array:
        return jnp.sum(residuals(elements, window, load_factor), axis=0)

    def along(direction: Float[Array, "k b"]) -> Array:
        return course.derivative(residual, window, direction)

    shape = window.position.shape
    basis = jnp.eye(shape[0] * shape[1]).reshape(-1, *shape)
    return jax.vmap(along, out_axes=-1)(basis).reshape(*shape, *shape)


def residuals(elements: Elements, window: Motion, load_factor: Array | None) -> Array:
    """Return the residual of each element in one window."""
    full = 1.0 if load_factor is None else load_factor
    return jnp.stack([(full if e.external else 1.0) * e.residual(window) for e in elements])
