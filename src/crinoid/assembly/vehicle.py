"""The numbers of a submarine that floats, and the body that they make."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.assembly.numbers import array, from_table
from crinoid.dynamics import Thrusters, Vehicle
from crinoid.scenario import Vehicle as Table


class VehicleParameters(eqx.Module):
    """The numbers of ``[vehicle]``; what has a value per axis may be one number for all."""

    mass: Float[Array, ""]
    inertia: Float[Array, ...]
    offset: Float[Array, " d"]
    volume: Float[Array, ""] | None
    """None: as much as carries it (m3)."""
    metacentric_height: Float[Array, ""]
    added_mass: Float[Array, ...]
    added_inertia: Float[Array, ...]
    drag_area: Float[Array, ...]
    angular_drag: Float[Array, ...]
    bandwidth: Float[Array, ""]
    """Natural frequency at which thrusters hold it; 0 if there are none (Hz)."""
    max_force: Float[Array, ""]
    """Infinite where there is no limit (N)."""
    max_moment: Float[Array, ""]
    """Infinite where there is no limit (N m)."""

    @staticmethod
    def of(vehicle: Table) -> VehicleParameters:
        """Return the numbers of a vehicle."""
        held = vehicle.hold == "thrusters"
        return from_table(
            VehicleParameters,
            vehicle,
            bandwidth=array(vehicle.bandwidth_hz if held else 0.0),
            max_force=array(vehicle.max_force or np.inf),
            max_moment=array(vehicle.max_moment or np.inf),
        )

    def vehicle(self, density: Array, gravity: Array) -> Vehicle:
        """Build the vehicle in water of a density (kg/m3); traceable."""
        axes = self.offset.size
        turns = 1 if axes == 2 else 3
        added_mass, drag_area = (
            jnp.broadcast_to(values, (axes,)) for values in (self.added_mass, self.drag_area)
        )
        inertia, added_inertia, angular_drag = (
            jnp.broadcast_to(values, (turns,))
            for values in (self.inertia, self.added_inertia, self.angular_drag)
        )
        moved, turned = self.mass + added_mass, inertia + added_inertia
        rate = 2 * jnp.pi * self.bandwidth
        if self.volume is None:
            displaced = jnp.where(density > 0, self.mass, 0.0)
        else:
            displaced = density * self.volume
        return Vehicle(
            mass=self.mass,
            inertia=inertia,
            displaced=displaced,
            added_mass=added_mass,
            added_inertia=added_inertia,
            drag=0.5 * density * drag_area,
            angular_drag=angular_drag,
            metacentric_height=self.metacentric_height,
            gravity=gravity,
            offset=self.offset,
            thrusters=Thrusters(
                stiffness=rate**2 * moved,
                damping=2 * rate * moved,
                turn_stiffness=rate**2 * turned,
                turn_damping=2 * rate * turned,
                max_force=self.max_force,
                max_moment=self.max_moment,
            ),
        )
