"""Obstacles: their numbers, and the arrays that follow from these."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import TYPE_CHECKING

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.assembly.arrays import array, from_tables
from crinoid.dynamics import FreeBodies, Obstacles
from crinoid.elements import (
    Ball,
    Bed,
    Body,
    BodyContact,
    BodySurfaceContact,
    Contact,
    Pair,
    SignedDistance,
    Surface,
    SurfaceContact,
)
from crinoid.elements.bodies import capsule_inertia
from crinoid.elements.soft_skin import surfaces
from crinoid.numerics.grid_spline import GridSpline
from crinoid.rod import Rod
from crinoid.scenario import Mesh, Obstacle, Plane, Scenario, Seabed
from crinoid.scenario.obstacle import ENDLESS
from crinoid.scenario.quantity import unit_vector

if TYPE_CHECKING:
    from crinoid.recording import SolidSurface


class ObstacleParameters(eqx.Module):
    """The numbers of all ``[[obstacle]]``; of a shape that lacks one it is without effect."""

    position: Float[Array, "m d"]
    """Where each one is at t = 0, in the world (m)."""
    velocity: Float[Array, "m d"]
    """Drift of each one; 0 of one that the flow carries (m/s)."""
    radius: Float[Array, " m"]
    axis: Float[Array, "m 3"]
    """Direction of each cylinder or capsule, of any length."""
    normal: Float[Array, "m d"]
    """Direction out of each plane, of any length; 0 of others."""
    friction: Float[Array, " m"]
    rolling_friction: Float[Array, " m"]
    """Moment of rolling resistance over the force (m)."""
    spinning_friction: Float[Array, " m"]
    """Moment of spinning friction over the force (m)."""
    mass: Float[Array, " m"]
    """Infinite for one that the arm cannot push away (kg)."""
    length: Float[Array, " m"]
    """Distance of the middles of the ends of a capsule or cylinder (m); 0 of others."""
    inertia: tuple[Float[Array, " turns"] | None, ...]
    """Moments of inertia at the start, about the axes of the world (kg m2); None of one that has
    those of a homogeneous solid."""
    spin: Float[Array, "m turns"]
    """Angular velocity at the start (rad/s)."""
    surfaces: tuple[Surface | None, ...]
    """Surfaces of meshes and beds, None of others; empty without any."""
    metacentric_height: Float[Array, " m"]
    """Height of the centre of buoyancy above that of mass at the start (m)."""
    free: tuple[int, ...] = eqx.field(static=True)
    carried: tuple[int, ...] = eqx.field(static=True)
    pairs: tuple[Pair, ...] = eqx.field(static=True)
    """Free obstacles with the obstacles that they can touch."""

    @staticmethod
    def of(scenario: Scenario, read: Mapping[str, SolidSurface]) -> ObstacleParameters:
        """Return the numbers of obstacles, one or more; ``read`` has their surfaces, by table."""
        obstacles, arm = scenario.obstacle, scenario.arm
        found = [read.get(f"obstacle.{index}") for index in range(len(obstacles))]
        edge = arm.length / (arm.nodes - 1)
        still = np.zeros(len(obstacles[0].position))
        drifts = [obstacle.velocity for obstacle in obstacles]
        turns, poles = 1 if still.size == 2 else 3, {"cylinder": 2 * ENDLESS}
        free = tuple(index for index, obstacle in enumerate(obstacles) if obstacle.free)
        return ObstacleParameters(
            **from_tables(obstacles, "radius", "metacentric_height"),
            **from_tables(obstacles, "friction", "rolling_friction", "spinning_friction"),
            position=array([o.position for o in obstacles]),
            velocity=array([still if drift == "flow" else drift for drift in drifts]),
            axis=array([unit_vector(getattr(o, "axis", (0.0, 1.0, 0.0))) for o in obstacles]),
            normal=array([o.out for o in obstacles]),
            mass=array([getattr(o, "mass", None) or np.inf for o in obstacles]),
            length=array([getattr(o, "length", poles.get(o.kind, 0.0)) for o in obstacles]),
            inertia=tuple(
                None if given is None else array(np.broadcast_to(given, turns))
                for given in (getattr(o, "inertia", None) for o in obstacles)
            ),
            spin=array([np.broadcast_to(getattr(o, "spin", 0.0), turns) for o in obstacles]),
            surfaces=tuple(each and _surface(each, edge) for each in found) if any(found) else (),
            free=free,
            carried=tuple(index for index, drift in enumerate(drifts) if drift == "flow"),
            pairs=_pairs(obstacles, free),
        )

    def obstacles(
        self,
        rod: Rod,
        origin: Float[Array, " d"],
        density: Array,
        gravity: Array,
        tool: Ball | None = None,
    ) -> Obstacles:
        """Build the obstacles near a rod whose root is set at ``origin`` (m); traceable."""
        solids = [index for index, each in enumerate(self.surfaces) if each is not None]
        others = np.setdiff1d(np.arange(len(self.mass)), solids).tolist()
        members = [*([others] if others else []), *([index] for index in solids)]

        def contact(members: Sequence[int]) -> Contact:
            at = np.array(members)
            found = Contact.of(
                rod,
                radius=self.radius[at],
                half_axis=self._half_axis[at],
                normal=_unit(self.normal)[at],
                friction=self.friction[at],
                mass=self.mass[at],
                tool=tool,
            )
            surface = self._surface(members[0])
            return found if surface is None else SurfaceContact(**vars(found), surface=surface)

        return Obstacles(
            contacts=tuple(map(contact, members)),
            members=tuple(map(tuple, members)),
            half_axis=self._half_axis,
            bodies=self._bodies(rod, density, gravity) if self.free else None,
            position=self.position - origin,
            drift=self.velocity,
            carried=self.carried,
        )

    @property
    def _half_axis(self) -> Float[Array, "m d"]:
        """Half of the cores that the surfaces are around, in the plane or in space (m)."""
        seen = [0, 2] if self.position.shape[1] == 2 else [0, 1, 2]
        return 0.5 * self.length[:, None] * _unit(self.axis)[:, np.array(seen)]

    def _inertia(self, index: int) -> Float[Array, "turns turns"]:
        """Return the inertia of a free body, by default that of a homogeneous solid (kg m2)."""
        given, axis = self.inertia[index], _unit(self.axis)[index]
        if given is not None:
            return jnp.diag(given)
        size = (each[index] for each in (self.mass, self.radius, self.length))
        along, across = capsule_inertia(*size)
        moments = across * jnp.eye(3) + (along - across) * jnp.outer(axis, axis)
        return moments if self.spin.shape[1] == 3 else moments[1:2, 1:2]

    def _bodies(self, rod: Rod, density: Array, gravity: Array) -> FreeBodies:
        """Build the free bodies among the obstacles."""
        at = np.asarray(self.free, int)
        groups = [[pair for pair in self.pairs if not self._surface(pair.second)]]
        groups += [[pair] for pair in self.pairs if self._surface(pair.second)]
        groups = [group for group in groups if group]
        return FreeBodies(
            index=self.free,
            body=Body.of(
                mass=self.mass[at],
                radius=self.radius[at],
                inertia=jnp.stack([self._inertia(index) for index in self.free]),
                half_axis=self._half_axis[at],
                length=self.length[at],
                metacentric_height=self.metacentric_height[at],
                density=density,
                gravity=gravity,
            ),
            spin=self.spin,
            contacts=tuple(self._contact(group, rod, gravity) for group in groups),
            pairs=tuple(tuple((pair.first, pair.second) for pair in group) for group in groups),
        )

    def _surface(self, index: int) -> Surface | None:
        return self.surfaces[index] if self.surfaces else None

    def _contact(self, pairs: Sequence[Pair], rod: Rod, gravity: Array) -> BodyContact:
        """Build the contact of pairs, or of one pair of a body with a surface from a file."""
        contact = BodyContact.between(
            pairs,
            radius=self.radius,
            half_axis=self._half_axis,
            normal=_unit(self.normal),
            friction=self.friction,
            rolling=self.rolling_friction,
            spinning=self.spinning_friction,
            mass=self.mass,
            strength=jnp.max(surfaces(rod)[1]),
            gravity=gravity,
        )
        surface = self._surface(pairs[0].second)
        if surface is None:
            return contact
        return BodySurfaceContact(**vars(contact), surface=surface)


def _unit(vectors: Float[Array, "m b"]) -> Float[Array, "m b"]:
    """Return directions of vectors, 0 of one without."""
    squared = jnp.sum(vectors**2, axis=1, keepdims=True)
    return vectors / jnp.sqrt(jnp.where(squared > 0, squared, 1.0))


def _pairs(obstacles: Sequence[Obstacle], free: tuple[int, ...]) -> tuple[Pair, ...]:
    """Return the pairs of obstacles that can touch, of which one or both are free.

    First is a sphere where one is, and never a plane or a solid from a file, so that points of
    contact are few: two of a capsule on a plane or another long body, otherwise one.
    """
    found: list[Pair] = []
    for one, other in combinations(range(len(obstacles)), 2):
        if one not in free and other not in free:
            continue
        first, second = one, other
        long = [any(obstacles[index].half_axis) for index in (one, other)]
        if long[0] != long[1]:
            first, second = (one, other) if long[1] else (other, one)
        elif one not in free:
            first, second = other, one
        if isinstance(obstacles[first], Plane | Mesh | Seabed):
            first, second = second, first
        ends = (1.0, -1.0) if any(obstacles[first].half_axis) else (0.0,)
        found += [Pair(first, second, end) for end in ends]
    return tuple(found)


def _surface(read: SolidSurface, edge: float) -> Surface:
    """Return a surface in contact with edges of a length (m)."""
    spline = GridSpline(*map(array, vars(read.spline).values()))
    # two points in each cell that an edge crosses
    samples = int(np.clip(2 * np.ceil(edge / read.spline.spacing.min()) + 1, 5, _MOST_SAMPLES))
    if read.heights:
        return Bed(height=spline, samples=samples)
    return SignedDistance(spline=spline, samples=samples)


_MOST_SAMPLES = 33  # most points on an edge among which the search for the nearest one begins
