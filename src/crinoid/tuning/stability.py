"""How near a loop comes to swinging by itself, with its slope."""

from typing import NamedTuple

import equinox as eqx
import numpy as np
from scipy.special import logsumexp

from crinoid.control import Controller
from crinoid.scenario import Mistake, ScenarioError
from crinoid.simulation.linear_loop import LinearLoop, LinearPlant, System, linear_controller
from crinoid.simulation.margin import Margin
from crinoid.simulation.setup import Setup
from crinoid.tuning.design import Around, Logs, difference

_SHARPNESS = 100.0
"""How sharp the smooth maximum over the frequencies is."""
_TIME = 1.0
"""Time in which an unstable loop is looked at (s)."""
_LATE = 2.0
"""By how much later commands may come in any case, in control periods."""
_KEPT = 0.5
"""Share of the modulus margin that is kept when they do."""
_EVERY = 5
"""One frequency of so many is enough for the slope."""


class Nearness(NamedTuple):
    """How near a loop comes to swinging by itself."""

    margin: Margin
    excess: float
    """By how much it is nearer to -1 than it may be; 1 and more: unstable."""
    slope: Logs
    """Slope of the excess by the logarithms of what is tuned."""


class Stability:
    """The linear loop of a scenario under one controller or another, in each of its waters.

    The excess over a modulus margin ``m`` (`crinoid.simulation.margin`) is the smooth maximum, over
    the waters, the frequencies and the eigenvalues ``l`` of the open loop, of ``1 - |1 + l| / m``.
    It is never below the largest one. So that late commands do no harm at once, half of the margin
    is to be left when they come two control periods later. Of an unstable loop these tell nothing:
    its excess is 1 and more, by how fast it grows.
    """

    def __init__(self, plant: LinearPlant, setup: Setup) -> None:
        self._plant, self._setup = plant, setup
        self._fewer = plant.every(_EVERY)
        self._late = _LATE * plant.period

    def closed(self, controller: Controller) -> LinearLoop:
        """Return the loop that a controller closes."""
        return self._plant.closed(self._linear(controller))

    def lack(self, margin: Margin, asked: float) -> float:
        """Return the share of the margins that a loop lacks; 0 and less: none."""
        if not margin.stable:
            return 1.0
        return 1 - min(margin.modulus / asked, margin.delay / self._late)

    def nearness(self, around: Around, asked: float) -> Nearness:
        """Return the excess over the modulus margin that is asked for, with its slope.

        The slope is what the controllers close by tell.
        """
        here = self._linear(around.here)
        margin = self._plant.closed(here).open.margin()

        def excess(controller: System) -> float:
            return self._excess(controller, asked) if margin.stable else self._growth(controller)

        others = ([excess(self._linear(each)) for each in side] for side in around[1:])
        return Nearness(margin, excess(here), difference(*map(np.array, others)))

    def _linear(self, controller: Controller) -> System:
        loop = eqx.tree_at(lambda x: x.controller, self._setup.loop, controller)
        found = linear_controller(loop, self._setup.state, self._plant.period)
        if not all(np.isfinite(part).all() for part in found):
            text = "takes 0 here: the controller has no derivatives where the arm stands still"
            raise ScenarioError([Mistake("--margin", text)])
        return found.minimal()

    def _excess(self, controller: System, asked: float) -> float:
        loop = self._fewer.transfer(controller)
        loci = np.linalg.eigvals(loop.transfer)
        late = loci * np.exp(-2j * np.pi * self._late * loop.frequency)[:, None]
        near = [1 - np.abs(1 + loci) / asked, 1 - np.abs(1 + late) / (_KEPT * asked)]
        return float(logsumexp(_SHARPNESS * np.array(near)) / _SHARPNESS)

    def _growth(self, controller: System) -> float:
        poles = self._plant.poles(controller).values()
        rate = max(0.0, *(float(each[0].real) for each in poles))
        return float(1 + np.log1p(_TIME * rate))
