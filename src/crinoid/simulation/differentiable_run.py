"""The closed loop as a pure function of its numbers: what gradients and batches act on."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from crinoid.assembly.parameters import Parameters
from crinoid.assembly.plan import AssembledScenario, Parts
from crinoid.assembly.prepared import Prepared
from crinoid.assembly.system import assemble
from crinoid.control import Controller, Pid, pose_error
from crinoid.dynamics import SOLVED, Outcome, State
from crinoid.scenario.errors import got
from crinoid.scenario.library import Source
from crinoid.simulation.conclusion import start_failure
from crinoid.simulation.loop import Loop, LoopState
from crinoid.simulation.setup import set_up


class Glance(eqx.Module):
    """The closed loop at the end of a time step; in a `Rollout` each has the steps in front."""

    time: Float[Array, "*steps"]
    """Time (s)."""
    tip: Float[Array, "*steps pose"]
    """Pose of the tip in the world (`crinoid.foundation.axes.POSE`; m, rad)."""
    target: Float[Array, "*steps pose"]
    """Wanted pose."""
    error: Float[Array, "*steps pose"]
    """Wanted pose less that of the tip, angles the short way round."""
    command: Float[Array, "*steps input"]
    """Command during the step, in the units of `crinoid.System.inputs`."""


class Rollout(eqx.Module):
    """The closed loop over a number of time steps.

    From the first time step that failed on, all floating-point numbers in `end` and `kept` are
    NaN, and so is every derivative of quantities computed from them.
    """

    end: LoopState
    """The loop at the end, from which another rollout may go on."""
    kept: Any
    """Observations at the end of each time step: each array has the steps in front."""
    outcome: Outcome
    """Outcome of the first time step that failed, else of the last one."""

    @property
    def converged(self) -> Bool[Array, ""]:
        """Whether all time steps succeeded."""
        return self.outcome.converged


def glance(loop: Loop, now: LoopState) -> Glance:
    """Return time, pose of the tip, target, target less tip, and command of a loop."""
    time, tip = now.state.time, loop.system.tip(now.state)
    target = loop.target(time)
    return Glance(time, tip, target, pose_error(target, tip), now.command)


def rollout(
    loop: Loop,
    start: State | LoopState,
    steps: int,
    *,
    observe: Callable[[Loop, LoopState], Any] = glance,
) -> Rollout:
    """Run a closed loop for a number of time steps, as a pure function.

    `jax.jit`, `jax.grad`, `jax.jvp` and `jax.vmap` apply: to the gains and all other numbers of the
    loop (`with_parameters`), and to the state at the start. The derivative goes through the
    solution of each time step (implicit function theorem), not through the iterations that found
    it. Reverse mode keeps the loop at the end of each time step and the step's solution; the rest
    it computes again, step by step (Griewank and Walther 2008, chapter 12). To keep more is to
    write hundreds of small arrays at each step and read them again, which is slower.

    Unlike in `simulate`, a time step that fails is not cut into shorter ones, as reverse mode needs
    a number of steps that is known beforehand.

    Parameters
    ----------
    loop : Loop
        As `closed_loop` gives it.
    start : State or LoopState
        State of the arm when the loop is closed, or the end of an earlier rollout to go on from.
    steps : int
        Number of time steps, at least 1.
    observe : function
        What to keep of the end of each time step: a pytree of arrays, by default a
        `crinoid.simulation.Glance`.

    Returns
    -------
    crinoid.simulation.Rollout
        The loop at the end, the observations, and whether all steps succeeded.

    Raises
    ------
    ValueError
        If there are no steps.

    Examples
    --------
    >>> scenario = crinoid.load("still-water", ["arm.nodes=5", "simulation.duration=0.2"])
    >>> loop, state = crinoid.closed_loop(scenario)
    >>> run = crinoid.rollout(loop, state, steps=4)
    >>> bool(run.converged), run.kept.tip.shape
    (True, (4, 3))
    """
    if steps < 1:
        raise ValueError(f"steps: {got(steps, 'be at least 1')}")
    initial = start if isinstance(start, LoopState) else loop.start(start)
    # of no weak type, as what a step returns
    initial = jax.tree.map(
        lambda x: jax.lax.convert_element_type(x, x.dtype), replace(initial, books=None)
    )
    Carry = tuple[LoopState, Outcome]

    def step(carry: Carry, _: None) -> tuple[Carry, Any]:
        before, earlier = carry
        now, latest = loop.step(before)
        now = _nan_unless(latest.converged, now)
        outcome = jax.tree.map(
            lambda new, old: jnp.where(earlier.converged, new, old), latest, earlier
        )
        return (now, outcome), _nan_unless(outcome.converged, observe(loop, now))

    (end, outcome), kept = jax.lax.scan(
        jax.checkpoint(
            step, prevent_cse=False, policy=jax.checkpoint_policies.save_only_these_names(SOLVED)
        ),
        (initial, Outcome.of_nothing(converged=True)),
        length=steps,
    )
    return Rollout(end, kept, outcome)


def _nan_unless(converged: Bool[Array, ""], tree: Any) -> Any:
    # a product: the slope of a choice would be 0, which looks like an answer
    factor = jnp.where(converged, 1.0, jnp.nan)
    return jax.tree.map(lambda x: factor * x if eqx.is_inexact_array(x) else x, tree)


def closed_loop(
    scenario: Source,
    *,
    controller: Controller | Callable[[AssembledScenario], Controller] | None = None,
) -> tuple[Loop, State]:
    """Return the closed loop of a scenario and the state that it starts from: for `rollout`.

    Parameters
    ----------
    scenario : Scenario, str or path
        What `simulate` would run: a scenario, the name of a built-in one, or a file.
    controller : Controller or function
        A controller to replace the scenario's, as in `simulate`.

    Returns
    -------
    tuple of Loop and State

    Raises
    ------
    RuntimeError
        If the equilibrium at the start was not found.
    ScenarioError
        If a file that the scenario names is not valid, or the controller cannot work.
    ValueError
        If the scenario describes several cases (`crinoid.Scenario.cases`).

    Examples
    --------
    >>> loop, state = crinoid.closed_loop(crinoid.load("still-water", ["arm.nodes=5"]))
    >>> loop.system.tip(state).round(2).tolist()  # x, z (m), angle (rad)
    [0.46, -9.83, 0.56]
    """
    setup = set_up(Prepared.with_parts(scenario, Parts(controller)))
    if trouble := start_failure(setup):
        raise RuntimeError(trouble)
    return setup.loop, setup.state


def with_parameters(loop: Loop, parameters: Parameters) -> Loop:
    """Return a closed loop with other numbers of its scenario, the gains of a PID among them.

    Pure: under `jax.jit`, `jax.grad` and `jax.vmap` these act on the numbers. Target, sensors, rate
    of commands, feed-forward and the mapping of errors to inputs stay those of the loop, and so do
    controllers other than a PID.

    Parameters
    ----------
    loop : Loop
        As `closed_loop` gives it.
    parameters : Parameters
        As `parameters` returns them for the same scenario, with any changes.

    Returns
    -------
    Loop

    Examples
    --------
    >>> import equinox as eqx
    >>> scenario = crinoid.load("still-water", ["arm.nodes=5"])
    >>> loop, state = crinoid.closed_loop(scenario)
    >>> numbers = crinoid.parameters(scenario)
    >>> softer = eqx.tree_at(lambda p: p.arm.youngs_modulus, numbers, 4e5)  # Pa
    >>> loop = crinoid.with_parameters(loop, softer)
    """
    system = assemble(parameters)
    if not isinstance(loop.controller, Pid):
        return eqx.tree_at(lambda x: x.system, loop, system)
    gains = parameters.pid.gains(system.inputs)
    return eqx.tree_at(
        lambda x: (x.system, *(getattr(x.controller, name) for name in gains)),
        loop,
        (system, *gains.values()),
    )
