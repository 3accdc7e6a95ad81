"""From a scenario to a closed loop that is ready to run."""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.assembly.controller import build_controller, build_feed_forward
from crinoid.assembly.door import check_sensor, made
from crinoid.assembly.numbers import array
from crinoid.assembly.parameters import Parameters
from crinoid.assembly.parts import Parts
from crinoid.assembly.plan import Plan
from crinoid.assembly.prepared import Prepared
from crinoid.assembly.sensor import build_sensors
from crinoid.assembly.system import assemble
from crinoid.assembly.target import build_target
from crinoid.control import Clock, Controller, Pid
from crinoid.dynamics import (
    Influence,
    Modes,
    ModesError,
    Outcome,
    SmallMotions,
    State,
    System,
    find_modes,
)
from crinoid.plausibility import Facts, doubts
from crinoid.programs import ONCE, compiled
from crinoid.scenario import Scenario
from crinoid.scenario.library import Source, scenario_of
from crinoid.simulation.failure import start_failure
from crinoid.simulation.loop import Loop
from crinoid.simulation.margin import OpenLoop, loop_doubts
from crinoid.simulation.response import Plant


class Setup(NamedTuple):
    """A loop and the state that it starts from."""

    loop: Loop
    state: State
    plan: Plan
    """Plan that the controller was built from."""
    outcome: Outcome
    """Outcome of the static solve; a converged one where the arm starts undeformed."""
    modes: Modes | None
    """Small vibrations about the state; none where no equilibrium was found."""
    doubts: list[str]
    """Notes on odd numbers of the scenario, a sentence each."""
    open_loop: OpenLoop | None
    """The loop, cut open, in each of the waters that it is judged in; none without a PID."""
    loop_doubts: list[str]
    """Notes on the closed loop."""


def set_up(prepared: Prepared) -> Setup:
    """Assemble the loop of a scenario and find the arm's state at the start."""
    prepared.check()
    scenario, system = prepared.scenario, prepared.system
    control = scenario.control
    current = Facts(prepared).mean_current
    state, outcome, tip, small, influence, jacobian = find_start(
        system, array(current), scenario.simulation.start == "equilibrium", is_mapped(scenario)
    )
    modes, told = None, doubts(prepared)
    if not outcome.converged:  # nothing will be run, and the shape that is left means nothing
        jacobian = None
    else:
        try:
            modes = find_modes(small.stiffness, small.mass, lines=influence.lines)
        except ModesError as error:  # a run does without
            told = [*told, f"{error}; the result has neither them nor what follows from them"]
    swings_free = modes is not None and scenario.base.mount == "pinned" and not modes.frequency[0]
    if jacobian is not None and swings_free:
        # the stiffness is singular: what its inverse says is round-off
        jacobian = jnp.full_like(jacobian, jnp.nan)
    swinging = modes.frequency[modes.frequency > 0] if modes is not None else np.zeros(0)
    first_period = float(1 / swinging[0]) if swinging.size else Facts(prepared).period
    loop, plan = loop_about(prepared, state, tip, jacobian, first_period)
    open_loop = None
    # an arm that does not swing back by itself has no response to speak of
    if control.kind == "pid" and modes is not None and np.all(modes.frequency > 0):
        waters = tuple(Facts(prepared).waters)
        open_loop = _open_loop(loop, small, influence, modes, waters)
    found = loop_doubts(open_loop, control.pid.present) if open_loop is not None else []
    return Setup(loop, state, plan, outcome, modes, told, open_loop, found)


def is_mapped(scenario: Scenario) -> bool:
    """Tell whether errors are mapped to inputs by how the tip follows these."""
    return scenario.control.kind != "none" and scenario.control.mapping == "static-jacobian"


def loop_about(
    prepared: Prepared,
    state: State,
    tip: Float[Array, " pose"],
    jacobian: Float[Array, "pose input"] | None,
    first_period: float,
) -> tuple[Loop, Plan]:
    """Return the loop of a scenario about a state of its arm, with the plan of its controller.

    Parameters
    ----------
    prepared
        The scenario.
    state
        The arm at the start.
    tip
        The pose of its tip.
    jacobian
        How that follows the inputs, where errors are mapped to inputs by that.
    first_period
        Period of the slowest vibration of the arm (s).
    """
    scenario, system, parts = prepared.scenario, prepared.system, prepared.parts
    sensors = (*build_sensors(scenario), *(parts.sensors if parts is not None else ()))
    for index, sensor in enumerate(sensors):
        check_sensor(sensor, f"sensor {index}", system, state)
    target = build_target(scenario, prepared.series.get("target"), system, tip)
    plan = Plan(
        scenario,
        prepared.parameters,
        system,
        state,
        jacobian,
        sensors,
        target,
        Facts(prepared).mean_current,
        prepared.recordings,
        first_period,
    )
    for words, names in (
        ("sensors", [sensor.name for sensor in sensors]),
        ("inputs", [each.name for each in plan.inputs]),
    ):
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"two {words} are called {' and '.join(twice)}; each takes its own")
    loop = Loop(
        system=system,
        sensors=sensors,
        controller=_controller(plan, parts),
        clock=Clock(array(plan.period)),
        switched_on=array(scenario.control.start),
        target=target,
        feed_forward=build_feed_forward(plan),
        enabled=jax.device_put(np.asarray(True)),
    )
    return loop, plan


