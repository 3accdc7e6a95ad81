"""Proximal policy optimisation (Schulman et al. 2017): improvement without derivatives of the arm.

Moves are drawn around those of the policy; those that cost less than a critic expected become more
likely, by no more than a clipped ratio in an update.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from crinoid.control import Controller, Seen
from crinoid.control.neural import Neural, NeuralMemory
from crinoid.control.policy import Policy
from crinoid.control.seen import Command
from crinoid.learning.learner import AWRY, Learner, Pace, Trained, judged, returns, stepped
from crinoid.learning.stage import Arm, Crew
from crinoid.learning.stretch import Course, Stretch, run_stretch
from crinoid.programs import OFTEN, compiled

SPREAD = -1.0
"""Logarithm of the standard deviation of moves that are drawn, over the usual one, at first."""
_CLIPPED = 0.2
"""How much more or less likely a move may become in an update, over how likely it was."""
_EPOCHS, _PARTS = 4, 4
STEPS = _EPOCHS * _PARTS
"""Steps down a slope in an update."""
"""Times that a stretch is gone through, and steps that are made each time."""


class Drawing(Controller):
    """A neural controller that draws its moves; its memory is that of the neural one.

    What it draws depends on its key and the time alone.
    """

    neural: Neural
    spread: Float[Array, " driven"]
    key: PRNGKeyArray

    def start(self, seen: Seen) -> NeuralMemory:
        """Return the memory at the first call."""
        return self.neural.start(seen)

    def command(self, memory: NeuralMemory, seen: Seen) -> tuple[Command, NeuralMemory]:
        """Return the command, and the memory for the next."""
        after, policy = self.neural.remembered(memory, seen), self.neural.policy
        call = jnp.round(seen.time / self.neural.observation.period).astype(int)
        drawn = jax.random.normal(jax.random.fold_in(self.key, call), self.spread.shape)
        around = policy.swing * jnp.exp(self.spread) * drawn
        return self.neural.moved(after, seen, policy.speed(after.features) + around)


@compiled(**OFTEN)
def _tried(shared: tuple[Course, Policy, Array], arm: tuple[Arm, PRNGKeyArray]) -> Stretch:
    (course, policy, spread), (here, key) = shared, arm
    drawing = Drawing(Neural(course.observation, policy), spread, key)
    found = run_stretch(course, drawing, *here)
    return eqx.tree_at(lambda x: x.kept, found, (found.kept.features, found.kept.speed))


@compiled(**OFTEN)
def _improved(
    pace: Pace,
    discount: Float[Array, ""],
    learner: Learner,
    features: Float[Array, "arm step feature"],
    speed: Float[Array, "arm step driven"],
    cost: Float[Array, "arm step"],
    sound: Bool[Array, " arm"],
    key: PRNGKeyArray,
) -> Learner:
    # of an arm that was lost nothing is learned; what is not chosen must still be a number
    features, speed = (jnp.where(sound[:, None, None], each, 0.0) for each in (features, speed))
    expected = jax.vmap(jax.vmap(learner.believed))(features)
    wanted = jnp.where(
        sound[:, None], returns(jnp.minimum(cost, AWRY), expected, discount), expected
    )
    # from the last step on there is nothing but what was expected
    more = (wanted - expected)[:, :-1]
    count = jnp.maximum(jnp.sum(sound) * more.shape[1], 1)
    more = more / jnp.sqrt(jnp.sum(more**2) / count + 1e-12)

    def likely(trained: Trained, features: Array, speed: Array) -> Array:
        policy = replace(learner.policy, linear=trained.linear, layers=trained.layers)
        width = policy.swing * jnp.exp(trained.spread)
        off = (speed - policy.speed(features)) / width
        return -jnp.sum(0.5 * off**2 + trained.spread)

    told, made = (each[:, :-1].reshape(-1, each.shape[2]) for each in (features, speed))
    rows = more.reshape(-1)
    kept = jnp.repeat(sound, more.shape[1])
    before = jax.vmap(lambda f, s: likely(learner.trained, f, s))(told, made)

    def loss(trained: Trained, part: Array) -> Array:
        now = jax.vmap(lambda f, s: likely(trained, f, s))(told[part], made[part])
        ratio = jnp.exp(now - before[part])
        cut = jnp.clip(ratio, 1 - _CLIPPED, 1 + _CLIPPED)
        worse = jnp.maximum(ratio * rows[part], cut * rows[part])
        return jnp.sum(jnp.where(kept[part], worse, 0.0)) / jnp.maximum(jnp.sum(kept[part]), 1)

    def step(learner: Learner, part: Array) -> tuple[Learner, None]:
        return stepped(pace, learner, jax.grad(loss)(learner.trained, part)), None

    size = rows.size // _PARTS * _PARTS
    order = [
        jax.random.permutation(each, rows.size)[:size].reshape(_PARTS, -1)
        for each in jax.random.split(key, _EPOCHS)
    ]
    learner, _ = jax.lax.scan(step, learner, jnp.concatenate(order))
    return judged(pace, learner, features, wanted)


def improve_by_ppo(
    pace: Pace, course: Course, learner: Learner, arms: Sequence[Arm], crew: Crew, number: int
) -> tuple[Learner, list[Stretch]]:
    """Run all arms for a stretch with moves that are drawn, and learn from it.

    The arguments are those of `crinoid.learning.gradient.improve_by_gradient`.
    """
    own, *keys = jax.random.split(jax.random.fold_in(course.key, number), len(arms) + 1)
    shared = course, learner.policy, learner.spread
    found = crew.each(_tried, shared, list(zip(arms, keys, strict=True)))
    features, speed = (jnp.stack(each) for each in zip(*[x.kept for x in found], strict=True))
    cost = jnp.stack([each.cost for each in found])
    sound = jnp.asarray(np.isfinite(np.asarray(cost)).all(axis=1))
    learner = _improved(pace, course.discount, learner, features, speed, cost, sound, own)
    return learner, found
