"""Contact of the arm with itself and with a hull: numbers, and the arrays that follow."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.assembly.arrays import array, from_table
from crinoid.base import Base
from crinoid.dynamics import FarEdges, Hull, Vehicle, far_edges, first_far_edge
from crinoid.elements import HullContact
from crinoid.foundation.axes import CHANNEL_TABLE
from crinoid.rod import Rod
from crinoid.scenario import Scenario, got, refusal


class SelfContactParameters(eqx.Module):
    """The numbers of ``[contact]``."""

    friction: Float[Array, ""]
    """Of the arm with itself and with the hull."""
    beyond: tuple[int, ...] | None = eqx.field(static=True)
    """First edge ahead of each edge that it can touch; None of an arm that reaches only a hull."""

    @staticmethod
    def of(scenario: Scenario) -> SelfContactParameters | None:
        """Return the numbers of an arm that can touch itself."""
        if not scenario.contact.self_:
            return None
        beyond = far_edges(*_edges(scenario))
        if min(beyond) == scenario.arm.nodes - 1:
            if scenario.hull is not None:
                return SelfContactParameters(array(scenario.contact.friction), None)
            hint = "The arm is too short for its radius to turn back and touch itself."
            raise refusal("contact.self", got(True, "be false", hint))
        return SelfContactParameters(array(scenario.contact.friction), beyond)

    def far_edges(self, rod: Rod) -> tuple[FarEdges, ...]:
        """Build the contact of a rod with itself, if there is any; traceable."""
        return () if self.beyond is None else (FarEdges.of(rod, self.beyond, self.friction),)


def _edges(scenario: Scenario) -> tuple[Float[np.ndarray, " e"], Float[np.ndarray, " e"]]:
    """Return lengths and radii of the edges of an arm (m)."""
    arm, diameters = scenario.arm, np.asarray(scenario.arm.diameters)
    edges = arm.nodes - 1
    return np.full(edges, arm.length / edges), (diameters[1:] + diameters[:-1]) / 4


class HullParameters(eqx.Module):
    """The numbers of ``[vehicle] hull``."""

    length: Float[Array, ""]
    diameter: Float[Array, ""]
    first_edge: int = eqx.field(static=True)
    """First edge of the arm that can touch it."""

    @staticmethod
    def of(scenario: Scenario) -> HullParameters | None:
        """Return the numbers of a hull that the arm can touch."""
        if scenario.hull is None:
            return None
        first = first_far_edge(*_edges(scenario), _retraction(scenario))
        if first == scenario.arm.nodes - 1:
            must = "be left out for an arm too short to turn back to it"
            raise refusal("vehicle.hull", got(scenario.hull, must))
        return from_table(HullParameters, scenario.hull, first_edge=first)

    def hull(
        self, rod: Rod, base: Base, vehicle: Vehicle | None, friction: Float[Array, ""]
    ) -> Hull:
        """Build the hull behind the root of a rod; traceable."""
        axis = None
        if vehicle is not None:
            axis = base.hold(jnp.zeros_like(base.servo.lower)) - vehicle.offset
        contact = HullContact.of(
            rod,
            self.first_edge,
            axis=axis,
            length=self.length,
            diameter=self.diameter,
            friction=friction,
            mass=jnp.asarray(jnp.inf) if vehicle is None else vehicle.mass,
        )
        return Hull(contact, self.first_edge)


def _retraction(scenario: Scenario) -> float:
    """Return how far the channels draw the root back into a hull that floats (m)."""
    if not scenario.floats:
        return 0.0
    base = scenario.base
    pan, tilt = np.deg2rad(base.pan_deg), np.deg2rad(base.tilt_deg)
    level = np.cos(tilt)
    ahead = {"x": level * np.cos(pan), "y": level * np.sin(pan), "z": np.sin(tilt)}
    back = 0.0
    for channel in CHANNEL_TABLE:
        found = base.channels.present.get(channel.name)
        if found is not None and not channel.turns:
            limits, forward = found.limits, ahead[channel.axis]
            back += max(0.0, -limits.low * forward, -limits.high * forward)
    return back
