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
OnEdges = Float[Array, "2 4"]

_SIGN = np.array([[-1.0], [1.0]])
"""Of the two edges of a node in their relative turn."""
_CROSSED = np.cross(np.eye(3), np.eye(3)[:, None])
"""Entries of the matrix of a vector product, by the vector."""


class Edges(NamedTuple):
    """The two edges of a window and their motion.

    Derivatives by an edge are those by the vector along it and by its spin.
    """

    tangent: Float[Array, "2 3"]
    length: Float[Array, "2 1"]
    """m."""
    rate: Float[Array, "2 3"]
    """Rate of the vector from end to end, over its length (1/s)."""
    spin_rate: Float[Array, "2 1"]
    """rad/s."""

    @staticmethod
    def of(motion: Motion) -> "Edges":
        vector, moving = (
            rows[1:, :3] - rows[:-1, :3] for rows in (motion.position, motion.velocity)
        )
        tangent, length = jax.vmap(unit)(vector)
        length = length[:, None]
        return Edges(tangent, length, moving / length, motion.velocity[1:, 3:])

    @property
    def turning(self) -> Vector:
        """Angular velocity of the second edge relative to the first (rad/s)."""
        rates = cross(self.tangent, self.rate) + self.spin_rate * self.tangent
        return rates[1] - rates[0]

    def forces(self, moment: Vector) -> OnEdges:
        """Return the forces of a moment on the second edge, and of its opposite on the first.

        Forces on the edges' vectors (N) and torques about them (N m).
        """
        force, torque = cross(moment, self.tangent), dot(moment, self.tangent)[:, None]
        return jnp.concatenate([force / self.length, torque], axis=1) * _SIGN

    def turns(self, lean: Float[Array, "2 3"] | None = None) -> Float[Array, "2 3 4"]:
        """Return the derivatives of the relative turn, at fixed directors or with a ``lean``."""
        swung = _skew(self.tangent)
        if lean is not None:
            swung += _outer(self.tangent, lean)
        swung /= self.length[..., None]
        return jnp.concatenate([swung, self.tangent[..., None]], axis=2) * _SIGN[..., None]

    def force_slopes(self, moment: Vector) -> Float[Array, "2 4 4"]:
        """Return the derivatives of the `forces` on each edge by itself at a fixed moment."""
        length, swing = self.length[..., None], self.swing
        pull = _outer(cross(moment, self.tangent), self.tangent) / length
        force = (product(_skew(moment), swing) - pull) / length
        torque = product(moment[None], swing)
        slopes = jnp.concatenate([force, torque], axis=1)
        return jnp.pad(slopes, ((0, 0), (0, 0), (0, 1))) * _SIGN[..., None]

    def turning_slopes(self) -> Float[Array, "2 3 4"]:
        """Return the derivatives of `turning` by each edge at fixed velocities."""
        swing = self.length[..., None] * self.swing
        changed = self.spin_rate[..., None] * swing - product(_skew(self.rate), swing)
        changed -= _outer(cross(self.tangent, self.rate), self.tangent)
        slopes = changed / self.length[..., None] * _SIGN[..., None]
        return jnp.pad(slopes, ((0, 0), (0, 0), (0, 1)))

    @property
    def swing(self) -> Float[Array, "2 3 3"]:
        """Derivatives of the tangents by the vectors along the edges."""
        return (jnp.eye(3) - _outer(self.tangent, self.tangent)) / self.length[..., None]


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

    def moment(self, stresses: Vector) -> Vector:
        """Return the moment of the stresses of the three strains (N m)."""
        return product(self.map, product(stresses, self.axes))

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
        bending = C * (np.eye(3) - _outer(d, d) + self.share * _outer(K, K))  # dk/dw
        turned = product(vector, bending)
        stretching = 0.25 * C * K  # dC/dw, as dC = k . dk / (4 C)
        return _outer(by_stretch, stretching) + b * (_outer(K, turned) + along * bending)

    def moment_slopes(self, stress: Vector, moment: Vector) -> tuple[Matrix, Matrix]:
        """Return the derivatives of the moment of a stress that turns with the frame.

        By ``w``, and by the mean rotation of the edges, half of each edge's.
        """
        across = _skew(moment)
        return self.map_slope(stress) - product(across, self.turning), -0.5 * across

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
        edges, strain = node_kinematics(motion)
        strained, rates = strain.strains - self.rest_strain, strain.rates(edges.turning)
        stress = self.material.stress(strained, rates, motion.memory, motion.step)
        return on_nodes(edges.forces(strain.moment(self.stiffness * stress)))

    def working(self, motion: Motion) -> Float[Array, "3 4"]:
        edges, strain = node_kinematics(motion)
        strained, rates = strain.strains - self.rest_strain, strain.rates(edges.turning)
        stress = self.material.viscous_stress(strained, rates, motion.memory, motion.step)
        return -on_nodes(edges.forces(strain.moment(self.stiffness * stress)))

    def jacobian(self, motion: Motion, direction: TangentDirection) -> Float[Array, "3 4 3 4"]:
        assert motion.orientation is not None
        edges, strain = node_kinematics(motion)
        turning, G = edges.turning, strain.map
        strained, rates = strain.strains - self.rest_strain, strain.rates(turning)
        stresses = self.stiffness * self.material.stress(
            strained, rates, motion.memory, motion.step
        )
        stress = product(stresses, strain.axes)
        moment = product(G, stress)
        # d(moment)/dw where the edges' mean does not turn, and d(moment)/d(relative velocity)
        on_strain = product(G, product(strain.axes.T * self.stiffness, strain.axes))
        damping_time = self.material.damping_time
        viscous = damping_time * product(on_strain, G)
        rated = strain.map_slope(turning) + product(G, product(_skew(turning), strain.turning))
        steered, taken_along = strain.moment_slopes(stress, moment)
        slope = self.material.slope(motion.memory, motion.step)
        by_turn = steered + product(on_strain, slope * G + damping_time * rated)
        # fixed velocities rotate backward in the turned frame
        by_mean = taken_along + 0.5 * product(viscous, _skew(turning))
        turns = edges.turns()
        velocity = direction.by_velocity * turns + direction.by_position * edges.turning_slopes()
        swung = edges.turns(motion.orientation.lean[1:])
        by_edge = product(by_turn + _SIGN[..., None] * by_mean, swung)
        return slopes_on_nodes(
            turns,
            direction.by_position * by_edge + product(viscous[None], velocity),
            direction.by_position * edges.force_slopes(moment),
        )

    def strains(self, motion: Motion) -> Float[Array, "3"]:
        """Return the integrated strains ``kappa_1, kappa_2, tau`` (rad)."""
        return node_kinematics(motion)[1].strains

    def energy(self, motion: Motion) -> Float[Array, ""]:
        strained = self.strains(motion) - self.rest_strain
        energy = self.material.energy(strained, motion.memory, motion.step)
        return jnp.sum(self.stiffness * energy)

    @property
    def remembers(self) -> bool:
        return self.material.relaxation is not None

    def steady(self, motion: Motion) -> Any:
        return self.material.steady(self.strains(motion) - self.rest_strain)

    def advance(self, motion: Motion) -> Any:
        strained = self.strains(motion) - self.rest_strain
        return self.material.advance(strained, motion.memory, motion.step)


