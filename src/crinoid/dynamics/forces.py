"""Force laws on an arm and on the bodies around it, and the places of their unknowns.

Arrays have a row for each node, obstacle and vehicle (`crinoid.dynamics.rows`). A row has ``b``
entries: ``d`` coordinates and, in space, the spin of the edge that ends at the node.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from crinoid.dynamics import windows
from crinoid.dynamics.far_contact import FarContact
from crinoid.dynamics.lines import LengthControlledThreads
from crinoid.dynamics.obstacles import Obstacles
from crinoid.dynamics.rows import RowLayout, Rows
from crinoid.dynamics.vehicle import Vehicle
from crinoid.elements import Bend, Element, Inertia, Motion, Stretch
from crinoid.flow import Water
from crinoid.rod.reference import Reference

Points = Float[Array, "rows d"]


class Forces(eqx.Module):
    """Elements of an arm, the water around them, obstacles, and a floating vehicle.

    ``origin`` (m) is the origin of the arm's coordinates in the world: small coordinates have small
    round-off at any depth. `crinoid.dynamics.ActingForces` evaluates them in a context.
    """

    elements: tuple[Element, ...]
    water: Water
    origin: Float[Array, " d"]
    obstacles: Obstacles | None = None
    vehicle: Vehicle | None = None
    """The submarine, if it floats; otherwise the motion of the base is prescribed."""
    lines: LengthControlledThreads | None = None
    """Tendons of given length and chambers of given content among the elements."""
    far_contacts: tuple[FarContact, ...] = ()
    """Contact of the arm with itself and with the hull, where it counts."""

    @property
    def axes(self) -> int:
        """Number of axes of a position."""
        return self.origin.shape[0]

    @property
    def rows(self) -> RowLayout:
        """Rows of nodes, obstacles and vehicle."""
        count = 0 if self.obstacles is None else self.obstacles.count
        return RowLayout.of(count, turning=self.turns, vehicle=self.vehicle is not None)

    @property
    def turns(self) -> bool:
        """Whether some obstacles are free, so that all have a row for their rotation."""
        return self.obstacles is not None and self.obstacles.bodies is not None

    @property
    def free(self) -> tuple[int, ...]:
        """Indices of the free obstacles."""
        return () if self.obstacles is None else self.obstacles.free

    @property
    def free_rows(self) -> Int[np.ndarray, " f"]:
        """Rows of the free obstacles."""
        return self.rows.obstacle(np.array(self.free, int))

    def nodes(self, rows: Rows) -> Float[Array, "n b"]:
        """Return the rows of the nodes."""
        return rows[self.rows.nodes]

    def num_nodes(self, rows: Rows) -> int:
        """Return the number of nodes among the rows."""
        return int(self.nodes(rows).shape[0])

    def flow_velocity(self, points: Points, time: Array) -> Points:
        """Return the velocity of the water at points (m/s)."""
        return jax.vmap(lambda point: self.water.velocity(self.origin + point, time))(points)

    @property
    def bend(self) -> Bend | None:
        """Element that resists bending, and in space twisting."""
        return self._only(Bend)

    @property
    def stretch(self) -> Stretch | None:
        """Element that resists stretching."""
        return self._only(Stretch)

    def _only(self, kind: Any) -> Any:
        """Return the element of a kind, if there is one.

        A second one would be missing in strains, tension and modes.
        """
        found = [each for each in self.elements if isinstance(each, kind)]
        if len(found) > 1:
            names = " and ".join(type(each).__name__ for each in found)
            raise ValueError(f"An arm must have a single element of this kind, got {names}.")
        return found[0] if found else None

    @property
    def mass(self) -> Float[Array, ""]:
        """Mass of the arm without water (kg)."""
        own = [jnp.sum(e.mass) for e in self.elements if isinstance(e, Inertia)]
        return sum(own, start=jnp.zeros(()))

    def bending_stiffness(self, reference: Reference) -> Float[Array, " ways"]:
        """Return the mean bending stiffness (N m2); in space toward both directors."""
        bend = self._known_bend()
        stiffness = bend.stiffness * reference.strain_length[:-1]
        # a pinned root has no stiffness, unlike the arm
        held = stiffness > 0
        ways = jnp.sum(stiffness, axis=0) / jnp.maximum(jnp.sum(held, axis=0), 1)
        return ways[: reference.axes - 1]

    def strains(self, motion: Motion) -> Float[Array, "bent strain"]:
        """Return the strain beyond rest at each node except the tip: bend, in space also twist.

        Zero at a pinned root.
        """
        bend = self._known_bend()
        owned = windows.motion_windows(bend, motion)
        strains = jax.vmap(lambda e, m: e.deformation(m).strain)(bend, owned)
        return jnp.where(bend.stiffness == 0, 0.0, strains)

    def _known_bend(self) -> Bend:
        if self.bend is None:
            raise ValueError("Nothing resists bending. Add a Bend to elements.")
        return self.bend
