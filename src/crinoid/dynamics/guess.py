"""First guess of Newton's method: how a time step is expected to end."""

import jax.numpy as jnp
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
    past = jnp.stack([*state.earlier[::-1], state.motion.acceleration])[:, :HELD]
    root = jnp.concatenate([past, held.acceleration[None]])
    # the ghost node tells by how much the tip would be swung
    root = jnp.stack([(root[:, 0] - root[:, 1]) * count, root[:, 1]], axis=1)
    return jnp.sum(jnp.diff(root, axis=0) ** 2) > _JERKY * jnp.sum(root**2)
