"""Gripper at the tip: its state, and the touches of obstacles that trigger it."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from crinoid.dynamics.obstacles import Obstacles
from crinoid.numerics.ramp import Onset


class GripState(eqx.Module):
    """Times at which the tip takes up its tool and lets it go, as decided by touches so far."""

    taken: Float[Array, ""]
    """Time of taking it up (s); infinite before."""
    dropped: Float[Array, ""]
    """Time of letting it go (s); before any touch the scheduled one, infinite if there is none."""

    @property
    def held(self) -> Onset:
        """Factor of time with which the tool acts on the arm."""
        known = self.taken < jnp.inf  # an onset computes differences from its start
        start = jnp.where(known, self.taken, 0.0)
        return Onset.of(start, 0.0, jnp.where(known, self.dropped, -jnp.inf), shape=(1,))


class GripTriggers(eqx.Module):
    """Obstacles at whose touch the tip takes up its tool, or lets it go.

    A step evaluates the touches of the state that it starts from. So the tool is there from the end
    of the step in which contact began, and the grip of a state is that of its balance.
    """

    take: int | None = eqx.field(static=True)
    """Obstacle at whose touch the tip takes up the tool; None: at the start of the window."""
    drop: int | None = eqx.field(static=True)
    """Obstacle at whose touch the tip lets the tool go; None: at the end of the window."""
    inside: Bool[Array, " edge"]
    """Edges whose touches count."""
    window: Onset
    """Time from which touches count, and the latest time of letting go."""

    def begin(self) -> GripState:
        """Return the grip before any touch."""
        taken = self.window.start if self.take is None else jnp.full((), jnp.inf)
        return GripState(taken, self.window.stop)

    def after(
        self,
        obstacles: Obstacles | None,
        grip: GripState | None,
        gap: Float[Array, "m e"] | None,
        time: Float[Array, ""],
    ) -> GripState:
        """Return the grip of a step from a state with this grip, these gaps (m) and time (s).

        A tool that is taken up is let go one step later at the earliest.
        """
        if obstacles is None or grip is None or gap is None:
            raise ValueError("Grip triggers require obstacles, and a state that has a grip.")
        touched = jnp.any(obstacles.touching(gap) & self.inside, axis=1)
        taken, dropped = grip.taken, grip.dropped
        if self.take is not None:
            due = jnp.isinf(taken) & (self.window.whole(time) > 0)
            taken = jnp.where(due & touched[self.take], time, taken)
        if self.drop is not None:
            dropped = jnp.where((grip.held.whole(time)[0] > 0) & touched[self.drop], time, dropped)
        return GripState(taken, dropped)
