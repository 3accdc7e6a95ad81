"""Print how slow this machine is now: 1 as the one on which the limits of tests were set.

Both cores compile a fixed function, as the tests do most of the time. On that machine it needs
REFERENCE seconds of CPU time, and `crinoid run station-keeping` 10 s with nothing compiled before.
"""

import multiprocessing
import os
import statistics
import time

REFERENCE = 2.7
"""CPU time on a machine of speed 1 (s)."""


def cost(_: int) -> float:
    """Return the CPU time of the compilation (s)."""
    os.environ["JAX_ENABLE_COMPILATION_CACHE"] = "false"
    import jax
    import jax.numpy as jnp

    def total(x: jax.Array) -> jax.Array:
        for k in range(40):
            x = jnp.sin(x @ x.T * (1 + k)) + jnp.roll(x, k, 0) / (2 + k)
        return x.sum()

    start = time.process_time()
    jax.jit(jax.grad(total)).lower(jnp.ones((8, 8))).compile()
    return time.process_time() - start


if __name__ == "__main__":
    with multiprocessing.get_context("spawn").Pool(2, maxtasksperchild=1) as pool:
        print(f"{statistics.mean(pool.map(cost, range(4), chunksize=1)) / REFERENCE:.2f}")
