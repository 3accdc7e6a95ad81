"""A single gust."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.flow.flow import Everywhere, Point, Time
from crinoid.onset import Onset


class Gust(Everywhere):
    """The 1-cosine gust: ``u = peak (1 - cos(2 pi s)) / 2`` with ``s = (t - start) / duration``.

    Nothing blows before its start and after its duration (the discrete gust of IEC 61400-1).
    """

    onset: Onset
    peak: Float[Array, " b"]
    """Velocity at the middle of the gust (m/s)."""
    duration: Float[Array, ""]
    """Length of the gust (s)."""

    def at(self, time: Time) -> Point:
        return self.peak * (0.5 - 0.5 * jnp.cos(2 * jnp.pi * self._share(time)))

    def path(self, time: Time) -> Point:
        share = self._share(time)
        swing = jnp.sin(2 * jnp.pi * share) / (2 * jnp.pi)
        return 0.5 * self.peak * self.duration * (share - swing)

    def _share(self, time: Time) -> Float[Array, ""]:
        """Return how much of the gust is over."""
        return jnp.clip((time - self.onset.start) / self.duration, 0.0, 1.0)
