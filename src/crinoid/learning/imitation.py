"""Imitation: a policy takes after a controller that knows a model of the arm.

The policy steers more and more while the controller says at each instant what it would do, so that
what is learned is also of the states that the policy itself brings about (Ross, Gordon and
Bagnell, AISTATS 2011).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray

from crinoid.control import Controller, Seen
from crinoid.control.neural import Neural, NeuralMemory
from crinoid.control.policy import Policy
from crinoid.control.seen import Command
from crinoid.learning.network import UNKNOWN
from crinoid.learning.stage import Arm, Crew
from crinoid.programs import OFTEN, compiled
from crinoid.simulation import Loop, LoopState, rollout

ROUNDS = (1.0, 0.5, 0.0)
"""Share of each move that is the teacher's, one round of episodes after the other."""
_STIRRED = 0.02
"""Standard deviation of what is added to each move, over the fastest one, to learn from."""
_NOTHING = 1e-9
"""Standard deviation of a feature, in the unit of what is observed, that is none."""
_RIDGE = 1e-5
"""Penalty on weights, over the mean square of a feature."""


class Lesson(eqx.Module):
    """Numbers that pupil and teacher carry from one call to the next."""

    taught: object
    """Memory of the teacher."""
    learned: NeuralMemory
    advice: Float[Array, " driven"]
    """Move that the teacher would make, over the fastest one."""
    calls: Int[Array, ""]


class Taught(Controller):
    """A neural controller under a teacher."""

    teacher: Controller
    pupil: Neural
    share: Float[Array, ""]
    """Share of each move that is the teacher's."""
    key: PRNGKeyArray

    def start(self, seen: Seen) -> Lesson:
        """Return the memory at the first call."""
        pupil = self.pupil.start(seen)
        none = jnp.zeros(self.pupil.policy.fastest.size)
        return Lesson(self.teacher.start(seen), pupil, none, jnp.asarray(0))

    def command(self, memory: Lesson, seen: Seen) -> tuple[Command, Lesson]:
        """Return the command, and the memory for the next."""
        wanted, taught = self.teacher.command(memory.taught, seen)
        learned, policy = self.pupil.remembered(memory.learned, seen), self.pupil.policy
        rows = jnp.asarray(self.pupil.observation.driven, int)
        advice = (wanted - seen.command)[rows] / policy.fastest
        key = jax.random.fold_in(self.key, memory.calls)
        stirred = _STIRRED * jax.random.normal(key, advice.shape)
        own = policy.speed(learned.features)
        mixed = self.share * advice + (1 - self.share) * own + stirred
        command, learned = self.pupil.moved(learned, seen, mixed)
        return command, Lesson(taught, learned, advice, memory.calls + 1)


@compiled(**OFTEN)
def _lesson(
    shared: tuple[Taught, int], pupils: tuple[Arm, PRNGKeyArray]
) -> tuple[Float[Array, "step feature"], Float[Array, "step driven"]]:
    (taught, steps), (arm, key) = shared, pupils
    loop = replace(arm.loop, controller=replace(taught, key=key))

    def look(_: Loop, now: LoopState) -> tuple[Array, Array]:
        return now.memory.learned.features, now.memory.advice

    return rollout(loop, arm.now.state, steps, observe=look).kept


def imitated(
    teacher: Controller, pupil: Neural, arms: Sequence[Arm], steps: int, seed: int, crew: Crew
) -> Policy:
    """Return a policy of which the linear part takes after a teacher, and the sizes of features.

    Parameters
    ----------
    teacher
        The controller to take after.
    pupil
        A neural controller whose features are in the units of what is observed.
    arms
        Arms at the start, on which it is taught: in each round all of them.
    steps
        Time steps of each.
    seed
        Of what is added to the moves.
    crew
        Runs the arms.
    """
    policy = pupil.policy
    gathered: list[tuple[np.ndarray, np.ndarray]] = []
    keys = jax.random.split(jax.random.key(seed), (len(ROUNDS), len(arms)))
    for share, own in zip(ROUNDS, keys, strict=True):
        taught = Taught(teacher, replace(pupil, policy=policy), jnp.asarray(share), own[0])
        found = crew.each(_lesson, (taught, steps), list(zip(arms, own, strict=True)))
        rows = [tuple(map(np.asarray, each)) for each in found]
        rows = [each for each in rows if np.isfinite(each[1]).all()]
        if not rows:
            raise FloatingPointError("no episode could be run to its end")
        features, advice = (np.concatenate(each) for each in zip(*rows, strict=True))
        if not gathered:
            policy, features = _scaled(policy, features, advice)
        gathered.append((features, advice))
        x, y = (np.concatenate(each) for each in zip(*gathered, strict=True))
        wide = x.T @ x + _RIDGE * len(x) * np.eye(x.shape[1])
        # what comes out goes through a hyperbolic tangent
        wanted = np.arctanh(np.clip(y, -0.95, 0.95)) / policy.swing
        linear = np.linalg.solve(wide, x.T @ wanted).T
        policy = eqx.tree_at(lambda p: p.linear, policy, jnp.asarray(linear))
    return policy


def _scaled(policy: Policy, features: np.ndarray, advice: np.ndarray) -> tuple[Policy, np.ndarray]:
    """Return a policy that knows the usual sizes of features, and the features over these.

    The centre of what is observed is left out of the slowest features.
    """
    entries, features = policy.centre.size, features / UNKNOWN
    centre = features[:, -entries:].mean(axis=0)
    features[:, -entries:] -= centre
    size = features.std(axis=0)
    told = size > _NOTHING
    usual = np.where(told, 1 / np.where(told, size, 1.0), 0.0)
    swing = np.maximum(np.sqrt(np.mean(advice**2, axis=0)), _STIRRED)
    known = (jnp.asarray(centre), jnp.asarray(usual), jnp.asarray(swing))
    policy = eqx.tree_at(lambda p: (p.centre, p.usual, p.swing), policy, known)
    return policy, features * usual
