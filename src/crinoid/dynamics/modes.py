"""Small free vibrations about a state at rest: natural frequencies and the shapes that go along."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid import chain
from crinoid.dynamics.forces import Forces
from crinoid.dynamics.integrator import Stage
from crinoid.dynamics.tangent import HELD
from crinoid.frames import Frames

COUNT = 8
"""How many modes are looked for: more than a current can reach on all but the limpest arms."""


class Modes(NamedTuple):
    """The slowest vibrations of an arm whose base is held, slowest first."""

    frequency: Float[np.ndarray, " mode"]
    """Natural frequencies (Hz); 0 where the arm does not swing back, to within round-off."""
    shape: Float[np.ndarray, "mode n b"]
    """How the nodes move, from the root (which does not) to the tip; at most 1.

    In space with the spin of the edge that ends at each node (rad for 1 m).
    """


def linearise(
    forces: Forces,
    time: Float[Array, ""],
    position: Float[Array, "rows b"],
    frames: Frames | None,
) -> tuple[chain.Bands, chain.Bands]:
    """Return stiffness (N/m) and mass (kg) of small motions of the nodes about a shape at rest.

    The water flows on as it does at ``time``, obstacles stay where they are (in ``position``, the
    rows after the nodes). The mass contains the added mass. In space ``frames`` are those of the
    shape, and the stiffness that of spins too (N m).
    """
    forces = forces.frozen(time)
    zero, none = jnp.zeros_like(position), jnp.zeros(())

    def tangent(by: Float[Array, "2"]) -> chain.Bands:
        stage = Stage(time, position, zero, zero, by[0], none, by[1], frames)
        around = forces.surroundings(stage, zero)
        return forces.tangent(stage, forces.motion(stage, zero, around), around).bands

    # one after the other: the tangent is compiled once for both
    stiffness, mass = jax.lax.map(tangent, jnp.eye(2))
    return stiffness, mass


def find_modes(stiffness: chain.Bands, mass: chain.Bands, count: int = COUNT) -> Modes:
    """Solve ``K phi = (2 pi f)^2 M phi`` of the free nodes for the slowest vibrations.

    Damping is left out. Of the stiffness the symmetric part is taken: drag and follower loads make
    it lopsided, but as ``phi . A phi = 0`` the antisymmetric rest ``A`` moves no squared frequency
    to first order. The mass is lumped, so each node's own block of it turns the problem into a
    standard one that is as narrow a band as the stiffness. Runs on the host.

    Round-off in the stiffness shifts the first bending frequency by a share that grows as the
    fourth power of the number of nodes, to some 1e-5 at 1000 nodes.

    Parameters
    ----------
    stiffness, mass
        Of all nodes, as `linearise` returns them.
    count
        How many modes; fewer if the arm has fewer.

    Raises
    ------
    ValueError
        If the acceleration of a node loads its neighbours.
    """
    from scipy.linalg import eig_banded, solve_banded  # slow to load, and many commands do without

    K, M = np.asarray(stiffness)[HELD:], np.asarray(mass)[HELD:]
    if np.delete(M, 2, axis=1).any():
        raise ValueError("natural frequencies need a mass that is lumped at the nodes")
    nodes, _, size, _ = K.shape
    root = np.linalg.inv(np.linalg.cholesky(M[:, 2]))
    reach = 3 * size - 1
    banded = np.zeros((2 * reach + 1, nodes * size))
    for offset in range(-2, 3):
        row = np.arange(max(0, -offset), min(nodes, nodes - offset))
        column = row + offset
        block = 0.5 * (K[row, 2 + offset] + K[column, 2 - offset].swapaxes(1, 2))
        block = root[row] @ block @ root[column].swapaxes(1, 2)
        for i in range(size):
            for j in range(size):
                banded[reach + i - j - size * offset, column * size + j] = block[:, i, j]

    count = min(count, nodes * size)
    squared = eig_banded(
        banded[reach:], lower=True, eigvals_only=True, select="i", select_range=(0, count - 1)
    )
    noise = nodes * size * np.finfo(float).eps * np.abs(banded).sum(axis=0).max()
    start = np.random.default_rng(0).standard_normal(nodes * size)
    shapes = np.zeros((count, nodes + 1, size))
    vectors = np.zeros((count, nodes * size))
    for mode, (shape, value) in enumerate(zip(shapes, squared, strict=True)):
        shifted = banded.copy()
        shifted[reach] -= value + noise  # beside the eigenvalue, or there would be nothing to solve
        vector = start
        for _ in range(3):  # inverse iteration
            vector = solve_banded((reach, reach), shifted, vector)
            # a round arm bends both ways at one frequency: not the same way again
            vector -= vectors[:mode].T @ (vectors[:mode] @ vector)
            vector /= np.linalg.norm(vector)
        vectors[mode] = vector
        shape[1:] = np.einsum("nji,nj->ni", root, vector.reshape(nodes, size))
        shape /= shape.flat[np.argmax(np.abs(shape))]
    frequency = np.sqrt(np.where(squared > noise, squared, 0.0)) / (2 * np.pi)
    return Modes(frequency, shapes)
