"""Measures of a run with their derivatives: those of the registry that have any."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.actuation import drives
from crinoid.assembly.parameters import Parameters
from crinoid.assembly.plan import find_state
from crinoid.compilation import SOMETIMES, compiled
from crinoid.control import pose_error
from crinoid.simulation import Loop, rollout, with_parameters
from crinoid.simulation.loop import LoopState

_SHARPNESS = 100.0
"""Weight of an instant falls by e where its value is less by the largest one over this."""
_TINY = 1e-24
"""Square that gives a root a derivative at zero."""
_LAST = 0.1
"""Share of a run, at its end, that counts as steady (`crinoid.results.metrics`)."""

Series = Float[Array, " time"]
Numbers = tuple[Parameters | Loop, Float[Array, " thread"]]
"""Numbers of a loop, or the loop itself; pressure of each thread at a share of 1 (Pa)."""


class SeenMotion(eqx.Module):
    """Quantities of the saved instants of a run, for measures."""

    time: Float[Array, "*time"]
    tip: Float[Array, "*time pose"]
    error: Float[Array, "*time pose"]
    force: Float[Array, "*time axis"]
    moment: Float[Array, "*time turn"]
    pressure: Float[Array, "*time thread"]

    def distance(self) -> Series:
        """Return the distance of the tip from its target (m)."""
        return _length(self.error[:, : self.axes])

    def angle(self) -> Series:
        """Return the angle between the tip and its target (rad)."""
        apart = _length(self.error[:, self.axes :])
        # in space the error is the chord between two unit vectors
        return apart if self.axes == 2 else 2 * jnp.arcsin(jnp.minimum(apart / 2, 1.0))

    @property
    def axes(self) -> int:
        """2 or 3."""
        return self.force.shape[-1]


def _length(vectors: Float[Array, "time axis"]) -> Series:
    return jnp.sqrt(jnp.sum(vectors**2, axis=1) + _TINY)


def _rms(values: Float[Array, "*instant"]) -> Array:
    return jnp.sqrt(jnp.mean(values**2) + _TINY)


def _largest(values: Float[Array, "*instant"]) -> Array:
    """Return the largest value, with the derivative of a smooth maximum.

    The derivative of the largest value itself jumps where another instant becomes the largest.
    """
    top = jnp.max(values)
    sharp = _SHARPNESS / jnp.maximum(jnp.abs(top), _TINY)
    weight = jax.lax.stop_gradient(jax.nn.softmax(sharp * values.ravel()))
    mean = weight @ values.ravel()
    return jax.lax.stop_gradient(top - mean) + mean


def _steady(seen: SeenMotion) -> Array:
    first, end = seen.time[0], seen.time[-1]
    late = seen.time >= end - _LAST * (end - first)
    return jnp.sum(jnp.where(late, seen.distance(), 0.0)) / jnp.sum(late)


def _wander(seen: SeenMotion) -> Array:
    tip = seen.tip[:, : seen.axes]
    return _length(tip - jnp.mean(tip, axis=0))


class _Smooth(NamedTuple):
    of: Callable[[SeenMotion], Array]
    whole: bool = False
    """Whether it counts from the start, not from `crinoid.Scenario.judged_from`."""


SMOOTH = {
    "rms_error": _Smooth(lambda seen: _rms(seen.distance())),
    "max_error": _Smooth(lambda seen: _largest(seen.distance())),
    "p95_error": _Smooth(lambda seen: jnp.percentile(seen.distance(), 95.0)),
    "steady_error": _Smooth(_steady),
    "fluctuation": _Smooth(lambda seen: _rms(_wander(seen))),
    "rms_angle_error": _Smooth(lambda seen: _rms(seen.angle())),
    "max_angle_error": _Smooth(lambda seen: _largest(seen.angle())),
    "rms_base_force": _Smooth(lambda seen: _rms(_length(seen.force)), whole=True),
    "rms_base_moment": _Smooth(lambda seen: _rms(_length(seen.moment)), whole=True),
    "max_pressure": _Smooth(lambda seen: _largest(jnp.abs(seen.pressure)), whole=True),
}
"""Measures that have derivatives, by their names in the registry."""


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


def _see(loop: Loop, pressures: Float[Array, " thread"], now: LoopState) -> SeenMotion:
    state, system = now.state, loop.system
    time, tip = state.time, system.tip(state)
    drive = drives(system.actuators, state.actuators)
    shares = jnp.zeros(0) if drive is None else drive[: pressures.shape[0]]
    error = pose_error(loop.target(time), tip)
    moment = jnp.atleast_1d(state.base_moment)
    return SeenMotion(time, tip, error, state.base_force, moment, pressures * shares)


@compiled(**SOMETIMES)
def measures(
    loop: Loop, numbers: Numbers, tangents: Any, names: tuple[str, ...], instants: SeenInstants
) -> tuple[Float[Array, " measure"], Float[Array, "measure key"]]:
    """Return measures of a run, or of an equilibrium, and their derivatives.

    ``tangents`` are the derivatives of ``numbers`` by each key, with the keys as first axis and
    None for constant leaves. All results are NaN where a time step failed or there is no
    equilibrium.
    """
    varying, constant = eqx.partition(numbers, eqx.is_inexact_array)

    def of(varying: Any) -> tuple[Array, Array]:
        first, pressures = eqx.combine(varying, constant)
        changed = first if isinstance(first, Loop) else with_parameters(loop, first)
        state, outcome = find_state.function(changed.system, instants.equilibrium)
        seen = jax.tree.map(lambda x: x[None], _see(changed, pressures, changed.start(state)))
        converged = outcome.converged
        if instants.steps:
            run = rollout(
                changed, state, instants.steps, observe=lambda loop, now: _see(loop, pressures, now)
            )
            last = instants.steps - 1
            rows = [*range(instants.stride - 1, last, instants.stride), last]
            kept = jax.tree.map(lambda x: x[jnp.array(rows)], run.kept)
            seen = jax.tree.map(lambda x, y: jnp.concatenate([x, y]), seen, kept)
            converged = converged & run.converged
        judged = jax.tree.map(lambda x: x[instants.judged :], seen)
        found = [SMOOTH[name].of(seen if SMOOTH[name].whole else judged) for name in names]
        values = jnp.where(converged, 1.0, jnp.nan) * jnp.stack(found)
        return values, values

    def along(tangent: Any) -> tuple[Array, Array, Array]:
        return jax.jvp(of, (varying,), (tangent,), has_aux=True)

    # the run itself is computed once for all directions
    _, slopes, values = jax.vmap(along, out_axes=(None, 1, None))(tangents)
    return values, slopes
