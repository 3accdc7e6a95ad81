"""Time the gradient of a whole run by the numbers of its scenario, beside the run itself."""

import argparse
import resource
import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console

import crinoid
from crinoid.assembly.parameters import Parameters
from crinoid.programs import OFTEN
from step import IN_SPACE, PLANAR, SOFT, STEADY, STEADY_IN_SPACE


def main() -> None:
    """Time both, in turn, and print their ratio and the memory."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--nodes", type=int, default=21)
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--in-space", action="store_true", help="an arm in space")
    parser.add_argument("--turbulence", action="store_true", help="turbulence, no uniform current")
    options = parser.parse_args()
    base, steady = (IN_SPACE, STEADY_IN_SPACE) if options.in_space else (PLANAR, STEADY)
    current = [] if options.turbulence else [steady]
    scenario = crinoid.load(base, [f"arm.nodes={options.nodes}", *SOFT, *current])
    parameters = crinoid.parameters(scenario)
    loop, state = crinoid.closed_loop(scenario)

    def loss(parameters: Parameters) -> jax.Array:
        closed = crinoid.with_parameters(loop, parameters)
        run = crinoid.rollout(closed, state, options.steps)
        return jnp.mean(jnp.sum(run.kept.error**2, axis=1))

    forward = eqx.filter_jit(loss, compiler_options=OFTEN)
    both = eqx.filter_jit(eqx.filter_value_and_grad(loss), compiler_options=OFTEN)
    begun = time.perf_counter()
    value, _ = both(parameters)
    compiling = time.perf_counter() - begun
    assert np.isfinite(value)
    assert np.isclose(value, forward(parameters), rtol=1e-12)
    times = []
    for _ in range(options.repeats):
        pair = []
        for run in (forward, both):
            begun = time.perf_counter()
            jax.block_until_ready(run(parameters))
            pair.append(time.perf_counter() - begun)
        times.append(pair)
    alone, together = np.median(times, axis=0)
    console = Console(highlight=False)
    console.print(
        f"{options.steps} steps of {options.nodes} nodes: {1e3 * alone:.1f} ms; with the gradient "
        f"by all numbers of the scenario {1e3 * together:.1f} ms, {together / alone:.2f} times that"
    )
    console.print(
        f"the gradient takes {compiling:.0f} s to compile; memory at most {_most_held():.0f} MB"
    )


def _most_held() -> float:
    """Return the most memory that this process has held so far (MB)."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


if __name__ == "__main__":
    main()
