"""Improvement by gradients through the closed loop.

The policy is improved by the derivative of what a stretch costs, through every time step of it, and
of what a critic expects from its last step on (short-horizon actor-critic: Xu et al., ICLR 2022).
"""

from __future__ import annotations

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from crinoid.control import Neural
from crinoid.control.policy import Policy
from crinoid.learning.learner import AWRY, Learner, Pace, Trained, judged, returns, stepped
from crinoid.learning.network import Critic
from crinoid.learning.stage import Arm, Crew
from crinoid.learning.stretch import Course, Stretch, run_stretch
from crinoid.programs import OFTEN, compiled

_STEEP = 3.0
"""Largest slope of an arm that counts in full, over the usual one of them: near the edge of
stability one arm would outweigh all others."""


class Slope(eqx.Module):
    """How a stretch asks for a policy to be changed."""

    stretch: Stretch
    slope: Policy
    """Derivative, by the numbers of the policy, of what the stretch and all after it cost."""


@compiled(**OFTEN)
def _slope(shared: tuple[Course, Policy, Critic], arm: Arm) -> Slope:
    course, policy, critic = shared
    weight = (1 - course.discount) * course.discount ** jnp.arange(course.steps - 1)

    def value(policy: Policy) -> tuple[Array, Stretch]:
        found = run_stretch(course, Neural(course.observation, policy), *arm)
        features = found.kept.features
        later = course.discount ** (course.steps - 1) * critic(features[-1])
        kept = eqx.tree_at(lambda x: x.kept, found, features)
        return jnp.sum(weight * found.cost[:-1]) + later, kept

    (_, stretch), slope = jax.value_and_grad(value, has_aux=True)(policy)
    return Slope(stretch, slope)


@compiled(**OFTEN)
def _improved(
    pace: Pace,
    course: Course,
    learner: Learner,
    slopes: Policy,
    features: Float[Array, "arm step feature"],
    cost: Float[Array, "arm step"],
    sound: Bool[Array, " arm"],
) -> Learner:
    size = jnp.sqrt(sum(jax.vmap(lambda x: jnp.sum(x**2))(x) for x in jax.tree.leaves(slopes)))
    usual = jnp.nanmedian(jnp.where(sound, size, jnp.nan))
    share = jnp.where(sound, jnp.minimum(1.0, _STEEP * usual / jnp.maximum(size, usual)), 0.0)
    share /= jnp.maximum(jnp.sum(sound), 1)

    def mean(each: Array) -> Array:
        # 0 times what is no number is none either
        kept = jnp.where(sound.reshape(-1, *[1] * (each.ndim - 1)), each, 0.0)
        return jnp.tensordot(share, kept, axes=1)

    by = jax.tree.map(mean, slopes)
    after = stepped(pace, learner, Trained(by.linear, by.layers, jnp.zeros_like(learner.spread)))
    # of an arm that was lost nothing is learned
    features = jnp.where(sound[:, None, None], features, 0.0)
    expected = jax.vmap(jax.vmap(learner.believed))(features)
    wanted = returns(jnp.minimum(cost, AWRY), expected, course.discount)
    wanted = jnp.where(sound[:, None], wanted, expected)
    return judged(pace, after, features, wanted)


def improve_by_gradient(
    pace: Pace, course: Course, learner: Learner, arms: Sequence[Arm], crew: Crew, number: int
) -> tuple[Learner, list[Stretch]]:
    """Run all arms for a stretch, and learn from it.

    Parameters
    ----------
    pace
        How fast is learned.
    course
        Everything that the arms have in common.
    learner
        What is trained.
    arms
        The arms where they are.
    crew
        Runs them.
    number
        Of the update.
    """
    found = crew.each(_slope, (course, learner.policy, learner.believed), arms)
    slopes = jax.tree.map(lambda *same: jnp.stack(same), *[each.slope for each in found])
    features = jnp.stack([each.stretch.kept for each in found])
    cost = jnp.stack([each.stretch.cost for each in found])
    sound = np.isfinite(np.asarray(cost)).all(axis=1)
    for leaf in jax.tree.leaves(slopes):
        sound &= np.isfinite(np.asarray(leaf)).reshape(len(arms), -1).all(axis=1)
    learner = _improved(pace, course, learner, slopes, features, cost, jnp.asarray(sound))
    return learner, [each.stretch for each in found]
