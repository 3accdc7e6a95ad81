"""A flow of another package at points about the arm, at times of the run."""

from __future__ import annotations

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from crinoid.assembly.door import is_own, require, who
from crinoid.assembly.numbers import array
from crinoid.flow import Flow
from crinoid.scenario import Scenario

_COUNT = 24
_ROUND_OFF = 1e-9


def samples(flow: Flow, scenario: Scenario) -> Float[np.ndarray, "time point d"]:
    """Return the velocity at full strength within a length of the arm from its base (m/s)."""
    random, base, arm = np.random.default_rng(0), scenario.base.position, scenario.arm
    points = base + arm.length * random.uniform(-1, 1, (_COUNT, arm.dimension))
    times = scenario.simulation.duration * random.uniform(0, 1, _COUNT)
    velocity = np.asarray(_velocities(flow, array(points), array(times)))
    return velocity[:, np.isfinite(velocity).all(axis=(0, 2))]


def check_steady(flow: Flow, place: str, scenario: Scenario) -> None:
    """Refuse a flow of another package whose `crinoid.Flow.steady` is wrong, or not declared."""
    if is_own(flow):
        return
    velocity, name = samples(flow, scenario), f"{who(flow, place)} steady"
    least = _ROUND_OFF * np.abs(velocity).max(initial=0.0)
    changes = np.any(np.abs(velocity - velocity[:1]) > least)
    differs = np.any(np.abs(velocity - velocity[:, :1]) > least)
    said = any("steady" in vars(base) for base in type(flow).__mro__ if base is not Flow)
    text = "got True for a velocity that changes in time; must be False"
    require(not (flow.steady and changes), name, text)
    text = (
        "got none for a velocity that differs in space and never changes; must be declared: "
        "`steady: ClassVar[bool] = True`, or False if it changes at other times"
    )
    require(said or changes or not differs, name, text)


@eqx.filter_jit
def _velocities(
    flow: Flow, points: Float[Array, "point d"], times: Float[Array, " time"]
) -> Float[Array, "time point d"]:
    return jax.vmap(jax.vmap(flow.fully_on, (0, None)), (None, 0))(points, times)
