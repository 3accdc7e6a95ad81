"""Elasticity of a discrete rod, with Kelvin-Voigt damping on every strain: stretch, planar bend.

A strain ``s`` of a window stores ``1/2 K (s - s_rest)^2``; its stress is
``K (s - s_rest + damping_time ds/dt)``, and the force is the stress times ``grad s``.
"""

from typing import ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.elements.element import Course, Element, Linearised, Motion
from crinoid.elements.geometry import bend_strain, turned, unit
from crinoid.rod import Rod


class Stretch(Element):
    """Stretch of an edge: ``s = |e| / l - 1`` with ``K = EA l`` (Bergou et al. 2010, eq. 3)."""

    stencil: ClassVar[int] = 2
    stored: ClassVar[str] = "elastic"
    worked: ClassVar[str] = "damping"
    first: int = eqx.field(static=True)
    EA: Float[Array, "*count"]
    """Stretching stiffness (N)."""
    rest_length: Float[Array, "*count"]
    """Length of the edge at rest (m)."""
    damping_time: Float[Array, "*count"]
    """Viscosity over modulus (s)."""

    @staticmethod
    def of(rod: Rod) -> "Stretch":
        """Build the edges of a rod."""
        damping_time = jnp.broadcast_to(rod.damping_time, rod.EA.shape)
        return Stretch(1, rod.EA, rod.chord_length, damping_time)

    def residual(self, motion: Motion) -> Float[Array, "2 b"]:
        strain, rate, direction = self._strain(motion)
        force = self.EA * (strain + self.damping_time * rate) * direction
        return jnp.stack([-force, force])

    def working(self, motion: Motion) -> Float[Array, "2 b"]:
        _, rate, direction = self._strain(motion)
        force = self.EA * self.damping_time * rate * direction
        return jnp.stack([force, -force])

    def energy(self, motion: Motion) -> Float[Array, ""]:
        strain, _, _ = self._strain(motion)
        return 0.5 * self.EA * self.rest_length * strain**2

    def _strain(self, motion: Motion) -> tuple[Array, Array, Array]:
        direction, length = unit(motion.position[1] - motion.position[0])
        speed = jnp.sum(direction * (motion.velocity[1] - motion.velocity[0]))
        return length / self.rest_length - 1.0, speed / self.rest_length, direction


class Turn(NamedTuple):
    """The turn at a node between two edges, with its derivatives by the positions of the nodes.

    It changes by ``n_2 . de_2 / l_2 - n_1 . de_1 / l_1``, with the normals and lengths of the
    edges.
    """

    strain: Float[Array, ""]
    growth: Float[Array, ""]
    """``d(strain)/d(turn)``."""
    growth_slope: Float[Array, ""]
    gradient: Float[Array, "3 2"]
    """``d(turn)/d(positions)`` (1/m)."""
    curved: Float[Array, "2 2 2"]
    """Second derivatives of the turn by the vectors of both edges (1/m2); none are mixed."""

    @staticmethod
    def of(position: Float[Array, "3 2"]) -> "Turn":
        """Observe the turn of three nodes."""
        edges = position[1:] - position[:-1]
        lengths = jnp.sqrt(jnp.sum(edges**2, axis=1))[:, None]
        directions = edges / lengths
        normals = turned(directions)
        before, after = directions
        half = jnp.sum(normals[0] * after) / (1.0 + jnp.sum(before * after))  # its tangent
        secant = jnp.sqrt(1.0 + half**2)
        by_edge = normals / lengths
        tilted = (directions / lengths)[:, :, None] * by_edge[:, None, :]
        curved = tilted + tilted.swapaxes(1, 2)
        return Turn(
            bend_strain(half, secant),
            (secant**2 + 2.0 / secant) / 3.0,
            half * (secant**2 - 1.0 / secant) / 3.0,
            jnp.stack([by_edge[0], -by_edge[0] - by_edge[1], by_edge[1]]),
            curved * jnp.array([1.0, -1.0])[:, None, None],
        )

    def along(self, moved: Float[Array, "3 2"]) -> Float[Array, "3 2"]:
        """Return how the gradient changes where the nodes are moved."""
        on_first, on_second = jnp.sum(self.curved * (moved[1:] - moved[:-1])[:, None], axis=-1)
        return jnp.stack([-on_first, on_first - on_second, on_second])

    @property
    def hessian(self) -> Float[Array, "3 2 3 2"]:
        """Second derivatives of the turn by the positions of the nodes (1/m2)."""
        return by_nodes(*self.curved)


