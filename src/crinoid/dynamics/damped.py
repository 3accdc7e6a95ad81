"""Small vibrations with their damping: the modes of a quadratic eigenproblem."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from crinoid import chain
from crinoid.dynamics.modes import ModesError, find_modes, inverse, of_free, round_off
from crinoid.dynamics.tangent import HELD, LineStiffness

_DENSE = 400
"""Unknowns up to which the problem is solved whole, in dense matrices."""
_SPARE = 40
"""Undamped modes that a larger one is looked for among, beside two for each that is asked for."""
_REAL = 1e-7
"""Part of an eigenvalue that is none: of a double root half the digits are known."""
_UNDAMPED = 1e-10
"""Part of an eigenvalue that is round-off."""
_REFINED = 1e-9
"""Change of an eigenvalue, over itself, that is the last."""
_SOLVES = 30


class DampedModes(NamedTuple):
    """Vibrations ``Re(shape exp(lambda t))`` of an arm whose base is held, slowest first.

    In the order of ``|lambda|``, their natural circular frequency; of a mode that is overdamped
    ``sqrt(k / m)``, with the stiffness and mass that its shape has. That one is told of by
    the slower of its two rates.
    """

    frequency: Float[np.ndarray, " mode"]
    """``Im(lambda) / 2 pi`` (Hz): how often it swings; 0 where it does not."""
    damping_ratio: Float[np.ndarray, " mode"]
    """``-Re(lambda) / |lambda|``: negative where the vibration grows, -1 where the arm leaves
    without swinging; ``c / (2 sqrt(k m))`` of an overdamped one, 1 or more. NaN of a motion that
    nothing drives back or away."""
    decay_rate: Float[np.ndarray, " mode"]
    """``-Re(lambda)`` (1/s)."""
    shape: Complex[np.ndarray, "mode n b"]
    """How the nodes move, from the root (which does not) to the tip; the largest entry is 1.

    Nodes that do not move in phase have entries that are not real. In space with the spin of
    the edge that ends at each node (rad for 1 m).
    """


def find_damped_modes(
    stiffness: chain.Bands,
    damping: chain.Bands,
    mass: chain.Bands,
    count: int,
    lines: LineStiffness | None = None,
) -> DampedModes:
    """Solve ``(K + lambda C + lambda^2 M) x = 0`` of the free nodes for the slowest modes.

    ``K`` and ``C`` may be lopsided, as those in a current are. The problem is solved in companion
    form (Tisseur and Meerbergen 2001, SIAM Review 43, section 3.4), in coordinates in which the
    undamped problem with the symmetric part of ``K`` is diagonal. Of an arm of more than 400
    unknowns only the slowest undamped modes are such coordinates, and what comes out is refined by
    residual inverse iteration (Neumaier 1985, SIAM Journal on Numerical Analysis 22). Runs on the
    host.

    Parameters
    ----------
    stiffness, damping, mass
        Of all nodes (N/m, N s/m, kg), as `crinoid.System.small_motions` returns them.
    count
        How many modes; an arm with fewer gives all.
    lines
        What lines add to the stiffness.

    Raises
    ------
    ModesError
        If the matrices hold what is no number, or the iteration does not converge.
    """
    # slow to load, and many commands do without
    from scipy.linalg import eig, eigh

    K, C, M = map(of_free, (stiffness, damping, mass))
    unknowns, size = K.shape[0], stiffness.shape[-1]
    pull, follow = _of_lines(lines, unknowns)
    whole = unknowns <= _DENSE
    try:
        basis = np.eye(unknowns)
        if not whole:
            known = find_modes(stiffness, mass, 2 * count + _SPARE, lines)
            basis = known.shape[:, 1:].reshape(-1, unknowns).T
        k, c, m = (basis.T @ (A @ basis) for A in (K, C, M))
        k += (basis.T @ pull) @ (follow @ basis)
        m = 0.5 * (m + m.T)
        _, own = eigh(0.5 * (k + k.T), m)
        basis, k, c = basis @ own, own.T @ k @ own, own.T @ c @ own
        n = k.shape[0]
        rates, vectors = eig(np.block([[np.zeros((n, n)), np.eye(n)], [-k, -c]]))
        rates, vectors, own = _slow(rates, vectors[:n], k, round_off(K, M, pull, follow))
        shapes = _in_phase(rates, vectors, basis, size)[:, :count]
        rates, own = rates[:count], own[:count]
        if not whole:
            problem = _Problem(K, C, M, pull, follow)
            for mode in np.flatnonzero(rates):
                rates[mode], shape = problem.refine(rates[mode], shapes[:, mode])
                shapes[:, mode], own[mode] = shape, problem.own(shape)
    except (RuntimeError, ValueError, np.linalg.LinAlgError) as error:
        raise ModesError(f"no damped modes found: {error}") from error
    shapes = np.pad(shapes.T.reshape(rates.size, -1, size), ((0, 0), (1, 0), (0, 0)))
    for shape in shapes:
        shape /= shape.flat[np.argmax(np.abs(shape))]
    return DampedModes(rates.imag / (2 * np.pi), _ratios(rates, own), -rates.real + 0.0, shapes)


def _of_lines(lines: LineStiffness | None, unknowns: int) -> tuple[np.ndarray, np.ndarray]:
    if lines is None:
        return np.zeros((unknowns, 0)), np.zeros((0, unknowns))
    pull = np.asarray(lines.pull)[HELD:].reshape(unknowns, -1)
    return pull, np.asarray(lines.follow)[:, HELD:].reshape(-1, unknowns)


def _slow(
    rates: Complex[np.ndarray, " root"],
    vectors: Complex[np.ndarray, "n root"],
    stiffness: Float[np.ndarray, "n n"],
    nothing: float,
) -> tuple[Complex[np.ndarray, " mode"], Complex[np.ndarray, "n mode"], Float[np.ndarray, " mode"]]:
    """Choose one root for each mode, slowest mode first, in coordinates in which the mass is 1.

    Of a pair that swings the one that turns ahead. Of two that do not, ``lambda^2 + c lambda + k``
    with ``k`` of the shape, the slower; where ``k`` is negative that is the one that leaves. Return
    rates, shapes and ``k``.
    """
    rates = np.where(np.abs(rates.imag) <= _REAL * np.abs(rates), rates.real, rates)
    rates = np.where(np.abs(rates.real) <= _UNDAMPED * np.abs(rates), 1j * rates.imag, rates)
    vectors = vectors / np.linalg.norm(vectors, axis=0)
    own = np.einsum("ij,ik,kj->j", vectors.conj(), stiffness, vectors).real
    squared = np.abs(rates) ** 2
    slower = (squared <= np.abs(own) * (1 + _REAL)) & ((own >= 0) | (rates.real >= 0))
    kept = np.flatnonzero(np.where(rates.imag == 0, slower, rates.imag > 0))
    rates = np.where((np.abs(own) <= nothing) & (squared <= nothing), 0.0, rates)
    kept = kept[np.argsort(np.where(rates.imag == 0, own, squared)[kept], kind="stable")]
    return rates[kept], vectors[:, kept], own[kept]


def _ratios(
    rates: Complex[np.ndarray, " mode"], own: Float[np.ndarray, " mode"]
) -> Float[np.ndarray, " mode"]:
    """Return damping ratios; ``own`` is ``k / m`` (1/s2) of modes that do not swing."""
    size = np.abs(rates)
    over = (rates.imag == 0) & (rates.real < 0)
    # c / m is -(lambda + k / (m lambda))
    natural = np.sqrt(np.where(over, own, 1.0))
    half = (own + size**2) / (2 * np.where(over, size, 1.0) * natural)
    ratio = -rates.real / np.where(size > 0, size, np.nan)
    return np.where(over, half, ratio + 0.0)


def _in_phase(
    rates: Complex[np.ndarray, " mode"],
    vectors: Complex[np.ndarray, "n mode"],
    basis: Float[np.ndarray, "unknowns n"],
    size: int,
) -> Complex[np.ndarray, "unknowns mode"]:
    """Return shapes of all nodes; of several with one rate those that move in phase, if any do.

    In space these are, as far as that goes, within the plane y = 0 first, and then across it.
    """
    shapes = basis @ vectors
    first = 0
    for last in range(1, rates.size + 1):
        if last < rates.size and abs(rates[last] - rates[first]) <= _REAL * abs(rates[first]):
            continue
        alike = last - first
        if alike > 1:
            parts = np.hstack([vectors[:, first:last].real, vectors[:, first:last].imag])
            real, weight, _ = np.linalg.svd(parts, full_matrices=False)
            if weight[alike:].max(initial=0.0) <= _REAL * weight[0]:
                moved = basis @ real[:, :alike]
                aside = moved[1::size] if size > 2 else moved
                shapes[:, first:last] = moved @ np.linalg.eigh(aside.T @ aside)[1]
        first = last
    return shapes


class _Problem(NamedTuple):
    """Sparse matrices of the free nodes, and what lines pull at and follow."""

    stiffness: Any
    damping: Any
    mass: Any
    pull: Float[np.ndarray, "n line"]
    follow: Float[np.ndarray, "line n"]

    def refine(
        self, rate: complex, shape: Complex[np.ndarray, " n"]
    ) -> tuple[complex, Complex[np.ndarray, " n"]]:
        """Return a mode of all unknowns near one that is nearly a mode."""
        dynamic = self.stiffness + rate * self.damping + rate**2 * self.mass
        solve = inverse(dynamic, self.pull, self.follow)
        real = not np.imag(rate)
        for _ in range(_SOLVES):
            stiff, damped, heavy = self._forces(shape)
            shape = shape - solve(stiff + rate * damped + rate**2 * heavy)
            shape /= np.linalg.norm(shape)
            roots = np.roots([shape.conj() @ each for each in self._forces(shape)[::-1]])
            before, rate = rate, complex(roots[np.argmin(np.abs(roots - rate))])
            rate = complex(rate.real) if real else rate
            if abs(rate - before) <= _REFINED * abs(rate):
                return rate, shape
        raise RuntimeError(f"the mode near {abs(rate) / (2 * np.pi):.3g} Hz does not settle")

    def own(self, shape: Complex[np.ndarray, " n"]) -> float:
        """Return ``k / m`` of a shape (1/s2)."""
        stiff, _, heavy = self._forces(shape)
        return float((shape.conj() @ stiff / (shape.conj() @ heavy)).real)

    def _forces(self, shape: Complex[np.ndarray, " n"]) -> tuple[Any, Any, Any]:
        stiff = self.stiffness @ shape + self.pull @ (self.follow @ shape)
        return stiff, self.damping @ shape, self.mass @ shape
