"""Arm, actuators and sensors over a control period: a linear system in discrete time.

The arm with its actuators is the linear model of a time step (`crinoid.System.transition`) over a
control period, in a steady current. Commands, and the velocity and acceleration of the water, are
held for a period. A reading comes as late as the newest known one is on average, in whole time
steps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float
from scipy.linalg import block_diag, schur, solve_triangular

from crinoid.assembly.arrays import array
from crinoid.assembly.linear import linearised
from crinoid.scenario.errors import got, refusal
from crinoid.simulation.loop_margin import age
from crinoid.simulation.setup import Setup

Matrix = Float[np.ndarray, "m n"]

GROWS = 1e-6  # by how much a pole may lie outside of the unit circle, by round-off


class System(NamedTuple):
    """``x' = A x + B u``, ``y = C x + D u``."""

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix

    def response(self, z: Complex[np.ndarray, " f"]) -> Complex[np.ndarray, "f output input"]:
        """Return ``C (z - A)^-1 B + D``, by one Schur decomposition (Laub 1981)."""
        upper, basis = schur(self.A, output="complex")
        entering, leaving = basis.conj().T @ self.B, self.C @ basis
        eye, found = np.eye(upper.shape[0]), np.empty((z.size, *self.D.shape), complex)
        for index, each in enumerate(z):
            found[index] = leaving @ solve_triangular(each * eye - upper, entering) + self.D
        return found

    def minimal(self) -> System:
        """Leave out states that no input reaches or no output observes, by their zeros."""
        return self.of_states(self.needed)

    @property
    def needed(self) -> Bool[np.ndarray, " x"]:
        """States that some input reaches and some output observes, by their zeros."""
        moves = self.A != 0
        reached = _reached(moves, (self.B != 0).any(axis=1))
        return reached & _reached(moves.T, (self.C != 0).any(axis=0))

    def of_states(self, kept: Bool[np.ndarray, " x"]) -> System:
        """Return the system of some of its states."""
        return System(self.A[np.ix_(kept, kept)], self.B[kept], self.C[:, kept], self.D)


class SampledPlant(NamedTuple):
    """Arm, actuators and sensors over a control period.

    Inputs: the commands, the water's velocity along each axis, uniform along the arm, and its
    acceleration. States: coordinates of the arm, states of the actuators, readings under way.
    Outputs: readings, states of the actuators.
    """

    system: System
    period: float  # time between two commands (s)
    commands: int  # number of inputs that are commands, the first ones
    observed: Matrix  # values of the sensors without delay, by arm and actuators
    late: list[int]  # how many periods ago each value of the sensors was taken, rounded up
    values: Float[np.ndarray, " y"]  # values of the sensors at the state that it is linear about

    @staticmethod
    def of(
        setup: Setup, current: tuple[float, ...], by_water: Matrix | None = None
    ) -> SampledPlant:
        """Return that of a scenario about the state in which its arm starts, in a current.

        ``by_water`` are the values of the sensors by the water's velocity and acceleration at the
        same instant; zero by default.
        """
        if not setup.outcome.converged:
            text = got("equilibrium", 'be "rest" where the arm has no equilibrium')
            raise refusal("simulation.start", text)
        loop = setup.loop
        step = float(loop.system.time_step)
        count = max(1, round(float(loop.clock.period) / step))
        period = count * step
        found, values, _ = linearised(loop.system, setup.state, array(current), loop.sensors)
        A, B, C = (np.asarray(part) for part in (found.A, found.B, found.C))
        if not all(np.isfinite(part).all() for part in (A, B, C)):
            text = "got a start from which no time step converges; must be one near an equilibrium"
            raise refusal("simulation.start", text)
        water = [np.asarray(part).sum(axis=1) for part in (found.stirred, found.hastened)]
        followers, commands = found.actuators.shape[0], B.shape[1]
        stirred = np.pad(np.concatenate(water, axis=1), ((0, followers), (0, 0)))
        B = np.concatenate([B, stirred], axis=1)
        direct = np.zeros((C.shape[0], B.shape[1]))
        if by_water is not None:
            direct[:, commands:] = by_water
        powers, sums = [np.eye(A.shape[0])], [np.zeros_like(B)]
        for _ in range(count):
            powers.append(A @ powers[-1])
            sums.append(A @ sums[-1] + B)
        total = System(powers[-1], sums[-1], np.zeros((0, A.shape[0])), np.zeros((0, B.shape[1])))
        row, late = 0, []
        for sensor in loop.sensors:
            size = sensor.noise.shape[0]
            seen, through, row = C[row : row + size], direct[row : row + size], row + size
            periods, part = divmod(round(age(sensor, period, step) / step), count)
            into = (count - part) % count  # of the period in which it was taken
            read = System(A, B, seen @ powers[into], seen @ sums[into] + through)
            late += [periods + (part > 0)] * size
            total = _with_late(total, read, A.shape[0], late[-1])
        last = np.zeros((followers, total.A.shape[0]))
        last[:, A.shape[0] - followers : A.shape[0]] = np.eye(followers)
        none = np.zeros((followers, B.shape[1]))
        system = total._replace(
            C=np.concatenate([total.C, last]), D=np.concatenate([total.D, none])
        )
        return SampledPlant(system, period, commands, C, late, np.asarray(values))

    def from_commands(self) -> System:
        """Return the system by the commands alone."""
        A, B, C, D = self.system
        return System(A, B[:, : self.commands], C, D[:, : self.commands])


def _with_late(total: System, read: System, arm: int, periods: int) -> System:
    """Add an output of the arm's states, the first ones, that comes some periods late."""
    states, size = total.A.shape[0], read.C.shape[0]
    reading = np.pad(read.C, ((0, 0), (0, states - arm)))
    if not periods:
        return total._replace(
            C=np.concatenate([total.C, reading]), D=np.concatenate([total.D, read.D])
        )
    under_way = size * periods
    A = block_diag(total.A, np.eye(under_way, k=-size))
    A[states : states + size, :states] = reading
    B = np.concatenate([total.B, np.zeros((under_way, total.B.shape[1]))])
    B[states : states + size] = read.D
    C = np.pad(total.C, ((0, size), (0, under_way)))
    C[-size:, -size:] = np.eye(size)
    return System(A, B, C, np.concatenate([total.D, 0 * read.D]))


def _reached(moves: Bool[np.ndarray, "x x"], begin: Bool[np.ndarray, " x"]) -> np.ndarray:
    """Return which states some others lead to, step by step."""
    found, count = begin.copy(), -1
    while count != found.sum():
        count = int(found.sum())
        found |= moves[:, found].any(axis=1)
    return found