def by_nodes(first: Float[Array, "2 2"], second: Float[Array, "2 2"]) -> Float[Array, "3 2 3 2"]:
    """Return second derivatives by three nodes from those by the vectors of the edges between."""
    none = jnp.zeros((2, 2))
    rows = [[first, -first, none], [-first, first + second, -second], [none, -second, second]]
    return jnp.stack([jnp.stack(row, axis=1) for row in rows])


class Bend(Linearised):
    """Bend at a node between two edges: ``s`` is the turn (``bend_strain``), and ``K = EI / l``.

    ``l`` is the length over which the node gathers the bend (after Bergou et al. 2008, eq. 1; 2010,
    section 4.1.1). The strain grows without bound as the edges fold onto each other, so an arm does
    not snap through a fold.
    At the root the first edge of the window is the ghost edge of the clamp, and the node owns half
    an edge: that keeps the clamp at the root itself.
    """

    stencil: ClassVar[int] = 3
    stored: ClassVar[str] = "elastic"
    worked: ClassVar[str] = "damping"
    first: int = eqx.field(static=True)
    stiffness: Float[Array, "*count"]
    """``EI / l`` (N m)."""
    rest_strain: Float[Array, "*count"]
    """Strain without load (rad)."""
    damping_time: Float[Array, "*count"]
    """Viscosity over modulus (s)."""

    @staticmethod
    def of(rod: Rod, *, pinned: bool = False) -> "Bend":
        """Build the nodes of a rod but its tip; a pinned root resists no bending."""
        stiffness = rod.EI[:-1] / rod.strain_length[:-1, 0]
        if pinned:
            stiffness = stiffness.at[0].set(0.0)
        damping_time = jnp.broadcast_to(rod.damping_time, stiffness.shape)
        tangent = jnp.tan(0.5 * rod.rest_turn[:-1])
        rest = bend_strain(tangent, jnp.sqrt(1.0 + tangent**2))
        return Bend(0, stiffness, rest, damping_time)

    def residual(self, motion: Motion) -> Float[Array, "3 2"]:
        turn = Turn.of(motion.position)
        return self._moment(turn, motion) * turn.growth * turn.gradient

    def working(self, motion: Motion) -> Float[Array, "3 2"]:
        turn = Turn.of(motion.position)
        moment = self.stiffness * self.damping_time * self._rate(turn, motion)
        return -moment * turn.growth * turn.gradient

    def jacobian(self, motion: Motion, course: Course) -> Float[Array, "3 2 3 2"]:
        turn, viscous = Turn.of(motion.position), self.stiffness * self.damping_time
        moment, grows, by_position = self._moment(turn, motion), turn.growth, course.by_position
        speed = jnp.sum(turn.gradient * motion.velocity)
        by_turn = by_position * self.stiffness * grows + viscous * (
            course.by_velocity * grows + by_position * turn.growth_slope * speed
        )
        of_moment = by_turn * turn.gradient + (
            by_position * viscous * grows * turn.along(motion.velocity)
        )
        of_lever = by_position * turn.growth_slope * turn.gradient
        steering = grows * of_moment + moment * of_lever
        return turn.gradient[:, :, None, None] * steering + by_position * moment * grows * (
            turn.hessian
        )

    def strains(self, motion: Motion) -> Float[Array, "1"]:
        """Return the strain, as the one of a window."""
        return Turn.of(motion.position).strain[None]

    def energy(self, motion: Motion) -> Float[Array, ""]:
        turn = Turn.of(motion.position)
        return 0.5 * self.stiffness * (turn.strain - self.rest_strain) ** 2

    def _moment(self, turn: Turn, motion: Motion) -> Float[Array, ""]:
        strained = turn.strain - self.rest_strain + self.damping_time * self._rate(turn, motion)
        return self.stiffness * strained

    @staticmethod
    def _rate(turn: Turn, motion: Motion) -> Float[Array, ""]:
        return turn.growth * jnp.sum(turn.gradient * motion.velocity)
