"""Assembly of a system from the numbers of a scenario, and checks of new flows and elements."""

from __future__ import annotations

from itertools import chain

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.assembly.actuators import assemble_actuators
from crinoid.assembly.arrays import array
from crinoid.assembly.door import build_part, check_element, check_flow, part_name, require
from crinoid.assembly.parameters import Parameters
from crinoid.base import Base
from crinoid.compilation import ONCE, compiled
from crinoid.dynamics import FarContact, Forces, Hull, Settings, System, resting
from crinoid.elements import AddedMass, Bend, Drag, Element, Inertia, Stretch, Weight
from crinoid.flow import Flow, Water, on_currents
from crinoid.scenario import Mistake, Scenario, ScenarioError
from crinoid.scenario.kinds import is_own

OWN = 6
"""Number of elements of the arm and its water, which come before the loads."""


def place_of(index: int, loads: int) -> str:
    """Return the place in the scenario of an element of `crinoid.System`, of so many loads."""
    return f"load {index - OWN}" if OWN <= index < OWN + loads else f"element {index}"


def assemble(parameters: Parameters) -> System:
    """Assemble the arm, its base and the water.

    Pure: under `jax.jit`, `jax.grad` and `jax.vmap` these act on the numbers of a scenario.

    Parameters
    ----------
    parameters : Parameters
        Numbers from `crinoid.parameters`, changed or not.

    Returns
    -------
    System

    Examples
    --------
    >>> import equinox as eqx
    >>> numbers = crinoid.parameters("still-water")
    >>> longer = eqx.tree_at(lambda p: p.arm.length, numbers, jnp.array(0.8))  # m
    >>> system = crinoid.assemble(longer)
    >>> system.tip(system.rest()).round(3).tolist()  # x, z (m), angle (rad)
    [0.8, -10.0, 0.0]
    """
    arm, base, water = parameters.arm, parameters.base, parameters.water
    simulation, obstacle = parameters.simulation, parameters.obstacle
    rod = arm.rod()
    elements: tuple[Element, ...] = (
        Stretch.of(rod),
        Bend.of(rod, pinned=base.mount == "pinned"),
        Inertia.of(rod),
        Weight.of(rod, density=water.density, gravity=water.gravity),
        Drag.of(
            rod,
            density=water.density,
            normal=water.drag_normal,
            tangential=water.drag_tangential,
            linear=water.linear_drag,
            viscosity=water.kinematic_viscosity,
        ),
        AddedMass.of(
            rod,
            density=water.density,
            normal=water.added_mass_normal,
            tangential=water.added_mass_tangential,
        ),
    )
    assert len(elements) == OWN
    loads = zip(parameters.load_builders, parameters.load, strict=True)
    elements += tuple(
        build_part(f"load {index}", Element, build, rod, **numbers)
        for index, (build, numbers) in enumerate(loads)
    )
    grasp = ball = None
    if parameters.tool is not None:
        ball = parameters.tool.ball
        elements += (parameters.tool.element(rod, water.density, water.gravity),)
        grasp = parameters.tool.grasp()
    if water.vortices is not None:
        elements += (water.vortices.element(rod, water.density),)
    actuators, through, lines = assemble_actuators(parameters.actuator, rod)
    obstacles = None
    if obstacle is not None:
        obstacles = obstacle.obstacles(rod, base.position, water.density, water.gravity, ball)
    vehicle = None
    if parameters.vehicle is not None:
        vehicle = parameters.vehicle.vehicle(water.density, water.gravity)
    flows = on_currents(parameters.flow, water.gravity)
    held = Base(base.angles, rod.rest_length[0], base.servo, base.motions(flows))
    contact, hull = parameters.contact, parameters.hull
    far: tuple[FarContact, ...] = () if contact is None else contact.far_edges(rod)
    if hull is not None and contact is not None:  # a hull needs contact.self
        far += (hull.hull(rod, held, vehicle, contact.friction),)
    system = System(
        reference=rod.reference,
        forces=Forces(
            (*elements, *through),
            Water(flows),
            base.position,
            obstacles,
            vehicle=vehicle,
            lines=lines,
            far_contacts=far,
        ),
        base=held,
        integrator=simulation.integrator,
        settings=Settings.for_rod(rod, simulation.tolerance, simulation.max_iterations),
        time_step=simulation.time_step,
        # infinite where it is not asked for, which has no slope
        max_error=jax.lax.stop_gradient(simulation.error * arm.length),
        max_halvings=simulation.max_halvings,
        actuators=actuators,
        grip_triggers=grasp,
    )
    for index, flow in enumerate(parameters.flow):
        check_flow(flow, f"flow {index}", rod.axes)
    for index, element in enumerate(system.forces.elements):
        check_element(element, place_of(index, len(parameters.load)), system)
    # no weak types: systems that differ only in numbers then share compiled programs
    return jax.tree.map(
        lambda x: jax.lax.convert_element_type(x, x.dtype) if eqx.is_inexact_array(x) else x, system
    )


