"""Time of a time step: bare, in the closed loop, by the number of nodes, and with each effect."""

from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from benchmarks.measurement import Rows, Scope, in_turn, row
from crinoid.assembly.prepared import Prepared
from crinoid.compilation import OFTEN, compiled
from crinoid.dynamics import State, System
from crinoid.scenario import Scenario, load
from crinoid.simulation.chunk import fast_chunk
from crinoid.simulation.setup import set_up

Run = tuple[Callable[[], Any], int]
"""A run, and the number of its time steps."""

ARMS = {"plane": "station-keeping", "space": "station-keeping-3d"}
"""Built-in scenarios of one arm under PID control."""
_SPEED = {"plane": [0.25, 0.0], "space": [0.0, 0.25, 0.0]}
"""Uniform current across the arm (m/s)."""
_TURBULENCE = {"kind": "turbulence", "mean": _SPEED["plane"], "intensity": 0.2, "length_scale": 0.5}
_WAVES = {"kind": "waves", "significant_height": 0.5, "peak_period": 5.0}
_SPHERE = {"kind": "sphere", "position": [0.3, -13.0], "radius": 0.05}
_CHAMBER = {"offset": 0.008, "area": 1e-4, "max_pressure": 1e4}
_EFFECTS: dict[str, dict[str, Any]] = {
    "vortices": {"water.vortices": {}},
    "relaxation of the material": {"arm.relaxation": [{"ratio": 0.4, "time": 1.5}]},
    "turbulence, 64 modes": {"flow": [_TURBULENCE | {"modes": 64}]},
    "turbulence, 256 modes": {"flow": [_TURBULENCE]},
    "waves, 64 components": {"flow": [_WAVES], "water.depth": 15.0},
    "one sphere, far away": {"obstacle": [_SPHERE]},
    "one chamber": {"chamber": [_CHAMBER]},
    "contact with itself, apart": {"contact.self": True},
}
"""What is added to the arm in the plane, in place of the current where it is one."""


def steady(axes: str, scope: Scope, values: Mapping[str, Any] | None = None) -> Scenario:
    """Return the arm in a uniform current, with other values of some keys."""
    current = {"kind": "uniform", "velocity": _SPEED[axes], "ramp_time": 3.0}
    own = {"arm.nodes": scope.nodes[0], "flow": [current], "water.vortices": None, **(values or {})}
    return scope.shortened(load(ARMS[axes]), own)


def march(
    system: System, state: State, command: Float[Array, " input"], steps: int | Int[Array, ""]
) -> tuple[State, Bool[Array, ""]]:
    """Return the state after some time steps, and whether all of them succeeded.

    That is the bare step: no sensor, controller, record, energy ledger or halving.
    """

    def step(_: Any, carry: tuple[State, Array]) -> tuple[State, Array]:
        state, outcome = system.step(carry[0], command)
        return state, carry[1] & outcome.converged

    return jax.lax.fori_loop(0, steps, step, (state, jnp.asarray(True)))


_march = compiled(**OFTEN)(march)


def benchmark(scope: Scope) -> Rows:
    """Yield times of a step in the closed loop and bare, and what each effect adds."""
    runs: dict[tuple[str, int], Run] = {}
    for nodes in scope.nodes:
        for axes in list(ARMS)[: scope.most]:
            scenario = steady(axes, scope, {"arm.nodes": nodes})
            runs[f"{axes}, closed loop", nodes] = _closed_loop(scenario)
            runs[f"{axes}, bare step", nodes] = _bare_steps(scenario)
    times = _times(runs, scope)
    for (name, nodes), each in times.items():
        yield row(name, "time of a step", "s", each, nodes=nodes)
    few, many = scope.nodes[0], scope.nodes[-1]
    for name in dict.fromkeys(name for name, _ in runs) if many > few else ():
        power = np.log(np.median(times[name, many] / times[name, few])) / np.log(many / few)
        yield row(name, "power of the number of nodes", "1", [power])
    yield from _built_in(scope)
    yield from _with_effects(scope)


def _built_in(scope: Scope) -> Rows:
    """Yield times of a step where the arm moves all the time: the built-in scenarios themselves."""
    own = {name: scope.shortened(load(name)) for name in list(ARMS.values())[: scope.most]}
    times = _times({name: _closed_loop(each) for name, each in own.items()}, scope)
    for name, each in times.items():
        yield row(f"{name}, moving", "time of a step", "s", each, nodes=own[name].arm.nodes)


def _with_effects(scope: Scope) -> Rows:
    ends = np.linspace(0.0, 1.0, scope.nodes[0]).tolist()
    each_edge = [_CHAMBER | {"span": list(span)} for span in pairwise(ends)]
    effects = _EFFECTS | {"a chamber on each edge": {"chamber": each_edge}}
    cases = [("plane", "", {}), *(("plane", *each) for each in list(effects.items())[: scope.most])]
    if not scope.most:
        also = "vortices", "contact with itself, apart"
        cases += [("space", "", {}), *(("space", name, effects[name]) for name in also)]
    runs = {(axes, name): _closed_loop(steady(axes, scope, values)) for axes, name, values in cases}
    times = _times(runs, scope)
    for (axes, name), each in times.items():
        if name:
            over = each / times[axes, ""]
            yield row(f"{axes}, {name}", "time of a step over that without", "1", over)


def _times(runs: dict[Any, Run], scope: Scope) -> dict[Any, Float[np.ndarray, " repeat"]]:
    """Return the times of a step of each run, measured in turn (s)."""
    times = in_turn([run for run, _ in runs.values()], scope.repeats)
    return {
        name: each / steps for (name, (_, steps)), each in zip(runs.items(), times, strict=True)
    }


def _closed_loop(scenario: Scenario) -> Run:
    """Return a whole run by the program of `crinoid run` for long runs."""
    setup = set_up(Prepared(scenario))
    stride = scenario.output_steps
    count = scenario.simulation.steps // stride
    given = setup.loop.start(setup.state), jnp.asarray(count * stride), jnp.asarray(stride)

    def run() -> None:
        _, _, filled, _ = fast_chunk(setup.loop, *given, count)
        if filled != count:
            raise RuntimeError(f"{scenario.title}: the run stopped early")

    return run, count * stride


def _bare_steps(scenario: Scenario) -> Run:
    """Return the time steps alone, the base at rest."""
    setup, steps = set_up(Prepared(scenario)), scenario.simulation.steps
    system = setup.loop.system
    given = system, setup.state, jnp.zeros(len(system.inputs)), jnp.asarray(steps)

    def run() -> None:
        if not _march(*given)[1]:
            raise RuntimeError(f"{scenario.title}: a step failed")

    return run, steps
