"""Bending and twisting of a discrete rod in space.

The two edges at a node carry a material frame each. Turned by half of the twist and half of the
bend both come to the same middle frame ``(d, M_1, M_2)``, with ``d`` along ``t_a + t_b``. The
strains of the node are read in it: with ``k = 2 t_a x t_b / (1 + t_a . t_b)``, the binormal, and
``s`` along ``k``, as long as `bend_strain` says,

``kappa_1 = s . M_2``, ``kappa_2 = -s . M_1`` and ``tau``, the twist from one frame to the other

(after Bergou et al. 2008, eq. 1; 2010, section 4). Where these average the components in the
frames of both edges the middle frame has the true ones: they do not shrink as the node twists.

With the edges' relative angular velocity ``w`` the binormal changes in the middle frame as
``dk/dt = C (w_n + h (k . w) k)``, where ``w_n`` is ``w`` across ``d`` and

``C = 1 / cos(bend / 2) = sqrt(1 + k.k / 4)``, ``h = 1 / (4 (C + 1))``,

and the strain as a vector ``e = kappa_1 M_2 - kappa_2 M_1 + tau d`` as ``de/dt = G w`` with the
symmetric

``G = a 1 + (C - a) d d^T + b k k^T``, ``a = (C + 2) / 3``, ``b = (C^2 - 2) / (12 C (C + 1))``,

so that a stress ``S`` along the same axes hands on the moment ``m = G S`` from edge to edge.
"""

from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.elements.elastic import bend_strain
from crinoid.elements.element import Linearised, Motion, TangentDirection
from crinoid.elements.material import Material
from crinoid.numerics.frames import cross, dot, transport, twist_between, unit
from crinoid.numerics.small_matrices import product
from crinoid.rod import Rod

Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]


class SpatialEdge(NamedTuple):
    """Edge of a window and its motion."""

    tangent: Vector
    director: Vector
    length: Float[Array, ""]
    rate: Vector
    """Rate of the vector from end to end, over its length (1/s)."""
    spin_rate: Float[Array, ""]

    @staticmethod
    def of(motion: Motion, end: int) -> "SpatialEdge":
        tangent, length = unit(motion.position[end, :3] - motion.position[end - 1, :3])
        rate = (motion.velocity[end, :3] - motion.velocity[end - 1, :3]) / length
        assert motion.orientation is not None
        director = motion.orientation.director[end]
        return SpatialEdge(tangent, director, length, rate, motion.velocity[end, 3])

    @property
    def angular_velocity(self) -> Vector:
        return cross(self.tangent, self.rate) + self.spin_rate * self.tangent

    def force(self, moment: Vector) -> Float[Array, "4"]:
        """Return a moment as a force on the edge's vector (N) and a torque about it (N m)."""
        return jnp.append(cross(moment, self.tangent) / self.length, dot(moment, self.tangent))

    def turning(self, lean: Vector) -> Float[Array, "3 4"]:
        """Return d(rotation)/d(vector and spin)."""
        swung = _crossing(self.tangent, np.eye(3)) + _outer(self.tangent, lean)
        return jnp.concatenate([swung / self.length, self.tangent[:, None]], axis=1)

    def force_slope(self, moment: Vector) -> Float[Array, "4 4"]:
        """Return d(force)/d(vector and spin) at a fixed moment."""
        swing = across(self.tangent) / self.length
        pull = _outer(cross(moment, self.tangent), self.tangent) / self.length
        force = (_crossing(moment, swing) - pull) / self.length
        torque = jnp.sum(moment[:, None] * swing, axis=0)
        return jnp.pad(jnp.concatenate([force, torque[None]]), ((0, 0), (0, 1)))

    def angular_velocity_slope(self) -> Float[Array, "3 4"]:
        """Return d(angular velocity)/d(vector and spin) at fixed velocities."""
        swing = across(self.tangent)
        rate = self.spin_rate * swing - _crossing(self.rate, swing)
        shrinking = _outer(cross(self.tangent, self.rate), self.tangent)
        return jnp.pad((rate - shrinking) / self.length, ((0, 0), (0, 1)))


