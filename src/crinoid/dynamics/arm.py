"""The elements of an arm, and what they say it is made of."""

from collections.abc import Callable, Iterator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid import chain
from crinoid.dynamics import windows
from crinoid.elements import (
    ENERGIES,
    Bend,
    BendTwist,
    Element,
    Inertia,
    Motion,
    Stretch,
)
from crinoid.reference import Reference


class Arm(eqx.Module):
    """The elements of an arm."""

    elements: tuple[Element, ...]

    @property
    def bend(self) -> Bend | BendTwist | None:
        """Element that resists bending, and in space twisting."""
        return next((e for e in self.elements if isinstance(e, Bend | BendTwist)), None)

    @property
    def stretch(self) -> Stretch | None:
        """Element that resists stretching."""
        return next((e for e in self.elements if isinstance(e, Stretch)), None)

    @property
    def mass(self) -> Float[Array, ""]:
        """Mass of the arm without water (kg)."""
        own = [jnp.sum(e.mass) for e in self.elements if isinstance(e, Inertia)]
        return sum(own, start=jnp.zeros(()))

    def bending_stiffness(self, reference: Reference) -> Float[Array, " ways"]:
        """Return the mean bending stiffness (N m2); in space toward both directors."""
        bend = self._known_bend()
        stiffness = bend.stiffness.reshape(reference.nodes - 1, -1) * reference.strain_length[:-1]
        # a pinned root resists nothing, and is not what the arm is made of
        held = stiffness > 0
        ways = jnp.sum(stiffness, axis=0) / jnp.maximum(jnp.sum(held, axis=0), 1)
        return ways[: reference.axes - 1]

    @eqx.filter_jit
    def energy(self, motion: Motion) -> Float[Array, " energy"]:
        """Return the stored energies, in the order of `crinoid.elements.ENERGIES` (J)."""
        energy = dict.fromkeys(ENERGIES, jnp.zeros(()))
        for element, stored in self._in_windows(motion, lambda e, window: e.energy(window)):
            energy[element.stored] += jnp.sum(stored)
        return jnp.stack(list(energy.values()))

    @eqx.filter_jit
    def working(self, motion: Motion, num_nodes: int) -> dict[str, Float[Array, "n b"]]:
        """Return the forces on the nodes whose work is not stored (N), torques on edges (N m).

        By the names in `crinoid.elements.WORKS`, of those that there are; contacts and the base
        aside.
        """
        size = motion.position.shape[1]
        working: dict[str, Array] = {}
        for element, forces in self._in_windows(motion, lambda e, window: e.working(window)):
            if forces is None:
                continue
            nodal = chain.widened(chain.scatter(forces, element.first, num_nodes), size)
            held = working.get(element.worked)
            working[element.worked] = nodal if held is None else held + nodal
        return working

    def _in_windows(
        self, motion: Motion, seen: Callable[[Element, Motion], Any]
    ) -> Iterator[tuple[Element, Any]]:
        """Yield each element, with what is ``seen`` of it in each of its windows."""
        for _, elements in windows.groups(self.elements, motion.flow_velocity.shape[1]):
            owned = windows.gathered(elements[0], motion)
            found = jax.vmap(lambda some, window: [seen(e, window) for e in some])(elements, owned)
            yield from zip(elements, found, strict=True)

    def strains(self, motion: Motion) -> Float[Array, "bent strain"]:
        """Return by how much each node but the tip is bent beyond its rest, in space also twisted.

        Zero at a root that turns freely.
        """
        bend = self._known_bend()
        owned = windows.gathered(bend, motion)
        strains = jax.vmap(lambda e, m: e.strains(m))(bend, owned)
        rest, free = (
            values.reshape(strains.shape) for values in (bend.rest_strain, bend.stiffness == 0)
        )
        return jnp.where(free, 0.0, strains - rest)

    def _known_bend(self) -> Bend | BendTwist:
        if self.bend is None:
            raise ValueError("nothing resists bending: elements takes a Bend, in space a BendTwist")
        return self.bend
