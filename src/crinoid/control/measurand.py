"""Measurands: what sensors measure of the arm, its base and the water."""

from abc import abstractmethod

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from crinoid.dynamics import State, System
from crinoid.space import AXES, POSE

Values = Float[Array, " m"]


class Measurand(eqx.Module):
    """A quantity that follows from the state of an arm: one or more numbers."""

    @abstractmethod
    def of(self, system: System, state: State) -> Values:
        """Return the true values, in the units that `names` gives."""

    @abstractmethod
    def names(self, axes: int) -> tuple[tuple[str, str], ...]:
        """Return the name and the unit of each value, for an arm in 2 or 3 dimensions."""


class TipPose(Measurand):
    """The tip's pose: its position (m) and its direction (`crinoid.space.POSE`)."""

    def of(self, system: System, state: State) -> Values:
        return system.tip(state)

    def names(self, axes: int) -> tuple[tuple[str, str], ...]:
        units = {"angle": "rad"} | dict.fromkeys(AXES[axes], "m")
        return tuple((name, units.get(name, "1")) for name in POSE[axes])


class Shape(Measurand):
    """Curvature at stations along the arm, in space with twist: what fibre-optic sensors give."""

    stations: Float[Array, " s"]
    """Distance from the root over the arm's length, 0 to 1."""

    def of(self, system: System, state: State) -> Values:
        strains, found = system.strains(state), self.stations * (state.position.shape[0] - 2)
        before = jnp.clip(jnp.floor(found).astype(int), 0, strains.shape[0] - 2)
        share = (found - before)[:, None]
        return ((1 - share) * strains[before] + share * strains[before + 1]).reshape(-1)

    def names(self, axes: int) -> tuple[tuple[str, str], ...]:
        parts: tuple[tuple[str, str], ...] = (("curvature", "m-1"),)
        if axes == 3:
            parts = (("kappa_1", "m-1"), ("kappa_2", "m-1"), ("twist", "rad m-1"))
        return tuple(
            (f"{name}_{index}", unit)
            for index in range(self.stations.shape[0])
            for name, unit in parts
        )


class BaseWrench(Measurand):
    """Force (N) and moment about the root (N m) of the arm on the submarine."""

    def of(self, system: System, state: State) -> Values:
        return jnp.concatenate([state.base_force, jnp.atleast_1d(state.base_moment)])

    def names(self, axes: int) -> tuple[tuple[str, str], ...]:
        turns = ("y",) if axes == 2 else AXES[3]
        forces = tuple((f"force_{name}", "N") for name in AXES[axes])
        return (*forces, *((f"moment_{name}", "N m") for name in turns))


class ContactForce(Measurand):
    """Resultant force of all obstacles on the arm, or on a part of it, along the world's axes."""

    inside: Bool[Array, " edge"]
    """Which edges feel it."""

    def of(self, system: System, state: State) -> Values:
        obstacles = system.forces.obstacles
        if obstacles is None:
            raise ValueError("there are no obstacles whose force it could measure")
        return obstacles.felt(system.forces.beside(state.motion), self.inside)

    def names(self, axes: int) -> tuple[tuple[str, str], ...]:
        return tuple((f"force_{name}", "N") for name in AXES[axes])


class WaterVelocity(Measurand):
    """Velocity of the water at points that the submarine carries along: a meter, or an ADCP."""

    points: Float[Array, "p d"]
    """Positions of the points from the base's set position (m)."""

    def of(self, system: System, state: State) -> Values:
        pose, _, _ = system.base.pose(state.time, system.base.servo.at_rest())
        axes = self.points.shape[1]
        turn, points, centre = system.base.rotation(pose), self.points, pose[:axes]
        vehicle = system.forces.vehicle
        if vehicle is not None and state.attitude is not None:
            turn, points = state.attitude, points - vehicle.offset
            centre = state.vehicle_position
        turned = jnp.sum(turn * points[:, None, :], axis=-1)
        return system.forces.flow_velocity(centre + turned, state.time).reshape(-1)

    def names(self, axes: int) -> tuple[tuple[str, str], ...]:
        return tuple(
            (f"velocity_{name}_{index}", "m s-1")
            for index in range(self.points.shape[0])
            for name in AXES[axes]
        )


class Inclination(Measurand):
    """Angle of the arm's tangent above the horizontal at stations (rad): inclinometers."""

    stations: Float[Array, " s"]
    """Distance from the root over the arm's length, 0 to 1."""

    def of(self, system: System, state: State) -> Values:
        edges = jnp.diff(state.position[1:], axis=0)
        level = jnp.sqrt(jnp.sum(edges[:, :-1] ** 2, axis=1))
        # in the plane the arm may point backward, past the vertical
        level = edges[:, 0] if edges.shape[1] == 2 else level
        angles = jnp.unwrap(jnp.arctan2(edges[:, -1], level))
        # an edge has its angle at its middle
        middle = (jnp.arange(edges.shape[0]) + 0.5) / edges.shape[0]
        return jnp.interp(self.stations, middle, angles)

    def names(self, axes: int) -> tuple[tuple[str, str], ...]:
        return tuple((f"inclination_{index}", "rad") for index in range(self.stations.shape[0]))
