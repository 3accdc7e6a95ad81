"""Time the gradient of a whole run by the numbers of its scenario, beside the run itself."""

import argparse
import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console

import crinoid
from crinoid.assembly.parameters import Parameters
from crinoid.programs import OFTEN
from step import PLANAR, SOFT, STEADY


def main() -> None:
    """Time both, in turn, and print their ratio."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--nodes", type=int, default=21)
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--repeats", type=int, default=7)
    options = parser.parse_args()
    scenario = crinoid.load(PLANAR, [f"arm.nodes={options.nodes}", *SOFT, STEADY])
    parameters = crinoid.parameters(scenario)

    def height(parameters: Parameters) -> jax.Array:
        system = crinoid.assemble(parameters)

        def step(state, _):
            state, outcome = system.step(state, jnp.zeros(len(system.inputs)))
            return state, outcome.converged

        end, converged = jax.lax.scan(step, system.rest(), length=options.steps)
        return jnp.where(converged.all(), system.tip(end)[1], jnp.nan)

    forward = eqx.filter_jit(height, compiler_options=OFTEN)
    both = eqx.filter_jit(eqx.filter_value_and_grad(height), compiler_options=OFTEN)
    value, _ = both(parameters)
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
    Console(highlight=False).print(
        f"{options.steps} steps of {options.nodes} nodes: {1e3 * alone:.1f} ms; with the gradient "
        f"by all numbers of the scenario {1e3 * together:.1f} ms, {together / alone:.2f} times that"
    )


if __name__ == "__main__":
    main()
