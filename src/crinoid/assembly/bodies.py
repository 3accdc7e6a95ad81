"""Vehicle and tool: their numbers, and the arrays that follow from these."""

from __future__ import annotations

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from crinoid.assembly.arrays import array, from_table
from crinoid.dynamics import GripTriggers, Thrusters, Vehicle
from crinoid.elements import Ball, Tool
from crinoid.numerics.ramp import Onset
from crinoid.rod import Rod
from crinoid.scenario import Tool as ToolTable
from crinoid.scenario import Vehicle as VehicleTable

_ROUNDED = 1e-9  # share of the arm's length that is round-off


def edges_within(span: tuple[float, float], nodes: int) -> Bool[Array, " edge"]:
    """Return which edges of an arm overlap a part of it, given as shares of its length."""
    ends = np.arange(nodes) / (nodes - 1)
    return jax.device_put((ends[1:] > span[0] + _ROUNDED) & (ends[:-1] < span[1] - _ROUNDED))


class ToolParameters(eqx.Module):
    """The numbers of ``[tool]``."""

    mass: Float[Array, ""]
    volume: Float[Array, ""]
    drag_area: Float[Array, ""]
    added_mass: Float[Array, ""]
    inertia: Float[Array, ...]
    """One number, or in space three (kg m2)."""
    offset: Float[Array, ""]
    radius: Float[Array, ""] | None
    """None: it touches nothing (m)."""
    held: Onset
    """From when on and until when it is held; infinite if for good (s). Where touches decide, the
    times between which they count."""
    touched: Bool[Array, " edge"] | None
    """Which edges take it up, or let it go, at a touch; None where times decide."""
    take: int | None = eqx.field(static=True)
    """The obstacle at whose touch it is taken up."""
    drop: int | None = eqx.field(static=True)
    """The obstacle at whose touch it is let go."""

    @staticmethod
    def of(tool: ToolTable, nodes: int) -> ToolParameters:
        """Return the numbers of the tool of an arm."""
        until = np.inf if tool.until is None else tool.until
        return from_table(
            ToolParameters,
            tool,
            held=Onset(*map(array, (tool.from_, 0.0, until))),
            touched=edges_within(tool.touched, nodes) if tool.touches else None,
            take=tool.take_at_touch,
            drop=tool.drop_at_touch,
        )

    @property
    def ball(self) -> Ball | None:
        """The ball by which it touches, if it does."""
        return None if self.radius is None else Ball(self.radius, self.offset, self.mass)

    def grasp(self) -> GripTriggers | None:
        """Return the touches that decide when it is held, if any do."""
        if self.touched is None:
            return None
        return GripTriggers(self.take, self.drop, self.touched, self.held)

    def element(self, rod: Rod, density: Array, gravity: Array) -> Tool:
        """Build the tool at the tip of a rod in water of a density (kg/m3); traceable."""
        # not there before a touch: a window without length
        stop = self.held.stop if self.take is None else self.held.start
        numbers = vars(self) | {"held": replace(self.held, stop=stop)}
        for key in ("radius", "touched", "take", "drop"):
            del numbers[key]
        return Tool.of(rod, density=density, gravity=gravity, **numbers)


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
    linear_drag: Float[Array, ...] | None
    """None: no drag in proportion to the speed."""
    angular_linear_drag: Float[Array, ...] | None
    bandwidth: Float[Array, ""]
    """Natural frequency at which thrusters hold it; 0 if there are none (Hz)."""
    max_force: Float[Array, ""]
    """Infinite where there is no limit (N)."""
    max_moment: Float[Array, ""]
    """Infinite where there is no limit (N m)."""

    @staticmethod
    def of(vehicle: VehicleTable) -> VehicleParameters:
        """Return the numbers of a vehicle."""
        held = vehicle.hold == "thrusters"
        linear = {
            name: array(getattr(vehicle, name)) if np.any(getattr(vehicle, name)) else None
            for name in ("linear_drag", "angular_linear_drag")
        }
        return from_table(
            VehicleParameters,
            vehicle,
            bandwidth=array(vehicle.bandwidth_hz if held else 0.0),
            max_force=array(vehicle.max_force or np.inf),
            max_moment=array(vehicle.max_moment or np.inf),
            **linear,
        )

    def vehicle(self, density: Array, gravity: Array) -> Vehicle:
        """Build the vehicle in water of a density (kg/m3); traceable."""
        axes = self.offset.size
        along, about = (axes,), (1 if axes == 2 else 3,)
        added_mass = jnp.broadcast_to(self.added_mass, along)
        inertia = jnp.broadcast_to(self.inertia, about)
        added_inertia = jnp.broadcast_to(self.added_inertia, about)
        linear, turning = self.linear_drag, self.angular_linear_drag
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
            drag=0.5 * density * jnp.broadcast_to(self.drag_area, along),
            angular_drag=jnp.broadcast_to(self.angular_drag, about),
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
            linear_drag=None if linear is None else jnp.broadcast_to(linear, along),
            angular_linear_drag=None if turning is None else jnp.broadcast_to(turning, about),
        )
