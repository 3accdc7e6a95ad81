"""Flows and elements of other packages about the arm at rest, at times of the run."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.assembly.door import require, who
from crinoid.assembly.numbers import array
from crinoid.assembly.system import place_of
from crinoid.dynamics import System
from crinoid.dynamics.statics import standing
from crinoid.dynamics.vehicle import moments
from crinoid.dynamics.windows import gathered
from crinoid.elements import Element
from crinoid.flow import Flow
from crinoid.scenario import Scenario
from crinoid.scenario.kinds import is_own

Foreign = tuple[dict[int, Float[np.ndarray, "s d"]], dict[str, tuple[Array, Array]]]

_COUNT = 64
_GOLDEN = (5**0.5 - 1) / 2
_ROUND_OFF = 1e-9


def samples(flow: Flow, scenario: Scenario) -> Float[np.ndarray, "time point d"]:
    """Return the velocity at full strength within a length of the arm from its base (m/s)."""
    base, arm = scenario.base.position, scenario.arm
    points = base + arm.length * np.random.default_rng(0).uniform(-1, 1, (_COUNT, arm.dimension))
    velocity = np.asarray(_velocities(flow, array(points), _times(scenario)))
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


def foreign(system: System, scenario: Scenario) -> Foreign:
    """Return velocities of flows by index, and force (N) and couple (N m) of elements by name."""
    forces, loads, times = system.forces, len(scenario.load), _times(scenario)
    return {
        index: np.concatenate(samples(flow, scenario))
        for index, flow in enumerate(forces.water.flows)
        if not is_own(flow)
    }, {
        who(one, place_of(index, loads)): _push(one, system, times)
        for index, one in enumerate(forces.elements)
        if not is_own(one)
    }


@eqx.filter_jit
def _push(element: Element, system: System, times: Float[Array, " time"]) -> tuple[Array, Array]:
    """Return the largest sums of magnitudes, over the windows, of force and couple.

    A couple is a moment in a window that no force there explains.
    """

    def at(time: Float[Array, ""]) -> tuple[Array, Array]:
        window = gathered(element, standing(*system.undeformed(time)))
        given = jax.vmap(lambda e, m: e.residual(m))(element, window)
        axes = system.forces.axes
        place, force = window.position[..., :axes], given[..., :axes]
        lever = place - jnp.mean(place, axis=1, keepdims=True)
        size, total = (jnp.linalg.norm(x, axis=-1) for x in (lever, jnp.sum(force, axis=1)))
        moment = jnp.linalg.norm(jnp.sum(moments(lever, force), axis=1), axis=-1)
        couple = jnp.maximum(0, moment - total * jnp.max(size, axis=1))
        return jnp.sum(total), jnp.sum(couple) + jnp.sum(jnp.abs(given[..., axes:]))

    force, couple = jax.vmap(at)(times)
    return jnp.max(force), jnp.max(couple)


def _times(scenario: Scenario) -> Float[Array, " time"]:
    """Return times that no period of a flow divides (s)."""
    return array(scenario.simulation.duration * (_GOLDEN * np.arange(_COUNT) % 1))


@eqx.filter_jit
def _velocities(
    flow: Flow, points: Float[Array, "point d"], times: Float[Array, " time"]
) -> Float[Array, "time point d"]:
    return jax.vmap(jax.vmap(flow.fully_on, (0, None)), (None, 0))(points, times)
