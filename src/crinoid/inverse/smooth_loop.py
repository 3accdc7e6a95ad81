"""Closed loop of one draw as a smooth function of numbers of its scenario."""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.actuation import drives
from crinoid.assembly.parameters import Parameters
from crinoid.assembly.plan import find_state
from crinoid.assembly.prepared import Prepared, at_rest
from crinoid.compilation import SOMETIMES, compiled
from crinoid.control import pose_error
from crinoid.inverse.ranges import Point, Ranges
from crinoid.results.errors import judged_at
from crinoid.results.metrics import smooth_measure
from crinoid.results.smooth import SeenMotion
from crinoid.scenario import Scenario
from crinoid.simulation import Loop, rollout, with_parameters
from crinoid.simulation.loop import LoopState
from crinoid.simulation.setup import set_up

_STEP = 1e-4
"""Step of a coordinate in the differences of arrays."""
_ALIKE = 1e-7
"""Relative difference of equal arrays: that of equilibria found from different starts."""


Numbers = tuple[Parameters | Loop, Float[Array, " thread"]]
"""Numbers of a loop, or the loop itself; pressure of each thread at a share of 1 (Pa)."""


class SeenInstants(NamedTuple):
    """Saved instants of a run that measures see."""

    steps: int
    """Number of time steps; 0 for the equilibrium at t = 0."""
    stride: int
    """Time steps between saved instants."""
    judged: int
    """Index of the first saved instant from which errors count."""
    equilibrium: bool
    """Whether the arm starts in equilibrium."""


def _see(loop: Loop, pressures: Float[Array, " thread"], judged: int, now: LoopState) -> SeenMotion:
    state, system = now.state, loop.system
    time, tip = state.time, system.tip(state)
    drive = drives(system.actuators, state.actuators)
    shares = jnp.zeros(0) if drive is None else drive[: pressures.shape[0]]
    error = pose_error(loop.target(time), tip)
    moment = jnp.atleast_1d(state.base_moment)
    return SeenMotion(time, tip, error, state.base_force, moment, pressures * shares, judged)


@compiled(**SOMETIMES)
def measures(
    loop: Loop, numbers: Numbers, tangents: Any, forms: tuple[str, ...], instants: SeenInstants
) -> tuple[Float[Array, " measure"], Float[Array, "measure key"]]:
    """Return measures of a run, or of an equilibrium, and their derivatives.

    ``forms`` are the functions of the measures (`crinoid.results.metrics.Measure.smooth`),
    ``tangents`` the derivatives of ``numbers`` by each key, with the keys as first axis and
    None for constant leaves. All results are NaN where a time step failed or there is no
    equilibrium.
    """
    varying, constant = eqx.partition(numbers, eqx.is_inexact_array)

    def of(varying: Any) -> tuple[Array, Array]:
        first, pressures = eqx.combine(varying, constant)
        changed = first if isinstance(first, Loop) else with_parameters(loop, first)

        def see(loop: Loop, now: LoopState) -> SeenMotion:
            return _see(loop, pressures, instants.judged, now)

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
        found = [smooth_measure(form)(seen) for form in forms]
        values = jnp.where(converged, 1.0, jnp.nan) * jnp.stack(found)
        return values, values

    def along(tangent: Any) -> tuple[Array, Array, Array]:
        return jax.jvp(of, (varying,), (tangent,), has_aux=True)

    # the run itself is computed once for all directions
    _, slopes, values = jax.vmap(along, out_axes=(None, 1, None))(tangents)
    return values, slopes


class StructureError(ValueError):
    """A key changes the structure of the loop, so there are no derivatives."""


