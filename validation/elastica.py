"""Inextensible planar rods by shooting: references that share nothing with crinoid's rod."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

Vector = Sequence[float] | Float[np.ndarray, "2"]


class PlanarEnd(NamedTuple):
    """End of a rod of unit length, and a measure of its drag."""

    x: float
    z: float
    angle: float
    """Direction at the tip, from +x toward +z (rad)."""
    reach: float
    """Integral of the cubed sine of the direction: the effective length of a blade upright in a
    current (Luhar and Nepf 2011)."""


def elastica(
    bracket: Vector,
    *,
    tilt: float = 0.0,
    dead: Vector = (0.0, 0.0),
    follower: Vector = (0.0, 0.0),
    moment: float = 0.0,
    distributed: Callable[[float], Vector] = lambda angle: (0.0, 0.0),
    stiffness: Callable[[float], float] = lambda s: 1.0,
    rest_curvature: float = 0.0,
) -> PlanarEnd:
    """Solve the boundary-value problem of an inextensible clamped rod by shooting from its tip.

    EI (theta' - rest_curvature) = M, M' = -t x n, n' = -load. At the tip M and n are the loads
    there, at the root theta is the tilt. Integration by DOP853 with a relative tolerance of 1e-12.

    Parameters
    ----------
    bracket
        Interval of the direction at the tip (rad), the only unknown.
    tilt
        Direction at the root (rad).
    dead, follower
        Forces at the tip over EI/L^2; a follower turns with the tip.
    moment
        Moment at the tip over EI/L.
    distributed
        Load along the rod over EI/L^3, a function of the direction (rad).
    stiffness
        Bending stiffness over that of the unit, a function of the arc length over L.
    rest_curvature
        Curvature without load, times L.

    Raises
    ------
    ValueError
        If the bracket holds no solution.
    """

    def rates(s: float, y: Float[np.ndarray, "7"]) -> list[float]:
        theta, bending, along_x, along_z = y[:4]
        c, s_ = np.cos(theta), np.sin(theta)
        load_x, load_z = distributed(theta)
        turn = bending / stiffness(s) + rest_curvature
        return [turn, s_ * along_x - c * along_z, -load_x, -load_z, c, s_, s_**3]

    def shoot(angle: float) -> Float[np.ndarray, "7"]:
        c, s = np.cos(angle), np.sin(angle)
        end_x = dead[0] + c * follower[0] - s * follower[1]
        end_z = dead[1] + s * follower[0] + c * follower[1]
        start = [angle, moment, end_x, end_z, 0.0, 0.0, 0.0]
        done = solve_ivp(rates, (1.0, 0.0), start, method="DOP853", rtol=1e-12, atol=1e-13)
        return np.asarray(done.y[:, -1])

    angle = brentq(lambda a: shoot(a)[0] - tilt, *bracket, xtol=1e-13, rtol=1e-14)
    root = shoot(angle)
    return PlanarEnd(-float(root[4]), -float(root[5]), float(angle), -float(root[6]))
