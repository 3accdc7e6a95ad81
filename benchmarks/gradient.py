"""Gradient of a whole run by the numbers of its scenario, over the run alone."""

from functools import partial
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from benchmarks.measurement import Rows, Scope, in_turn, row
from benchmarks.step import ARMS, steady
from crinoid.assembly.parameters import Parameters
from crinoid.assembly.prepared import parameters
from crinoid.compilation import OFTEN, compiled
from crinoid.dynamics import State
from crinoid.flow.currents import Uniform
from crinoid.simulation import closed_loop, rollout, with_parameters
from crinoid.simulation.loop import Loop


def benchmark(scope: Scope) -> Rows:
    """Yield times of a run, and of the run with its gradient by four numbers and by all."""
    names = ("run", "gradient by four numbers", "gradient by all numbers")
    for axes in list(ARMS)[: scope.most]:
        scenario = steady(axes, scope)
        numbers = parameters(scenario)
        given = numbers, *closed_loop(scenario), scenario.simulation.steps
        by_four = partial(_by_four, _four(numbers), *given)
        times = in_turn([partial(_run, *given), by_four, partial(_by_all, *given)], scope.repeats)
        for name, each in zip(names, times, strict=True):
            yield row(f"{axes}, {name}", "time", "s", each)
            yield row(f"{axes}, {name}", "time over that of the run", "1", each / times[0])


def _mean_square(numbers: Parameters, loop: Loop, state: State, steps: int) -> Float[Array, ""]:
    run = rollout(with_parameters(loop, numbers), state, steps)
    return jnp.mean(jnp.sum(run.kept.error**2, axis=1))


def _four(numbers: Parameters) -> list[Any]:
    """Return Young's modulus and radius of the arm, density of the water, and the current."""
    arm, flow = numbers.arm, numbers.flow[0]
    assert isinstance(flow, Uniform)
    return [arm.youngs_modulus, arm.radius, numbers.water.density, flow.uniform_velocity]


_run = compiled(**OFTEN)(_mean_square)


@compiled(**OFTEN)
def _by_four(four: list[Array], numbers: Parameters, *rest: Any) -> tuple[Array, list[Array]]:
    def of(four: list[Array]) -> Float[Array, ""]:
        return _mean_square(eqx.tree_at(_four, numbers, four), *rest)

    return eqx.filter_value_and_grad(of)(four)


@compiled(**OFTEN)
def _by_all(numbers: Parameters, *rest: Any) -> tuple[Array, Parameters]:
    return eqx.filter_value_and_grad(_mean_square)(numbers, *rest)
