"""A compiled function of pytrees that is called often: only lists of arrays go in and out."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from crinoid.programs import OFTEN

Numbers = list[jax.Array]


def numbers_of(tree: Any) -> Numbers:
    """Return the arrays of a pytree; keys of random numbers as the numbers that they are of."""
    return [
        jax.random.key_data(leaf) if jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key) else leaf
        for leaf in jax.tree.leaves(tree)
    ]


class Form:
    """The form of a pytree, from which its arrays make one like it.

    Parameters
    ----------
    tree
        A pytree of which all leaves are arrays.
    """

    def __init__(self, tree: Any) -> None:
        leaves, self._tree = jax.tree.flatten(tree)
        self._keys = [
            jax.random.key_impl(leaf) if jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key) else None
            for leaf in leaves
        ]
        self.shapes = [(leaf.shape, leaf.dtype) for leaf in leaves]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Form):
            return NotImplemented
        return (self._tree, self._keys, self.shapes) == (other._tree, other._keys, other.shapes)

    __hash__ = None  # type: ignore[assignment]

    def tree(self, numbers: Numbers) -> Any:
        """Return the pytree of some numbers; traceable."""
        leaves = [
            number if kind is None else jax.random.wrap_key_data(number, impl=kind)
            for number, kind in zip(numbers, self._keys, strict=True)
        ]
        return jax.tree.unflatten(self._tree, leaves)


def often(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function of lists of arrays that runs often."""
    return jax.jit(function, compiler_options=OFTEN)