class NodeStrain(NamedTuple):
    """Strains of a node, and the middle frame of their components."""

    binormal: Vector
    axes: Matrix
    """Rows ``M_2, -M_1, d``, the directions of the three strains."""
    strains: Vector
    """Integrated strains ``kappa_1, kappa_2, tau`` of the node (rad)."""
    stretch: Float[Array, ""]
    """``C``."""

    @staticmethod
    def of(a: Vector, b: Vector, director: Vector, twist: Float[Array, ""]) -> "NodeStrain":
        """Return the strains from two tangents, the first edge's director and the twist."""
        facing = 1.0 + dot(a, b)
        binormal = 2.0 * cross(a, b) / facing
        stretch = jnp.sqrt(1.0 + 0.25 * dot(binormal, binormal))
        middle = (a + b) / (facing * stretch)
        first = transport(director, a, middle)
        half = 0.5 * twist
        m_1 = jnp.cos(half) * first + jnp.sin(half) * cross(middle, first)
        m_2 = cross(middle, m_1)
        bend = bend_strain(0.5 * binormal, stretch)
        return NodeStrain(
            binormal,
            jnp.stack([m_2, -m_1, middle]),
            jnp.stack([dot(bend, m_2), -dot(bend, m_1), twist]),
            stretch,
        )

    def rates(self, relative: Vector) -> Vector:
        """Return the rates of the strains, from the edges' relative angular velocity."""
        return product(self.axes, product(self.map, relative))

    @property
    def map(self) -> Matrix:
        """``G``."""
        K, C, d = self.binormal, self.stretch, self.axes[2]
        a = (C + 2.0) / 3.0
        return a * jnp.eye(3) + (C - a) * _outer(d, d) + self.excess * _outer(K, K)

    def map_slope(self, vector: Vector) -> Matrix:
        """Return ``d(G vector)/dw`` for a ``vector`` that turns with the middle frame."""
        K, C, d = self.binormal, self.stretch, self.axes[2]
        b = self.excess
        b_slope = (C**2 + 4.0 * C + 2.0) / (12.0 * C**2 * (C + 1.0) ** 2)
        along = dot(K, vector)
        by_stretch = (vector + 2.0 * dot(d, vector) * d) / 3.0 + b_slope * along * K
        bending = C * (across(d) + self.share * _outer(K, K))  # dk/dw
        turned = jnp.sum(vector[:, None] * bending, axis=0)
        stretching = 0.25 * C * K  # dC/dw, as dC = k . dk / (4 C)
        return _outer(by_stretch, stretching) + b * (_outer(K, turned) + along * bending)

    def moment_slopes(self, stress: Vector, moment: Vector) -> tuple[Matrix, Matrix]:
        """Return the derivatives of the moment of a stress that turns with the frame.

        By ``w``, and by the mean rotation of the edges, half of each edge's.
        """
        steered = self.map_slope(stress) - _crossing(moment, self.turning)
        return steered, -0.5 * _crossing(moment, np.eye(3))

    @property
    def turning(self) -> Matrix:
        """Rotation of the middle frame per ``w``, relative to the mean of the two edges."""
        middle = self.axes[2]
        aside = cross(self.binormal, middle)
        return self.share * _outer(middle, aside) - 0.25 * _outer(aside, middle)

    @property
    def excess(self) -> Float[Array, ""]:
        """``b``."""
        C = self.stretch
        return (C**2 - 2.0) / (12.0 * C * (C + 1.0))

    @property
    def share(self) -> Float[Array, ""]:
        """``h``."""
        return 1.0 / (4.0 * (self.stretch + 1.0))