def node_kinematics(motion: Motion) -> tuple[Edges, NodeStrain]:
    """Return the two edges of a window, and the strains of their node."""
    assert motion.orientation is not None
    edges, orientation = Edges.of(motion), motion.orientation
    a, b = edges.tangent
    strain = NodeStrain.of(a, b, orientation.director[1], orientation.twist[1])
    return edges, strain


def on_nodes(on_edges: Float[Array, "2 4 ..."]) -> Float[Array, "3 4 ..."]:
    """Distribute forces on the vectors of two edges, and torques about them, to their nodes."""
    rest = [(0, 0)] * (on_edges.ndim - 1)
    ahead = jnp.pad(on_edges[:, :3], ((0, 1), (0, 1), *rest[1:]))
    return jnp.pad(on_edges, ((1, 0), *rest)) - ahead


def slopes_on_nodes(
    turns: Float[Array, "2 s 4"], followed: Float[Array, "2 s 4"], own: Float[Array, "2 4 4"]
) -> Float[Array, "3 4 3 4"]:
    """Return the Jacobian of the forces and torques of stresses on two edges.

    By each edge, ``turns`` has the derivatives of the stresses' strains, ``followed`` those of the
    stresses, and ``own`` those of its forces at fixed stresses.
    """
    acts, by = (jnp.moveaxis(each, 1, -1).reshape(8, -1) for each in (turns, followed))
    blocks = product(acts, by.T).reshape(2, 4, 2, 4)
    blocks += own[:, :, None] * np.eye(2)[:, None, :, None]
    columns = jnp.moveaxis(on_nodes(blocks), (0, 1), (2, 3))
    return jnp.moveaxis(on_nodes(columns), (0, 1), (2, 3))


def _outer(a: Float[Array, "*edge 3"], b: Float[Array, "*edge 3"]) -> Float[Array, "*edge 3 3"]:
    return a[..., :, None] * b[..., None, :]


def _skew(vector: Float[Array, "*edge 3"]) -> Float[Array, "*edge 3 3"]:
    """Return the matrix of the vector product with a vector."""
    return jnp.sum(_CROSSED * vector[..., None, None, :], axis=-1)
