"""The end of a run: its failure, its notes, and its result."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool

from crinoid.actuation import Input, drives, followed
from crinoid.assembly.door import part_name
from crinoid.assembly.prepared import Prepared
from crinoid.assembly.system import place_of
from crinoid.diagnostics.control_loop import unresolved_vibrations
from crinoid.diagnostics.energy_balance import Defect, find_defect, shorter_step, vibration_angle
from crinoid.diagnostics.held_commands import command_jumps, held_commands_note
from crinoid.diagnostics.run_notes import notes, tear_failure, tool_notes
from crinoid.dynamics import ActingForces, Hull, Outcome, State, System
from crinoid.dynamics.outcome import cos_turn_angle
from crinoid.dynamics.resting import undeformed
from crinoid.dynamics.statics import static_motion
from crinoid.dynamics.windows import motion_windows
from crinoid.foundation.axes import LARGEST_TURN
from crinoid.foundation.status import Status
from crinoid.results.dataset import Instants, build_dataset, describe, signals, solids
from crinoid.results.dimensionless import dimensionless, with_velocity_moments
from crinoid.results.record import Record
from crinoid.results.result import UNFINISHED, Result
from crinoid.results.result_file import named_leaves
from crinoid.scenario import Scenario, counted
from crinoid.simulation.loop import LoopState
from crinoid.simulation.setup import Setup
from crinoid.simulation.sink import Build

__all__ = ["conclude", "dataset_builder", "result_attributes"]

_LATELY = 5  # saved instants before a failure that show its vibrations


def start_failure(setup: Setup) -> str:
    """Return why no initial state exists; empty if it does."""
    scenario, system, outcome = setup.scenario, setup.loop.system, setup.outcome
    if outcome.converged:
        return ""
    if found := nonfinite(scenario, system, None, outcome):
        return f"failed at t = 0 s: {found}"
    where = outcome.imbalance(system.reference.nodes, system.forces.free)
    return (
        f"failed at t = 0 s: no static equilibrium found, {where}; "
        f"try {_other_base(scenario)}"
        'simulation.start = "rest", loads that come on with ramp_time, or more arm.nodes'
    )


def command_failure(inputs: Sequence[Input], command: Sequence[float], time: float) -> str:
    """Return which inputs got a command that is not finite; empty if none did."""
    given = {each.name: value for each, value in zip(inputs, command, strict=True)}
    wrong = [name for name, value in given.items() if not np.isfinite(value)]
    if not wrong:
        return ""
    words = " and ".join(f"{given[name]:g} for {name}" for name in wrong)
    return f"failed at t = {time:.6g} s: the controller commanded {words}, which is no number"


def short_step_failure(scenario: Scenario, system: System, state: State, outcome: Outcome) -> str:
    """Return why no step from ``state`` was found, without its past."""
    what, remedy = _trouble(scenario, system, state, outcome)
    return f"failed at t = {float(state.time):.6g} s: {what}; try {remedy}"


def step_failure(
    scenario: Scenario,
    system: System,
    state: State,
    outcome: Outcome,
    dataset: xr.Dataset,
    defect: Defect | None,
) -> str:
    """Return why no step from ``state``, the end of ``dataset``, was found."""
    simulation, obstacles = scenario.simulation, system.forces.obstacles
    when = f"failed at t = {float(state.time):.6g} s"
    what, remedy = _trouble(scenario, system, state, outcome)
    if defect is not None and defect.gained:
        return f"{when}: {defect.summary}; {defect.cause}, until {what}; try {defect.remedy}"
    if outcome.resolved and vibration_angle(dataset, simulation, -_LATELY) > 1.0:
        ways = shorter_step(simulation, 1.0) + simulation.or_damping
        remedy = f"{ways}, or loads that come on with ramp_time"
        what = f"vibrations are too fast for time steps of {simulation.time_step:g} s, and {what}"
    caught = False
    if obstacles is not None:
        assert state.gap is not None
        caught = bool(np.any(np.asarray(obstacles.touching(state.gap))))
    # what sticks and slips in turn within a step may be beyond Newton's method
    rubs = " or rub it less" * any(obstacle.friction > 0 for obstacle in scenario.obstacle)
    room = f", or obstacles that leave the arm room{rubs}" * (caught and bool(outcome.resolved))
    return f"{when}: {what}; try {remedy}{room}"


def _trouble(scenario: Scenario, system: System, state: State, outcome: Outcome) -> tuple[str, str]:
    """Return the cause of a failed step, and the remedy where nothing else is known."""
    halvings = f"even after {counted(scenario.simulation.max_halvings, 'halving')}"
    smaller = "a smaller simulation.time_step"
    if found := nonfinite(scenario, system, state, outcome):
        return found, "numbers with which it is finite"
    if not outcome.resolved:
        slower = ", or slower obstacles" * (state.gap is not None)
        nearest = nearest_pair(system, state)
        return (
            f"a hit is too hard or too fast for a time step {halvings}, {nearest}",
            f"{smaller}, more simulation.max_halvings{slower}",
        )
    if outcome.folded:
        cosine = np.asarray(cos_turn_angle(system.forces, state.motion.position))
        node, angle = int(np.argmin(cosine)), np.rad2deg(np.arccos(np.clip(cosine.min(), -1, 1)))
        return (
            f"the arm folds onto itself, two edges meet at more than {LARGEST_TURN:.0f} degrees "
            f"{halvings}, and node {node} was bent by {angle:.0f} before",
            f"{_other_base(scenario)}more arm.nodes, weaker loads, a stiffer arm, or {smaller}",
        )
    if outcome.error > system.max_error:
        return (
            f"a time step errs by {1e3 * float(outcome.error):.3g} mm {halvings}, and "
            f"simulation.error allows {1e3 * float(system.max_error):.3g} mm",
            f"{smaller}, more simulation.max_halvings, or a larger simulation.error",
        )
    where = outcome.imbalance(system.reference.nodes, system.forces.free)
    return (
        f"a time step could not be solved {halvings}, {where}",
        f"{smaller}, loads that come on with ramp_time, or more simulation.max_halvings",
    )


def nonfinite(scenario: Scenario, system: System, state: State | None, outcome: Outcome) -> str:
    """Name the part that gives nan or infinity in a step from a state, and when; empty if none.

    The check covers the shortest step and the longest; without a state, the arm at rest at t = 0.
    """
    if np.isfinite(outcome.residual):
        return ""
    forces, loads = system.forces, len(scenario.load)
    parts = [(part_name(each, "actuator"), "a drive") for each in system.actuators]
    parts += [
        (part_name(each, f"flow {i}"), "a velocity") for i, each in enumerate(forces.water.flows)
    ]
    parts += [
        (part_name(each, place_of(i, loads)), "a force") for i, each in enumerate(forces.elements)
    ]
    for share in (0.0,) if state is None else (0.5 ** int(system.max_halvings), 1.0):
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
        motion = static_motion(*undeformed(system, step))
    else:
        command, before = jnp.zeros(len(system.inputs)), (state.servo, *state.actuators)
        states, old = followed(system.followers, before, command, step)[1:], state.motion
        motion = replace(
            old,
            time=old.time + step,
            position=old.position + step * old.velocity,
            drive=drives(system.actuators, states),
        )
    points = forces.origin + motion.position[:, : forces.axes]
    given = [one.drive(each) for one, each in zip(system.actuators, states, strict=True)]
    times = jnp.stack([motion.time - step, motion.time])  # of a start at rest the first as well
    at = [jax.vmap(jax.vmap(flow.jet, (0, None)), (None, 0)) for flow in forces.water.flows]
    given += [jets(points, times) for jets in at]
    given += [
        jax.vmap(lambda e, m: e.residual(m))(e, motion_windows(e, motion)) for e in forces.elements
    ]
    return [jnp.isfinite(ravel_pytree(each)[0]).all() for each in given]


def nearest_pair(system: System, state: State) -> str:
    """Describe the smallest distance of two surfaces: of arm, obstacles and hull."""
    gaps = [] if state.gap is None else np.min(np.asarray(state.gap), axis=1).tolist()
    found = [(gap, f"obstacle {index}", "the arm") for index, gap in enumerate(gaps)]
    rows = state.motion.position
    forces = ActingForces.of(system.forces, state.context)
    for each in forces.far_contacts:
        other = "the hull" if isinstance(each, Hull) else "itself"
        found.append((float(jnp.min(each.group(forces.heading).gaps(rows))), "the arm", other))
    bodies = None if system.forces.obstacles is None else system.forces.obstacles.bodies
    if bodies is not None and state.body_gap is not None:
        apart = np.asarray(state.body_gap) - np.asarray(bodies.skin)
        for pair, gap in zip(chain(*bodies.pairs), apart.tolist(), strict=True):
            first, second = (f"obstacle {index}" for index in sorted(pair))
            found.append((gap, first, second))
    gap, one, other = min(found)
    if gap < 0:
        return f"{one} is pressed {-1e3 * gap:.3g} mm into {other}"
    return f"{one} is nearest to {other} with {1e3 * gap:.3g} mm between them"


def _other_base(scenario: Scenario) -> str:
    """Return the first remedy where a joint may be bent too far."""
    jointed = scenario.arm.dimension == 3 and scenario.base.mount == "pinned"
    if not jointed:
        return ""
    return f"a base that points less than {LARGEST_TURN:.0f} degrees from where the arm hangs, "


def dataset_builder(setup: Setup) -> Build:
    """Return what makes data of the instants of a run."""
    loop, scenario = setup.loop, setup.scenario
    about = result_attributes(setup.prepared, UNFINISHED, 0.0, [])

    def build(kept: Record, before: float | None) -> xr.Dataset:
        system, diameters = loop.system, scenario.arm.diameters
        if not loop.enabled:  # the observer does not run either
            kept = eqx.tree_at(  # of arrays of NumPy
                lambda each: (each.estimate, each.estimate_time),
                kept,
                (None, None),
                is_leaf=lambda leaf: leaf is None,
            )
        run, modes = Instants(system, kept, before), setup.modes
        built = build_dataset(
            run,
            diameters,
            signals(kept, setup.plan.inputs, loop.readings, system.forces.lines),
            solids(setup.prepared.surfaces),
            dimensionless(run.relative_flow, run.tangent, np.array(diameters), scenario, modes),
        )
        return built.assign_attrs(about)

    return build


def conclude(
    setup: Setup,
    carry: LoopState,
    dataset: xr.Dataset,
    trouble: str,
    failed: Outcome | None,
    wall_time: float,
    *,
    with_ledger: bool = True,
    with_notes: bool = True,
) -> Result:
    """Return the result of a run that is over, from its state at the end and all its instants.

    ``trouble`` ended it early, other than a step that failed, of which ``failed`` is the outcome.
    Its energies are not to balance (``with_ledger``) where numbers of the arm changed meanwhile.
    Notes cost a tenth of a short run: not ``with_notes`` where nobody reads them.
    """
    prepared, scenario, system = setup.prepared, setup.scenario, setup.loop.system
    dataset = with_velocity_moments(dataset)
    defect = None
    jumps, damped = command_jumps(dataset, system, prepared.facts), scenario.simulation.or_damping
    step_energy, rings = unresolved_vibrations(dataset, system, jumps, damped)
    if with_ledger:
        floor = float(carry.state.reused_tangent.floor.max())
        defect = find_defect(dataset, scenario, floor, step_energy)
    if failed is not None:
        time = float(carry.state.time)
        trouble = command_failure(system.inputs, np.asarray(carry.command).tolist(), time)
        if not trouble:
            trouble = step_failure(scenario, system, carry.state, failed, dataset, defect)
    elif not trouble:
        trouble = tear_failure(dataset)
        if defect is not None and defect.failed is not None:
            trouble = defect.failure
    found_notes = []
    if with_notes:
        rings = held_commands_note(dataset, system, prepared.facts) or rings
        found_notes = [
            *prepared.notes(),
            *setup.warnings,
            *setup.loop_warnings,
            *notes(dataset, prepared.facts),
            *tool_notes(scenario.tool, carry.state.grip),
            *([rings] if rings else []),
        ]
        if defect is not None and defect.summary not in trouble:
            found_notes.append(defect.note)
    dataset.attrs = result_attributes(prepared, trouble or Status.OK.value, wall_time, found_notes)
    return Result(dataset, named_leaves(carry))


def result_attributes(
    prepared: Prepared, status: str, wall_time: float, found_notes: list[str]
) -> dict[str, object]:
    """Return the attributes of a result."""
    return describe(prepared.scenario) | {
        "status": status,
        "wall_time": wall_time,
        "notes": "\n".join(found_notes),
        # as sha256sum writes and checks it
        "files": "\n".join(f"{digest}  {file}" for file, digest in prepared.digests.items()),
    }
