"""Actuators as small commands see them."""

from typing import Any, TypeVar

import jax
import jax.numpy as jnp

__all__ = ["for_small_commands"]

_FAR = 1e6
"""By how much limits are moved away, over themselves and 1."""

Actuators = TypeVar("Actuators")


def for_small_commands(actuators: Actuators) -> Actuators:
    """Return actuators, in whatever tree, without what keeps small commands from doing anything.

    That is a dead band, and the ends of a range, at which some are at rest: what is linear about
    them would be half of it, or nothing.
    """

    def of(path: tuple[Any, ...], leaf: Any) -> Any:
        match getattr(path[-1], "name", ""):
            case "dead_band":
                return jnp.zeros_like(leaf)
            case "lower":
                return leaf - _FAR * (1 + jnp.abs(leaf))
            case "upper":
                return leaf + _FAR * (1 + jnp.abs(leaf))
            case _:
                return leaf

    return jax.tree_util.tree_map_with_path(of, actuators)
