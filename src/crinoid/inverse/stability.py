"""Stability margin of a controller, a limit of a search that needs no run."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

from crinoid.analysis.linear_loop import LinearLoop, LinearPlant, linear_controller
from crinoid.analysis.sampled_plant import System
from crinoid.assembly.prepared import Prepared
from crinoid.inverse.smooth_loop import Neighbours
from crinoid.scenario import Scenario, refusal
from crinoid.simulation import Loop
from crinoid.simulation.setup import set_up

_SHARPNESS = 100.0  # sharpness of the smooth maximum over the frequencies
_TIME = 1.0  # time scale of the growth rate of an unstable loop (s)
_LATE = 2.0  # extra delay of commands that every loop must tolerate, in control periods
_LATE_SHARE = 0.5  # share of the modulus margin that must remain with this delay
_EVERY = 5  # stride through the frequencies, of which a part is enough for the gradient


class StabilityMargin:
    """Modulus margin of the linear loop, in each water of a scenario, and its violation.

    The violation of a margin ``m`` (`crinoid.simulation.loop_margin`) is the smooth maximum, over
    the waters, the frequencies and the eigenvalues ``l`` of the open loop, of ``1 - |1 + l| / m``.
    It is never below the largest term. Half of the margin must remain if commands come two control
    periods later. An unstable loop has no margin: its violation is 1 or more and grows with its
    growth rate.
    """

    def __init__(self, scenario: Scenario, asked: float) -> None:
        self._setup, self._asked = set_up(Prepared(scenario), notes=False), asked
        self._plant = LinearPlant.of(self._setup)
        self._fewer, self._late = self._plant.every(_EVERY), _LATE * self._plant.period

    def closed(self, scenario: Scenario) -> LinearLoop:
        """Return the closed loop with the controller of a scenario."""
        loop = set_up(self._setup.prepared.with_scenario(scenario), notes=False).loop
        return self._plant.closed(self._linear(loop))

    def kept(self, loop: LinearLoop) -> float:
        """Return the modulus margin, less where the loop does not bear late commands; 0: unstable.

        It is the required margin or more only if the loop has both.
        """
        margin = loop.open.margin()
        if not margin.stable:
            return 0.0
        return min(margin.modulus, self._asked * margin.delay / self._late)

    def excess(self, near: Neighbours) -> tuple[float, float, Float[np.ndarray, " key"]]:
        """Return the margin that a loop keeps, its violation, and the gradient of that."""
        nominal = self._linear(near.loop)
        loop = self._plant.closed(nominal)
        violation = self._excess if loop.open.stable else self._growth
        slopes = near.slopes(lambda each: violation(self._linear(each)))
        return self.kept(loop), violation(nominal), slopes

    def _linear(self, loop: Loop) -> System:
        found = linear_controller(loop, self._setup.state, self._plant.period)
        if not all(np.isfinite(part).all() for part in found):
            text = "must be 0 here: the controller has no derivatives at the equilibrium"
            raise refusal("--margin", text)
        return found.minimal()

    def _excess(self, controller: System) -> float:
        loop = self._fewer.transfer(controller)
        loci = np.linalg.eigvals(loop.transfer)
        late = loci * np.exp(-2j * np.pi * self._late * loop.frequency)[:, None]
        near = [
            1 - np.abs(1 + loci) / self._asked,
            1 - np.abs(1 + late) / (_LATE_SHARE * self._asked),
        ]
        return float(logsumexp(_SHARPNESS * np.array(near)) / _SHARPNESS)

    def _growth(self, controller: System) -> float:
        poles = self._plant.poles(controller).values()
        rate = max(0.0, *(float(each[0].real) for each in poles))
        return float(1 + np.log1p(_TIME * rate))
