"""Elements of an arm, with its stiffness, mass, energies and strains."""

from collections.abc import Callable, Iterator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.dynamics import windows
from crinoid.elements import (
    ENERGIES,
    Bend,
    Element,
    Inertia,
    Motion,
    Stretch,
    VortexForces,
    Vortices,
)
from crinoid.numerics import banded
from crinoid.rod.reference import Reference

Memory = tuple[Any, ...]
"""Memory of each element; None for those without."""


class Arm(eqx.Module):
    """Elements of an arm."""

    elements: tuple[Element, ...]

    def memory_at_start(self, motion: Motion) -> Memory:
        """Return the memory of the elements at the start of a run, None for those without."""
        return self._memory(motion, "steady")

    def memory_after(self, motion: Motion) -> Memory:
        """Return the memory of the elements at the end of a step with the motion there."""
        return self._memory(motion, "advance")

    def _memory(self, motion: Motion, method: str) -> Memory:
        def one(element: Element) -> Any:
            if not element.remembers:
                return None
            owned = windows.motion_windows(element, motion)
            return jax.vmap(lambda e, m: getattr(e, method)(m))(element, owned)

        return tuple(map(one, self.elements))

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

    @eqx.filter_jit
    def energy(self, motion: Motion) -> Float[Array, " energy"]:
        """Return the stored energies, in the order of `crinoid.elements.ENERGIES` (J)."""
        energy = dict.fromkeys(ENERGIES, jnp.zeros(()))
        for element, stored in self._in_windows(motion, lambda e, window: e.energy(window)):
            energy[element.stored] += jnp.sum(stored)
        return jnp.stack(list(energy.values()))

    @eqx.filter_jit
    def nonconservative_forces(
        self, motion: Motion, num_nodes: int
    ) -> dict[str, Float[Array, "n b"]]:
        """Return the forces on the nodes whose work is not stored (N), torques on edges (N m).

        By the names in `crinoid.elements.WORKS`, without contacts and the base.
        """
        size = motion.position.shape[1]
        working: dict[str, Array] = {}
        for element, forces in self._in_windows(motion, lambda e, window: e.working(window)):
            if forces is None:
                continue
            nodal = banded.pad_columns(banded.scatter(forces, element.first, num_nodes), size)
            sum_ = working.get(element.worked)
            working[element.worked] = nodal if sum_ is None else sum_ + nodal
        return working

    @eqx.filter_jit
    def memory_energy(self, motion: Motion) -> dict[str, Float[Array, ""]]:
        """Return the stored energy that the memory of elements adds (J).

        By the names in `crinoid.elements.WORKS`: forces by memory do work under these.
        """
        found: dict[str, Array] = {}

        def added(element: Element, window: Motion) -> Array:
            return element.energy(window) - element.remembering(None, None).energy(window)

        for element in self.elements:
            if getattr(element, "memory", None) is None:
                continue
            owned = windows.motion_windows(element, motion)
            energy = jnp.sum(jax.vmap(added)(element, owned))
            found[element.worked] = found.get(element.worked, 0.0) + energy
        return found

    def branch_tension(self) -> Float[Array, " e"] | None:
        """Return the axial force of the Maxwell branches (N); None of a material without them."""
        memory = None if self.stretch is None else self.stretch.memory
        if self.stretch is None or memory is None:
            return None
        return self.stretch.EA * jnp.sum(memory.branches, axis=-1)

    def vortex_forces(self, motion: Motion) -> VortexForces | None:
        """Return forces and phases of shed vortices on the edges, if the water sheds any."""
        vortices = self._only(Vortices)
        if vortices is None:
            return None
        owned = windows.motion_windows(vortices, motion)
        return jax.vmap(lambda e, m: e.forces(m))(vortices, owned)

    def _in_windows(
        self, motion: Motion, of: Callable[[Element, Motion], Any]
    ) -> Iterator[tuple[Element, Any]]:
        """Yield each element with a quantity ``of`` it in each of its windows."""
        for _, elements in windows.groups(self.elements, motion.flow_velocity.shape[1]):
            owned = windows.motion_windows(elements[0], motion)
            found = jax.vmap(lambda some, window: [of(e, window) for e in some])(elements, owned)
            yield from zip(elements, found, strict=True)

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
