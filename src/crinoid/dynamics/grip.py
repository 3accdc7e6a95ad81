"""Whether the tip has its tool, where touches of obstacles decide it."""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.dynamics.forces import Forces
from crinoid.elements import Tool
from crinoid.onset import Onset


class Grip(eqx.Module):
    """When the tip took up its tool and let it go, as far as touches have decided."""

    taken: Float[Array, ""]
    """Infinite before (s)."""
    dropped: Float[Array, ""]
    """Before, the time at which it is let go whatever is touched; infinite if at none (s)."""

    @property
    def held(self) -> Onset:
        """The factor of time with which the tool acts on the arm."""
        known = self.taken < jnp.inf  # an onset takes differences from its start
        start = jnp.where(known, self.taken, 0.0)
        return Onset.of(start, 0.0, jnp.where(known, self.dropped, -jnp.inf), shape=(1,))


def holding(forces: Forces, grip: Grip | None) -> Forces:
    """Return the forces where the tip has its tool as a grip says; without one the same."""
    if grip is None:
        return forces
    held = grip.held
    elements = tuple(
        replace(each, held=held) if isinstance(each, Tool) else each for each in forces.elements
    )
    return replace(forces, elements=elements)


def carried(forces: Forces, grip: Grip | None, time: Float[Array, ""]) -> Float[Array, ""] | None:
    """Return 1 where the tip has its tool at a time (s), and 0 where not; None: there is none."""
    tools = [each for each in holding(forces, grip).elements if isinstance(each, Tool)]
    return tools[0].held.whole(time)[0] if tools else None
