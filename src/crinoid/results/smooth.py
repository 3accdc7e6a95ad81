"""Measures of a run with derivatives: those of `crinoid.results.metrics` that are smooth."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.results.effort import EFFORT_TIME, CostWeights
from crinoid.results.errors import steady_from

_SHARPNESS = 100.0
"""Weight of an instant falls by e where its value is less by the largest one over this."""
_TINY = 1e-24  # square that gives a root a derivative at zero

Series = Float[Array, " judged"]
Number = Float[Array, ""]


class SeenMotion(eqx.Module):
    """Quantities of the saved instants of a run, for measures.

    Time (s), pose of the tip and its error (`crinoid.foundation.axes.POSE`; m, rad or 1), force and
    moment of the arm on its base (N, N m), pressures of the chambers (Pa), and commands.
    """

    time: Float[Array, "*time"]
    tip: Float[Array, "*time pose"]
    error: Float[Array, "*time pose"]
    force: Float[Array, "*time axis"]
    moment: Float[Array, "*time turn"]
    pressure: Float[Array, "*time thread"]
    command: Float[Array, "*time input"]
    judged: int = eqx.field(static=True)  # index of the first saved instant from which errors count
    weights: CostWeights = eqx.field(static=True)
    """Weights of errors and inputs in the cost of a controller."""

    def distance(self) -> Series:
        """Return the distance of the tip from its target (m)."""
        return _length(self.error[self.judged :, : self.axes])

    def angle(self) -> Series:
        """Return the angle between the tip and its target (rad)."""
        apart = _length(self.error[self.judged :, self.axes :])
        # in space the error is the chord between two unit vectors
        return apart if self.axes == 2 else 2 * jnp.arcsin(jnp.minimum(apart / 2, 1.0))

    @property
    def axes(self) -> int:
        """2 or 3."""
        return self.force.shape[-1]


def _length(vectors: Float[Array, "instant axis"]) -> Float[Array, " instant"]:
    return jnp.sqrt(jnp.sum(vectors**2, axis=1) + _TINY)


def _rms(values: Float[Array, "*instant"]) -> Number:
    return jnp.sqrt(jnp.mean(values**2) + _TINY)


def _largest(values: Float[Array, "*instant"]) -> Number:
    """Return the largest value, with the derivative of a smooth maximum.

    The derivative of the largest value itself jumps where another instant becomes the largest.
    """
    top = jnp.max(values)
    sharp = _SHARPNESS / jnp.maximum(jnp.abs(top), _TINY)
    weight = jax.lax.stop_gradient(jax.nn.softmax(sharp * values.ravel()))
    mean = weight @ values.ravel()
    return jax.lax.stop_gradient(top - mean) + mean


def _steady_error(seen: SeenMotion) -> Number:
    late = seen.time[seen.judged :] >= steady_from(seen.time)
    return jnp.sum(jnp.where(late, seen.distance(), 0.0)) / jnp.sum(late)


def _fluctuation(seen: SeenMotion) -> Number:
    tip = seen.tip[seen.judged :, : seen.axes]
    return _rms(_length(tip - jnp.mean(tip, axis=0)))


def _control_cost(seen: SeenMotion) -> Number:
    """Return the cost of a controller (m), as `crinoid.results.effort.control_cost` does."""
    error = jnp.array(seen.weights.pose) * seen.error[seen.judged :]
    moves = jnp.diff(jnp.array(seen.weights.inputs) * seen.command[seen.judged :], axis=0)
    speeds = EFFORT_TIME * moves / jnp.diff(seen.time[seen.judged :])[:, None]
    squares = [jnp.mean(jnp.sum(each**2, axis=1)) for each in (error, speeds)]
    return jnp.sqrt(sum(squares, _TINY))


SMOOTH: dict[str, Callable[[SeenMotion], Number]] = {
    "rms_error": lambda seen: _rms(seen.distance()),
    "max_error": lambda seen: _largest(seen.distance()),
    "p95_error": lambda seen: jnp.percentile(seen.distance(), 95.0),
    "steady_error": _steady_error,
    "fluctuation": _fluctuation,
    "rms_angle_error": lambda seen: _rms(seen.angle()),
    "max_angle_error": lambda seen: _largest(seen.angle()),
    "control_cost": _control_cost,
    "rms_base_force": lambda seen: _rms(_length(seen.force)),
    "rms_base_moment": lambda seen: _rms(_length(seen.moment)),
    "max_pressure": lambda seen: _largest(jnp.abs(seen.pressure)),
}
"""Measures of a run with a derivative, by their names in `crinoid.results.metrics.MEASURES`."""
