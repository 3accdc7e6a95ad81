"""The touches of obstacles at which the tip takes up its tool, or lets it go."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from crinoid.dynamics.grip import Grip
from crinoid.dynamics.obstacles import Obstacles
from crinoid.dynamics.state import State
from crinoid.onset import Onset


class Grasp(eqx.Module):
    """Which touches decide when the tip has its tool.

    A step looks at the touches of the state that it starts from. So the tool is there from the end
    of the step in which contact began, and the grip of a state is that of its own balance.
    """

    take: int | None = eqx.field(static=True)
    """The obstacle at whose touch it is taken up; None: at the start of the window."""
    drop: int | None = eqx.field(static=True)
    """The obstacle at whose touch it is let go; None: at the end of the window."""
    inside: Bool[Array, " edge"]
    """The edges whose touches count."""
    window: Onset
    """From when on touches count, and when the tool is let go at the latest."""

    def begin(self) -> Grip:
        """Return the grip before any touch."""
        taken = self.window.start if self.take is None else jnp.full((), jnp.inf)
        return Grip(taken, self.window.stop)

    def after(
        self, obstacles: Obstacles, grip: Grip, gap: Float[Array, "m e"], time: Float[Array, ""]
    ) -> Grip:
        """Return the grip of a step from a state with this grip, at these gaps (m) and time (s).

        What is taken up is let go a step later at the earliest.
        """
        touched = jnp.any(obstacles.touching(gap) & self.inside, axis=1)
        taken, dropped = grip.taken, grip.dropped
        if self.take is not None:
            due = jnp.isinf(taken) & (self.window.whole(time) > 0)
            taken = jnp.where(due & touched[self.take], time, taken)
        if self.drop is not None:
            dropped = jnp.where((grip.held.whole(time)[0] > 0) & touched[self.drop], time, dropped)
        return Grip(taken, dropped)


def begun(grasp: Grasp | None) -> Grip | None:
    """Return the grip before any touch, if touches decide on one."""
    return None if grasp is None else grasp.begin()


def gripped(grasp: Grasp | None, obstacles: Obstacles | None, state: State) -> Grip | None:
    """Return the grip of a step from a state, if touches decide on one."""
    if grasp is None:
        return None
    if obstacles is None or state.grip is None or state.gap is None:
        raise ValueError("a grasp goes with obstacles, and with a state that has a grip")
    return grasp.after(obstacles, state.grip, state.gap, state.time)
