"""The networks that are trained: a policy, and a critic that tells what is to come."""

from __future__ import annotations

from itertools import pairwise

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.control.policy import Dense, Policy

AVERAGED = (0.02, 0.05, 0.12, 0.3, 0.8, 2.0)
"""Times over which what is observed is averaged (s)."""
HIDDEN = (32, 32)
"""Units of the hidden layers of the policy."""
_JUDGING = (64, 64)
_MOST = 10.0
"""Largest feature that the critic looks at, over the usual one: it learns nothing of rarer ones."""
UNKNOWN = 1e-9
"""Stands for one over the size of a feature as long as none is known: nothing is cut off."""


class Critic(eqx.Module):
    """Tells by the features of a policy what the next time steps will cost on average.

    The nearer ones count more: the time step ``k`` ahead for ``discount ** k``.
    """

    linear: Float[Array, " feature"]
    layers: tuple[Dense, ...]

    def __call__(self, features: Float[Array, " feature"]) -> Float[Array, ""]:
        """Return that mean."""
        # not in the loop of time steps, and for many at once: a product of matrices is faster
        *inner, last = self.layers
        features = jnp.clip(features, -_MOST, _MOST)
        hidden = features
        for layer in inner:
            hidden = jnp.tanh(layer.weight @ hidden + layer.bias)
        return self.linear @ features + (last.weight @ hidden + last.bias)[0]


def new_policy(
    entries: int, fastest: Float[np.ndarray, " driven"], period: float, random: np.random.Generator
) -> Policy:
    """Return a policy that commands nothing."""
    features = entries * (len(AVERAGED) + 1)
    return Policy(
        centre=jnp.zeros(entries),
        usual=jnp.full(features, UNKNOWN),
        kept=jnp.exp(-period / jnp.array(AVERAGED)),
        linear=jnp.zeros((fastest.size, features)),
        layers=_layers((features, *HIDDEN, fastest.size), random),
        swing=jnp.ones(fastest.size),
        fastest=jnp.asarray(fastest * period),
    )


def new_critic(features: int, random: np.random.Generator) -> Critic:
    """Return a critic that expects nothing."""
    return Critic(jnp.zeros(features), _layers((features, *_JUDGING, 1), random))


def _layers(sizes: tuple[int, ...], random: np.random.Generator) -> tuple[Dense, ...]:
    """Return layers with weights of mean square 1 / inputs, but for the last one, which is zero."""
    layers = []
    for number, (before, after) in enumerate(pairwise(sizes), start=2):
        weight = random.normal(size=(after, before)) / np.sqrt(before)
        layers.append(Dense(jnp.asarray(weight * (number < len(sizes))), jnp.zeros(after)))
    return tuple(layers)
