"""Time the gradient of a whole run by the numbers of its scenario, beside the run itself."""

import argparse
import resource
import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import crinoid
from crinoid.assembly.parameters import Parameters
from crinoid.compilation import OFTEN
from crinoid.flow.turbulence import Turbulence
from step import IN_SPACE, PLANAR, SOFT, STEADY, STEADY_IN_SPACE


def main() -> None:
    """Time the run and both gradients, in turn, and print their ratios and the memory."""
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

    def loss_of_few(numbers: list[jax.Array]) -> jax.Array:
        return loss(eqx.tree_at(_few, parameters, numbers))

    alone = eqx.filter_jit(loss, compiler_options=OFTEN)
    by_few, by_all = (
        eqx.filter_jit(eqx.filter_value_and_grad(of), compiler_options=OFTEN)
        for of in (loss_of_few, loss)
    )
    value, runs, compiling, held = alone(parameters), [(alone, parameters)], [], []
    for gradient, given in ((by_few, _few(parameters)), (by_all, parameters)):
        begun = time.perf_counter()
        run = gradient.lower(given).compile()
        compiling.append(time.perf_counter() - begun)
        held.append(run.compiled.memory_analysis().temp_size_in_bytes)
        assert np.isclose(run(given)[0], value, rtol=1e-9)
        runs.append((run, given))
    times = []
    for _ in range(options.repeats):
        row = []
        for run, given in runs:
            begun = time.perf_counter()
            jax.block_until_ready(run(given))
            row.append(time.perf_counter() - begun)
        times.append(row)
    medians = np.median(times, axis=0)
    print(f"{options.steps} steps of {options.nodes} nodes: {1e3 * medians[0]:.1f} ms")
    names = ("four numbers", "all numbers")
    for name, together, took, room in zip(names, medians[1:], compiling, held, strict=True):
        ratio, spent = together / medians[0], 1e3 * together
        print(f"with the gradient by {name} {spent:.1f} ms, {ratio:.2f} times that", end="; ")
        print(f"{took:.0f} s to compile, {1e-6 * room:.1f} MB by the compiler's account")
    print(f"memory at most {_most_held():.0f} MB, compiling included")


def _few(parameters: Parameters) -> list[jax.Array]:
    """Return Young's modulus and radius of the arm, density of the water, and the mean current."""
    flow = parameters.flow[0]
    current = flow.mean if isinstance(flow, Turbulence) else flow.uniform_velocity
    return [parameters.arm.youngs_modulus, parameters.arm.radius, parameters.water.density, current]


def _most_held() -> float:
    """Return the most memory that this process has held so far (MB)."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


if __name__ == "__main__":
    main()
