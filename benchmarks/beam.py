"""Beam theory of a straight clamped arm whose weight sets in: small motion."""

import numpy as np
from numpy.polynomial import legendre
from scipy.linalg import eigh

from crinoid import Scenario

SHEAR_COEFFICIENT = 27 / 28
"""Shear coefficient of a round section in PyElastica (Kaneko 1975, Poisson's ratio 1/2)."""


def beam_tip(scenario: Scenario, times: np.ndarray, *, shears: bool) -> np.ndarray:
    """Return how high the tip is, without damping, by all modes that polynomials can hold.

    Parameters
    ----------
    scenario
        Whose arm, water density and gravity to take.
    times
        In s.
    shears
        Timoshenko's beam: it shears, and its sections resist being turned. Otherwise both have a
        thousandth of their effect, which leaves 0.002 % between it and the beam of Euler and
        Bernoulli.

    Returns
    -------
    height
        ``times.shape``, in m.
    """
    arm, water = scenario.arm, scenario.water
    thickness = 1.0 if shears else 1e-3
    area = np.pi * arm.radius**2
    second_moment = area * arm.radius**2 / 4
    shear_modulus = arm.youngs_modulus / (2 * (1 + arm.poisson_ratio))
    weight = water.gravity * (arm.density - water.density) * area

    # deflection and turn of the section are x times a polynomial of x: none at the clamp
    degree = 16
    nodes, weights = legendre.leggauss(2 * degree)
    x, weights = 0.5 * arm.length * (nodes + 1), 0.5 * arm.length * weights
    basis = legendre.Legendre.basis
    value = np.stack([x * basis(k)(nodes) for k in range(degree)])
    slope = np.stack(
        [basis(k)(nodes) + (1 + nodes) * basis(k).deriv()(nodes) for k in range(degree)]
    )
    none = np.zeros_like(value)
    deflection, turn = np.concatenate([value, none]), np.concatenate([none, value])
    shear, bending = np.concatenate([slope, -value]), np.concatenate([none, slope])

    def product(rows: np.ndarray, stiffness: float) -> np.ndarray:
        return stiffness * (rows * weights) @ rows.T

    stiffness = product(bending, arm.youngs_modulus * second_moment) + product(
        shear, SHEAR_COEFFICIENT * shear_modulus * area / thickness
    )
    mass = product(deflection, arm.density * area) + product(
        turn, arm.density * second_moment * thickness
    )
    squares, modes = eigh(stiffness, mass)
    tip = np.concatenate([np.full(degree, arm.length), np.zeros(degree)])  # basis(k)(1) = 1
    share = (tip @ modes) * (modes.T @ (deflection @ (-weight * weights))) / squares
    return (1 - np.cos(np.sqrt(squares) * times[..., None])) @ share
