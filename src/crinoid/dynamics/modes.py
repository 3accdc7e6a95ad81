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
    to first order. Runs on the host.

    Round-off in the stiffness shifts the first bending frequency by a share that grows as the
    fourth power of the number of nodes, to some 1e-5 at 1000 nodes.

    Parameters
    ----------
    stiffness, mass
        Of all nodes, as `linearise` returns them.
    count
        How many modes; fewer if the arm has fewer.
    """
    from scipy.linalg import eigh  # slow to load, and many commands do without

    K, M = (_free(bands) for bands in (stiffness, mass))
    nodes, size = stiffness.shape[0] - HELD, stiffness.shape[-1]
    count = min(count, nodes * size)
    squared, vectors = eigh(K, M, subset_by_index=(0, count - 1))
    scale = 1 / np.sqrt(np.diag(M))
    noise = nodes * size * np.finfo(float).eps * (np.abs(K) @ scale * scale).max()
    shapes = np.pad(vectors.T.reshape(count, nodes, size), ((0, 0), (1, 0), (0, 0)))
    for shape in shapes:
        shape /= shape.flat[np.argmax(np.abs(shape))]
    frequency = np.sqrt(np.where(squared > noise, squared, 0.0)) / (2 * np.pi)
    return Modes(frequency, shapes)


def _free(bands: chain.Bands) -> Float[np.ndarray, "unknown unknown"]:
    """Return the symmetric part of the matrix of the free nodes."""
    blocks = np.asarray(bands)[HELD:]
    nodes, _, size, _ = blocks.shape
    matrix = np.zeros((nodes, size, nodes, size))
    for offset in range(-2, 3):
        row = np.arange(max(0, -offset), min(nodes, nodes - offset))
        matrix[row, :, row + offset, :] = blocks[row, 2 + offset]
    square = matrix.reshape(nodes * size, nodes * size)
    return 0.5 * (square + square.T)