class BendTwist(Linearised):
    """Bend and twist at a node between two edges in space.

    Stores ``1/2 sum_i K_i (s_i - s_i rest)^2`` over the strains ``s = kappa_1, kappa_2, tau`` with
    ``K = EI_1 / l, EI_2 / l, GJ / l``; ``l`` is the length over which the node integrates them.
    At the root the first edge of the window is the ghost edge of the clamp, as in the plane
    (`Bend`).

    The bend's strains grow without bound as the edges fold onto each other.
    """

    stencil: ClassVar[int] = 3
    spins: ClassVar[bool] = True
    stored: ClassVar[str] = "elastic"
    worked: ClassVar[str] = "damping"
    first: int = eqx.field(static=True)
    stiffness: Float[Array, "*count 3"]
    """``EI_1 / l, EI_2 / l, GJ / l`` (N m)."""
    rest_strain: Float[Array, "*count 3"]
    """Strains without load (rad)."""
    material: Material
    memory: Any = None
    step: Float[Array, "*count"] | None = None

    @staticmethod
    def of(rod: Rod, *, pinned: bool = False) -> "BendTwist":
        """Build bend and twist of a rod, without its tip; a pinned root resists twist only."""
        assert rod.GJ is not None
        assert rod.rest_twist is not None
        stiffness = jnp.concatenate([rod.EI, rod.GJ[:, None]], axis=1) / rod.strain_length
        stiffness = stiffness[:-1]
        if pinned:
            stiffness = stiffness.at[0, :2].set(0.0)
        clamp = jnp.eye(3)
        places, directors = rod.rest_frames(clamp)
        edges = jnp.concatenate([clamp[:1], jnp.diff(places, axis=0)])
        tangents = edges / jnp.sqrt(dot(edges, edges))[:, None]
        directors = jnp.concatenate([clamp[1:2], directors])
        pairs = (tangents[:-1], tangents[1:])
        expected = (rod.rest_twist * rod.voronoi_length)[:-1]
        twist = twist_between(directors[:-1], directors[1:], pairs, expected)
        rest = jax.vmap(lambda *edge: NodeStrain.of(*edge).strains)(*pairs, directors[:-1], twist)
        return BendTwist(0, stiffness, rest, Material.of(rod, stiffness.shape[0]))

    def residual(self, motion: Motion) -> Float[Array, "3 4"]:
        a, b, strain = node_kinematics(motion)
        moment = product(strain.map, self._stress(strain, b.angular_velocity - a.angular_velocity))
        return on_nodes(-a.force(moment), b.force(moment))

    def working(self, motion: Motion) -> Float[Array, "3 4"]:
        a, b, strain = node_kinematics(motion)
        strained = strain.strains - self.rest_strain
        rates = strain.rates(b.angular_velocity - a.angular_velocity)
        stress = self.material.viscous_stress(strained, rates, self.memory, self.step)
        moment = product(strain.map, self._directed(strain, stress))
        return on_nodes(a.force(moment), -b.force(moment))

    def jacobian(self, motion: Motion, direction: TangentDirection) -> Float[Array, "3 4 3 4"]:
        assert motion.orientation is not None
        lean = motion.orientation.lean
        a, b, strain = node_kinematics(motion)
        relative = b.angular_velocity - a.angular_velocity
        stress = self._stress(strain, relative)
        G = strain.map
        stiffness = jnp.sum(
            self.stiffness[:, None, None] * strain.axes[:, :, None] * strain.axes[:, None, :],
            axis=0,
        )
        moment = product(G, stress)
        # d(moment)/dw where the edges' mean does not turn, and d(moment)/d(relative velocity)
        on_strain = product(G, stiffness)
        damping_time = self.material.damping_time
        viscous = damping_time * product(on_strain, G)
        rated = strain.map_slope(relative) + product(G, _crossing(relative, strain.turning))
        steered, taken_along = strain.moment_slopes(stress, moment)
        slope = self.material.slope(self.memory, self.step)
        by_turn = steered + product(on_strain, slope * G + damping_time * rated)
        # fixed velocities rotate backward in the turned frame
        by_mean = taken_along + 0.5 * cross(viscous, relative)

        def followed(edge: SpatialEdge, end: int, by_turn: Matrix) -> Float[Array, "3 4"]:
            velocity = direction.by_velocity * edge.turning(jnp.zeros(3))
            velocity += direction.by_position * edge.angular_velocity_slope()
            return direction.by_position * product(by_turn, edge.turning(lean[end])) + (
                product(viscous, velocity)
            )

        still = jnp.zeros(3)
        own = (-a.force_slope(moment), b.force_slope(moment))
        return slopes_on_nodes(
            (-a.turning(still).T, b.turning(still).T),
            (-followed(a, 1, by_turn - by_mean), followed(b, 2, by_turn + by_mean)),
            (direction.by_position * own[0], direction.by_position * own[1]),
        )

    def strains(self, motion: Motion) -> Float[Array, "3"]:
        """Return the integrated strains ``kappa_1, kappa_2, tau`` (rad)."""
        return node_kinematics(motion)[2].strains

    def energy(self, motion: Motion) -> Float[Array, ""]:
        strained = self.strains(motion) - self.rest_strain
        energy = self.material.energy(strained, self.memory, self.step)
        return jnp.sum(self.stiffness * energy)

    def steady(self, motion: Motion) -> Any:
        return self.material.steady(self.strains(motion) - self.rest_strain)

    def advance(self, motion: Motion) -> Any:
        strained = self.strains(motion) - self.rest_strain
        return self.material.advance(strained, self.memory, self.step)

    def _stress(self, strain: NodeStrain, relative: Vector) -> Vector:
        """Return the stress as a vector in space."""
        strained, rates = strain.strains - self.rest_strain, strain.rates(relative)
        stress = self.material.stress(strained, rates, self.memory, self.step)
        return self._directed(strain, stress)

    def _directed(self, strain: NodeStrain, strained: Vector) -> Vector:
        return jnp.sum((self.stiffness * strained)[:, None] * strain.axes, axis=0)


