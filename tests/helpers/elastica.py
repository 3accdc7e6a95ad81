"""Figures that others have published on inextensible rods in a plane."""

import numpy as np

UPRIGHT = np.pi / 2

LIMP = np.deg2rad(38.173)
"""From the vertical: normal drag r cos^2 = sin for r = 1/2 rho C_d d U^2 / w = 1, which the golden
section solves."""

# Euler: pi^2 / 4. Greenhill (1881): a standing arm buckles under its own weight where
# w L^3 / EI is 9/4 of the square of the first zero of the Bessel function J_{-1/3}: 7.837347.
CRITICAL = {"tip": np.pi**2 / 4, "own": 7.837347}
