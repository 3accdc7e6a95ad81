"""Laws on an arm with their memory: energies, works, and the memory after a step."""

from collections.abc import Callable, Iterator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.dynamics import windows
from crinoid.dynamics.context import Context, Memory
from crinoid.elements import ENERGIES, Element, Motion, Stretch, Tool, VortexForces, Vortices
from crinoid.numerics import banded, index_array
from crinoid.numerics.frames import moments, unit

_BENT = 3  # nodes of a window that bends


class Arm(eqx.Module):
    """Elements of an arm, each with its memory of a step."""

    laws: windows.ArmLaws

    def memory_at_start(self, motion: Motion) -> Memory:
        """Return the memory of the elements at the start of a run, None for those without."""
        return self._memory(motion, "steady")

    def memory_after(self, motion: Motion) -> Memory:
        """Return the memory of the elements at the end of a step with the motion there."""
        return self._memory(motion, "advance")

    def _memory(self, motion: Motion, method: str) -> Memory:
        def one(element: Element, held: windows.Held) -> Any:
            if not element.remembers:
                return None
            owned = windows.motion_windows(element, motion, held)
            return jax.vmap(lambda e, m: getattr(e, method)(m))(element, owned)

        return tuple(one(*law) for law in self.laws)

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
            nodal = index_array.scatter(forces, windows.nodes_of(element), num_nodes)
            nodal = banded.pad_columns(nodal, size)
            working[element.worked] = working.get(element.worked, 0.0) + nodal
        return working

    @eqx.filter_jit
    def memory_energy(self, motion: Motion) -> dict[str, Float[Array, ""]]:
        """Return the stored energy that the memory of elements adds (J).

        By the names in `crinoid.elements.WORKS`: forces by memory do work under these.
        """
        found: dict[str, Array] = {}

        def added(element: Element, window: Motion) -> Array:
            return element.energy(window) - element.energy(window.remembering(None, None))

        for element, held in self.laws:
            if held is None or not element.remembers:
                continue
            owned = windows.motion_windows(element, motion, held)
            energy = jnp.sum(jax.vmap(added)(element, owned))
            found[element.worked] = found.get(element.worked, 0.0) + energy
        return found

    @eqx.filter_jit
    def moments(self, motion: Motion, num_nodes: int) -> Float[Array, "n turns"]:
        """Return the moment of the arm beyond each node on the arm before it (N m).

        It is that of the internal forces on three nodes, of material and threads: about the node
        in the middle, of the forces on the first node and of the torque on the first edge.
        """

        def handed_on(element: Element, window: Motion) -> Array | None:
            if not element.relative or element.stencil != _BENT:
                return None
            forces, axes = element.residual(window), window.flow_velocity.shape[-1]
            edge = window.position[1, :axes] - window.position[0, :axes]
            moment = moments(edge, forces[0, :axes])
            return moment - forces[1, 3] * unit(edge)[0] if forces.shape[1] > 3 else moment

        total = jnp.zeros((num_nodes, 1 if motion.flow_velocity.shape[-1] == 2 else 3))
        for element, found in self._in_windows(motion, handed_on):
            if found is not None:
                middle = windows.nodes_of(element)[:, 1:2]
                total += index_array.scatter(found[:, None], middle, num_nodes)
        return total

    def branch_tension(self) -> Float[Array, " e"] | None:
        """Return the axial force of the Maxwell branches (N); None of a material without them."""
        found = [(e, held) for e, held in self.laws if isinstance(e, Stretch) and held is not None]
        return next((e.EA * jnp.sum(held[0].branches, axis=-1) for e, held in found), None)

    def vortex_forces(self, motion: Motion) -> VortexForces | None:
        """Return forces and phases of shed vortices on the edges, if the water sheds any."""
        for element, held in self.laws:
            if isinstance(element, Vortices):
                owned = windows.motion_windows(element, motion, held)
                return jax.vmap(lambda e, m: e.forces(m))(element, owned)
        return None

    def tool_factor(self, time: Float[Array, ""]) -> Float[Array, ""] | None:
        """Return 1 while the tip has its tool at a time (s), else 0; None without a tool."""
        for element, held in self.laws:
            if isinstance(element, Tool):
                return (element.held if held is None else held[0]).whole(time)[0]
        return None

    def _in_windows(
        self, motion: Motion, of: Callable[[Element, Motion], Any]
    ) -> Iterator[tuple[Element, Any]]:
        """Yield each element with a quantity ``of`` it in each of its windows."""

        def each(laws: windows.ArmLaws, window: Motion) -> list[Any]:
            return [of(e, windows.remembering(window, held)) for e, held in laws]

        for group in windows.groups(self.laws, motion.flow_velocity.shape[1]):
            found = group.each(each, group.windows(motion))
            yield from zip([e for e, _ in group.laws], found, strict=True)


def prepared(elements: tuple[Element, ...], context: Context) -> tuple[windows.Held, ...]:
    """Return the memory of elements, prepared for the step of a context."""

    def held(element: Element, memory: Any) -> windows.Held:
        if isinstance(element, Tool) and context.grip is not None:
            return context.grip.held, None
        if memory is None:
            return None
        assert context.step is not None
        step = jnp.broadcast_to(context.step, (windows.count(element),))
        return element.prepared(memory, step), step

    memory = context.memory or (None,) * len(elements)
    return tuple(held(*each) for each in zip(elements, memory, strict=True))
