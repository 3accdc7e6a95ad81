"""A neural network that turns what is observed into moves of commands."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.products import product


class Dense(eqx.Module):
    """A layer: ``weight x + bias``."""

    weight: Float[Array, "out in"]
    bias: Float[Array, " out"]

    def __call__(self, x: Float[Array, " in"]) -> Float[Array, " out"]:
        return product(self.weight, x) + self.bias


class Policy(eqx.Module):
    """Commands by what was observed, now and before.

    The past is told by running averages of each observation over several times (a gamma memory of
    order one: de Vries and Principe, Neural Networks 5 (1992) 565-576); a feature is the difference
    of two of them that follow each other. What comes out is a linear function of the features
    and a network of them, added up, and says how fast each command moves.
    """

    centre: Float[Array, " entry"]
    """Usual value of each number that is observed, in its unit."""
    usual: Float[Array, " feature"]
    """One over the usual size of each feature."""
    kept: Float[Array, " average"]
    """Share of an average that is left after a control period, the shortest first."""
    linear: Float[Array, "driven feature"]
    layers: tuple[Dense, ...]
    """All but the last are followed by a hyperbolic tangent."""
    swing: Float[Array, " driven"]
    """Usual speed of each command, over the fastest one."""
    fastest: Float[Array, " driven"]
    """Largest move of each command in a period, in its unit."""

    def start(self, observed: Float[Array, " entry"]) -> Float[Array, "average entry"]:
        """Return the averages of what has been observed for ever."""
        return jnp.broadcast_to(observed, (self.kept.size, observed.size))

    def remembered(
        self, averages: Float[Array, "average entry"], observed: Float[Array, " entry"]
    ) -> Float[Array, "average entry"]:
        """Return the averages a control period later."""
        return observed + self.kept[:, None] * (averages - observed)

    def features(
        self, averages: Float[Array, "average entry"], observed: Float[Array, " entry"]
    ) -> Float[Array, " feature"]:
        """Return what the network is told."""
        ladder = jnp.concatenate([observed[None], averages, self.centre[None]])
        return jnp.ravel(ladder[:-1] - ladder[1:]) * self.usual

    def speed(self, features: Float[Array, " feature"]) -> Float[Array, " driven"]:
        """Return how fast commands are to move, over the fastest; beyond 1 as well."""
        hidden = features
        for layer in self.layers[:-1]:
            hidden = jnp.tanh(layer(hidden))
        return self.swing * (product(self.linear, features) + self.layers[-1](hidden))
