"""Node between two edges of a discrete rod: its strains, and the forces of their stresses.

The strains are integrated over the node (rad). A relative turn ``w`` of the two edges (rad) changes
them by ``G w``, so that stresses ``S`` hand on the moment ``G^T S`` from edge to edge.

In the plane the strain is the turn, as `bend_strain` measures it. In space the two edges carry a
material frame each. Turned by half of the twist and half of the bend both come to the same middle
frame ``(d, M_1, M_2)``, with ``d`` along ``t_a + t_b``. The strains are read in it: with
``k = 2 t_a x t_b / (1 + t_a . t_b)``, the binormal, and ``s`` along ``k``, as long as `bend_strain`
says,

``kappa_1 = s . M_2``, ``kappa_2 = -s . M_1`` and ``tau``, the twist from one frame to the other

(after Bergou et al. 2008, eq. 1; 2010, section 4). Where these average the components in the
frames of both edges the middle frame has the true ones: they do not shrink as the node twists.

With the edges' relative angular velocity ``w`` the binormal changes in the middle frame as
``dk/dt = C (w_n + h (k . w) k)``, where ``w_n`` is ``w`` across ``d`` and

``C = 1 / cos(bend / 2) = sqrt(1 + k.k / 4)``, ``h = 1 / (4 (C + 1))``.

The axes ``M_2``, ``-M_1`` and ``d``, turned back by half of the bend, are those of the first edge.
In these ``k`` has the same components ``(k_1, k_2, 0)``, and with ``q = (k_2, -k_1) / 2``

``kappa = m k``, ``G = [[m 1 + k k^T / 12, -m q], [q^T, 1]]``, ``m = (1 + 2 / C) / 3``.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.elements.element import Motion
from crinoid.numerics.frames import cross, dot, moments, rotate_90, rotation_velocity, unit
from crinoid.numerics.small_matrices import product

_SIGN = np.array([[-1.0], [1.0]])  # of the two edges of a node in their relative turn


class Node(NamedTuple):
    """Kinematics of a node: two edges, and the strains between them."""

    tangent: Float[Array, "2 d"]
    length: Float[Array, "2"]  # m
    lever: Float[Array, "2 d"]
    """Tangents over lengths: ``lever x v`` is the turning of an edge whose ends part by ``v``."""
    strains: Float[Array, " s"]
    """Turn of the edges, in space ``kappa_1, kappa_2, tau`` (rad)."""
    slope: Float[Array, "s turns"]
    """``G``."""

    @staticmethod
    def of(motion: Motion) -> "Node":
        """Return the node in the middle of a window."""
        tangent, length = jax.vmap(unit)(_between(motion.position, motion))
        if motion.orientation is None:
            strains, slope = planar_strains(*tangent)
        else:
            director, twist = motion.orientation.director[1], motion.orientation.twist[1]
            strains, slope = spatial_strains(tangent[0], tangent[1], director, twist)
        return Node(tangent, length, tangent / length[:, None], strains, slope)

    def rates(self, motion: Motion) -> Float[Array, " s"]:
        """Return the rates of the strains (rad/s)."""
        turning = moments(self.lever, _between(motion.velocity, motion))
        if motion.orientation is not None:
            turning += motion.velocity[1:, 3:] * self.tangent
        return product(self.slope, turning[1] - turning[0])

    def forces(
        self, stresses: Float[Array, " s"], pulls: Float[Array, "2"] | None = None
    ) -> Float[Array, "3 b"]:
        """Return the residual of stresses of the strains (N m), and of pulls of the edges (N)."""
        moment = product(stresses, self.slope)
        force = _SIGN * rotation_velocity(moment, self.lever)
        if pulls is not None:
            force += pulls[:, None] * self.tangent
        ends = jnp.stack([-force[0], force[0] - force[1], force[1]])
        if moment.size == 1:
            return ends
        torque = _SIGN * dot(moment, self.tangent)[:, None]
        return jnp.concatenate([ends, jnp.pad(torque, ((1, 0), (0, 0)))], axis=1)


def _between(rows: Float[Array, "3 b"], motion: Motion) -> Float[Array, "2 d"]:
    """Return the differences along the edges."""
    rows = rows[:, : motion.flow_velocity.shape[-1]]
    return rows[1:] - rows[:-1]


def planar_strains(
    before: Float[Array, "2"], after: Float[Array, "2"]
) -> tuple[Float[Array, "1"], Float[Array, "1 1"]]:
    """Return the strain between two directions, and ``G``."""
    tangent = dot(rotate_90(before), after)[None] / (1.0 + dot(before, after))
    secant = jnp.sqrt(1.0 + tangent**2)
    return bend_strain(tangent, secant), ((secant**2 + 2.0 / secant) / 3.0)[None]


def spatial_strains(
    before: Float[Array, "3"],
    after: Float[Array, "3"],
    director: Float[Array, "3"],
    twist: Float[Array, ""],
) -> tuple[Float[Array, "3"], Float[Array, "3 3"]]:
    """Return the strains from both tangents, the first director and the twist, and ``G``."""
    # M_2 and -M_1 turned back by half of the bend, about the binormal: it reads the same in both
    cosine, sine, aside = jnp.cos(0.5 * twist), jnp.sin(0.5 * twist), cross(before, director)
    axes = jnp.stack([cosine * aside - sine * director, -sine * aside - cosine * director])
    half = product(axes, after) / (1.0 + dot(before, after))
    binormal = 2.0 * jnp.stack([-half[1], half[0]])
    secant = jnp.sqrt(1.0 + dot(half, half))
    growth = (1.0 + 2.0 / secant) / 3.0
    around = binormal[:, None] * product(binormal / 12.0, axes)
    bending = growth * (axes - half[:, None] * before) + around
    twisting = before + product(half, axes)
    return (
        jnp.append(bend_strain(0.5 * binormal, secant), twist),
        jnp.concatenate([bending, twisting[None]]),
    )


def bend_strain(tangent: Float[Array, "..."], secant: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return the strain of a bend from tangent and secant of half its angle.

    ``(2 tan(a / 2) + 4 sin(a / 2)) / 3``, a mean of Snell's and Huygens's bounds of the arc: the
    angle ``a`` to within ``a^5 / 320``, yet unbounded as the edges fold onto each other. The
    binormal ``2 tan(a / 2)`` alone would stiffen a bend by ``a^2 / 3``.
    """
    return 2.0 / 3.0 * tangent * (1.0 + 2.0 / secant)
