"""Elasticity of a discrete rod: stretch, bend, and in space twist.

A strain ``s`` of a window stores ``1/2 K (s - s_rest)^2``. Its stress, ``K`` times that of a
`Material`, acts as a force along ``grad s``.
"""

from abc import abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.elements.element import Element, Motion
from crinoid.elements.material import Material
from crinoid.elements.node import Node, bend_strain, spatial_strains
from crinoid.numerics.frames import dot, twist_between, unit
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


class Deformation(NamedTuple):
    """Strains of a window, one or several."""

    strain: Float[Array, "..."]
    """Beyond rest."""
    rate: Float[Array, "..."]
    forces: Callable[[Array], Array]
    """Residual of stresses, linear in them: the transpose of the rate by the velocities."""


class Elastic(Element):
    """Force law of a `Material` on the strains of a window."""

    relative: ClassVar[bool] = True
    stored: ClassVar[str] = "elastic"
    worked: ClassVar[str] = "damping"
    material: eqx.AbstractVar[Material]

    @property
    @abstractmethod
    def modulus(self) -> Float[Array, "..."]:
        """``K`` of each strain (J)."""

    @abstractmethod
    def deformation(self, motion: Motion) -> Deformation:
        """Return the strains of a window."""

    def residual(self, motion: Motion) -> Float[Array, "k b"]:
        strain, rate, forces = self.deformation(motion)
        viscous = self.material.viscous_stress(strain, rate, motion.memory, motion.step)
        return forces(self.modulus * (strain + viscous))

    def working(self, motion: Motion) -> Float[Array, "k b"]:
        strain, rate, forces = self.deformation(motion)
        viscous = self.material.viscous_stress(strain, rate, motion.memory, motion.step)
        return -forces(self.modulus * viscous)

    def energy(self, motion: Motion) -> Float[Array, ""]:
        strain = self.deformation(motion).strain
        return jnp.sum(self.modulus * self.material.energy(strain, motion.memory, motion.step))

    @property
    def remembers(self) -> bool:
        return self.material.relaxation is not None

    def steady(self, motion: Motion) -> Any:
        return self.material.steady(self.deformation(motion).strain)

    def advance(self, motion: Motion) -> Any:
        return self.material.advance(self.deformation(motion).strain, motion.memory, motion.step)


class Stretch(Elastic):
    """Stretch of an edge: ``s = |e| / l - 1`` with ``K = EA l`` (Bergou et al. 2010, eq. 3)."""

    stencil: ClassVar[int] = 2
    first: int = eqx.field(static=True)
    EA: Float[Array, "*count"]
    """Stretching stiffness (N)."""
    rest_length: Float[Array, "*count"]
    """Length of the edge at rest (m)."""
    material: Material

    @staticmethod
    def of(rod: Rod) -> "Stretch":
        """Build the edges of a rod."""
        material = Material.of(rod, rod.EA.size)
        return Stretch(first=1, EA=rod.EA, rest_length=rod.chord_length, material=material)

    @property
    def modulus(self) -> Float[Array, "*count"]:
        return self.EA * self.rest_length

    def deformation(self, motion: Motion) -> Deformation:
        direction, length = unit(motion.position[1] - motion.position[0])
        slope = direction / self.rest_length
        return Deformation(
            length / self.rest_length - 1.0,
            dot(slope, motion.velocity[1] - motion.velocity[0]),
            lambda stress: stress * jnp.stack([-slope, slope]),
        )


class Bend(Elastic):
    """Bend, and in space twist, at a node between two edges (``crinoid.elements.node``).

    ``K`` is ``EI / l``, in space ``EI_1 / l, EI_2 / l, GJ / l``; ``l`` is the length over which the
    node integrates the strain (after Bergou et al. 2008, eq. 1; 2010, section 4.1.1). The strain
    grows without bound as the edges fold onto each other, so an arm does not snap through a fold.
    At the root the first edge of the window is the ghost edge of the clamp, and the node owns half
    an edge, which places the clamp at the root itself.
    """

    stencil: ClassVar[int] = 3
    spins: ClassVar[bool] = True
    first: int = eqx.field(static=True)
    stiffness: Float[Array, "*count s"]
    """``K`` of each strain (N m)."""
    rest_strain: Float[Array, "*count s"]
    """Strains without load (rad)."""
    material: Material

    @staticmethod
    def of(rod: Rod, *, pinned: bool = False) -> "Bend":
        """Build bend and twist of a rod, without its tip; a pinned root resists twist only."""
        resistance = rod.EI.reshape(rod.nodes, -1)
        if rod.GJ is not None:
            resistance = jnp.concatenate([resistance, rod.GJ[:, None]], axis=1)
        stiffness = (resistance / rod.strain_length)[:-1]
        if pinned:
            stiffness = stiffness.at[0, : rod.axes - 1].set(0.0)
        material, rest = Material.of(rod, stiffness.shape[0]), _rest_strain(rod)
        return Bend(first=0, stiffness=stiffness, rest_strain=rest, material=material)

    @property
    def modulus(self) -> Float[Array, "*count s"]:
        return self.stiffness

    def deformation(self, motion: Motion) -> Deformation:
        node = Node.of(motion)
        return Deformation(node.strains - self.rest_strain, node.rates(motion), node.forces)


def _rest_strain(rod: Rod) -> Float[Array, "count s"]:
    """Return the strains of each node except the tip without load (rad)."""
    if rod.rest_twist is None:
        tangent = jnp.tan(0.5 * rod.rest_turn[:-1])
        return bend_strain(tangent, jnp.sqrt(1.0 + tangent**2))[:, None]
    clamp = jnp.eye(3)
    places, directors = rod.rest_frames(clamp)
    edges = jnp.concatenate([clamp[:1], jnp.diff(places, axis=0)])
    tangents = edges / jnp.sqrt(dot(edges, edges))[:, None]
    directors = jnp.concatenate([clamp[1:2], directors])
    pairs = (tangents[:-1], tangents[1:])
    expected = (rod.rest_twist * rod.voronoi_length)[:-1]
    twist = twist_between(directors[:-1], directors[1:], pairs, expected)
    return jax.vmap(spatial_strains)(*pairs, directors[:-1], twist)[0]
