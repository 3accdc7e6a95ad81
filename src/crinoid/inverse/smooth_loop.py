"""Closed loop of some draws as a smooth function of numbers of its scenario."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.actuation import drives
from crinoid.assembly.control_loop import build_controller
from crinoid.assembly.parameters import Parameters, PidParameters
from crinoid.assembly.plan import find_state
from crinoid.assembly.prepared import Prepared, at_rest
from crinoid.compilation import OFTEN, compiled
from crinoid.control import Controller, pose_error
from crinoid.inverse.ranges import Point, Ranges
from crinoid.results.effort import CostWeights
from crinoid.results.errors import judged_at
from crinoid.results.smooth import SMOOTH, SeenMotion
from crinoid.scenario import Scenario
from crinoid.simulation import Loop, rollout, with_parameters
from crinoid.simulation.loop import LoopState
from crinoid.simulation.setup import set_up

_STEP = 1e-4  # step of a coordinate in the differences of arrays
_ALIKE = 1e-7  # relative difference of equal arrays: that of equilibria found from different starts
_FEW = 3
"""Keys for each measure up to which forward mode is faster: it costs half a run for each key,
reverse mode two runs for each measure."""
_KEPT = 64  # number of points whose controllers are kept


Numbers = tuple[Parameters | Loop, Float[Array, " thread"]]
"""Numbers of a loop, or the loop itself; pressure of each thread at a share of 1 (Pa)."""


class SeenInstants(NamedTuple):
    """Saved instants of a run that measures see."""

    steps: int  # number of time steps; 0 for the equilibrium at t = 0
    stride: int  # time steps between saved instants
    judged: int  # index of the first saved instant from which errors count
    equilibrium: bool  # whether the arm starts in equilibrium
    weights: CostWeights  # weights of errors and inputs in the cost of a controller


def _see(
    loop: Loop, pressures: Float[Array, " thread"], instants: SeenInstants, now: LoopState
) -> SeenMotion:
    state, system = now.state, loop.system
    time, tip = state.time, system.tip(state)
    drive = drives(system.actuators, state.actuators)
    shares = jnp.zeros(0) if drive is None else drive[: pressures.shape[0]]
    error = pose_error(loop.target(time), tip)
    force, moment = state.base_force, jnp.atleast_1d(state.base_moment)
    judged, weights = instants.judged, instants.weights
    return SeenMotion(
        time, tip, error, force, moment, pressures * shares, now.command, judged, weights
    )


@compiled(**OFTEN)
def measures(
    loop: Loop,
    numbers: Numbers,
    tangents: Any,
    names: tuple[str, ...],
    instants: SeenInstants,
    *,
    reverse: bool,
) -> tuple[Float[Array, " measure"], Float[Array, "measure key"]]:
    """Return measures of a run, or of an equilibrium, and their derivatives.

    ``names`` are those of the measures, ``tangents`` the derivatives of ``numbers`` by each key,
    with the keys as first axis and None for constant leaves. The mode is forward or ``reverse``.
    All results are NaN where a time step failed or there is no equilibrium.
    """
    keys = jax.tree.leaves(tangents)[0].shape[0]

    def of(step: Array) -> tuple[Array, Array]:
        moves = jax.tree.map(lambda slope: jnp.tensordot(step, slope, 1), tangents)
        first, pressures = eqx.apply_updates(numbers, moves)
        changed = first if isinstance(first, Loop) else with_parameters(loop, first)

        def see(loop: Loop, now: LoopState) -> SeenMotion:
            return _see(loop, pressures, instants, now)

        state, outcome = find_state.function(changed.system, instants.equilibrium)
        seen = jax.tree.map(lambda x: x[None], see(changed, changed.start(state)))
        converged = outcome.converged
        if instants.steps:
            run = rollout(changed, state, instants.steps, observe=see)
            last = instants.steps - 1
            rows = [*range(instants.stride - 1, last, instants.stride), last]
            kept = jax.tree.map(lambda x: x[jnp.array(rows)], run.kept)
            seen = jax.tree.map(lambda x, y: jnp.concatenate([x, y]), seen, kept)
            converged = converged & run.converged
        found = [SMOOTH[name](seen) for name in names]
        values = jnp.where(converged, 1.0, jnp.nan) * jnp.stack(found)
        return values, values

    derivative = jax.jacrev if reverse else jax.jacfwd
    slopes, values = derivative(of, has_aux=True)(jnp.zeros(keys))
    return values, slopes


class StructureError(ValueError):
    """A key changes the structure of the loop, so there are no derivatives."""


class Neighbours(NamedTuple):
    """Loop of the first draw at a point, and at points a step away along each coordinate."""

    loop: Loop
    pairs: list[tuple[Loop, Loop]]
    widths: Float[np.ndarray, " key"]  # distances between the loops of each pair

    def slopes(self, value: Callable[[Loop], float]) -> Float[np.ndarray, " key"]:
        """Return the derivatives of a function of the loop."""
        found = ((value(one) - value(other)) for one, other in self.pairs)
        return np.array([*found]) / self.widths


class SmoothLoop:
    """Closed loop of some draws, or its equilibrium, with derivatives of measures.

    The derivatives of the loop's arrays by the keys are central differences, which need no run;
    those of the measures by the arrays go through every time step. Where the keys act on the
    controller alone, it is designed once for all draws; where they act on the scenario's numbers
    alone (`crinoid.with_parameters`), nothing is designed again.
    """

    def __init__(
        self, scenario: Scenario, ranges: Ranges, seeds: Sequence[int], *, rest: bool
    ) -> None:
        self._ranges, self._rest, self.seeds = ranges, rest, seeds
        self._prepared = [self._at(scenario, seed) for seed in seeds]
        setups = [set_up(each, notes=False) for each in self._prepared]
        self._loops, self._plan = [each.loop for each in setups], setups[0].plan
        simulation, stride = scenario.simulation, scenario.output_steps
        saved = scenario.output_interval * np.arange(simulation.steps // stride + 2)
        self._instants = SeenInstants(
            0 if rest else simulation.steps,
            stride,
            0 if rest else int(np.argmax(judged_at(saved, scenario))),
            rest or simulation.start == "equilibrium",
            CostWeights.of(scenario, [each.unit for each in self._loops[0].system.inputs]),
        )
        self._moving: set[int] = set()
        self._controller = lru_cache(_KEPT)(self._build_controller)
        steps = np.diag(np.where(ranges.start > 0.5, -_STEP, _STEP))
        others = [(point, self._set_up(point, 0)) for point in ranges.start + steps]
        self.acts_on = "all"
        """What the keys act on: the controller, the scenario's numbers, or all of the loop."""
        if all(key.startswith("control.") for key in ranges.keys) and all(
            _same(loop, self._with_controller(point, 0)) for point, loop in others
        ):
            self.acts_on = "controller"
        elif all(_same(loop, self._with_numbers(point, 0)) for point, loop in others):
            self.acts_on = "numbers"

    def measures(
        self, point: Point, names: tuple[str, ...]
    ) -> tuple[Float[np.ndarray, "measure draw"], Float[np.ndarray, "measure draw key"]]:
        """Return measures at a point in each draw, and their derivatives by its coordinates.

        ``names`` are those of measures with a derivative (`crinoid.results.smooth`). NaN where
        a time step failed or there is no equilibrium.

        Raises
        ------
        StructureError
            If a key changes the structure of the loop.
        ScenarioError
            If the values of a point exclude each other.
        """
        found, slopes, reverse = [], None, point.size > _FEW * len(names)
        for draw, loop in enumerate(self._loops):
            if slopes is None or self.acts_on != "controller":
                slopes = self._slopes(point, draw)
            numbers = self._numbers(point, draw)
            found.append(measures(loop, numbers, slopes, names, self._instants, reverse=reverse))
        values, gradients = (np.stack(each, axis=1) for each in zip(*found, strict=True))
        return values, gradients

    def neighbours(self, point: Point) -> Neighbours:
        """Return the loop of the first draw at a point, and loops about it."""
        ends = _ends(point)
        pairs = [(self._loop(one, 0), self._loop(other, 0)) for one, other, _ in ends]
        return Neighbours(self._loop(point, 0), pairs, np.array([width for *_, width in ends]))

    def _slopes(self, point: Point, draw: int) -> Any:
        """Return the derivatives of the numbers by each key, with the keys as first axis.

        None for leaves that were constant at all points so far: derivatives by them would cost
        time, and another set of leaves another compilation.
        """
        found = []
        for *ends, width in _ends(point):
            pair = [eqx.filter(self._numbers(end, draw), eqx.is_inexact_array) for end in ends]
            _require_same_structure(*pair)
            found.append(jax.tree.map(lambda a, b, w=width: _slope(a, b, w), *pair))
        leaves, structure = jax.tree.flatten(jax.tree.map(lambda *each: np.stack(each), *found))
        self._moving |= {index for index, leaf in enumerate(leaves) if leaf.any()}
        moving = self._moving or range(len(leaves))
        kept = [leaf if index in moving else None for index, leaf in enumerate(leaves)]
        return jax.tree.unflatten(structure, kept)

    def _numbers(self, point: Point, draw: int) -> Numbers:
        chambers = self._ranges.scenario(point).chamber
        pressures = [0.0 if each.lined else each.max_pressure for each in chambers]
        numbers = self.acts_on == "numbers"
        first = self._moved(point, draw).parameters if numbers else self._loop(point, draw)
        return first, jnp.asarray(np.array(pressures))

    def _loop(self, point: Point, draw: int) -> Loop:
        ways = {
            "controller": self._with_controller,
            "numbers": self._with_numbers,
            "all": self._set_up,
        }
        return ways[self.acts_on](point, draw)

    def _with_controller(self, point: Point, draw: int) -> Loop:
        controller = self._controller(point.tobytes())
        return eqx.tree_at(lambda x: x.controller, self._loops[draw], controller)

    def _build_controller(self, point: bytes) -> Controller:
        scenario = self._ranges.scenario(np.frombuffer(point))
        pid = PidParameters.of(scenario)
        parameters = eqx.tree_at(lambda x: x.pid, self._plan.parameters, pid)
        return build_controller(replace(self._plan, scenario=scenario, parameters=parameters))

    def _with_numbers(self, point: Point, draw: int) -> Loop:
        return with_parameters(self._loops[draw], self._moved(point, draw).parameters)

    def _set_up(self, point: Point, draw: int) -> Loop:
        return set_up(self._moved(point, draw), notes=False).loop

    def _moved(self, point: Point, draw: int) -> Prepared:
        prepared = self._prepared[draw]
        changed = self._at(self._ranges.scenario(point), prepared.scenario.seed)
        return prepared.with_scenario(changed.scenario)

    def _at(self, scenario: Scenario, seed: int) -> Prepared:
        changed = scenario.with_values({"seed": seed})
        return Prepared(at_rest(changed) if self._rest else changed)


