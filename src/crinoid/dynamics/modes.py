"""Small free vibrations about a state at rest: natural frequencies and the shapes that go along."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from crinoid import chain
from crinoid.dynamics.forces import Forces
from crinoid.dynamics.integrator import Stage
from crinoid.dynamics.tangent import HELD, LineStiffness
from crinoid.frames import Frames

COUNT = 8
"""How many modes are looked for: more than a current can reach on all but the limpest arms."""


class ModesError(RuntimeError):
    """Modes could not be found."""


class Modes(NamedTuple):
    """The slowest vibrations of an arm whose base is held, slowest first.

    Of an arm that is far from stable those nearest to none.
    """

    frequency: Float[np.ndarray, " mode"]
    """Natural frequencies (Hz); 0 where the arm does not swing back, to within round-off."""
    shape: Float[np.ndarray, "mode n b"]
    """How the nodes move, from the root (which does not) to the tip; at most 1.

    In space with the spin of the edge that ends at each node (rad for 1 m).
    """


class SmallMotions(NamedTuple):
    """Stiffness, damping and mass of small motions of all nodes about a shape at rest."""

    stiffness: chain.Bands
    """N/m, and of spins N m."""
    mass: chain.Bands
    """With added mass (kg)."""
    stiffness_in_current: chain.Bands
    """In a steady current, whose drag changes as the arm turns (N/m)."""
    damping_in_current: chain.Bands
    """Damping of the material, and the slope of the quadratic drag in that current (N s/m)."""
    stiffness_in_still_water: chain.Bands
    damping_in_still_water: chain.Bands


def linearise(
    forces: Forces,
    time: Float[Array, ""],
    position: Float[Array, "rows b"],
    frames: Frames | None,
    current: Float[Array, " d"],
) -> SmallMotions:
    """Linearise the forces on the nodes about a shape at rest.

    In the water as it flows at ``time``, in a steady ``current`` (m/s) past the same shape, and in
    still water. Obstacles stay where they are (in ``position``, the rows after the nodes). In
    space ``frames`` are those of the shape.
    """
    forces = forces.frozen(time)
    zero = jnp.zeros_like(position)

    def tangent(by: Float[Array, "3"], steady: Bool[Array, ""], speed: Array) -> chain.Bands:
        stage = Stage(time, position, zero, zero, by[0], by[1], by[2], frames)
        around = forces.surroundings(stage, zero)
        flows = jnp.where(steady, speed * current, around.velocity)
        slope = jnp.where(steady, 0.0, around.velocity_slope)
        around = eqx.tree_at(lambda a: (a.velocity, a.velocity_slope), around, (flows, slope))
        return forces.tangent(stage, forces.motion(stage, zero, around), around).bands

    of = jnp.eye(3)[jnp.array([0, 2, 0, 1, 0, 1])]
    steady = jnp.array([False, False, True, True, True, True])
    speed = jnp.array([0.0, 0.0, 1.0, 1.0, 0.0, 0.0])
    # one after the other: the tangent is compiled once for all
    return SmallMotions(*jax.lax.map(lambda one: tangent(*one), (of, steady, speed)))


def find_modes(
    stiffness: chain.Bands,
    mass: chain.Bands,
    count: int = COUNT,
    lines: LineStiffness | None = None,
) -> Modes:
    """Solve ``K phi = (2 pi f)^2 M phi`` of the free nodes for the slowest vibrations.

    Damping is left out. Of the stiffness the symmetric part is taken: drag and follower loads make
    it lopsided, but as ``phi . A phi = 0`` the antisymmetric rest ``A`` moves no squared frequency
    to first order. By Lanczos's method on the inverse, shifted to zero (ARPACK); runs on the host.

    Round-off in the stiffness shifts the first bending frequency by a share that grows as the
    fourth power of the number of nodes, to some 1e-5 at 1000 nodes.

    Parameters
    ----------
    stiffness, mass
        Of all nodes (N/m, kg), as `crinoid.System.linearise` returns them.
    count
        How many modes; fewer than the free nodes have coordinates.
    lines
        What lines add to the stiffness.

    Raises
    ------
    ModesError
        If the matrices hold what is no number, or the iteration does not converge.
    """
    # slow to load, and many commands do without
    from scipy.linalg import eigh
    from scipy.sparse.linalg import LinearOperator, eigsh

    K, M = (0.5 * (A + A.T) for A in map(of_free, (stiffness, mass)))
    unknowns, size = K.shape[0], stiffness.shape[-1]
    held = _roots(lines, unknowns)
    nothing = round_off(K, M, held, held.T)
    shift = -1e3 * nothing  # the least ones are next to it, and nothing is singular there
    try:
        _, near = eigsh(
            K,
            min(count, unknowns - 1),
            M,
            sigma=shift,
            OPinv=LinearOperator(K.shape, inverse(K - shift * M, held, held.T), dtype=float),
            v0=np.random.default_rng(0).standard_normal(unknowns),
        )
        # what the shift has cost in accuracy comes back in the space of these few
        taut = held.T @ near
        squared, mixed = eigh(near.T @ (K @ near) + taut.T @ taut, near.T @ (M @ near))
    except (RuntimeError, ValueError) as error:  # of ARPACK, SuperLU and LAPACK
        raise ModesError(f"no natural frequencies found: {error}") from error
    shapes = np.pad((near @ mixed).T.reshape(squared.size, -1, size), ((0, 0), (1, 0), (0, 0)))
    for shape in shapes:
        shape /= shape.flat[np.argmax(np.abs(shape))]
    frequency = np.sqrt(np.where(squared > nothing, squared, 0.0)) / (2 * np.pi)
    return Modes(frequency, shapes)


def _roots(lines: LineStiffness | None, unknowns: int) -> Float[np.ndarray, "unknowns line"]:
    """Return ``U`` of the stiffness ``U U^T`` of lines: what they pull at is what they follow."""
    if lines is None:
        return np.zeros((unknowns, 0))
    pull = np.asarray(lines.pull)[HELD:].reshape(unknowns, -1)
    follow = np.asarray(lines.follow)[:, HELD:].reshape(-1, unknowns)
    stiffness = np.linalg.norm(follow, axis=1) / np.linalg.norm(pull, axis=0)
    return np.asarray(pull * np.sqrt(stiffness))


def inverse(
    matrix: Any, pull: Float[np.ndarray, "n line"], follow: Float[np.ndarray, "line n"]
) -> Callable[[np.ndarray], Any]:
    """Return what solves with a sparse matrix plus ``pull follow`` (Woodbury's formula)."""
    from scipy.sparse.linalg import splu

    parts = splu(matrix.tocsc())
    if not pull.size:
        return parts.solve
    answers = parts.solve(pull.astype(matrix.dtype))
    small = np.eye(pull.shape[1]) + follow @ answers

    def solve(rhs: np.ndarray) -> Any:
        alone = parts.solve(rhs)
        return alone - answers @ np.linalg.solve(small, follow @ alone)

    return solve


def of_free(bands: chain.Bands) -> Any:
    """Return the matrix of the free nodes, sparse."""
    from scipy.sparse import csc_array

    blocks = np.asarray(bands)[HELD:]
    nodes, _, size, _ = blocks.shape
    node, offset, i, j = np.indices(blocks.shape)
    row, column = node * size + i, (node + offset - 2) * size + j
    inside = (column >= 0) & (column < nodes * size)
    return csc_array(
        (blocks[inside], (row[inside], column[inside])), shape=(nodes * size, nodes * size)
    )


def round_off(
    K: Any, M: Any, pull: Float[np.ndarray, "n line"], follow: Float[np.ndarray, "line n"]
) -> float:
    """Return the squared circular frequency (1/s2) that is none but round-off of the stiffness."""
    scale = 1 / np.sqrt(M.diagonal())
    resisted = abs(K) @ scale + np.abs(pull) @ (np.abs(follow) @ scale)
    return float(16 * np.finfo(float).eps * (resisted * scale).max())
