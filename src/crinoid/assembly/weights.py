"""The file of a policy: a line of JSON that describes it, then its numbers.

The numbers are the arrays as `equinox.tree_serialise_leaves` writes them: nothing in the file is
ever executed.
"""

from itertools import pairwise
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp

from crinoid.assembly.description import Description, described, opened, refuse
from crinoid.control.policy import Dense, Policy
from crinoid.replacement import replacing
from crinoid.scenario import ScenarioError


def write_policy(path: Path, policy: Policy, description: Description) -> None:
    """Write a policy to a file, whole or not at all."""
    with replacing(path) as temporary, temporary.open("wb") as file:
        file.write(description.line)
        eqx.tree_serialise_leaves(file, policy)


def read_policy(path: Path) -> tuple[Policy, Description]:
    """Read a policy."""
    try:
        with opened(path) as file:
            told = described(path, file)
            policy = eqx.tree_deserialise_leaves(file, _blank(told))
            rest = file.read(1)
    except ScenarioError:
        raise
    except Exception:  # Equinox and NumPy tell of damage in many ways
        refuse(path, "is damaged: its numbers are not those that its first line tells of")
    if rest or not all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(policy)):
        refuse(path, "is damaged: it holds more than its numbers, or some that are none")
    return policy, told


def _blank(told: Description) -> Policy:
    """Return a policy of the sizes that a description tells of."""
    entries, driven = len(told.observations), len(told.actions)
    features = entries * (told.averages + 1)
    sizes = [features, *told.layers]
    return Policy(
        centre=jnp.zeros(entries),
        usual=jnp.zeros(features),
        kept=jnp.zeros(told.averages),
        linear=jnp.zeros((driven, features)),
        layers=tuple(
            Dense(jnp.zeros((after, before)), jnp.zeros(after)) for before, after in pairwise(sizes)
        ),
        swing=jnp.zeros(driven),
        fastest=jnp.zeros(driven),
    )
