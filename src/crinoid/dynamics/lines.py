"""Lines: tendons on winches and closed chambers, whose tension or pressure follows from the shape.

A line measures the path ``m`` of a thread: a tendon its length, a chamber minus its volume, so that
a load ``f`` (tension or pressure) does the work ``-f dm`` on the arm. The load depends on the path
of the whole thread and couples all nodes that it runs past. It stays out of the nodes' matrix as an
unknown of its own, ``df = slope . dq`` (`crinoid.dynamics.tangent`).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid import chain
from crinoid.dynamics import windows
from crinoid.dynamics.integrator import Stage
from crinoid.elements import Element, Motion, Threads

Loads = Float[Array, " line"]

_TOE = 1e-4
"""Strain over which a tendon grows taut: less would leave Newton's method nothing to go by."""


class Lines(eqx.Module):
    """Threads of given length or content, with the drives that wind them or fill them.

    At a drive ``s`` a line without load measures ``free = rest - shortening s``. The load of a
    tendon is ``EA (m / free - 1)`` where it is taut; it grows taut over a strain of 1e-4, the toe,
    half of which it therefore stretches beyond that. The pressure of a fluid is
    ``K (V_free / V - 1)``, which is ``p V`` constant of a gas whose absolute pressure is ``K``
    without load, and ``-K log(V / V_free)`` of a liquid to first order in ``p / K``.
    """

    drives: tuple[int, ...] = eqx.field(static=True)
    """Which of `crinoid.Motion.drive` winds each line."""
    fluid: tuple[bool, ...] = eqx.field(static=True)
    """Which are chambers."""
    rest: Loads
    """Measure of the arm without load: m, or minus m3."""
    shortening: Loads
    """How much less it measures at a drive of 1 (m), or more fluid it holds (m3)."""
    stiffness: Loads
    """``EA`` of a tendon (N), bulk modulus ``K`` of a fluid (Pa)."""

    def loads(self, elements: tuple[Element, ...], motion: Motion) -> Loads:
        """Return the tensions (N) and pressures (Pa) in a motion."""
        assert motion.drive is not None
        return self._loads(_measured(_threads(elements), motion), motion.drive)

    def slopes(
        self, elements: tuple[Element, ...], stage: Stage, motion: Motion, num_nodes: int
    ) -> Float[Array, "line n b"]:
        """Return how the loads follow a correction of the nodes."""
        assert motion.drive is not None
        drive, threads = motion.drive, _threads(elements)
        by_window = jax.vmap(lambda e, m: e.measured_slope(m))
        by_windows = by_window(threads, windows.gathered(threads, motion))
        along = jax.vmap(lambda one: chain.scatter(one, threads.first, num_nodes), 1)(by_windows)
        measured = _measured(threads, motion)
        ones = jnp.ones_like(measured)
        slope = jax.jvp(lambda m: self._loads(m, drive), (measured,), (ones,))[1]
        return stage.by_position * slope[:, None, None] * along

    def _loads(self, measured: Loads, drive: Float[Array, " drive"]) -> Loads:
        free = self.rest - self.shortening * drive[np.asarray(self.drives)]
        strain = measured / free - 1.0
        bent = jnp.clip(strain, 0.0, _TOE)
        taut = bent**2 / (2 * _TOE) + jnp.maximum(strain - _TOE, 0.0)
        return self.stiffness * jnp.where(np.asarray(self.fluid), free / measured - 1.0, taut)


def _threads(elements: tuple[Element, ...]) -> Threads:
    return next(element for element in elements if isinstance(element, Threads))


def _measured(threads: Threads, motion: Motion) -> Loads:
    window = windows.gathered(threads, motion)
    return jnp.sum(jax.vmap(lambda e, m: e.measured(m))(threads, window), axis=0)
