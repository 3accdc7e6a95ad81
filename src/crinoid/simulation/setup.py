"""From a scenario to a closed loop that is ready to run."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.assembly.arrays import array
from crinoid.assembly.control_loop import build_controller, build_feed_forward
from crinoid.assembly.door import check_sensor
from crinoid.assembly.plan import AssembledScenario, find_state
from crinoid.assembly.prepared import Prepared
from crinoid.compilation import ONCE, compiled
from crinoid.control import Clock
from crinoid.diagnostics.plausibility import plausibility_warnings
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
from crinoid.results.metrics import measures_of
from crinoid.scenario import Scenario
from crinoid.simulation.frequency_response import Plant
from crinoid.simulation.loop import Loop
from crinoid.simulation.loop_margin import OpenLoop, loop_warnings


class Setup(NamedTuple):
    """A scenario with its loop, and the state that it starts from."""

    prepared: Prepared
    loop: Loop
    state: State
    plan: AssembledScenario
    """Plan that the controller was built from."""
    outcome: Outcome
    """Outcome of the static solve; a converged one where the arm starts undeformed."""
    modes: Modes | None
    """Small vibrations about the state; none where no equilibrium was found."""
    warnings: list[str]
    """Notes on odd numbers of the scenario, a sentence each."""
    open_loop: OpenLoop | None
    """The loop, cut open, in each of the waters that it is judged in; none without a PID."""
    loop_warnings: list[str]
    """Notes on the closed loop."""

    @property
    def scenario(self) -> Scenario:
        """Scenario of the run."""
        return self.prepared.scenario


def set_up(prepared: Prepared, *, notes: bool = True) -> Setup:
    """Assemble the loop of a scenario and find the arm's state at the start.

    Without ``notes`` neither the scenario nor its loop is judged, which costs more than all the
    rest.
    """
    warnings = plausibility_warnings(prepared) if notes else []
    prepared.check()
    measures_of(prepared.scenario)  # refuses those that are in no package, before any run
    scenario, system, facts = prepared.scenario, prepared.system, prepared.facts
    state, outcome = find_state(system, scenario.simulation.start == "equilibrium")
    control = scenario.control
    mapped = control.acts and control.mapping == "static-jacobian"
    tip, small, influence, jacobian = _find_small_motions(
        system, state, array(facts.mean_current), mapped
    )
    modes, frequencies = None, np.zeros(0)
    if not outcome.converged:  # nothing will be run, and the shape that is left means nothing
        jacobian = None
    else:
        try:
            modes = find_modes(small.stiffness, small.mass, lines=influence.lines)
            frequencies = modes.frequency
        except ModesError as error:  # a run does without
            note = f"{error}; the result has neither them nor what follows from them"
            warnings = [*warnings, note]
    swings_free = modes is not None and scenario.base.mount == "pinned" and not frequencies[0]
    if jacobian is not None and swings_free:
        # the stiffness is singular: what its inverse says is round-off
        jacobian = jnp.full_like(jacobian, jnp.nan)
    swinging = frequencies[frequencies > 0]
    first_period = float(1 / swinging[0]) if swinging.size else facts.period
    loop, plan = loop_about(prepared, state, tip, jacobian, first_period)
    open_loop, found = None, []
    # an arm that does not swing back by itself has no response to speak of
    if notes and control.gains and modes is not None and np.all(frequencies > 0):
        open_loop = _open_loop(loop, small, influence, modes, tuple(facts.waters))
        found = loop_warnings(open_loop, control.gains)
    return Setup(prepared, loop, state, plan, outcome, modes, warnings, open_loop, found)


def loop_about(
    prepared: Prepared,
    state: State,
    tip: Float[Array, " pose"],
    jacobian: Float[Array, "pose input"] | None,
    first_period: float,
) -> tuple[Loop, AssembledScenario]:
    """Return the loop of a scenario about a state of its arm, with the plan of its controller.

    ``tip`` is the pose of the tip, ``jacobian`` how it follows the inputs, where errors are mapped
    to inputs by that, and ``first_period`` that of the slowest vibration (s).
    """
    system, sensors = prepared.system, prepared.sensors
    for index, sensor in enumerate(sensors):
        check_sensor(sensor, f"sensor {index}", system, state)
    target = prepared.target(tip)
    plan = AssembledScenario(
        prepared.scenario,
        prepared.parameters,
        system,
        state,
        jacobian,
        sensors,
        target,
        prepared.facts.mean_current,
        prepared.recordings,
        first_period,
    )
    plan.check_names()
    loop = Loop(
        system=system,
        sensors=sensors,
        controller=build_controller(plan, prepared.parts),
        clock=Clock(array(plan.period)),
        switched_on=array(plan.scenario.control.start),
        target=target,
        feed_forward=build_feed_forward(plan),
        enabled=jax.device_put(np.asarray(True)),
    )
    return loop, plan


def _open_loop(
    loop: Loop, small: SmallMotions, influence: Influence, modes: Modes, waters: tuple[str, ...]
) -> OpenLoop:
    """Return the loop, cut open, in each of the waters."""
    in_waters = (
        (small.stiffness_in_current, small.damping_in_current),
        (small.stiffness_in_still_water, small.damping_in_still_water),
    )
    plants = {
        water: Plant(np.asarray(stiffness), np.asarray(damping), np.asarray(small.mass), influence)
        for water, (stiffness, damping) in zip(waters, in_waters, strict=False)
    }
    return OpenLoop.of(plants, loop, modes.frequency)


# apart from `find_state`: XLA compiles one program longer than its two halves
@compiled(**ONCE)
def _find_small_motions(
    system: System, state: State, current: Float[Array, " d"], mapped: bool
) -> tuple[Float[Array, " pose"], SmallMotions, Influence, Float[Array, "pose input"] | None]:
    small, influence = system.small_motions(state, current), system.influence(state)
    jacobian = influence.static(small.stiffness) if mapped else None
    return system.tip(state), small, influence, jacobian
