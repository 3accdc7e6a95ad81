"""From the numbers of a scenario to the arrays that move the arm: pure, traceable."""

import equinox as eqx
import jax
import jax.numpy as jnp

from crinoid.assembly.actuator import assemble_actuators
from crinoid.assembly.door import check_element, check_flow, made
from crinoid.assembly.parameters import Parameters
from crinoid.dynamics import Forces, Settings, System
from crinoid.elements import AddedMass, Bend, BendTwist, Drag, Element, Inertia, Stretch, Weight
from crinoid.flow import Water
from crinoid.programs import ONCE, compiled

OWN = 6
"""How many elements of the arm and its water there are before the loads."""


def place_of(index: int, loads: int) -> str:
    """Return the place in the scenario of an element of `crinoid.System`, of so many loads."""
    return f"load {index - OWN}" if OWN <= index < OWN + loads else f"element {index}"


def assemble(parameters: Parameters) -> System:
    """Assemble the arm, its base and the water.

    Pure: under `jax.jit`, `jax.grad` and `jax.vmap` these act on the numbers of a scenario.

    Parameters
    ----------
    parameters
        As `crinoid.parameters` gives them, with whatever was changed since.
    """
    arm, base, water = parameters.arm, parameters.base, parameters.water
    simulation, obstacle = parameters.simulation, parameters.obstacle
    rod = arm.rod()
    elements: tuple[Element, ...] = (
        Stretch.of(rod),
        (Bend if rod.axes == 2 else BendTwist).of(rod, pinned=base.mount == "pinned"),
        Inertia.of(rod),
        Weight.of(rod, density=water.density, gravity=water.gravity),
        Drag.of(
            rod,
            density=water.density,
            normal=water.drag_normal,
            tangential=water.drag_tangential,
            linear=water.linear_drag,
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
        made(f"load {index}", Element, build, rod, **numbers)
        for index, (build, numbers) in enumerate(loads)
    )
    grasp = None
    if parameters.tool is not None:
        elements += (parameters.tool.element(rod, water.density, water.gravity),)
        grasp = parameters.tool.grasp()
    actuators, through, lines = assemble_actuators(parameters.actuator, rod)
    obstacles = None
    if obstacle is not None:
        obstacles = obstacle.obstacles(rod, base.position, water.density, water.gravity)
    vehicle = None
    if parameters.vehicle is not None:
        vehicle = parameters.vehicle.vehicle(water.density, water.gravity)
    system = System(
        reference=rod.reference,
        forces=Forces(
            (*elements, *through),
            Water(parameters.flow),
            base.position,
            obstacles,
            vehicle=vehicle,
            lines=lines,
        ),
        base=base.base(rod),
        integrator=simulation.integrator,
        settings=Settings.for_rod(
            rod,
            simulation.tolerance,
            simulation.max_iterations,
            0.0 if lines is None else jnp.max(lines.stiffness * jnp.abs(lines.rest)) / rod.length,
        ),
        time_step=simulation.time_step,
        # infinite where it is not asked for, which has no slope
        max_error=jax.lax.stop_gradient(simulation.error * arm.length),
        max_halvings=simulation.max_halvings,
        actuators=actuators,
        grasp=grasp,
    )
    for index, flow in enumerate(parameters.flow):
        check_flow(flow, f"flow {index}", rod.axes)
    for index, element in enumerate(system.forces.elements):
        check_element(element, place_of(index, len(parameters.load)), system)
    # of no weak type: systems that differ in numbers alone take the same compiled programs
    return jax.tree.map(
        lambda x: jax.lax.convert_element_type(x, x.dtype) if eqx.is_inexact_array(x) else x, system
    )


assemble_once = compiled(**ONCE)(assemble)
"""`assemble` as one small program, kept between runs; not under a transformation of JAX."""
