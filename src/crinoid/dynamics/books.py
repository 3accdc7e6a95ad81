"""The running accounts of an arm: works of the energy ledger, and impulses of contacts.

What is stored is known from a state alone (`crinoid.dynamics.System.energy`).
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.dynamics.forces import Forces
from crinoid.dynamics.grip import holding
from crinoid.dynamics.obstacles import Touch
from crinoid.dynamics.state import State
from crinoid.dynamics.tangent import HELD
from crinoid.elements import WORKS


class Books(eqx.Module):
    """Works and impulses since the start, and the present forces, which only runs that ask keep."""

    working: dict[str, Float[Array, "n b"]]
    """Forces on the nodes whose work is not stored, by the names in `crinoid.elements.WORKS` (N),
    torques about the edges (N m). What holds the base is ``reaction`` of the state."""
    work: Float[Array, " work"]
    """Work done on the arm since the start, in the order of `crinoid.elements.WORKS` (J)."""
    touch: Touch | None
    """Forces, impulses and times of the obstacles on the arm."""

    @staticmethod
    def of(forces: Forces, state: State) -> "Books":
        """Open the books of an arm that starts from ``state``."""
        nodes = forces.nodes(state.motion.position).shape[0]
        working, touch = holding(forces, state.grip).working(state.motion, nodes), None
        if forces.obstacles is not None:
            touch, working["contact"] = forces.obstacles.touch(forces.beside(state.motion))
        return Books(working, jnp.zeros(len(WORKS)), touch)

    def after(self, forces: Forces, before: State, after: State, step: Array) -> "Books":
        """Return the books after a step of given length (s).

        Works are forces along the path, which is known, and not powers over the time: a servo's
        speed, or that of an arm that is hit, may change much within a step.
        """
        now = Books.of(forces, after)
        path = forces.nodes(after.motion.position - before.motion.position)
        gained = dict.fromkeys(WORKS, jnp.zeros(()))
        for name, force in now.working.items():
            gained[name] += jnp.sum((self.working[name] + force) * path)
        gained["actuation"] += jnp.sum((before.reaction + after.reaction) * path[:HELD])
        touch = None
        if now.touch is not None and self.touch is not None:
            touch = now.touch.since(self.touch, step)
        return Books(
            now.working, self.work + 0.5 * jnp.stack([gained[name] for name in WORKS]), touch
        )
