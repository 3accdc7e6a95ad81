"""Length-controlled threads ("lines"): tendons on winches and closed chambers.

Tension or pressure follow from the shape. A line measures the path ``m`` of a thread: a tendon its
length, a chamber minus its volume, so that a load ``f`` (tension or pressure) does the work
``-f dm`` on the arm. The load depends on the whole path and couples all of its nodes. It is a
separate unknown, ``df = slope . dq``, outside of the banded matrix (`crinoid.dynamics.tangent`).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.dynamics import windows
from crinoid.dynamics.arm import Arm
from crinoid.dynamics.integrator import StepMap
from crinoid.elements import Motion, Threads
from crinoid.elements.tendon_friction import Rubbing
from crinoid.foundation.fixed_numbers import TOE
from crinoid.numerics import index_array

Loads = Float[Array, " line"]


class LengthControlledThreads(eqx.Module):
    """Threads of given length or content, with the drives that wind or fill them.

    At a drive ``s`` a line without load measures ``free = rest - shortening s``. The load of a
    tendon is ``EA (m / free - 1)`` where it is taut; it grows taut over a strain of 1e-4, the toe,
    half of which it therefore stretches beyond that. The pressure of a fluid is
    ``K (V_free / V - 1)``, which is ``p V`` constant of a gas whose absolute pressure is ``K``
    without load, and ``-K log(V / V_free)`` of a liquid to first order in ``p / K``.

    With friction a load is that at the root end: its mean along the thread stretches it.
    """

    drives: tuple[int, ...] = eqx.field(static=True)
    """Index in `crinoid.Motion.drive` for each line."""
    fluid: tuple[bool, ...] = eqx.field(static=True)
    """Whether each line is a chamber."""
    rest: Loads
    """Path on the undeformed arm: m, or minus m3."""
    shortening: Loads
    """Shortening at a drive of 1 (m), or fluid added (m3)."""
    stiffness: Loads
    """``EA`` of a tendon (N), bulk modulus ``K`` of a fluid (Pa)."""

    def loads(self, arm: Arm, motion: Motion) -> Loads:
        """Return the tensions (N) and pressures (Pa) in a motion."""
        assert motion.drive is not None
        threads, memory = _threads(arm)
        return threads.at_root(self._loads(_measured(threads, motion), motion.drive), memory)

    def slopes(
        self, arm: Arm, stage: StepMap, motion: Motion, num_nodes: int
    ) -> Float[Array, "line n b"]:
        """Return the derivative of the loads by a correction of the nodes."""
        assert motion.drive is not None
        drive, (threads, memory) = motion.drive, _threads(arm)

        def by_window(threads: Threads, window: Motion) -> Float[Array, "line k b"]:
            still = jnp.zeros((*window.flow_velocity.shape, window.flow_velocity.shape[-1]))
            direction = windows.tangent_direction(stage, (still, None))
            return windows.derivative(direction, threads.measure, window, relative=True)

        by_windows = jax.vmap(by_window)(threads, windows.motion_windows(threads, motion))
        index = windows.nodes_of(threads)
        along = jax.vmap(lambda one: index_array.scatter(one, index, num_nodes), 1)(by_windows)
        measured = _measured(threads, motion)
        ones = jnp.ones_like(measured)
        slope = jax.jvp(lambda m: self._loads(m, drive), (measured,), (ones,))[1]
        slope = threads.at_root(slope, memory)
        return slope[:, None, None] * along

    def _loads(self, measured: Loads, drive: Float[Array, " drive"]) -> Loads:
        free = self.rest - self.shortening * drive[np.asarray(self.drives)]
        strain = measured / free - 1.0
        bent = jnp.clip(strain, 0.0, TOE)
        taut = bent**2 / (2 * TOE) + jnp.maximum(strain - TOE, 0.0)
        return self.stiffness * jnp.where(np.asarray(self.fluid), free / measured - 1.0, taut)


def _threads(arm: Arm) -> tuple[Threads, Rubbing | None]:
    """Return the threads, and the memory of their friction."""
    found = ((each, held) for each, held in arm.laws if isinstance(each, Threads))
    threads, held = next(found)
    return threads, None if held is None else held[0]


def _measured(threads: Threads, motion: Motion) -> Loads:
    window = windows.motion_windows(threads, motion)
    return jnp.sum(jax.vmap(lambda e, m: e.measure(m))(threads, window), axis=0)
