"""Search by gradients through the closed loop, within limits and with a stability margin."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from crinoid.inverse import StoppedError
from crinoid.inverse.constrained_search import SearchTrial, constrain, move_inside
from crinoid.inverse.goal import Goal
from crinoid.inverse.ranges import Point
from crinoid.inverse.smooth_loop import SmoothLoop, StructureError
from crinoid.inverse.stability import StabilityMargin
from crinoid.scenario import ScenarioError

_ENOUGH = 1e-6  # a search ends when a step changes its objective by less than this

_REFUSALS = (StructureError, ScenarioError, RuntimeError)
"""Errors that a search survives: the point counts as a failed trial."""

Found = Float[np.ndarray, "measure draw"]
_Rows = tuple[Float[np.ndarray, " row"], Float[np.ndarray, " row"], Float[np.ndarray, "row key"]]


class GradientSearch:
    """Improves points by gradients of the measures of a loop.

    It minimises the mean of the first measure over the draws, over its ``scale``, or the logarithm
    of its square without a scale. The first step is about ``step``. Each start moves to a near
    point with the ``margin``, which needs no run; unstable loops are not run. Before each trial
    ``stop`` is asked whether to end, with a `StoppedError`.
    """

    def __init__(
        self,
        loop: SmoothLoop,
        goal: Goal,
        margin: StabilityMargin | None,
        stop: Callable[[], bool],
        scale: float | None,
        step: float,
    ) -> None:
        self._loop, self._goal, self._margin, self._stop = loop, goal, margin, stop
        self._scale, self._step = scale, step
        self.failure = ""  # why a point was not run
        self._known: dict[bytes, SearchTrial] = {}

    def begin(self, start: Point) -> Point:
        """Return a near point with the margin, or the start without a margin."""

        def excess(point: Point) -> tuple[float, Point]:
            _, (value,), (gradient,) = self._margins(point)
            return value, gradient

        return start if self._margin is None else move_inside(excess, start, self._step)

    def descend(self, start: Point, trials: int, keep: Callable[[Point, Found], None]) -> bool:
        """Improve a start; return whether more trials were asked for.

        ``keep`` receives the measures of each trial.
        """
        left, draws = trials, len(self._loop.seeds)
        limits = (len(self._goal.of_run) - 1) * draws
        none, nothing = np.zeros(limits), np.zeros((limits, start.size))

        def attempt(point: Point) -> SearchTrial:
            nonlocal left
            if point.tobytes() in self._known:
                return self._known[point.tobytes()]
            if left == 0:
                raise StopIteration
            left, failed = left - 1, SearchTrial(np.nan, 0 * point, none, nothing)
            try:
                kept, excess, slope = self._margins(point)
                failed = failed._replace(
                    excess=np.append(none, excess), excess_gradient=np.vstack([nothing, slope])
                )
                if (excess >= 1).any():
                    self.failure = "the closed loop is unstable. Set other gains."
                    return failed
                measured, slopes = self._loop.measures(point, self._goal.of_run)
            except _REFUSALS as error:
                self.failure = " ".join(str(error).split())
                return failed
            keep(point, np.vstack([measured, np.tile(kept[:, None], draws)]))
            if not (np.isfinite(measured).all() and np.isfinite(slopes).all()):
                return failed
            limit, gradient = self._goal.excess(measured, slopes)
            found = SearchTrial(
                *self._value(measured[0].mean(), slopes[0].mean(axis=0)),
                np.append(limit, excess),
                np.vstack([gradient, slope]),
            )
            self._known[point.tobytes()] = found
            return found

        try:
            constrain(attempt, self.begin(start), self._step, _ENOUGH)
        except StopIteration:
            return True
        except _REFUSALS as error:  # of the margin at the start
            self.failure = " ".join(str(error).split())
        return False

    def _value(self, mean: float, slope: Point) -> tuple[float, Point]:
        if self._scale is None:
            return 2 * float(np.log(mean)), 2 * slope / mean
        return float(mean / self._scale), slope / self._scale

    def _margins(self, point: Point) -> _Rows:
        """Return the margin, its violation and the gradient, as rows; none without a margin."""
        if self._stop():
            raise StoppedError
        if self._margin is None:
            return np.zeros(0), np.zeros(0), np.zeros((0, point.size))
        kept, excess, slopes = self._margin.excess(self._loop.neighbours(point))
        return np.array([kept]), np.array([excess]), slopes[None]
