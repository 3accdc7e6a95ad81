"""The numbers of a loop that change while it runs: all are arguments of its compiled step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from crinoid.assembly.numbers import array
from crinoid.assembly.parameters import Parameters
from crinoid.control import Pid
from crinoid.flow import Flow
from crinoid.live.knobs import Knobs
from crinoid.live.props import PULL
from crinoid.onset import Onset
from crinoid.programs import ONCE, compiled
from crinoid.simulation import Loop, with_parameters

__all__ = ["NO_PULL", "Pull", "Switches", "changed", "with_numbers"]


class Pull(NamedTuple):
    """A force at the tip for a moment."""

    force: tuple[float, ...]
    """N."""
    start: float
    """When it sets in (s)."""

    @property
    def stop(self) -> float:
        """When it ends (s)."""
        return self.start + PULL["lasts"]


NO_PULL = Pull((), 0.0)


def changed(parameters: Parameters, knobs: Knobs, flows: Sequence[Flow], pull: Pull) -> Parameters:
    """Return the numbers of a scenario with props as they are to be.

    Parameters
    ----------
    parameters
        As the scenario has them; the last of the loads is the one that pulls.
    knobs
        Multiples of them.
    flows
        The water (`crinoid.live.water.stirred`).
    pull
        The pull at the tip.
    """
    arm, pid = parameters.arm, parameters.pid
    section = replace(
        arm.section,
        **{
            name: None if given is None else _times(knobs.stiffness, given)
            for name, given in vars(arm.section).items()
            if name in ("EA", "EI", "GJ")
        },
    )
    modulus = _times(knobs.stiffness, arm.youngs_modulus)
    kp, ki, kd = (_times(knobs.gains, gain) for gain in (pid.kp, pid.ki, pid.kd))
    *others, load = parameters.load
    if pull.force:
        onset = Onset(*map(array, (pull.start, PULL["ramp_time"], pull.stop)))
        load = load | {"dead_force": array(pull.force), "onset": onset}
    return replace(
        parameters,
        arm=replace(arm, youngs_modulus=modulus, section=section),
        pid=replace(pid, kp=kp, ki=ki, kd=kd),
        flow=tuple(flows),
        load=(*others, load),
    )


class Switches(NamedTuple):
    """Numbers of a loop that no scenario has."""

    parked: Bool[Array, ""]
    """Whether the debris waits: no water, no weight moves it."""
    shift: Float[Array, " d"]
    """Shift of the target (m)."""
    switched_on: Float[Array, ""]
    """When the controller was switched on (s)."""
    take_up: Float[Array, ""]
    """How long a PID takes to answer in full then (s)."""


@compiled(**ONCE)
def with_numbers(loop: Loop, parameters: Parameters, switches: Switches, debris: bool) -> Loop:
    """Return a loop with other numbers; ``debris``: its last obstacle may wait."""
    loop = with_parameters(loop, parameters)
    loop = eqx.tree_at(
        lambda x: (x.target.shift, x.switched_on),
        loop,
        (switches.shift, switches.switched_on),
    )
    if isinstance(loop.controller, Pid):
        loop = eqx.tree_at(lambda x: x.controller.take_up, loop, switches.take_up)
    if debris:

        def held(values: Float[Array, " f"]) -> Float[Array, " f"]:
            return values.at[-1].set(jnp.where(switches.parked, 0.0, values[-1]))

        def moved_by(x: Any) -> list[Any]:
            bodies = x.system.forces.obstacles.bodies
            return [bodies.displaced, bodies.drag, bodies.weight]

        loop = eqx.tree_at(moved_by, loop, [held(values) for values in moved_by(loop)])
    return loop


def _times(factor: float, number: Array) -> Array:
    return array(factor * np.asarray(number))
