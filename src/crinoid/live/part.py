"""A scenario under one kind of controller, ready to be run with props."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from crinoid.assembly.numbers import array
from crinoid.assembly.parameters import Parameters
from crinoid.assembly.prepared import Prepared
from crinoid.comparison import controlled_by
from crinoid.control import Pid
from crinoid.flow import Flow
from crinoid.live.knobs import Knobs
from crinoid.live.numbers import Switches
from crinoid.live.props import Props
from crinoid.live.target import Shifted
from crinoid.live.water import stirred
from crinoid.scenario import Scenario
from crinoid.simulation.ahead import compile_ahead
from crinoid.simulation.failure import start_failure
from crinoid.simulation.loop import Loop
from crinoid.simulation.setup import Setup, set_up

__all__ = ["CAPACITY", "KINDS", "Part", "StartError", "kinds_for"]

CAPACITY = 64
"""Most instants of a stretch."""
KINDS = ("none", "pid", "lqg", "mpc")
"""Kinds of controllers that any scenario with inputs may be switched to."""


class StartError(RuntimeError):
    """A scenario without a state to start from."""


class Part(NamedTuple):
    """A scenario under one kind of controller."""

    scenario: Scenario
    """Without props."""
    parameters: Parameters
    """With props."""
    flows: tuple[Flow, ...]
    """The water as the scenario has it."""
    setup: Setup
    loop: Loop
    """As it is at the start, with a target that can be shifted."""

    @staticmethod
    def of(scenario: Scenario, props: Props, kind: str) -> Part:
        """Set a scenario up under a kind of controller."""
        if kind != scenario.control.kind:
            scenario = controlled_by(scenario, kind)
        prepared = Prepared(props.added(scenario))
        flows, place = prepared.parameters.flow, np.asarray(scenario.base.position)
        # a loop that starts has the form of one whose water was changed: both are one program
        prepared.parameters = replace(
            prepared.parameters,
            flow=stirred(flows, None, Knobs(), place, 0.0),
        )

        def shifted(loop: Loop) -> Loop:
            target = Shifted.of(loop.target, scenario.arm.dimension)
            return eqx.tree_at(lambda x: x.target, loop, target)

        compile_ahead(prepared, CAPACITY, shifted)
        setup = set_up(prepared)
        trouble = start_failure(scenario, setup.loop.system, setup.outcome)
        if trouble:
            raise StartError(trouble)
        return Part(scenario, prepared.parameters, flows, setup, shifted(setup.loop))

    def switches(
        self, *, parked: bool, shift: Float[np.ndarray, " d"], since: float | None
    ) -> Switches:
        """Return the numbers of a loop that no scenario has.

        Parameters
        ----------
        parked
            Whether the debris waits.
        shift
            That of the target (m).
        since
            When the controller took over (s); None if it is at work from the start.
        """
        controller = self.loop.controller
        own = controller.take_up if isinstance(controller, Pid) else array(0.0)
        return Switches(
            jnp.asarray(parked),
            array(shift),
            self.loop.switched_on if since is None else array(since),
            own if since is None else array(self.setup.plan.first_period),
        )


def kinds_for(scenario: Scenario) -> tuple[str, ...]:
    """Return the kinds of controllers that a scenario may be switched to, its own last if new."""
    own = scenario.control.kind
    if not (scenario.base.channels.present or scenario.thread_names):
        return tuple(dict.fromkeys(("none", own)))
    return tuple(dict.fromkeys((*KINDS, own)))