class SmoothLoop:
    """Closed loop of one draw, or its equilibrium, with derivatives of measures.

    The derivatives of the loop's arrays by the keys are central differences, which need no run;
    those of the measures by the arrays go through every time step. Where a key acts on the
    scenario's numbers alone (`crinoid.with_parameters`), the loop is not designed again.
    """

    def __init__(self, scenario: Scenario, ranges: Ranges, seed: int, *, rest: bool) -> None:
        self._ranges, self._rest, self._seed = ranges, rest, {"seed": seed}
        self._prepared = self._at(scenario)
        self._loop = set_up(self._prepared, notes=False).loop
        simulation, stride = scenario.simulation, scenario.output_steps
        saved = scenario.output_interval * np.arange(simulation.steps // stride + 2)
        self._instants = SeenInstants(
            0 if rest else simulation.steps,
            stride,
            0 if rest else int(np.argmax(judged_at(saved, scenario))),
            rest or simulation.start == "equilibrium",
        )
        steps = np.diag(np.where(ranges.start > 0.5, -_STEP, _STEP))
        self.designed = not all(self._follows(ranges.start + step) for step in steps)
        """Whether another point has another design of the controller, target or sensors."""

    def measures(
        self, point: Point, forms: tuple[str, ...]
    ) -> tuple[Float[np.ndarray, " measure"], Float[np.ndarray, "measure key"]]:
        """Return measures at a point, and their derivatives by its coordinates.

        ``forms`` are their functions with a derivative (`crinoid.results.metrics.Measure.smooth`).
        NaN where a time step failed or there is no equilibrium.

        Raises
        ------
        StructureError
            If a key changes the structure of the loop.
        ScenarioError
            If the values of a point exclude each other.
        """
        numbers, tangents = self._numbers(point), []
        for axis in np.eye(point.size):
            ends = [np.clip(point + sign * _STEP * axis, 0.0, 1.0) for sign in (1, -1)]
            pair = [eqx.filter(self._numbers(end), eqx.is_inexact_array) for end in ends]
            _require_same_structure(*pair)
            width = float(axis @ (ends[0] - ends[1]))
            tangents.append(jax.tree.map(lambda a, b, w=width: _slope(a, b, w), *pair))
        tangent = jax.tree.map(lambda *each: np.stack(each), *tangents)
        found = measures(self._loop, numbers, tangent, forms, self._instants)
        return np.asarray(found[0]), np.asarray(found[1])

    def _at(self, scenario: Scenario) -> Prepared:
        changed = scenario.with_values(self._seed)
        return Prepared(at_rest(changed) if self._rest else changed)

    def _moved(self, point: Point) -> Prepared:
        return self._prepared.with_scenario(self._at(self._ranges.scenario(point)).scenario)

    def _numbers(self, point: Point) -> Numbers:
        prepared = self._moved(point)
        pressures = [
            0.0 if chamber.lined else chamber.max_pressure for chamber in prepared.scenario.chamber
        ]
        first = set_up(prepared, notes=False).loop if self.designed else prepared.parameters
        return first, jnp.asarray(np.array(pressures))

    def _follows(self, point: Point) -> bool:
        """Return whether the loop at a point is that of its numbers."""
        prepared = self._moved(point)
        pair = set_up(prepared, notes=False).loop, with_parameters(self._loop, prepared.parameters)
        one, other = (eqx.filter(each, eqx.is_inexact_array) for each in pair)
        try:
            _require_same_structure(one, other)
        except StructureError:
            return False
        return all(jax.tree.leaves(jax.tree.map(_alike, one, other)))


def _require_same_structure(one: Any, other: Any) -> None:
    forms = [
        (jax.tree.structure(each), [leaf.shape for leaf in jax.tree.leaves(each)])
        for each in (one, other)
    ]
    if forms[0] != forms[1]:
        raise StructureError("a key changes the structure of the loop")


def _alike(one: Array, other: Array) -> bool:
    size = np.abs(np.asarray(one)).max(initial=0.0, where=np.isfinite(one))
    return np.allclose(one, other, rtol=0.0, atol=_ALIKE * size, equal_nan=True)


def _slope(plus: Array, minus: Array, width: float) -> Float[np.ndarray, ...]:
    one, other = np.asarray(plus), np.asarray(minus)
    same = one == other  # an absent limit is infinite, and constant
    return np.subtract(one, other, where=~same, out=np.zeros_like(one)) / width