def _ends(point: Point) -> list[tuple[Point, Point, float]]:
    """Return two points about a point along each coordinate, in the ranges, and their distance."""
    found = []
    for axis in np.eye(point.size):
        one, other = (np.clip(point + sign * _STEP * axis, 0.0, 1.0) for sign in (1, -1))
        found.append((one, other, float(axis @ (one - other))))
    return found


def _require_same_structure(one: Any, other: Any) -> None:
    forms = [
        (jax.tree.structure(each), [leaf.shape for leaf in jax.tree.leaves(each)])
        for each in (one, other)
    ]
    if forms[0] != forms[1]:
        raise StructureError("a key changes the structure of the loop")


def _same(one: Loop, other: Loop) -> bool:
    """Return whether two loops have the same structure and the same numbers."""
    pair = [eqx.filter(each, eqx.is_inexact_array) for each in (one, other)]
    try:
        _require_same_structure(*pair)
    except StructureError:
        return False
    return all(jax.tree.leaves(jax.tree.map(_alike, *pair)))


def _alike(one: Array, other: Array) -> bool:
    size = np.abs(np.asarray(one)).max(initial=0.0, where=np.isfinite(one))
    return np.allclose(one, other, rtol=0.0, atol=_ALIKE * size, equal_nan=True)


def _slope(plus: Array, minus: Array, width: float) -> Float[np.ndarray, ...]:
    one, other = np.asarray(plus), np.asarray(minus)
    same = one == other  # an absent limit is infinite, and constant
    return np.subtract(one, other, where=~same, out=np.zeros_like(one)) / width