def node_kinematics(motion: Motion) -> tuple[SpatialEdge, SpatialEdge, NodeStrain]:
    """Return the two edges of a window, and the strains of their node."""
    assert motion.orientation is not None
    a, b = SpatialEdge.of(motion, 1), SpatialEdge.of(motion, 2)
    twist = motion.orientation.twist[1]
    return a, b, NodeStrain.of(a.tangent, b.tangent, a.director, twist)


def on_nodes(on_a: Float[Array, "4 ..."], on_b: Float[Array, "4 ..."]) -> Float[Array, "3 4 ..."]:
    """Distribute forces on the vectors of two edges, and torques about them, to their nodes."""
    places = [-on_a[:3], on_a[:3] - on_b[:3], on_b[:3]]
    spins = [jnp.zeros_like(on_a[3:]), on_a[3:], on_b[3:]]
    return jnp.stack([jnp.concatenate(node) for node in zip(places, spins, strict=True)])


def slopes_on_nodes(
    acts: tuple[Float[Array, "4 s"], Float[Array, "4 s"]],
    followed: tuple[Float[Array, "s 4"], Float[Array, "s 4"]],
    own: tuple[Float[Array, "4 4"], Float[Array, "4 4"]],
) -> Float[Array, "3 4 3 4"]:
    """Return the Jacobian of the forces and torques of stresses on two edges.

    ``acts`` has the force on each edge per unit of a stress, ``followed`` the derivatives of the
    stresses by each edge, and ``own`` those of the forces at fixed stresses.
    """
    blocks = [[product(act, by) for by in followed] for act in acts]
    blocks[0][0] += own[0]
    blocks[1][1] += own[1]
    columns = [jnp.moveaxis(on_nodes(*pair), -1, 0) for pair in zip(*blocks, strict=True)]
    return jnp.moveaxis(on_nodes(*columns), (0, 1), (2, 3))


def _outer(a: Vector, b: Vector) -> Matrix:
    return a[:, None] * b


def across(tangent: Vector) -> Matrix:
    """Return the projection normal to a unit vector."""
    return jnp.eye(3) - _outer(tangent, tangent)


def _crossing(vector: Vector, matrix: Matrix | np.ndarray) -> Matrix:
    """Return the products of a vector and each column of a matrix."""
    return cross(vector[:, None], jnp.asarray(matrix), axis=0)
