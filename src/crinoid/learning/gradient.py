"""Gradient update of a policy and its critic through the closed loop.

The policy goes down the derivative of the cost of a segment, through every time step, plus the cost
that a critic expects after it (short-horizon actor-critic: Xu et al., ICLR 2022).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Bool, Float

from crinoid.compilation import OFTEN, ONCE, compiled
from crinoid.control import Neural
from crinoid.control.neural import Dense, Policy
from crinoid.learning.rollout import (
    EpisodeState,
    Learners,
    RolloutSegment,
    SegmentResult,
    run_segment,
)

AVERAGED = (0.02, 0.05, 0.12, 0.3, 0.8, 2.0)
"""Time constants of the running averages of an observation (s)."""
HIDDEN = (32, 32)  # units of the hidden layers of the policy
_CRITIC_HIDDEN = (64, 64)
_LARGEST_FEATURE = 10.0
"""Limit of the critic's features, over their typical size: larger ones are too rare to learn."""
UNSCALED = 1e-9  # factor on a feature whose size is unknown yet: so small that nothing saturates
TRACE = 0.95  # lambda of the critic's target (`lambda_returns`)
_TARGET_SHARE = 0.2  # share by which the target critic approaches the critic in an update
_CRITIC_STEPS = 4  # steps of the critic in an update
_RATE, _CRITIC_RATE = 3e-4, 1e-3
_FINAL_SHARE = 0.05  # learning rate at the end, over the initial one
DIVERGED_COST = 20.0
"""Mean cost from which an arm counts as diverged; the critic learns no larger cost."""
_LARGEST_GRADIENT = 1.0  # norm to which the gradient of the policy is clipped
_LARGEST_RATIO = 3.0
"""Norm of an arm's gradient that counts in full, over the median: near the edge of stability one
arm would outweigh all others."""


class Critic(eqx.Module):
    """Expected mean cost of the next time steps, from the features of a policy.

    The time step ``k`` ahead has the weight ``discount ** k``.
    """

    linear: Float[Array, " feature"]
    layers: tuple[Dense, ...]

    def __call__(self, features: Float[Array, " feature"]) -> Float[Array, ""]:
        """Return the expected cost."""
        # outside of the loop of time steps, for many rows: a matrix product is faster
        *inner, last = self.layers
        features = jnp.clip(features, -_LARGEST_FEATURE, _LARGEST_FEATURE)
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
        usual=jnp.full(features, UNSCALED),
        kept=jnp.exp(-period / jnp.array(AVERAGED)),
        linear=jnp.zeros((fastest.size, features)),
        layers=_layers((features, *HIDDEN, fastest.size), random),
        swing=jnp.ones(fastest.size),
        fastest=jnp.asarray(fastest * period),
    )


def new_critic(features: int, random: np.random.Generator) -> Critic:
    """Return a critic that expects no cost."""
    return Critic(jnp.zeros(features), _layers((features, *_CRITIC_HIDDEN, 1), random))


def _layers(sizes: tuple[int, ...], random: np.random.Generator) -> tuple[Dense, ...]:
    """Return layers with weights of mean square 1 / inputs, and a last one of zeros."""
    layers = []
    for number, (before, after) in enumerate(pairwise(sizes), start=2):
        weight = random.normal(size=(after, before)) / np.sqrt(before)
        layers.append(Dense(jnp.asarray(weight * (number < len(sizes))), jnp.zeros(after)))
    return tuple(layers)


Features = Float[Array, "arm step feature"]
Steps = Float[Array, "arm step"]


class Learner(eqx.Module):
    """A policy and its critic, with the states of their optimisers."""

    policy: Policy
    critic: Critic
    target_critic: Critic
    """Slowly following copy of the critic, so that the critic does not chase itself."""
    policy_optimiser: Any
    critic_optimiser: Any
    rate_factor: Float[Array, ""]  # factor on the learning rate of the policy


def _weights(policy: Policy) -> tuple[Any, Any]:
    """Return the weights of a policy that training changes."""
    return policy.linear, policy.layers


class Optimisers(eqx.Module):
    """Adam (Kingma and Ba 2015) for policy and critic; the policy's rate decays as a cosine."""

    updates: int = eqx.field(static=True)

    @property
    def policy(self) -> optax.GradientTransformation:
        """Optimiser of the policy."""
        rate = optax.cosine_decay_schedule(_RATE, self.updates, _FINAL_SHARE)
        return optax.chain(optax.clip_by_global_norm(_LARGEST_GRADIENT), optax.adam(rate, b2=0.95))

    @property
    def critic(self) -> optax.GradientTransformation:
        """Optimiser of the critic."""
        return optax.adam(_CRITIC_RATE)


def new_learner(policy: Policy, optimisers: Optimisers, random: np.random.Generator) -> Learner:
    """Return a learner that starts with a policy."""
    critic = new_critic(policy.usual.size, random)
    states = _initial_states(optimisers, policy, critic)
    return Learner(policy, critic, critic, *states, jnp.asarray(1.0))


