"""Numbers of a scenario by name, on which gradients and batches act. SI units and radians.

Names are those of the scenario: `Parameters.arm.youngs_modulus`, `Parameters.water.density`. What
decides on the shape of a program (numbers of nodes and axes, kinds of loads and flows, which
obstacles are free) is static.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from crinoid.actuation import Input
from crinoid.assembly.actuators import ActuatorParameters
from crinoid.assembly.arrays import Builder, Numbers, array, build_flow, from_table, load_numbers
from crinoid.assembly.base import BaseParameters
from crinoid.assembly.bodies import ToolParameters, VehicleParameters
from crinoid.assembly.door import build_part
from crinoid.assembly.far_contacts import HullParameters, SelfContactParameters
from crinoid.assembly.obstacles import ObstacleParameters
from crinoid.assembly.parameter_rows import parameter_rows
from crinoid.assembly.threads import ThreadParameters
from crinoid.dynamics import Integrator
from crinoid.elements import Oscillator, Synchronisation, Vortices, WakeOscillator
from crinoid.elements.material import branches_of_loss_factor
from crinoid.elements.water import cylinder_added_mass
from crinoid.flow import Flow, Waves
from crinoid.foundation.representation import Represented, cut_list
from crinoid.rod import Rod
from crinoid.scenario import Scenario, Simulation, SineFlow, SurfaceWaves

if TYPE_CHECKING:
    from crinoid.recording import (
        Recording,
        Sea,
        Series,
        SolidSurface,
        VesselResponse,
    )  # xarray, slow to load

_INTEGRATORS: dict[str, Callable[..., Integrator]] = {
    "newmark": Integrator.newmark,
    "generalized-alpha": Integrator.generalized_alpha,
    "implicit-euler": Integrator.implicit_euler,
}


class SectionParameters(eqx.Module):
    """Section properties in place of those by radius, density and modulus; None: not replaced."""

    EA: Float[Array, ...] | None
    """All along the arm, or at root and tip; so are the others."""
    EI: Float[Array, ...] | None
    GJ: Float[Array, ...] | None
    mass_per_length: Float[Array, ""] | None
    diameter: Float[Array, ""] | None
    displaced_area: Float[Array, ""] | None


class RelaxationParameters(eqx.Module):
    """The numbers of a Maxwell branch."""

    ratio: Float[Array, ""]
    time: Float[Array, ""]


class ArmParameters(eqx.Module):
    """The numbers of ``[arm]``."""

    length: Float[Array, ""]
    radius: Float[Array, ...]
    """At the root and at the tip, or one number for both (m)."""
    density: Float[Array, ""]
    youngs_modulus: Float[Array, ""]
    poisson_ratio: Float[Array, ""]
    damping_time: Float[Array, ""]
    rest_curvature: Float[Array, ...]
    section: SectionParameters
    relaxation: tuple[RelaxationParameters, ...]
    nodes: int = eqx.field(static=True)
    dimension: int = eqx.field(static=True)

    def rod(self) -> Rod:
        """Build the sections of the arm; traceable."""
        return Rod.round(
            length=self.length,
            nodes=self.nodes,
            radius=self.radius,
            density=self.density,
            youngs_modulus=self.youngs_modulus,
            rest_curvature=self.rest_curvature,
            damping_time=self.damping_time,
            axes=self.dimension,
            poisson_ratio=self.poisson_ratio,
            relaxation=jnp.stack([jnp.stack([b.ratio, b.time]) for b in self.relaxation], axis=1)
            if self.relaxation
            else None,
            **vars(self.section),
        )


_HARMONICS = np.array([1.0, 2.0])
"""Frequencies of both oscillators over that of shedding, across and along the flow."""


class VortexParameters(eqx.Module):
    """The numbers of ``[water.vortices]``; None of those of another model."""

    lift: Float[Array, ""]
    in_line: Float[Array, ""]
    centre: Float[Array, ""] | None
    range: Float[Array, ""] | None
    strouhal: Float[Array, ""] | None
    coupling: Float[Array, ""] | None
    damping: Float[Array, ""] | None
    angles: Float[Array, "edge 2"]
    """Phases at the start across and along the flow, drawn by the seed (rad)."""

    @staticmethod
    def of(scenario: Scenario) -> VortexParameters | None:
        """Return the numbers of a scenario's vortices, if it has any."""
        table = scenario.water.vortices
        if table is None or scenario.water.density == 0:
            return None
        # a key of two numbers: those of the flows have one
        seed = np.random.SeedSequence(scenario.seed, spawn_key=(0, 0))
        edges = scenario.arm.nodes - 1
        angles = np.random.default_rng(seed).uniform(0, 2 * np.pi, (edges, 2))
        numbers = {name: array(value) for name, value in table.numbers.items()}
        return from_table(VortexParameters, table, angles=array(angles), **numbers)

    def element(self, rod: Rod, density: Array) -> Vortices:
        """Build the element of a rod in water of a density (kg/m3)."""

        def oscillator(kind: type[Oscillator], *numbers: Array | None) -> Oscillator:
            both = (jnp.broadcast_to(number, (2,)) for number in numbers if number is not None)
            return kind(jnp.asarray(_HARMONICS), *both)

        if self.centre is not None:
            found = oscillator(Synchronisation, self.centre, self.range)
        else:
            found = oscillator(WakeOscillator, self.strouhal, self.coupling, self.damping)
        return Vortices.of(
            rod,
            density=density,
            coefficients=jnp.stack([self.lift, self.in_line]),
            angles=self.angles,
            oscillator=found,
        )


