"""The numbers that training changes, and how slopes change them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float

from crinoid.control.policy import Policy
from crinoid.learning.network import Critic, new_critic
from crinoid.programs import ONCE, compiled

TRACE = 0.95
"""Lambda of what the critic learns (`returns`)."""
_FOLLOWING = 0.2
"""Share by which the critic that is believed follows the one that learns, in an update."""
_LESSONS = 4
"""Steps of the critic in an update."""
_JUDGING_RATE = 1e-3
_LEFT = 0.05
"""Share of the learning rate that is left at the end."""
AWRY = 20.0
"""Cost from which on an arm has gone astray: more of it makes no difference to the critic, and the
arm begins anew."""
_LARGEST = 1.0
"""Norm that the slope of the policy is cut to."""


class Trained(NamedTuple):
    """The numbers of a policy that are trained."""

    linear: Array
    layers: Any
    spread: Array
    """Logarithm of the standard deviation of moves that are drawn, over the usual one."""


class Learner(eqx.Module):
    """A policy, its critic, and the state of their optimisers."""

    policy: Policy
    spread: Float[Array, " driven"]
    critic: Critic
    believed: Critic
    """The critic as it is believed: it follows slowly, so that it does not chase itself."""
    by_policy: Any
    by_critic: Any
    share: Float[Array, ""]
    """Share of the learning rate that is taken."""

    @property
    def trained(self) -> Trained:
        """The numbers of the policy that are trained."""
        return Trained(self.policy.linear, self.policy.layers, self.spread)


class Pace(eqx.Module):
    """How fast is learned.

    Adam (Kingma and Ba 2015) with a learning rate that falls along a cosine.
    """

    rate: float = eqx.field(static=True)
    updates: int = eqx.field(static=True)

    @property
    def of_policy(self) -> optax.GradientTransformation:
        """The optimiser of the policy."""
        falling = optax.cosine_decay_schedule(self.rate, self.updates, _LEFT)
        return optax.chain(optax.clip_by_global_norm(_LARGEST), optax.adam(falling, b2=0.95))

    @property
    def of_critic(self) -> optax.GradientTransformation:
        """The optimiser of the critic."""
        return optax.adam(_JUDGING_RATE)


def new_learner(policy: Policy, spread: float, pace: Pace, random: np.random.Generator) -> Learner:
    """Return a learner that begins with a policy."""
    critic = new_critic(policy.usual.size, random)
    wide = jnp.full(policy.fastest.size, spread)
    started = _started(pace, Trained(policy.linear, policy.layers, wide), critic)
    return Learner(policy, wide, critic, critic, *started, jnp.asarray(1.0))


@compiled(**ONCE)
def _started(pace: Pace, trained: Trained, critic: Critic) -> tuple[Any, Any]:
    return pace.of_policy.init(trained), pace.of_critic.init(critic)


def stepped(pace: Pace, learner: Learner, slope: Trained) -> Learner:
    """Return a learner whose policy has made a step down a slope; traceable."""
    moves, after = pace.of_policy.update(slope, learner.by_policy)
    trained = jax.tree.map(lambda at, move: at + learner.share * move, learner.trained, moves)
    policy = replace(learner.policy, linear=trained.linear, layers=trained.layers)
    return replace(learner, policy=policy, spread=trained.spread, by_policy=after)


def judged(
    pace: Pace,
    learner: Learner,
    features: Float[Array, "arm step feature"],
    wanted: Float[Array, "arm step"],
) -> Learner:
    """Return a learner whose critic has learned what came after; traceable."""
    critic, state = learner.critic, learner.by_critic

    def loss(critic: Critic) -> Array:
        return jnp.mean((jax.vmap(jax.vmap(critic))(features) - wanted) ** 2)

    for _ in range(_LESSONS):
        moves, state = pace.of_critic.update(jax.grad(loss)(critic), state)
        critic = jax.tree.map(jnp.add, critic, moves)
    believed = jax.tree.map(
        lambda new, old: _FOLLOWING * new + (1 - _FOLLOWING) * old, critic, learner.believed
    )
    return replace(learner, critic=critic, believed=believed, by_critic=state)


def returns(
    cost: Float[Array, "arm step"], expected: Float[Array, "arm step"], discount: Float[Array, ""]
) -> Float[Array, "arm step"]:
    """Return the discounted mean cost from each time step on: TD(lambda).

    After Sutton and Barto 2018, chapter 12, with `TRACE` for lambda; from the last step on there is
    only what the critic expects.

    Parameters
    ----------
    cost
        Cost of each step.
    expected
        Cost from each step on that a critic expects.
    discount
        Weight of a time step over that of the one before.
    """

    def back(after: Array, at: tuple[Array, Array]) -> tuple[Array, Array]:
        cost, expected = at
        after = (1 - discount) * cost + discount * ((1 - TRACE) * expected + TRACE * after)
        return after, after

    last = expected[:, -1]
    _, found = jax.lax.scan(back, last, (cost[:, :-1].T, expected[:, 1:].T), reverse=True)
    return jnp.concatenate([found.T, last[:, None]], axis=1)
