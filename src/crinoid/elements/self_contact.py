"""Contact of the arm with itself: pairs of edges that are far from each other along the arm."""

from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from crinoid.elements.element import Motion
from crinoid.elements.soft_skin import SoftSkin, closest_of_cores, size, surfaces
from crinoid.foundation.fixed_numbers import EASE, SKIN
from crinoid.numerics.frames import cross, unit
from crinoid.numerics.small_matrices import product
from crinoid.rod import Rod


class SelfContact(SoftSkin):
    """Contact of two edges of the arm, each a capsule as thick as the arm.

    A window has the two nodes of the first edge, then those of the second. The force law is that of
    `Contact`, with the radius and the modulus of the weaker edge. Both points of least distance
    are drawn to the middles of their edges. The distance is the root of
    ``min_st |x(s) - y(t)|^2 + EASE (|e|^2 (s - 1/2)^2 + |f|^2 (t - 1/2)^2)``, with the edges ``e``
    and ``f``.

    Both edges rub where they meet: at one point, so friction keeps the angular momentum. The point
    divides the line between their axes as their radii.
    """

    spins: ClassVar[bool] = True
    radii: Float[Array, "*count 2"]
    """Radii of the two edges (m)."""
    strength: Float[Array, "*count"]
    friction: Float[Array, "*count"]
    mass: Float[Array, "*count"]

    @staticmethod
    def of(rod: Rod, pairs: Int[Array, "pair 2"], friction: Float[Array, ""]) -> "SelfContact":
        """Pair edges of a rod, given by index."""
        radius, strength = surfaces(rod)
        return SelfContact(
            radius[pairs],
            jnp.min(strength[pairs], axis=1),
            jnp.broadcast_to(friction, pairs.shape[:1]),
            1 / jnp.sum(1 / rod.edge_mass[:, 1][pairs], axis=1),
        )

    @property
    def skin(self) -> Float[Array, "*count"]:
        return SKIN * jnp.min(self.radii, axis=-1)

    @property
    def between_axes(self) -> Float[Array, "*count"]:
        return jnp.sum(self.radii, axis=-1)

    def travel(self, moved: Float[Array, "4 b"]) -> Float[Array, ""]:
        places = moved[:, :3]
        return jnp.max(size(places[:2, None] - places[None, 2:]))

    def gap(self, position: Float[Array, "4 b"], pose: Any) -> Float[Array, ""]:
        distance, _, _, _ = _closest(position[:, :3])
        return distance - self.between_axes

    def residual(self, motion: Motion) -> Float[Array, "4 b"]:
        axes = motion.flow_velocity.shape[-1]
        places = motion.position[:, :axes]
        distance, slopes, shares, between = _closest(places)
        gap = distance - self.between_axes
        pressing = self.damped(gap, jnp.sum(slopes * motion.velocity[:, :axes]))
        outward, _ = unit(between)
        inward = between / self.between_axes

        def slide(velocity: Float[Array, "4 b"]) -> Float[Array, " d"]:
            one = carried(places[:2], shares[0], -self.radii[0] * inward, velocity[:2])
            other = carried(places[2:], shares[1], self.radii[1] * inward, velocity[2:])
            return one - other

        # the forces that do the work of friction, by the transpose of the sliding
        sliding, spread = jax.vjp(slide, motion.velocity)
        sliding = sliding - product(sliding, outward) * outward
        (rubbed,) = spread(self.rubbing(pressing, sliding))
        return -rubbed.at[:, :axes].add(pressing * slopes)


def _closest(position: Float[Array, "4 d"]) -> tuple[Array, Array, Array, Array]:
    """Return the distance of two axes, its gradient, both places along them, and their distance.

    The last one is the vector from the second to the first.
    """
    edge, other = position[1] - position[0], position[3] - position[2]
    apart = position[0] - 0.5 * (position[2] + position[3])
    share, along = closest_of_cores(edge, 0.5 * other, apart, core_ease=EASE)
    off, off_other = share - 0.5, 0.5 * along
    between = apart + share * edge - off_other * other
    eased, eased_other = EASE * off**2 * edge, EASE * off_other**2 * other
    distance = jnp.sqrt(
        product(between, between)
        + product(eased, edge)
        + product(eased_other, other)
        + jnp.finfo(float).tiny
    )
    slopes = jnp.stack(
        [
            (0.5 - off) * between - eased,
            (0.5 + off) * between + eased,
            (off_other - 0.5) * between - eased_other,
            eased_other - (0.5 + off_other) * between,
        ]
    )
    shares = jnp.stack([share, 0.5 + off_other])
    return distance, slopes / distance, shares, between


def carried(
    ends: Float[Array, "2 d"], share: Array, lever: Float[Array, " d"], velocity: Array
) -> Float[Array, " d"]:
    """Return the velocity of a point of an edge (m/s), at a lever from a place on its axis."""
    axes = lever.size
    moving = velocity[:, :axes]
    along, length = unit(ends[1] - ends[0])
    change = (moving[1] - moving[0]) / length
    # the edge turns at the rate along x change
    turning = change * product(along, lever) - along * product(change, lever)
    carried = moving[0] + share * (moving[1] - moving[0]) + turning
    if velocity.shape[-1] > axes:
        carried = carried + velocity[1, -1] * cross(along, lever)
    return carried
