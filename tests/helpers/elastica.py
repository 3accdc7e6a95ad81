"""The exact shapes of inextensible rods in a plane, and figures that others have published."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

UPRIGHT = np.pi / 2


class Shape(NamedTuple):
    """Measures of a shape of unit length that tests compare."""

    x: float
    z: float
    angle: float
    """Direction at the tip, from +x toward +z (rad)."""
    reach: float
    """Integral of the cubed sine of the direction: the share of the length that a current feels
    (the effective length of Luhar and Nepf 2011)."""


def elastica(
    bracket: tuple[float, float],
    *,
    tilt: float = 0.0,
    dead=(0.0, 0.0),
    follower=(0.0, 0.0),
    moment: float = 0.0,
    distributed: Callable = lambda angle: (0.0, 0.0),
    stiffness: Callable = lambda s: 1.0,
    rest_curvature: float = 0.0,
) -> Shape:
    """Solve the boundary-value problem of an inextensible rod by shooting from its tip.

    EI (theta' - rest curvature) = M, M' = -t x n, n' = -load; at the tip M and n are the tip's
    load, at the root theta is the tilt. The direction at the tip, sought within the bracket, is
    the only unknown.
    """

    def rates(s, y):
        theta, bending, along_x, along_z = y[:4]
        c, s_ = np.cos(theta), np.sin(theta)
        load_x, load_z = distributed(theta)
        turn = bending / stiffness(s) + rest_curvature
        return [turn, s_ * along_x - c * along_z, -load_x, -load_z, c, s_, s_**3]

    def shoot(angle):
        c, s = np.cos(angle), np.sin(angle)
        end_x = dead[0] + c * follower[0] - s * follower[1]
        end_z = dead[1] + s * follower[0] + c * follower[1]
        start = [angle, moment, end_x, end_z, 0.0, 0.0, 0.0]
        done = solve_ivp(rates, (1.0, 0.0), start, method="DOP853", rtol=1e-12, atol=1e-13)
        return done.y[:, -1]

    angle = brentq(lambda a: shoot(a)[0] - tilt, *bracket, xtol=1e-13, rtol=1e-14)
    root = shoot(angle)
    return Shape(-root[4], -root[5], angle, -root[6])


# Clamped, horizontal, dead force down at the tip, a = P L^2 / EI: tip angle, drop, shortening.
# Mattiasson, Int. J. Numer. Methods Eng. 17 (1981) 145-153, from elliptic integrals.
MATTIASSON = {
    1: (0.461352, 0.301721, 0.056433),
    2: (0.781750, 0.493457, 0.160642),
    5: (1.215368, 0.713792, 0.387628),
    10: (1.430286, 0.810609, 0.554996),
}
# Clamped, horizontal, own weight w L^3 / EI: drop, shortening (two-point problem, to 1e-9).
OWN_WEIGHT = {1: (0.123471, 0.008754), 5: (0.495905, 0.153343), 10: (0.700200, 0.343646)}

# Upright blade of neutral weight in a steady current, normal drag only (the model of Luhar and
# Nepf, Limnol. Oceanogr. 56 (2011) 2003-2017). Ca = 1/2 rho C_d d U^2 L^3/EI; B = buoyancy per
# length times L^3/EI: effective length, tip angle from upright in degrees.
BLADES = {
    (1, 0): (0.97483, 9.31),
    (10, 0): (0.52361, 47.09),
    (1, 10): (0.99508, 3.98),
    (10, 10): (0.74471, 30.69),
}

LIMP = np.deg2rad(38.173)
"""From the vertical: normal drag r cos^2 = sin for r = 1/2 rho C_d d U^2 / w = 1, which the golden
section solves."""

# Euler: pi^2 / 4. Greenhill (1881): a standing arm buckles under its own weight where
# w L^3 / EI is 9/4 of the square of the first zero of the Bessel function J_{-1/3}: 7.837347.
CRITICAL = {"tip": np.pi**2 / 4, "own": 7.837347}
