"""Figures that others have published on inextensible rods in a plane."""

import numpy as np

UPRIGHT = np.pi / 2


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

LIMP = np.deg2rad(38.173)
"""From the vertical: normal drag r cos^2 = sin for r = 1/2 rho C_d d U^2 / w = 1, which the golden
section solves."""

# Euler: pi^2 / 4. Greenhill (1881): a standing arm buckles under its own weight where
# w L^3 / EI is 9/4 of the square of the first zero of the Bessel function J_{-1/3}: 7.837347.
CRITICAL = {"tip": np.pi**2 / 4, "own": 7.837347}