def _controller(plan: Plan, parts: Parts | None) -> Controller:
    if parts is None or parts.controller is None:
        return build_controller(plan)
    given = parts.controller
    if isinstance(given, Controller):
        return given
    return made("controller", Controller, given, plan)


def _open_loop(
    loop: Loop,
    small: SmallMotions,
    influence: Influence,
    modes: Modes,
    waters: tuple[str, ...],
) -> OpenLoop:
    """Return the loop, cut open, in each of the waters."""
    assert isinstance(loop.controller, Pid)
    in_waters = (
        (small.stiffness_in_current, small.damping_in_current),
        (small.stiffness_in_still_water, small.damping_in_still_water),
    )
    return OpenLoop.of(
        {
            water: Plant(
                stiffness=np.asarray(stiffness),
                damping=np.asarray(damping),
                mass=np.asarray(small.mass),
                influence=influence,
            )
            for water, (stiffness, damping) in zip(waters, in_waters, strict=False)
        },
        loop.system.followers,
        loop.sensors[0],
        loop.controller,
        time_step=float(loop.system.time_step),
        resonances=modes.frequency,
    )


def find_start(
    system: System, current: Float[Array, " d"], loaded: bool, mapped: bool
) -> tuple[
    State,
    Outcome,
    Float[Array, " pose"],
    SmallMotions,
    Influence,
    Float[Array, "pose input"] | None,
]:
    """Return the state that an arm starts from, loaded or not, and what is known of it then."""
    state, outcome = find_state(system, loaded)
    return state, outcome, *_find_small_motions(system, state, current, mapped)


# in two: XLA takes longer over one program than over the two halves of it
@compiled(**ONCE)
def find_state(system: System, loaded: bool) -> tuple[State, Outcome]:
    """Return the state that an arm starts from, loaded or not."""
    if loaded:
        return system.find_equilibrium()
    return system.rest(), Outcome.of_nothing(converged=True)


@compiled(**ONCE)
def _find_small_motions(
    system: System, state: State, current: Float[Array, " d"], mapped: bool
) -> tuple[Float[Array, " pose"], SmallMotions, Influence, Float[Array, "pose input"] | None]:
    small, influence = system.small_motions(state, current), system.influence(state)
    jacobian = influence.static(small.stiffness) if mapped else None
    return system.tip(state), small, influence, jacobian


def closed_loop(
    scenario: Source, *, controller: Controller | Callable[[Plan], Controller] | None = None
) -> tuple[Loop, State]:
    """Return the closed loop of a scenario and the state that it starts from: for `rollout`.

    Parameters
    ----------
    scenario
        What `simulate` would run: a scenario, the name of a built-in one, or a file.
    controller
        One of your own in place of the scenario's, as `simulate` takes it.

    Raises
    ------
    RuntimeError
        If the equilibrium at the start was not found.
    ScenarioError
        If a file that the scenario names is not what it takes, or the controller cannot work.
    ValueError
        If the scenario stands for several cases (`crinoid.Scenario.cases`).
    """
    described = scenario_of(scenario)
    require_one_case(described)
    if controller is not None:
        described = described.with_values({"control.kind": "custom"})
    setup = set_up(Prepared(described, Parts(controller)))
    trouble = start_failure(described, setup.loop.system, setup.outcome)
    if trouble:
        raise RuntimeError(trouble)
    return setup.loop, setup.state


def require_one_case(scenario: Scenario) -> None:
    """Refuse a scenario with several cases."""
    if scenario.vary:
        raise ValueError("a scenario with [vary] stands for several cases: run scenario.cases()")


def with_parameters(loop: Loop, parameters: Parameters) -> Loop:
    """Return a closed loop with other numbers of its scenario, the gains of a PID among them.

    Pure: under `jax.jit`, `jax.grad` and `jax.vmap` these act on the numbers. Target, sensors,
    feed-forward and the mapping of errors to inputs stay those of the loop, and so do controllers
    other than a PID.

    Parameters
    ----------
    loop
        As `closed_loop` gives it.
    parameters
        As `parameters` gives them for the same scenario, with whatever was changed since.
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
