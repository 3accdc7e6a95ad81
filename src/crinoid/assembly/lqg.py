"""From the description of an LQG controller to its gains."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from crinoid.assembly.known import Known
from crinoid.assembly.numbers import array
from crinoid.assembly.regulator import Regulator, straight
from crinoid.control import Braking, Lqg
from crinoid.scenario import Mistake, ScenarioError

if TYPE_CHECKING:
    from crinoid.assembly.plan import Plan

Matrix = Float[np.ndarray, "_ _"]
Ticks = Int[np.ndarray, " look"]

_GENTLER = 2.0 ** np.arange(0, 4.1, 0.25)
"""Smoothness of each gain, over the first: errors are worth less speed."""
_PREVIEW = 1.5
"""How far it looks ahead to the target, over the arm's first period."""
_LOOKS = 24
"""Times at which it does so."""


def build_lqg(plan: Plan) -> Lqg:
    """Return the LQG controller of a plan."""
    settings, looks = plan.scenario.control.lqg, np.zeros(1, int)
    if plan.scenario.target.feeds_forward:
        ticks = max(_LOOKS, round(_PREVIEW * plan.first_period / plan.period))
        looks = np.unique(np.round(np.geomspace(1, 1 + ticks, _LOOKS)).astype(int)) - 1
    try:
        known = Known.of(plan, settings)
        found = [
            _Gain.of(
                known._replace(worth=factor * known.worth),
                settings.integral_time,
                plan.period,
                looks,
            )
            for factor in _GENTLER
        ]
    except np.linalg.LinAlgError as error:  # of the Riccati equations
        text = f'got "lqg", for which there is no gain here: {error}; takes another'
        raise ScenarioError([Mistake("control.kind", text)]) from error
    gains, by_aim, curved = map(np.stack, zip(*found, strict=True))
    return Lqg(
        observer=known.observer,
        gains=array(gains),
        by_aim=array(by_aim),
        curved=array(curved),
        integrating=array(known.integrating),
        period=array(plan.period),
        mapping=array(known.mapping),
        lead=array(looks * plan.period),
        braking=Braking.of(
            known.speed * plan.period, known.acceleration * plan.period**2, np.ones(1)
        ),
        rows=known.model.rows,
    )


class _Gain(NamedTuple):
    """Gain of the least quadratic cost."""

    by_state: Matrix
    by_aim: Float[np.ndarray, "u look aim"]
    curved: Matrix
    """How the cost is curved by the next move."""

    @staticmethod
    def of(known: Known, integral_time: float, period: float, looks: Ticks) -> _Gain:
        """Work it out, for aims that are told at ``looks`` and go straight in between."""
        regulator = Regulator.of(known, integral_time, period)
        A, B, _, rate, _, _ = regulator
        later = regulator.to_come()
        curved = rate + B.T @ later @ B
        gain = np.linalg.solve(curved, B.T @ later @ A)
        # readings under way tell nothing more of what is to come
        under_way = [known.parts.known] * (known.parts.move.shape[0] - known.parts.known)
        ticks = max(1, int(looks[-1]))
        by_aim = straight(looks, ticks) @ regulator.by_aim(later, ticks).swapaxes(0, 1)
        return _Gain(np.insert(gain, under_way, 0.0, axis=1), by_aim, curved)
