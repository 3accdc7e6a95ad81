"""Elasticity of a discrete rod: stretch, planar bend.

A strain ``s`` of a window stores ``1/2 K (s - s_rest)^2``. Its stress, ``K`` times that of a
`Material`, acts as a force along ``grad s``.
"""

from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.elements.element import Element, Linearised, Motion, TangentDirection
from crinoid.elements.material import Material
from crinoid.numerics.frames import rotate_90, unit
from crinoid.numerics.small_matrices import product
from crinoid.rod import Rod
from crinoid.rod.reference import mass_matrices


class Inertia(Element):
    """Inertia: ``m a`` along each edge, and in space ``I`` times the acceleration of its spin."""

    stencil: ClassVar[int] = 2
    stored: ClassVar[str] = "kinetic"
    spins: ClassVar[bool] = True
    first: int = eqx.field(static=True)
    mass: Float[Array, "*count 2 2"]
    """Mass matrix of an edge (kg)."""
    spin: Float[Array, "*count turns"]
    """Moment of inertia of the edge about its axis in space (kg m2)."""

    @staticmethod
    def of(rod: Rod) -> "Inertia":
        """Build the inertia of a rod."""
        mass = mass_matrices(rod.edge_mass)
        spin = rod.spin_inertia
        spin = jnp.zeros((mass.shape[0], 0)) if spin is None else spin[:, None]
        return Inertia(1, mass, spin)

    def residual(self, motion: Motion) -> Float[Array, "2 b"]:
        return self._momentum(motion.acceleration)

    def energy(self, motion: Motion) -> Float[Array, ""]:
        return 0.5 * jnp.sum(self._momentum(motion.velocity) * motion.velocity)

    def working(self, motion: Motion) -> None:
        return None

    def _momentum(self, velocity: Float[Array, "2 b"]) -> Float[Array, "2 b"]:
        axes = velocity.shape[1] - self.spin.size
        moving = product(self.mass, velocity[:, :axes])
        spinning = jnp.stack([jnp.zeros_like(self.spin), self.spin * velocity[1, axes:]])
        return jnp.concatenate([moving, spinning], axis=1)


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
    material: Material

    @staticmethod
    def of(rod: Rod) -> "Stretch":
        """Build the edges of a rod."""
        return Stretch(1, rod.EA, rod.chord_length, Material.of(rod, rod.EA.size))

    def residual(self, motion: Motion) -> Float[Array, "2 b"]:
        strain, rate, direction = self._strain(motion)
        stress = self.material.stress(strain, rate, motion.memory, motion.step)
        force = self.EA * stress * direction
        return jnp.stack([-force, force])

    def working(self, motion: Motion) -> Float[Array, "2 b"]:
        strain, rate, direction = self._strain(motion)
        stress = self.material.viscous_stress(strain, rate, motion.memory, motion.step)
        force = self.EA * stress * direction
        return jnp.stack([force, -force])

    def energy(self, motion: Motion) -> Float[Array, ""]:
        strain, _, _ = self._strain(motion)
        energy = self.material.energy(strain, motion.memory, motion.step)
        return self.EA * self.rest_length * energy

    @property
    def remembers(self) -> bool:
        return self.material.relaxation is not None

    def steady(self, motion: Motion) -> Any:
        return self.material.steady(self._strain(motion)[0])

    def advance(self, motion: Motion) -> Any:
        return self.material.advance(self._strain(motion)[0], motion.memory, motion.step)

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
        """Return the turn at the middle one of three nodes."""
        edges = position[1:] - position[:-1]
        lengths = jnp.sqrt(jnp.sum(edges**2, axis=1))[:, None]
        directions = edges / lengths
        normals = rotate_90(directions)
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
        """Return the change of the gradient for displacements of the nodes."""
        on_first, on_second = jnp.sum(self.curved * (moved[1:] - moved[:-1])[:, None], axis=-1)
        return jnp.stack([-on_first, on_first - on_second, on_second])

    @property
    def hessian(self) -> Float[Array, "3 2 3 2"]:
        """Second derivatives of the turn by the positions of the nodes (1/m2)."""
        return by_nodes(*self.curved)


def by_nodes(first: Float[Array, "2 2"], second: Float[Array, "2 2"]) -> Float[Array, "3 2 3 2"]:
    """Return second derivatives by three nodes from those by the vectors of their edges."""
    none = jnp.zeros((2, 2))
    rows = [[first, -first, none], [-first, first + second, -second], [none, -second, second]]
    return jnp.stack([jnp.stack(row, axis=1) for row in rows])


