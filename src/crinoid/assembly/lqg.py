"""From the description of an LQG controller to its gains."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from crinoid.assembly.known import Known
from crinoid.assembly.lags import lags
from crinoid.assembly.numbers import array
from crinoid.assembly.regulator import Regulator
from crinoid.control import Braking, Lqg
from crinoid.scenario import Mistake, ScenarioError

if TYPE_CHECKING:
    from crinoid.assembly.plan import Plan

Matrix = Float[np.ndarray, "_ _"]

_GENTLER = 2.0 ** np.arange(0, 4.1, 0.25)
"""Smoothness of each gain, over the first: errors are worth less speed."""


def build_lqg(plan: Plan) -> Lqg:
    """Return the LQG controller of a plan.

    Raises
    ------
    ScenarioError
        If the inputs do not move what is controlled, or there is no gain that does.
    """
    settings = plan.scenario.control.lqg
    try:
        known = Known.of(plan, settings)
        found = [
            _gain(known._replace(worth=factor * known.worth), settings.integral_time, plan.period)
            for factor in _GENTLER
        ]
    except np.linalg.LinAlgError as error:  # of the Riccati equations
        text = f'got "lqg", for which there is no gain here: {error}; takes another'
        raise ScenarioError([Mistake("control.kind", text)]) from error
    gains, curved = map(np.stack, zip(*found, strict=True))
    lag = lags(plan.system.followers)[list(known.model.rows)]
    return Lqg(
        observer=known.observer,
        gains=array(gains),
        curved=array(curved),
        integrating=array(known.integrating),
        period=array(plan.period),
        actuators=array(known.model.actuators),
        commanded=array(known.model.commanded),
        mapping=array(known.mapping),
        lead=array(lag + 0.5 * plan.period),
        braking=Braking.of(
            known.speed * plan.period, known.acceleration * plan.period**2, np.ones(1)
        ),
        rows=known.model.rows,
    )


def _gain(known: Known, integral_time: float, period: float) -> tuple[Matrix, Matrix]:
    """Return the gain of the least quadratic cost, and how that is curved by the next move."""
    from scipy.linalg import solve_discrete_are  # slow to load

    A, B, cost, rate, _ = Regulator.of(known, integral_time, period)
    later = solve_discrete_are(A, B, cost, rate)
    curved = rate + B.T @ later @ B
    gain = np.linalg.solve(curved, B.T @ later @ A)
    # readings under way tell nothing more of what is to come
    under_way = [known.parts.known] * (known.parts.move.shape[0] - known.parts.known)
    return np.insert(gain, under_way, 0.0, axis=1), curved
