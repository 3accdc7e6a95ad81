"""Undamped modes of vibration about a state at rest. Computed on the host."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from crinoid.dynamics.rows import BOUNDARY_NODES
from crinoid.dynamics.tangent import LineStiffness
from crinoid.numerics import banded

COUNT = 8
"""Default number of modes: more than a current can excite on all but very limp arms."""


class ModesError(RuntimeError):
    """Failure of an eigenvalue solver."""


class Modes(NamedTuple):
    """Undamped modes of an arm whose base is held, slowest first.

    Of an arm far from stable, those of least frequency.
    """

    frequency: Float[np.ndarray, " mode"]
    """Natural frequencies (Hz); 0 where the arm does not swing back, to within round-off."""
    shape: Float[np.ndarray, "mode n b"]
    """Displacement of the nodes from the root (zero) to the tip; at most 1.

    In space with the spin of the edge that ends at each node (rad per m).
    """


def find_modes(
    stiffness: banded.Bands,
    mass: banded.Bands,
    count: int = COUNT,
    lines: LineStiffness | None = None,
) -> Modes:
    """Solve ``K phi = (2 pi f)^2 M phi`` of the free nodes for the slowest vibrations.

    Damping is omitted, and the stiffness symmetrised: drag and follower loads make it asymmetric,
    but as ``phi . A phi = 0`` the antisymmetric part ``A`` changes no squared frequency to first
    order. Shift-invert Lanczos method (ARPACK), on the host.

    Round-off in the stiffness shifts the first bending frequency by a share that grows as the
    fourth power of the number of nodes, to some 1e-5 at 1000 nodes.

    The matrices are those of all nodes (N/m, kg), of `crinoid.System.linearise`, and ``lines`` the
    stiffness that lines add. ``count`` is less than the coordinates of the free nodes.
    """
    # slow to load, and many commands do without
    from scipy.linalg import eigh
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import LinearOperator, eigsh

    K, M = (0.5 * (A + A.T) for A in map(of_free, (stiffness, mass)))
    unknowns, size = K.shape[0], stiffness.shape[-1]
    pull, follow = of_lines(lines, unknowns)
    if pull.shape[1] > unknowns:  # contact of the arm with itself: not a low rank
        far = csc_array(0.5 * (pull @ follow + (pull @ follow).T))
        K, pull, follow = K + far, pull[:, :0], follow[:0]
    # the stiffness of lines is U U^T: the nodes that they pull at are those that they follow
    held = pull * np.sqrt(np.linalg.norm(follow, axis=1) / np.linalg.norm(pull, axis=0))
    nothing = round_off(K, M, held, held.T)
    shift = -1e3 * nothing  # below the least ones, so nothing is singular there
    try:
        _, near = eigsh(
            K,
            min(count, unknowns - 1),
            M,
            sigma=shift,
            OPinv=LinearOperator(K.shape, inverse(K - shift * M, held, held.T), dtype=float),
            v0=np.random.default_rng(0).standard_normal(unknowns),
        )
        # Rayleigh-Ritz in the space of these few restores the accuracy that the shift cost
        taut = held.T @ near
        squared, mixed = eigh(near.T @ (K @ near) + taut.T @ taut, near.T @ (M @ near))
    except (RuntimeError, ValueError) as error:  # from ARPACK, SuperLU and LAPACK
        raise ModesError(f"no natural frequencies found: {error}") from error
    frequency = np.sqrt(np.where(squared > nothing, squared, 0.0)) / (2 * np.pi)
    return Modes(frequency, normalised(near @ mixed, size))


def normalised(shapes: np.ndarray, size: int) -> np.ndarray:
    """Return shapes from the columns of free nodes, with a root, the largest entry of each 1."""
    shapes = np.pad(shapes.T.reshape(shapes.shape[1], -1, size), ((0, 0), (1, 0), (0, 0)))
    for shape in shapes:
        shape /= shape.flat[np.argmax(np.abs(shape))]
    return shapes


def inverse(
    matrix: Any, pull: Float[np.ndarray, "n line"], follow: Float[np.ndarray, "line n"]
) -> Callable[[np.ndarray], Any]:
    """Return a solver of a sparse matrix plus ``pull follow`` (Woodbury's formula)."""
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


def of_free(bands: banded.Bands) -> Any:
    """Return the sparse matrix of the free nodes."""
    from scipy.sparse import csc_array

    blocks = np.asarray(bands)[BOUNDARY_NODES:]
    nodes, _, size, _ = blocks.shape
    row, column = banded.places(nodes, size)
    inside = (column >= 0) & (column < nodes * size)
    return csc_array(
        (blocks[inside], (row[inside], column[inside])), shape=(nodes * size, nodes * size)
    )


def round_off(
    K: Any, M: Any, pull: Float[np.ndarray, "n line"], follow: Float[np.ndarray, "line n"]
) -> float:
    """Return the squared circular frequency (1/s2) that round-off of the stiffness makes."""
    scale = 1 / np.sqrt(M.diagonal())
    resisted = abs(K) @ scale + np.abs(pull) @ (np.abs(follow) @ scale)
    return float(16 * np.finfo(float).eps * (resisted * scale).max())


def of_lines(lines: LineStiffness | None, unknowns: int) -> tuple[np.ndarray, np.ndarray]:
    """Return pull and follow of lines on the free nodes, empty without lines."""
    if lines is None:
        return np.zeros((unknowns, 0)), np.zeros((0, unknowns))
    pull = np.asarray(lines.pull)[BOUNDARY_NODES:].reshape(unknowns, -1)
    return pull, np.asarray(lines.follow)[:, BOUNDARY_NODES:].reshape(-1, unknowns)