assemble_once = compiled(**ONCE)(assemble)
"""`assemble` as one small program, kept between runs; not under a transformation of JAX."""


_COUNT = 64
_GOLDEN = (5**0.5 - 1) / 2
_ROUND_OFF = 1e-9


def sampled_velocities(flow: Flow, scenario: Scenario) -> Float[np.ndarray, "time point d"]:
    """Return the velocity at full strength within a length of the arm from its base (m/s)."""
    base, arm = scenario.base.position, scenario.arm
    points = base + arm.length * np.random.default_rng(0).uniform(-1, 1, (_COUNT, arm.dimension))
    # no period of a flow divides these times (s)
    times = array(scenario.simulation.duration * (_GOLDEN * np.arange(_COUNT) % 1))
    velocity = np.asarray(_velocities_at(flow, array(points), times))
    return velocity[:, np.isfinite(velocity).all(axis=(0, 2))]


def check_steady(flow: Flow, place: str, scenario: Scenario) -> None:
    """Refuse a flow of another package that says that it is steady, but changes in time."""
    if is_own(flow):
        return
    velocity = sampled_velocities(flow, scenario)
    least = _ROUND_OFF * np.abs(velocity).max(initial=0.0)
    changes = np.any(np.abs(velocity - velocity[:1]) > least)
    text = "got True for a velocity that changes in time; must be False"
    require(not (flow.steady and changes), f"{part_name(flow, place)} steady", text)


@eqx.filter_jit
def _velocities_at(
    flow: Flow, points: Float[Array, "point d"], times: Float[Array, " time"]
) -> Float[Array, "time point d"]:
    return jax.vmap(jax.vmap(flow.fully_on, (0, None)), (None, 0))(points, times)


_clearance = compiled(**ONCE)(resting.clearance)


@compiled(**ONCE)
def _body_clearance(system: System) -> Float[Array, " pair"]:
    """Return the distance of each pair of free bodies and other obstacles at the start (m)."""
    forces, _, rows, _ = resting.undeformed(system, jnp.zeros(()))
    room = [group.gaps(rows) - group.contact.skin for group in forces.body_contacts(rows)]
    return jnp.concatenate(room)


@compiled(**ONCE)
def _far_clearances(system: System) -> tuple[Float[Array, ""], ...]:
    """Return the smallest distance of the undeformed arm in each contact of far parts (m)."""
    forces, _, rows, _ = resting.undeformed(system, jnp.zeros(()))
    return tuple(jnp.min(gaps) for gaps in forces.far_gaps(rows))


def check_far_clearances(system: System) -> None:
    """Refuse an arm that overlaps itself or the hull without load."""
    gaps, mistakes = _far_clearances(system), []
    for far, gap in zip(system.forces.far_contacts, map(float, gaps), strict=True):
        if gap < 0 and isinstance(far, Hull):
            text = f"overlaps the arm without load by {-1e3 * gap:.3g} mm; must be clear of it"
            hint = "Lower its diameter or arm.rest_curvature"
            mistakes.append(Mistake("vehicle.hull", f"{text}. {hint}."))
        elif gap < 0:
            text = f"got true for an arm that overlaps itself by {-1e3 * gap:.3g} mm without load"
            hint = "Lower arm.rest_curvature or arm.radius"
            mistakes.append(Mistake("contact.self", f"{text}; must be clear of itself. {hint}."))
    if mistakes:
        raise ScenarioError(mistakes)


def clearance(system: System) -> Float[np.ndarray, " m"]:
    """Return the distance of each obstacle from the arm without load (m), or refuse an overlap.

    A free obstacle may overlap another one by the skin of their contact.
    """
    room, length = np.asarray(_clearance(system, jnp.zeros(()))), float(system.reference.length)
    mistakes = [
        Mistake(
            f"obstacle.{index}.position",
            f"overlaps the arm without load by {-1e3 * gap:.3g} mm. Move it clear of the arm."
            if -gap < length
            else f"overlaps the arm by {-gap:.3g} m, more than the length of the arm. Are size and "
            "place of the obstacle in m?",
        )
        for index, gap in enumerate(room)
        if gap < 0
    ]
    obstacles = system.forces.obstacles
    if obstacles is not None and obstacles.bodies is not None and obstacles.bodies.pairs:
        depths = np.asarray(-_body_clearance(system))
        pairs, skins = chain(*obstacles.bodies.pairs), np.asarray(obstacles.bodies.skin)
        for pair, depth, skin in zip(pairs, depths, skins, strict=True):
            first, second = sorted(pair, key=lambda index: index not in obstacles.free)
            text = f"overlaps obstacle.{second} by {1e3 * depth:.3g} mm. Move it clear of that."
            mistake = Mistake(f"obstacle.{first}.position", text)
            if depth > skin and all(mistake.key != known.key for known in mistakes):
                mistakes.append(mistake)
    if mistakes:
        raise ScenarioError(mistakes)
    return room
