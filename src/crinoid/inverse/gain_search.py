"""Local searches for gains: gradients of cost and stability margin, with and without constraint."""

from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple

import equinox as eqx
import numpy as np
from scipy.optimize import minimize
from scipy.special import logsumexp

from crinoid.analysis.linear_loop import LinearLoop, LinearPlant, linear_controller
from crinoid.analysis.sampled_plant import System
from crinoid.control import Controller
from crinoid.inverse.constrained_search import FAILED, STEP, SearchTrial, constrain
from crinoid.inverse.gain_design import GainPerturbations, Logs, central_difference
from crinoid.scenario import ScenarioError
from crinoid.simulation.loop_margin import Margin
from crinoid.simulation.setup import Setup

_SHARPNESS = 100.0
"""Sharpness of the smooth maximum over the frequencies."""
_TIME = 1.0
"""Time scale of the growth rate of an unstable loop (s)."""
_LATE = 2.0
"""Extra delay of commands that every loop must tolerate, in control periods."""
_LATE_SHARE = 0.5
"""Share of the modulus margin that must remain with this delay."""
_EVERY = 5
"""Stride through the frequencies, of which a part is enough for the gradient."""


class MarginExcess(NamedTuple):
    """Stability margin of a loop, and by how much the loop violates the required one."""

    margin: Margin
    excess: float
    """Violation of the modulus margin, relative to it; 1 and more: unstable."""
    gradient: Logs
    """Derivative of the excess by the logarithms of the tuned parameters."""


class StabilityConstraint:
    """Constraint on the modulus margin of the linear loop, in each water of a scenario.

    The excess over a modulus margin ``m`` (`crinoid.simulation.loop_margin`) is the smooth maximum,
    over the waters, the frequencies and the eigenvalues ``l`` of the open loop, of ``1 - |1 + l| /
    m``. It is never below the largest term. Half of the margin must remain if commands come two
    control periods later. An unstable loop has no such margin: its excess is 1 or more and grows
    with its growth rate.
    """

    def __init__(self, plant: LinearPlant, setup: Setup) -> None:
        self._plant, self._setup = plant, setup
        self._fewer = plant.every(_EVERY)
        self._late = _LATE * plant.period

    def closed(self, controller: Controller) -> LinearLoop:
        """Return the closed loop of a controller."""
        return self._plant.closed(self._linear(controller))

    def shortfall(self, margin: Margin, asked: float) -> float:
        """Return the relative shortfall of a loop's margins; at most 0 if it has all of them."""
        if not margin.stable:
            return 1.0
        return 1 - min(margin.modulus / asked, margin.delay / self._late)

    def excess(self, controllers: GainPerturbations, asked: float) -> MarginExcess:
        """Return the excess over a modulus margin, with its gradient by central differences."""
        nominal = self._linear(controllers.nominal)
        margin = self._plant.closed(nominal).open.margin()

        def excess(controller: System) -> float:
            return self._excess(controller, asked) if margin.stable else self._growth(controller)

        others = ([excess(self._linear(each)) for each in side] for side in controllers[1:])
        gradient = central_difference(*map(np.array, others))
        return MarginExcess(margin, excess(nominal), gradient)

    def _linear(self, controller: Controller) -> System:
        loop = eqx.tree_at(lambda x: x.controller, self._setup.loop, controller)
        found = linear_controller(loop, self._setup.state, self._plant.period)
        if not all(np.isfinite(part).all() for part in found):
            text = "must be 0 here: the controller has no derivatives at the equilibrium"
            raise ScenarioError.of("--margin", text)
        return found.minimal()

    def _excess(self, controller: System, asked: float) -> float:
        loop = self._fewer.transfer(controller)
        loci = np.linalg.eigvals(loop.transfer)
        late = loci * np.exp(-2j * np.pi * self._late * loop.frequency)[:, None]
        near = [1 - np.abs(1 + loci) / asked, 1 - np.abs(1 + late) / (_LATE_SHARE * asked)]
        return float(logsumexp(_SHARPNESS * np.array(near)) / _SHARPNESS)

    def _growth(self, controller: System) -> float:
        poles = self._plant.poles(controller).values()
        rate = max(0.0, *(float(each[0].real) for each in poles))
        return float(1 + np.log1p(_TIME * rate))


_MOST = np.log(1e3)
"""Largest change of the logarithm of a parameter."""
_WEIGHT = 10.0
"""Weight of the penalty on the excess."""
_NEAREST_TRIALS = 60
"""Largest number of trials of `nearest`."""
_NEAR = 0.01
"""Excess with which a constrained search may start."""


class GainTrial(SearchTrial):
    """Result for one set of parameters; numbers are logarithms of these.

    ``value`` is the logarithm of the cost, not a number if there was no run or it failed, and
    ``excess`` the violation of the modulus margin (`MarginExcess`).
    """

    @property
    def stable(self) -> bool:
        """Whether the closed loop is stable."""
        return float(self.excess) < 1

    @property
    def penalised(self) -> float:
        """The value plus the penalty."""
        return self.value + _WEIGHT * max(float(self.excess), 0.0) ** 2


Attempt = Callable[[Logs], GainTrial]


def descend(attempt: Attempt, begin: Logs) -> None:
    """Minimise cost plus penalty on the margin by L-BFGS-B; ``attempt`` keeps each trial.

    The value of an unstable loop grows with its growth rate. The search steps back from a failed
    run, and ends if the first run fails.
    """
    highest = np.nan

    def of(steps: Logs) -> tuple[float, Logs]:
        nonlocal highest
        found = attempt(STEP * steps)
        excess = float(found.excess)
        if not found.stable:
            value, gradient = _WEIGHT * excess, _WEIGHT * found.excess_gradient
        elif np.isfinite(found.value):
            value = found.penalised
            gradient = found.gradient + 2 * _WEIGHT * max(excess, 0.0) * found.excess_gradient
        elif np.isnan(highest):
            raise StopIteration
        else:
            return highest + FAILED, np.zeros_like(steps)
        highest = np.fmax(highest, value)
        return value, STEP * gradient

    limits = np.array(bounds(begin)) / STEP
    minimize(of, begin / STEP, jac=True, method="L-BFGS-B", bounds=limits)


def nearest(excess: Callable[[Logs], tuple[float, Logs]], begin: Logs) -> Logs:
    """Return the nearest logarithms without excess, or those of least excess among the trials."""
    best, looks = (np.inf, begin), 0

    def attempt(logs: Logs) -> GainTrial:
        nonlocal best, looks
        found, away, looks = excess(logs), logs - begin, looks + 1
        if found[0] < best[0]:
            best = found[0], logs.copy()
        if best[0] < _NEAR or looks == _NEAREST_TRIALS:
            raise StopIteration
        distance = 0.5 * float(away @ away) if found[0] < 1 else np.nan  # that of a stable loop
        return GainTrial(distance, away, *found)

    with suppress(StopIteration):
        constrain(attempt, begin, bounds(begin))
    return best[1]


def bounds(begin: Logs) -> list[tuple[float, float]]:
    """Return the bounds of each logarithm."""
    return [(-_MOST, _MOST)] * len(begin)
