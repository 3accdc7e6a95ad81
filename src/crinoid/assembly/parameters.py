"""The numbers of a scenario by name: what a gradient or a batch acts on. SI units and radians.

Names are those of the scenario: `Parameters.arm.youngs_modulus`, `Parameters.water.density`. What
decides on the shape of a program (numbers of nodes and axes, kinds of loads and flows, which
obstacles are free) is static.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from crinoid.actuation import Input
from crinoid.assembly.actuator import ActuatorParameters
from crinoid.assembly.base import BaseParameters
from crinoid.assembly.door import made
from crinoid.assembly.flow import build_flow
from crinoid.assembly.load import Builder, load_numbers
from crinoid.assembly.numbers import Numbers, array, from_table
from crinoid.assembly.obstacle import ObstacleParameters
from crinoid.assembly.threads import ThreadParameters
from crinoid.assembly.tool import ToolParameters
from crinoid.assembly.vehicle import VehicleParameters
from crinoid.dynamics import Integrator
from crinoid.flow import Flow
from crinoid.rod import Rod
from crinoid.scenario import Arm, Scenario, Simulation, Water

if TYPE_CHECKING:
    from crinoid.recording import Recording, Series  # xarray, slow to load

_INTEGRATORS: dict[str, Callable[..., Integrator]] = {
    "newmark": Integrator.newmark,
    "generalized-alpha": Integrator.generalized_alpha,
    "implicit-euler": Integrator.implicit_euler,
}


class SectionParameters(eqx.Module):
    """Section properties that replace what radius, density and modulus give; None: they do not."""

    EA: Float[Array, ""] | None
    EI: Float[Array, ...] | None
    GJ: Float[Array, ""] | None
    mass_per_length: Float[Array, ""] | None
    diameter: Float[Array, ""] | None
    displaced_area: Float[Array, ""] | None


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
    nodes: int = eqx.field(static=True)
    dimension: int = eqx.field(static=True)

    @staticmethod
    def of(arm: Arm) -> ArmParameters:
        """Return the numbers of an arm."""
        return from_table(
            ArmParameters,
            arm,
            section=from_table(SectionParameters, arm.section),
            nodes=arm.nodes,
            dimension=arm.dimension,
        )

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
            **vars(self.section),
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

    @staticmethod
    def of(water: Water) -> WaterParameters:
        """Return the numbers of the water."""
        return from_table(WaterParameters, water)


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
        """Return them by name, as `crinoid.control.Pid` takes them: 0 of what is not driven."""
        every = [each.name for each in inputs]
        rows = [every.index(name) for name in self.names]
        place = np.eye(len(every))[:, rows]
        numbers = {name: value for name, value in vars(self).items() if name != "names"}
        return {name: jnp.dot(place, value) for name, value in numbers.items()}

    @staticmethod
    def of(scenario: Scenario) -> PidParameters:
        """Return the gains of a controller."""
        names = scenario.driven if scenario.control.kind == "pid" else ()
        rows = [
            (gains.kp, gains.ki, gains.kd, 0.5 / (np.pi * gains.derivative_filter_hz))
            for gains in map(scenario.control.pid.present.get, names)
            if gains is not None
        ]
        kp, ki, kd, filter_time = map(array, np.array(rows).reshape(-1, 4).T)
        return PidParameters(kp, ki, kd, filter_time, names)


class SimulationParameters(eqx.Module):
    """The numbers of ``[simulation]`` that a time step takes."""

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


class Parameters(eqx.Module):
    """All numbers that a `crinoid.System` is assembled from, and the gains; a pytree of arrays.

    Made by `crinoid.parameters`, taken by `crinoid.assemble`.
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
    tool: ToolParameters | None
    actuator: tuple[ActuatorParameters, ...]
    vehicle: VehicleParameters | None
    pid: PidParameters
    simulation: SimulationParameters
    load_builders: tuple[Builder, ...] = eqx.field(static=True)

    @staticmethod
    def of(
        scenario: Scenario, recordings: Mapping[int, Recording], series: Mapping[str, Series]
    ) -> Parameters:
        """Return the numbers of a scenario, with what was read from its files."""
        loads = [load_numbers(load, i, scenario) for i, load in enumerate(scenario.load)]
        return Parameters(
            arm=ArmParameters.of(scenario.arm),
            base=BaseParameters.of(scenario, series),
            water=WaterParameters.of(scenario.water),
            flow=tuple(
                build_flow(scenario, index, flow, recordings.get(index))
                for index, flow in enumerate(scenario.flow)
            ),
            load=tuple(numbers for _, numbers in loads),
            obstacle=ObstacleParameters.of(scenario.obstacle) if scenario.obstacle else None,
            tool=None
            if scenario.tool is None
            else ToolParameters.of(scenario.tool, scenario.arm.nodes),
            actuator=_actuators(scenario),
            vehicle=None if scenario.vehicle is None else VehicleParameters.of(scenario.vehicle),
            pid=PidParameters.of(scenario),
            simulation=SimulationParameters.of(scenario.simulation),
            load_builders=tuple(builder for builder, _ in loads),
        )


def _actuators(scenario: Scenario) -> tuple[ActuatorParameters, ...]:
    threads = ThreadParameters.of(scenario)
    own = () if threads is None else (threads,)
    builders = [(f"actuator {i}", each.build) for i, each in enumerate(scenario.actuator)]
    return (*own, *(made(place, ActuatorParameters, one, scenario) for place, one in builders))
