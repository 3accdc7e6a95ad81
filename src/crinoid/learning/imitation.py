"""Imitation of a model-based controller by a policy.

The policy steers more and more, while the controller says at each call which command it would give.
So the policy also learns from the states that it causes itself (DAgger: Ross, Gordon and Bagnell,
AISTATS 2011).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray

from crinoid.compilation import OFTEN, compiled
from crinoid.control import Controller, ControllerInput
from crinoid.control.controller import Command
from crinoid.control.neural import Neural, NeuralMemory, Policy
from crinoid.learning.gradient import UNSCALED
from crinoid.learning.rollout import EpisodeState, Learners
from crinoid.simulation import Loop, LoopState, rollout

ROUNDS = (1.0, 0.5, 0.0)  # share of the teacher in each move, in successive rounds of episodes
_NOISE = 0.02  # standard deviation of the noise on each move, over the fastest move
_CONSTANT = 1e-9  # standard deviation below which a feature counts as constant, in its unit
_RIDGE = 1e-5  # ridge penalty on weights, over the mean square of a feature


class ImitationMemory(eqx.Module):
    """Memories of teacher and pupil between two calls, with the teacher's last advice."""

    teacher: object
    pupil: NeuralMemory
    advice: Float[Array, " driven"]  # move that the teacher would make, over the fastest one
    calls: Int[Array, ""]


class GuidedPolicy(Controller):
    """A neural controller that shares its moves with a teacher."""

    teacher: Controller
    pupil: Neural
    share: Float[Array, ""]  # share of the teacher in each move
    key: PRNGKeyArray

    def start(self, seen: ControllerInput) -> ImitationMemory:
        """Return the memory at the first call."""
        pupil = self.pupil.start(seen)
        none = jnp.zeros(self.pupil.policy.fastest.size)
        return ImitationMemory(self.teacher.start(seen), pupil, none, jnp.asarray(0))

    def command(
        self, memory: ImitationMemory, seen: ControllerInput
    ) -> tuple[Command, ImitationMemory]:
        """Return the command, and the memory for the next call."""
        advised, teacher = self.teacher.command(memory.teacher, seen)
        pupil, policy = self.pupil.update_memory(memory.pupil, seen), self.pupil.policy
        rows = jnp.asarray(self.pupil.observation.driven, int)
        advice = (advised - seen.command)[rows] / policy.fastest
        key = jax.random.fold_in(self.key, memory.calls)
        noise = _NOISE * jax.random.normal(key, advice.shape)
        own = policy.speed(pupil.features)
        mixed = self.share * advice + (1 - self.share) * own + noise
        command, pupil = self.pupil.act(pupil, seen, mixed)
        return command, ImitationMemory(teacher, pupil, advice, memory.calls + 1)


@compiled(**OFTEN)
def _lesson(
    shared: tuple[GuidedPolicy, int], arm: tuple[EpisodeState, PRNGKeyArray]
) -> tuple[Float[Array, "step feature"], Float[Array, "step driven"]]:
    """Return the features and the advice at each time step of an episode."""
    (guided, steps), (episode, key) = shared, arm
    loop = replace(episode.loop, controller=replace(guided, key=key))

    def observe(_: Loop, now: LoopState) -> tuple[Array, Array]:
        return now.memory.pupil.features, now.memory.advice

    return rollout(loop, episode.now.state, steps, observe=observe).kept


def imitate(
    teacher: Controller,
    pupil: Neural,
    arms: Sequence[EpisodeState],
    steps: int,
    seed: int,
    learners: Learners,
) -> Policy:
    """Return a policy with the sizes of its features, and a linear part that imitates a teacher.

    Each round runs all arms from their start for ``steps`` time steps; ``seed`` is that of the
    noise on the moves. The features of the pupil are in the units of the observations.
    """
    policy = pupil.policy
    gathered: list[tuple[np.ndarray, np.ndarray]] = []
    keys = jax.random.split(jax.random.key(seed), (len(ROUNDS), len(arms)))
    for share, own in zip(ROUNDS, keys, strict=True):
        guided = GuidedPolicy(teacher, replace(pupil, policy=policy), jnp.asarray(share), own[0])
        found = learners.run(_lesson, (guided, steps), list(zip(arms, own, strict=True)))
        rows = [tuple(map(np.asarray, each)) for each in found]
        rows = [each for each in rows if np.isfinite(each[1]).all()]
        if not rows:
            raise FloatingPointError("no episode could be run to its end")
        features, advice = (np.concatenate(each) for each in zip(*rows, strict=True))
        if not gathered:
            policy, features = _scale(policy, features, advice)
        gathered.append((features, advice))
        x, y = (np.concatenate(each) for each in zip(*gathered, strict=True))
        normal = x.T @ x + _RIDGE * len(x) * np.eye(x.shape[1])
        # the output passes through a hyperbolic tangent
        target = np.arctanh(np.clip(y, -0.95, 0.95)) / policy.swing
        linear = np.linalg.solve(normal, x.T @ target).T
        policy = eqx.tree_at(lambda p: p.linear, policy, jnp.asarray(linear))
    return policy


def _scale(policy: Policy, features: np.ndarray, advice: np.ndarray) -> tuple[Policy, np.ndarray]:
    """Return a policy with the typical sizes of features, and the features over these sizes.

    The slowest features are taken about the mean observation.
    """
    entries, features = policy.centre.size, features / UNSCALED
    centre = features[:, -entries:].mean(axis=0)
    features[:, -entries:] -= centre
    size = features.std(axis=0)
    varies = size > _CONSTANT
    scale = np.where(varies, 1 / np.where(varies, size, 1.0), 0.0)
    swing = np.maximum(np.sqrt(np.mean(advice**2, axis=0)), _NOISE)
    values = (jnp.asarray(centre), jnp.asarray(scale), jnp.asarray(swing))
    policy = eqx.tree_at(lambda p: (p.centre, p.usual, p.swing), policy, values)
    return policy, features * scale
