"""Products of small arrays, and systems of a few equations."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


def product(a: Float[Array, "..."], b: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return ``a @ b`` of vectors, matrices, or two stacks of matrices.

    As a sum of products, which XLA fuses with its surroundings. ``@`` becomes a call of a routine
    for large matrices, and a loop with such a call is never compiled as a whole.
    """
    if b.ndim == 1:
        return jnp.sum(a * b, axis=-1)
    if a.ndim == 1:
        return jnp.sum(a[:, None] * b, axis=0)
    return jnp.sum(a[..., :, :, None] * b[..., None, :, :], axis=-2)


@jax.custom_jvp
def long_product(a: Float[Array, "..."], b: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return the `product` of a vector and a matrix whose rows are hundreds, or the other way.

    That is ``(m,) (m, k)`` or ``(m, k) (k,)``. The derivative by the vector is written column by
    column: transposed, it is a sum of columns times numbers, or one sum per column, which XLA fuses
    with its surroundings. The derivative by the matrix stays `@`: where many points share the
    matrix, reverse mode sums over them, for which `@` is faster.
    """
    return product(a, b)


def _by_columns(a: Float[Array, "..."], b: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return the same product, one column after the other."""
    if a.ndim == 1:
        return jnp.stack([jnp.sum(a * b[:, i]) for i in range(b.shape[1])])
    return sum((a[:, i] * b[i] for i in range(1, a.shape[1])), start=a[:, 0] * b[0])


long_product.defjvps(
    lambda change, _, a, b: _by_columns(change, b) if a.ndim == 1 else change @ b,
    lambda change, _, a, b: _by_columns(a, change) if b.ndim == 1 else a @ change,
)


def solve(matrix: Float[Array, "k k"], rhs: Float[Array, " k"]) -> Float[Array, " k"]:
    """Solve by Gauss-Jordan elimination without pivots, for matrices that need none.

    In place of a routine for large matrices, as in `product`.
    """

    def clear(i: Array, rows: Array) -> Array:
        pivot = rows[i] / rows[i, i]
        return (rows - rows[:, i, None] * pivot).at[i].set(pivot)

    return jax.lax.fori_loop(0, rhs.size, clear, jnp.c_[matrix, rhs])[:, -1]


def inverse(matrix: Float[Array, "k k"]) -> Float[Array, "k k"]:
    """Return the inverse of a positive definite matrix by sweeps of its pivots (Goodnight 1979).

    In place of a routine for large matrices, as in `product`.
    """
    unit = 1 / jnp.sqrt(jnp.diagonal(matrix))

    def sweep(i: Array, rows: Array) -> Array:
        row = rows[i]
        less = row.at[i].add(-1.0)
        return (rows - less[:, None] * (less / row[i])).at[i, i].add(-2.0)

    swept = jax.lax.fori_loop(0, unit.size, sweep, unit[:, None] * matrix * unit)
    return -unit[:, None] * swept * unit
