"""The part that gives nan or infinity, after a solve that failed."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool

from crinoid.actuation import drives, followed
from crinoid.assembly.door import who
from crinoid.assembly.system import place_of
from crinoid.dynamics import Outcome, State, System
from crinoid.dynamics.statics import standing
from crinoid.dynamics.windows import gathered
from crinoid.scenario import Scenario

__all__ = ["culprit"]


def culprit(scenario: Scenario, system: System, state: State | None, outcome: Outcome) -> str:
    """Name the part that gives nan or infinity in a step from a state, and when; empty if none.

    The check covers the shortest step and the longest; without a state, the arm at rest at t = 0.
    """
    if np.isfinite(outcome.residual):
        return ""
    forces, loads = system.forces, len(scenario.load)
    parts = [(who(each, "actuator"), "a drive") for each in system.actuators]
    parts += [(who(each, f"flow {i}"), "a velocity") for i, each in enumerate(forces.water.flows)]
    parts += [(who(each, place_of(i, loads)), "a force") for i, each in enumerate(forces.elements)]
    for share in (0.0,) if state is None else (0.0, 0.5 ** int(system.max_halvings), 1.0):
        step = jnp.asarray(share * system.time_step)
        for (name, gives), finite in zip(parts, _finite(system, state, step), strict=True):
            if not finite:
                time = float(step) + (0.0 if state is None else float(state.time))
                return f"{name} gives {gives} that is not finite at t = {time:.6g} s"
    return ""


@eqx.filter_jit
def _finite(system: System, state: State | None, step: Array) -> list[Bool[Array, ""]]:
    """Return whether the results of actuators, flows and elements are finite after a step."""
    forces, states = system.forces, [one.at_rest() for one in system.actuators]
    if state is None:
        motion = standing(*system.undeformed(step))
    else:
        command, before = jnp.zeros(len(system.inputs)), (state.servo, *state.actuators)
        states, old = followed(system.followers, before, command, step)[1:], state.motion
        motion = eqx.tree_at(
            lambda m: (m.time, m.position, m.drive),
            old,
            (old.time + step, old.position + step * old.velocity, drives(system.actuators, states)),
            is_leaf=lambda x: x is None,
        )
    points = forces.origin + motion.position[:, : forces.axes]
    given = [one.drive(each) for one, each in zip(system.actuators, states, strict=True)]
    given += [jax.vmap(flow.jet, (0, None))(points, motion.time) for flow in forces.water.flows]
    given += [jax.vmap(lambda e, m: e.residual(m))(e, gathered(e, motion)) for e in forces.elements]
    return [jnp.isfinite(ravel_pytree(each)[0]).all() for each in given]