class WaterParameters(eqx.Module):
    """The numbers of ``[water]`` that act on the arm."""

    density: Float[Array, ""]
    gravity: Float[Array, ""]
    drag_normal: Float[Array, ""]
    drag_tangential: Float[Array, ""]
    linear_drag: Float[Array, ""]
    added_mass_normal: Float[Array, ""]
    added_mass_tangential: Float[Array, ""]
    vortices: VortexParameters | None
    kinematic_viscosity: Float[Array, ""] | None
    """With it (m2/s) ``drag_normal`` is a factor on the drag of a smooth cylinder."""

    @staticmethod
    def of(scenario: Scenario, flows: Sequence[Flow]) -> WaterParameters:
        """Return the numbers of a scenario with its flows."""
        water = scenario.water
        given: dict[str, Any] = {"kinematic_viscosity": None}
        if water.coefficients == "literature":
            given = {
                "kinematic_viscosity": array(water.kinematic_viscosity),
                "drag_normal": array(1.0),
                "added_mass_normal": array(
                    cylinder_added_mass(keulegan_carpenter(scenario, flows))
                ),
            }
        vortices = VortexParameters.of(scenario)
        return from_table(WaterParameters, water, vortices=vortices, **given)


def keulegan_carpenter(scenario: Scenario, flows: Sequence[Flow]) -> float:
    """Return the Keulegan-Carpenter number of the water at the base.

    It is the largest of those of sines and surface waves, and 0 without them: ``U T / d`` of the
    amplitude of the velocity, the period and the mean diameter of the arm.
    """
    diameter, found = float(np.mean(scenario.arm.diameters)), [0.0]
    for flow, built in zip(scenario.flow, flows, strict=True):
        if isinstance(flow, SineFlow):
            found.append(float(np.hypot.reduce(flow.amplitude)) / flow.frequency_hz)
        elif isinstance(flow, SurfaceWaves):
            state, gravity = flow.state_of(built), scenario.water.gravity
            along = flow.current_along(scenario, built)
            waves = Waves.regular(
                flow.onset,
                height=2 * np.sqrt(2) * state.deviation,
                period=state.period,
                direction=0.0,
                phase=0.0,
                depth=scenario.water.depth,
                gravity=gravity,
                current=(along,),
            ).carried(array([along, 0.0]), array(gravity))
            place = array((0.0, scenario.base.position[-1]))
            # the level velocity under a crest
            speed = float(waves.fully_on(place, array(0.0))[0])
            found.append(speed * state.period)
    return max(found) / diameter if diameter else 0.0


class PidParameters(eqx.Module):
    """The gains of ``[control.pid]``, one an input, in the order of ``names``."""

    kp: Float[Array, " driven"]
    ki: Float[Array, " driven"]
    """Integral gain (1/s)."""
    kd: Float[Array, " driven"]
    """Derivative gain (s)."""
    filter_time: Float[Array, " driven"]
    """Lag of the derivative (s), ``1 / (2 pi derivative_filter_hz)``."""
    names: tuple[str, ...] = eqx.field(static=True)
    """Names of the inputs that are driven."""

    def gains(self, inputs: Sequence[Input]) -> dict[str, Float[Array, " input"]]:
        """Return them by field of `crinoid.control.Pid`, 0 of inputs that are not driven."""
        every = [each.name for each in inputs]
        rows = [every.index(name) for name in self.names]
        place = np.eye(len(every))[:, rows]
        numbers = {name: value for name, value in vars(self).items() if name != "names"}
        return {name: jnp.dot(place, value) for name, value in numbers.items()}

    @staticmethod
    def of(scenario: Scenario) -> PidParameters:
        """Return the gains of a controller."""
        gains = scenario.control.gains
        driven = {name: gains[name] for name in scenario.driven if name in gains}
        rows = [
            (each.kp, each.ki, each.kd, 0.5 / (np.pi * each.derivative_filter_hz))
            for each in driven.values()
        ]
        kp, ki, kd, filter_time = map(array, np.array(rows).reshape(-1, 4).T)
        return PidParameters(kp, ki, kd, filter_time, tuple(driven))


