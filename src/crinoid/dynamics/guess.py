"""First guess of Newton's method: how a time step is expected to end."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from crinoid.base import Prescribed
from crinoid.dynamics.forces import Forces
from crinoid.dynamics.integrator import Stage
from crinoid.dynamics.start import carried
from crinoid.dynamics.state import State
from crinoid.dynamics.tangent import HELD

Rows = Float[Array, "rows b"]

_JERKY = 1.0
"""Squares of the changes of a base's acceleration over those of the acceleration itself from which
on it is jerky; of noise 1.5, of what alternates from step to step 3, of what steps resolve 0.1."""

_CAUTION = np.array([1.0, 2.0, 16.0])
"""Factors of the squared errors of three guesses, the last of which relies on smooth motion."""


def expected_acceleration(forces: Forces, state: State) -> Rows:
    """Return the acceleration that is expected at the end of the next step (m/s2).

    That it stays what it is, comes back to that of one step ago, or goes on as smoothly as it
    changed: whichever would have been best one step ago. What counts is how far its error differs
    from node to node, which is what stretches and bends the arm.

    A guess that was taken as it was tells nothing of its error: then the acceleration stays.
    """
    known = jnp.concatenate([state.motion.acceleration[None], state.earlier])
    errors = [forces.nodes(known[0] - guess) for guess in _guesses(known[1:])]
    unlike = jnp.stack([jnp.sum(jnp.diff(error, axis=0) ** 2) for error in errors])
    best = jnp.where(state.guessed, 0, jnp.argmin(_CAUTION * unlike))
    return jax.lax.select_n(best.astype(jnp.int32), *_guesses(known[:-1]))


def _guesses(known: Float[Array, "5 rows b"]) -> list[Rows]:
    """Return guesses of an acceleration from those of the five steps before, the last one first.

    The trapezoid rule does not damp stiff motion but lets its acceleration alternate in sign
    (Hairer and Wanner 1996, section IV.3); the second guess goes on with that. In the means
    ``(a + 2 a' + a'') / 4`` over three steps nothing alternates: they are the second differences of
    its positions, over the step squared. The third guess carries these on by a parabola, and what
    alternates as well. It takes the steps to be of one length.
    """
    a, b, c, d, e = known
    return [a, b, a + 2.0 * (b - c) - d + e]


def first_guess(forces: Forces, held: Prescribed, stage: Stage, state: State, usual: Rows) -> Rows:
    """Return the correction that Newton's method begins with (m), zero on what is prescribed.

    The ``usual`` one says nothing of a base that each new command jerks: the nodes next to it would
    stay behind, and be bent and stretched by far more than they will be. There the guess is that
    the arm moves along with its base, rigidly, which neither bends it nor damps.

    ``held`` is how the base moves at the stage, and ``state`` where the step starts.
    """
    nodes = forces.nodes(stage.position)
    count = nodes.shape[0]
    follows = (carried(held, nodes) - stage.velocity[:count]) / stage.by_velocity
    rigid = jnp.concatenate([usual[:HELD], follows[HELD:], usual[count:]])
    return jnp.where(_is_jerky(state, held, count), rigid, usual)


def _is_jerky(state: State, held: Prescribed, count: int) -> Bool[Array, ""]:
    """Tell whether the base's acceleration jumps about, at the end of a step and lately."""
    past = jnp.stack([*state.earlier[1::-1], state.motion.acceleration])[:, :HELD]
    root = jnp.concatenate([past, held.acceleration[None]])
    # the ghost node tells by how much the tip would be swung
    root = jnp.stack([(root[:, 0] - root[:, 1]) * count, root[:, 1]], axis=1)
    return jnp.sum(jnp.diff(root, axis=0) ** 2) > _JERKY * jnp.sum(root**2)