@compiled(**ONCE)
def _initial_states(optimisers: Optimisers, policy: Policy, critic: Critic) -> tuple[Any, Any]:
    return optimisers.policy.init(_weights(policy)), optimisers.critic.init(critic)


def lambda_returns(cost: Steps, expected: Steps, discount: Float[Array, ""]) -> Steps:
    """Return the TD(lambda) returns: discounted mean cost from each step on.

    After Sutton and Barto 2018, chapter 12, with `TRACE` for lambda. ``expected`` is the critic's
    cost from each step on, and all that is known after the last step.
    """

    def back(after: Array, at: tuple[Array, Array]) -> tuple[Array, Array]:
        cost, expected = at
        after = (1 - discount) * cost + discount * ((1 - TRACE) * expected + TRACE * after)
        return after, after

    last = expected[:, -1]
    _, found = jax.lax.scan(back, last, (cost[:, :-1].T, expected[:, 1:].T), reverse=True)
    return jnp.concatenate([found.T, last[:, None]], axis=1)


@compiled(**OFTEN)
def _gradient(
    shared: tuple[RolloutSegment, Policy, Critic], arm: EpisodeState
) -> tuple[SegmentResult, Policy]:
    """Return the result of a segment, and the gradient of its cost by the policy."""
    segment, policy, critic = shared
    weight = (1 - segment.discount) * segment.discount ** jnp.arange(segment.steps - 1)

    def value(policy: Policy) -> tuple[Array, SegmentResult]:
        found = run_segment(segment, Neural(segment.observation, policy), *arm)
        features = found.memory.features
        later = segment.discount ** (segment.steps - 1) * critic(features[-1])
        result = eqx.tree_at(lambda x: x.memory, found, features)
        return jnp.sum(weight * found.cost[:-1]) + later, result

    (_, result), gradient = jax.value_and_grad(value, has_aux=True)(policy)
    return result, gradient


@compiled(**OFTEN)
def _update(
    optimisers: Optimisers,
    segment: RolloutSegment,
    learner: Learner,
    gradients: Policy,
    features: Features,
    cost: Steps,
    finite: Bool[Array, " arm"],
) -> Learner:
    size = jax.vmap(optax.global_norm)(gradients)
    median = jnp.nanmedian(jnp.where(finite, size, jnp.nan))
    ratio = jnp.minimum(1.0, _LARGEST_RATIO * median / jnp.maximum(size, median))
    share = jnp.where(finite, ratio, 0.0)
    share /= jnp.maximum(jnp.sum(finite), 1)

    def mean(each: Array) -> Array:
        # 0 times a value that is not finite is not finite either
        chosen = jnp.where(finite.reshape(-1, *[1] * (each.ndim - 1)), each, 0.0)
        return jnp.tensordot(share, chosen, axes=1)

    by = jax.tree.map(mean, gradients)
    moves, state = optimisers.policy.update(_weights(by), learner.policy_optimiser)
    before, rate = _weights(learner.policy), learner.rate_factor
    weights = jax.tree.map(lambda at, move: at + rate * move, before, moves)
    policy = eqx.tree_at(_weights, learner.policy, weights)
    after = replace(learner, policy=policy, policy_optimiser=state)
    # nothing is learned from an arm that failed
    features = jnp.where(finite[:, None, None], features, 0.0)
    expected = jax.vmap(jax.vmap(learner.target_critic))(features)
    returns = lambda_returns(jnp.minimum(cost, DIVERGED_COST), expected, segment.discount)
    return _critic_step(optimisers, after, features, jnp.where(finite[:, None], returns, expected))


def _critic_step(
    optimisers: Optimisers, learner: Learner, features: Features, returns: Steps
) -> Learner:
    critic, state = learner.critic, learner.critic_optimiser

    def loss(critic: Critic) -> Array:
        return jnp.mean((jax.vmap(jax.vmap(critic))(features) - returns) ** 2)

    for _ in range(_CRITIC_STEPS):
        moves, state = optimisers.critic.update(jax.grad(loss)(critic), state)
        critic = jax.tree.map(jnp.add, critic, moves)
    target = optax.incremental_update(critic, learner.target_critic, _TARGET_SHARE)
    return replace(learner, critic=critic, target_critic=target, critic_optimiser=state)


def gradient_update(
    optimisers: Optimisers,
    segment: RolloutSegment,
    learner: Learner,
    arms: Sequence[EpisodeState],
    learners: Learners,
) -> tuple[Learner, list[SegmentResult]]:
    """Run all arms for a segment, and return the improved learner with the results."""
    shared = segment, learner.policy, learner.target_critic
    found = learners.run(_gradient, shared, arms)
    results = [result for result, _ in found]
    gradients = jax.tree.map(lambda *same: jnp.stack(same), *[slope for _, slope in found])
    features = jnp.stack([each.memory for each in results])
    cost = jnp.stack([each.cost for each in results])
    finite = np.isfinite(np.asarray(cost)).all(axis=1)
    for leaf in jax.tree.leaves(gradients):
        finite &= np.isfinite(np.asarray(leaf)).reshape(len(arms), -1).all(axis=1)
    learner = _update(optimisers, segment, learner, gradients, features, cost, jnp.asarray(finite))
    return learner, results