class SimulationParameters(eqx.Module):
    """The numbers of ``[simulation]`` for a time step."""

    time_step: Float[Array, ""]
    error: Float[Array, ""]
    """Largest estimated local error of a step, over the arm's length; infinite where any does."""
    tolerance: Float[Array, ""]
    max_iterations: Int[Array, ""]
    integrator: Integrator
    max_halvings: Int[Array, ""]

    @staticmethod
    def of(simulation: Simulation) -> SimulationParameters:
        """Return the numbers of a simulation."""
        return from_table(
            SimulationParameters,
            simulation,
            error=array(simulation.error or np.inf),
            max_iterations=jax.device_put(np.asarray(simulation.max_iterations)),
            integrator=_INTEGRATORS[simulation.integrator](**simulation.integrator_options),
            max_halvings=jax.device_put(np.asarray(simulation.max_halvings)),
        )


class Parameters(Represented, eqx.Module):
    """All numbers that a `crinoid.System` is assembled from, and the gains; a pytree of arrays.

    The result of `crinoid.parameters`, and the argument of `crinoid.assemble`. A changed number
    acts as its key does, except for those that docs/how-to/parameters.md lists under "What stays".
    """

    arm: ArmParameters
    base: BaseParameters
    water: WaterParameters
    flow: tuple[Flow, ...]
    """Each flow as it is computed: speeds by the names of the scenario where it has them; of one
    that is random what was drawn, of one that was measured its splines."""
    load: tuple[Numbers, ...]
    """Arguments of each load's element, by name."""
    obstacle: ObstacleParameters | None
    contact: SelfContactParameters | None
    hull: HullParameters | None
    tool: ToolParameters | None
    actuator: tuple[ActuatorParameters, ...]
    vehicle: VehicleParameters | None
    pid: PidParameters
    simulation: SimulationParameters
    load_builders: tuple[Builder, ...] = eqx.field(static=True)

    def _representation(self) -> tuple[str, dict[str, str]]:
        count = sum(np.size(leaf) for leaf in jax.tree.leaves(self))
        place = "in space" if self.arm.dimension == 3 else "in the plane"
        title = f"Parameters of an arm {place} of {self.arm.nodes} nodes: {count} numbers"
        return title, {table: cut_list(parts) for table, parts in parameter_rows(self).items()}

    @staticmethod
    def of(
        scenario: Scenario,
        recordings: Mapping[int, Recording | Sea],
        series: Mapping[str, Series | VesselResponse],
        surfaces: Mapping[str, SolidSurface],
    ) -> Parameters:
        """Return the numbers of a scenario, with what was read from its files."""
        tool, vehicle, threads = scenario.tool, scenario.vehicle, ThreadParameters.of(scenario)
        actuators: list[ActuatorParameters] = [] if threads is None else [threads]
        for i, each in enumerate(scenario.actuator):
            made = build_part(f"actuator {i}", ActuatorParameters, each.build, scenario)
            actuators.append(made)
        loads = [load_numbers(load, i, scenario) for i, load in enumerate(scenario.load)]
        section = from_table(SectionParameters, scenario.arm.section)
        branches = [(branch.ratio, branch.time) for branch in scenario.arm.relaxation]
        if (loss := scenario.arm.loss_factor) is not None:
            branches = branches_of_loss_factor(loss.value, loss.band_hz).T.tolist()
        relaxation = tuple(RelaxationParameters(*map(array, branch)) for branch in branches)
        flows = tuple(
            build_flow(scenario, index, flow, recordings.get(index))
            for index, flow in enumerate(scenario.flow)
        )
        return Parameters(
            arm=from_table(ArmParameters, scenario.arm, section=section, relaxation=relaxation),
            base=BaseParameters.of(scenario, series, flows),
            water=WaterParameters.of(scenario, flows),
            flow=flows,
            load=tuple(numbers for _, numbers in loads),
            obstacle=ObstacleParameters.of(scenario, surfaces) if scenario.obstacle else None,
            contact=SelfContactParameters.of(scenario),
            hull=HullParameters.of(scenario),
            tool=ToolParameters.of(tool, scenario.arm.nodes) if tool else None,
            actuator=tuple(actuators),
            vehicle=VehicleParameters.of(vehicle) if vehicle and vehicle.floats else None,
            pid=PidParameters.of(scenario),
            simulation=SimulationParameters.of(scenario.simulation),
            load_builders=tuple(builder for builder, _ in loads),
        )
