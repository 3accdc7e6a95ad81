"""Damped modes of vibration about a state at rest. Computed on the host."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from crinoid.dynamics.modes import (
    ModesError,
    find_modes,
    inverse,
    normalised,
    of_free,
    of_lines,
    round_off,
)
from crinoid.dynamics.tangent import LineStiffness
from crinoid.foundation.fixed_numbers import (
    DENSE_UNKNOWNS,
    NEGLIGIBLE_PART,
    RATE_SOLVES,
    REFINED,
    SETTLED_RATE,
    SPARE_MODES,
    UNDAMPED,
)
from crinoid.numerics import banded


class DampedModes(NamedTuple):
    """Damped modes ``Re(shape exp(lambda t))`` of an arm whose base is held, slowest first.

    Sorted by ``|lambda|``, their natural circular frequency; an overdamped mode by
    ``sqrt(k / m)``, with the stiffness and mass of its shape, and represented by the slower of its
    two rates.
    """

    frequency: Float[np.ndarray, " mode"]
    """``Im(lambda) / 2 pi`` (Hz); 0 of a mode that does not oscillate."""
    damping_ratio: Float[np.ndarray, " mode"]
    """``-Re(lambda) / |lambda|``: negative for growth, -1 for divergence; ``c / (2 sqrt(k m))``,
    1 or more, for an overdamped mode. NaN without a restoring or driving force."""
    decay_rate: Float[np.ndarray, " mode"]
    """``-Re(lambda)`` (1/s)."""
    shape: Complex[np.ndarray, "mode n b"]
    """Displacement of the nodes from the root (zero) to the tip; the largest entry is 1.

    Complex where nodes do not move in phase. In space with the spin of the edge that ends at each
    node (rad per m).
    """

    def rate(self, mode: int) -> complex:
        """Return ``lambda`` of a mode (1/s)."""
        return complex(-self.decay_rate[mode], 2 * np.pi * self.frequency[mode])


class Relaxing(NamedTuple):
    """Maxwell branches in parallel with the elastic stiffness."""

    elastic: banded.Bands
    """Stiffness of the relaxed material alone, without loads and tension (N/m)."""
    branches: Float[np.ndarray, "2 branch"]
    """Ratios and times (s)."""

    def acting(self, rate: complex) -> tuple[float, float]:
        """Return the shares of stiffness and damping (s) that act on a motion ``exp(rate t)``."""
        ratio, time = self.branches
        modulus = complex(np.sum(ratio * rate * time / (1 + rate * time)))
        damping = modulus.imag / rate.imag if rate.imag else 0.0
        return modulus.real - damping * rate.real, damping


def find_relaxing_modes(
    relaxing: Relaxing | None,
    stiffness: banded.Bands,
    damping: banded.Bands,
    mass: banded.Bands,
    count: int,
    lines: LineStiffness | None = None,
) -> DampedModes:
    """Find the modes of a material with Maxwell branches, as `find_damped_modes` those without.

    Each mode has the stiffness and the damping that the branches have at its own rate, by
    fixed-point iteration. Rates at which the material creeps are no modes. A mode whose rate does
    not settle, as one that the branches damp strongly may not, is NaN.
    """
    modes = find_damped_modes(stiffness, damping, mass, count, lines)
    if relaxing is None:
        return modes
    rows = [modes] * modes.frequency.size
    for index in range(len(rows)):
        rate, tried = modes.rate(index), []
        for _ in range(RATE_SOLVES):
            more, viscous = relaxing.acting(rate)
            rows[index] = find_damped_modes(
                stiffness + more * relaxing.elastic,
                damping + viscous * relaxing.elastic,
                mass,
                count,
                lines,
            )
            found = rows[index].rate(index)
            if abs(found - rate) <= SETTLED_RATE * abs(found):
                break
            tried.append((rate, found))
            rate = _following(tried)
        else:
            rows[index] = DampedModes(*(np.full_like(each, np.nan) for each in modes))
    if np.isnan([row.frequency[index] for index, row in enumerate(rows)]).all():
        raise ModesError("the rate of no mode settles")
    return DampedModes(
        *(np.stack([f[i] for i, f in enumerate(each)]) for each in zip(*rows, strict=True))
    )


def _following(tried: list[tuple[complex, complex]]) -> complex:
    """Return the rate to try next, from those tried in a fixed-point iteration and those found.

    Anderson acceleration of depth 2 (Walker and Ni 2011, SIAM Journal on Numerical Analysis 49);
    the rate found last where some of the last ones oscillate and others do not.
    """
    last = np.array(tried[-3:])
    change, found = last[:, 1] - last[:, 0], complex(last[-1, 1])
    swings = set((last.imag > 0).flat)
    if len(tried) < 3 or len(swings) > 1:
        return found
    steps = np.array([np.diff(change).real, np.diff(change).imag])
    share = np.linalg.lstsq(steps, [change[-1].real, change[-1].imag])[0]
    rate = complex(found - np.diff(last[:, 1]) @ share)
    near = abs(rate - found) <= abs(found)
    return rate if near and (rate.imag > 0) in swings else found


def find_damped_modes(
    stiffness: banded.Bands,
    damping: banded.Bands,
    mass: banded.Bands,
    count: int,
    lines: LineStiffness | None = None,
) -> DampedModes:
    """Solve ``(K + lambda C + lambda^2 M) x = 0`` of the free nodes for the slowest modes.

    ``K`` and ``C`` may be asymmetric, as in a current. The problem is solved in companion form
    (Tisseur and Meerbergen 2001, SIAM Review 43, section 3.4), in coordinates that make the
    undamped problem with the symmetric part of ``K`` diagonal. With more than 400 unknowns only the
    slowest undamped modes are coordinates, and the result is refined by residual inverse iteration
    (Neumaier 1985, SIAM Journal on Numerical Analysis 22). Runs on the host.

    The matrices are those of all nodes (N/m, N s/m, kg), of `crinoid.System.small_motions`, and
    ``lines`` the stiffness that lines add. An arm of fewer than ``count`` modes has all of them.
    """
    # slow to load, and many commands do without
    from scipy.linalg import eig, eigh

    K, C, M = map(of_free, (stiffness, damping, mass))
    unknowns, size = K.shape[0], stiffness.shape[-1]
    pull, follow = of_lines(lines, unknowns)
    whole = unknowns <= DENSE_UNKNOWNS
    try:
        basis = np.eye(unknowns)
        if not whole:
            known = find_modes(stiffness, mass, 2 * count + SPARE_MODES, lines)
            basis = known.shape[:, 1:].reshape(-1, unknowns).T
        k, c, m = (basis.T @ (A @ basis) for A in (K, C, M))
        k += (basis.T @ pull) @ (follow @ basis)
        m = 0.5 * (m + m.T)
        _, own = eigh(0.5 * (k + k.T), m)
        basis, k, c = basis @ own, own.T @ k @ own, own.T @ c @ own
        n = k.shape[0]
        rates, vectors = eig(np.block([[np.zeros((n, n)), np.eye(n)], [-k, -c]]))
        vectors = vectors[:n].astype(complex)  # real ones where no rate oscillates
        rates, vectors, own = _slow(rates, vectors, k, round_off(K, M, pull, follow))
        shapes = _in_phase(rates, vectors, basis, size)[:, :count]
        rates, own = rates[:count], own[:count]
        if not whole:
            problem = _Problem(K, C, M, pull, follow)
            for mode in np.flatnonzero(rates):
                rates[mode], shape = problem.refine(rates[mode], shapes[:, mode])
                shapes[:, mode], own[mode] = shape, problem.own(shape)
    except (RuntimeError, ValueError, np.linalg.LinAlgError) as error:
        raise ModesError(f"no damped modes found: {error}") from error
    shapes = normalised(shapes, size)
    return DampedModes(rates.imag / (2 * np.pi), _ratios(rates, own), -rates.real + 0.0, shapes)


def _slow(
    rates: Complex[np.ndarray, " root"],
    vectors: Complex[np.ndarray, "n root"],
    stiffness: Float[np.ndarray, "n n"],
    nothing: float,
) -> tuple[Complex[np.ndarray, " mode"], Complex[np.ndarray, "n mode"], Float[np.ndarray, " mode"]]:
    """Choose one root for each mode, slowest mode first, in coordinates of unit mass.

    Of a complex pair the one with positive imaginary part. Of two real roots of
    ``lambda^2 + c lambda + k``, with ``k`` of the shape, the slower; for negative ``k`` the one
    that grows. Return rates, shapes and ``k``.
    """
    rates = np.where(np.abs(rates.imag) <= NEGLIGIBLE_PART * np.abs(rates), rates.real, rates)
    rates = np.where(np.abs(rates.real) <= UNDAMPED * np.abs(rates), 1j * rates.imag, rates)
    vectors = vectors / np.linalg.norm(vectors, axis=0)
    own = np.einsum("ij,ik,kj->j", vectors.conj(), stiffness, vectors).real
    squared = np.abs(rates) ** 2
    slower = (squared <= np.abs(own) * (1 + NEGLIGIBLE_PART)) & ((own >= 0) | (rates.real >= 0))
    chosen = np.flatnonzero(np.where(rates.imag == 0, slower, rates.imag > 0))
    rates = np.where((np.abs(own) <= nothing) & (squared <= nothing), 0.0, rates)
    order = chosen[np.argsort(np.where(rates.imag == 0, own, squared)[chosen], kind="stable")]
    return rates[order], vectors[:, order], own[order]


def _ratios(
    rates: Complex[np.ndarray, " mode"], own: Float[np.ndarray, " mode"]
) -> Float[np.ndarray, " mode"]:
    """Return damping ratios; ``own`` is ``k / m`` (1/s2) of modes that do not oscillate."""
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
    """Return shapes of all nodes; for a repeated rate those that move in phase, if any do.

    In space these lie, as far as possible, first within the plane y = 0, then across it.
    """
    shapes = basis @ vectors
    first = 0
    for last in range(1, rates.size + 1):
        if last < rates.size and abs(rates[last] - rates[first]) <= NEGLIGIBLE_PART * abs(
            rates[first]
        ):
            continue
        alike = last - first
        if alike > 1:
            parts = np.hstack([vectors[:, first:last].real, vectors[:, first:last].imag])
            real, weight, _ = np.linalg.svd(parts, full_matrices=False)
            if weight[alike:].max(initial=0.0) <= NEGLIGIBLE_PART * weight[0]:
                moved = basis @ real[:, :alike]
                aside = moved[1::size] if size > 2 else moved
                shapes[:, first:last] = moved @ np.linalg.eigh(aside.T @ aside)[1]
        first = last
    return shapes


class _Problem(NamedTuple):
    """Sparse matrices of the free nodes, and the stiffness of lines ``pull follow``."""

    stiffness: Any
    damping: Any
    mass: Any
    pull: Float[np.ndarray, "n line"]
    follow: Float[np.ndarray, "line n"]

    def refine(
        self, rate: complex, shape: Complex[np.ndarray, " n"]
    ) -> tuple[complex, Complex[np.ndarray, " n"]]:
        """Return the mode of all unknowns nearest to an approximate one."""
        dynamic = self.stiffness + rate * self.damping + rate**2 * self.mass
        solve = inverse(dynamic, self.pull, self.follow)
        real = not np.imag(rate)
        for _ in range(RATE_SOLVES):
            stiff, damped, heavy = self._forces(shape)
            shape = shape - solve(stiff + rate * damped + rate**2 * heavy)
            shape /= np.linalg.norm(shape)
            roots = np.roots([shape.conj() @ each for each in self._forces(shape)[::-1]])
            before, rate = rate, complex(roots[np.argmin(np.abs(roots - rate))])
            rate = complex(rate.real) if real else rate
            if abs(rate - before) <= REFINED * abs(rate):
                return rate, shape
        raise RuntimeError(f"the mode near {abs(rate) / (2 * np.pi):.3g} Hz does not settle")

    def own(self, shape: Complex[np.ndarray, " n"]) -> float:
        """Return ``k / m`` of a shape (1/s2)."""
        stiff, _, heavy = self._forces(shape)
        return float((shape.conj() @ stiff / (shape.conj() @ heavy)).real)

    def _forces(self, shape: Complex[np.ndarray, " n"]) -> tuple[Any, Any, Any]:
        stiff = self.stiffness @ shape + self.pull @ (self.follow @ shape)
        return stiff, self.damping @ shape, self.mass @ shape
