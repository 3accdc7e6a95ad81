"""From the description of an LQG controller to its gains."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from crinoid.assembly.known import Known
from crinoid.assembly.lags import lags
from crinoid.assembly.numbers import array
from crinoid.assembly.regulator import Regulator
from crinoid.control import Lqg
from crinoid.scenario import Mistake, ScenarioError

if TYPE_CHECKING:
    from crinoid.assembly.plan import Plan

Matrix = Float[np.ndarray, "_ _"]


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
        gain = _gain(known, settings.integral_time, plan.period)
    except np.linalg.LinAlgError as error:  # of the Riccati equations
        text = f'got "lqg", for which there is no gain here: {error}; takes another'
        raise ScenarioError([Mistake("control.kind", text)]) from error
    lag = lags(plan.system.followers)[list(known.model.rows)]
    return Lqg(
        observer=known.observer,
        gain=array(gain),
        integrating=array(known.integrating),
        period=array(plan.period),
        actuators=array(known.model.actuators),
        commanded=array(known.model.commanded),
        mapping=array(known.mapping),
        lead=array(lag + 0.5 * plan.period),
        max_speed=array(known.speed),
        max_acceleration=array(known.acceleration),
        rows=known.model.rows,
    )


def _gain(known: Known, integral_time: float, period: float) -> Matrix:
    """Return the gain of the least quadratic cost (discrete Riccati equation).

    A command moves at the rate that its acceleration has brought it to, ``du = T (r + T a)``: rates
    ``r`` are states, behind the others.
    """
    from scipy.linalg import block_diag, solve_discrete_are  # slow to load

    A, B, cost, rate, controlled = Regulator.of(known, integral_time, period)
    inputs, one = B.shape[1], np.eye(B.shape[1])
    A = np.block([[A, period * B], [np.zeros((inputs, A.shape[0])), one]])
    B = period * np.concatenate([period * B, one])
    cost = block_diag(cost, period**2 * rate)
    push = np.diag((known.worth / known.acceleration) ** 2)
    found = solve_discrete_are(A, B, cost, push)
    gain = np.linalg.solve(push + B.T @ found @ B, B.T @ found @ A)
    # readings under way tell nothing more of what is to come; integrals go behind the rates
    size = known.parts.known
    under_way = np.zeros((inputs, known.parts.move.shape[0] - size))
    estimate, rest, integrals, rates = np.split(
        gain, [size, gain.shape[1] - controlled - inputs, gain.shape[1] - inputs], axis=1
    )
    return np.hstack([estimate, under_way, rest, rates, integrals])