class Bend(Linearised):
    """Bend at a node between two edges: ``s`` is the turn (``bend_strain``), and ``K = EI / l``.

    ``l`` is the length over which the node integrates the bend (after Bergou et al. 2008, eq. 1;
    2010, section 4.1.1). The strain grows without bound as the edges fold onto each other, so an
    arm does not snap through a fold.
    At the root the first edge of the window is the ghost edge of the clamp, and the node owns half
    an edge, which places the clamp at the root itself.
    """

    stencil: ClassVar[int] = 3
    stored: ClassVar[str] = "elastic"
    worked: ClassVar[str] = "damping"
    first: int = eqx.field(static=True)
    stiffness: Float[Array, "*count"]
    """``EI / l`` (N m)."""
    rest_strain: Float[Array, "*count"]
    """Strain without load (rad)."""
    material: Material

    @staticmethod
    def of(rod: Rod, *, pinned: bool = False) -> "Bend":
        """Build the bending of a rod, without its tip; a pinned root has no stiffness."""
        stiffness = rod.EI[:-1] / rod.strain_length[:-1, 0]
        if pinned:
            stiffness = stiffness.at[0].set(0.0)
        tangent = jnp.tan(0.5 * rod.rest_turn[:-1])
        rest = bend_strain(tangent, jnp.sqrt(1.0 + tangent**2))
        return Bend(0, stiffness, rest, Material.of(rod, stiffness.size))

    def residual(self, motion: Motion) -> Float[Array, "3 2"]:
        turn = Turn.of(motion.position)
        return self._moment(turn, motion) * turn.growth * turn.gradient

    def working(self, motion: Motion) -> Float[Array, "3 2"]:
        turn = Turn.of(motion.position)
        strain, rate = turn.strain - self.rest_strain, self._rate(turn, motion)
        stress = self.material.viscous_stress(strain, rate, motion.memory, motion.step)
        return -self.stiffness * stress * turn.growth * turn.gradient

    def jacobian(self, motion: Motion, direction: TangentDirection) -> Float[Array, "3 2 3 2"]:
        turn, viscous = Turn.of(motion.position), self.stiffness * self.material.damping_time
        stiffness = self.stiffness * self.material.slope(motion.memory, motion.step)
        moment, grows, by_position = self._moment(turn, motion), turn.growth, direction.by_position
        speed = jnp.sum(turn.gradient * motion.velocity)
        by_turn = by_position * stiffness * grows + viscous * (
            direction.by_velocity * grows + by_position * turn.growth_slope * speed
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
        """Return the strain of a window."""
        return Turn.of(motion.position).strain[None]

    def energy(self, motion: Motion) -> Float[Array, ""]:
        strain = Turn.of(motion.position).strain - self.rest_strain
        return self.stiffness * self.material.energy(strain, motion.memory, motion.step)

    @property
    def remembers(self) -> bool:
        return self.material.relaxation is not None

    def steady(self, motion: Motion) -> Any:
        return self.material.steady(Turn.of(motion.position).strain - self.rest_strain)

    def advance(self, motion: Motion) -> Any:
        strain = Turn.of(motion.position).strain - self.rest_strain
        return self.material.advance(strain, motion.memory, motion.step)

    def _moment(self, turn: Turn, motion: Motion) -> Float[Array, ""]:
        strain, rate = turn.strain - self.rest_strain, self._rate(turn, motion)
        return self.stiffness * self.material.stress(strain, rate, motion.memory, motion.step)

    @staticmethod
    def _rate(turn: Turn, motion: Motion) -> Float[Array, ""]:
        return turn.growth * jnp.sum(turn.gradient * motion.velocity)


def bend_strain(tangent: Float[Array, "..."], secant: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return the strain of a bend from tangent and secant of half its angle.

    ``(2 tan(a / 2) + 4 sin(a / 2)) / 3``, a mean of Snell's and Huygens's bounds of the arc: the
    angle ``a`` to within ``a^5 / 320``, yet unbounded as the edges fold onto each other. The
    binormal ``2 tan(a / 2)`` alone would stiffen a bend by ``a^2 / 3``.
    """
    return 2.0 / 3.0 * tangent * (1.0 + 2.0 / secant)
