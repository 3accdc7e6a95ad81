"""Statistics of a Gauss-Markov current."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from matplotlib.axes import Axes
from scipy.interpolate import CubicSpline

from crinoid.assembly.prepared import system
from crinoid.flow import Flow
from crinoid.scenario import Scenario
from crinoid.validation.case import Case, Check, Evidence
from crinoid.view.figures.style import BLUE, INK, VERMILLION, key

_TIME, _MEAN, _DEVIATION = 0.5, np.array([0.3, -0.1]), np.array([0.2, 0.05])
_DURATION = 20_000 * _TIME
_LAGS = np.array([0.5, 1.0, 2.0])
"""Lags over the correlation time."""
_SCENARIO = Scenario().with_values(
    {
        "arm.nodes": 3,
        "flow": [
            {
                "kind": "gauss-markov",
                "mean": _MEAN.tolist(),
                "standard_deviation": _DEVIATION.tolist(),
                "correlation_time": _TIME,
            }
        ],
        "simulation.duration": _DURATION,
    }
)


@eqx.filter_jit
def _velocities(flow: Flow, times: Float[Array, " t"]) -> Float[Array, "t 2"]:
    return jax.vmap(lambda time: flow.velocity(jnp.zeros(2), time))(times)


def _correlation(flow: Flow, step: float) -> Float[np.ndarray, "lag axis"]:
    """Return variance and correlations at `_LAGS`, of a record read at steps of this size (s)."""
    record = np.asarray(_velocities(flow, jnp.arange(0.0, _DURATION, step)))
    wandering = (record - _MEAN) / _DEVIATION
    behind = [0, *np.round(_LAGS * _TIME / step).astype(int)]
    return np.stack([np.mean(wandering[n:] * wandering[: len(wandering) - n], 0) for n in behind])


def _kept() -> float:
    """Return the variance of a spline through the process at twentieths of the correlation time."""
    points = np.arange(121)
    weights = CubicSpline(points, np.eye(121))(np.linspace(60, 61, 101))
    covariance = np.exp(-np.abs(points[:, None] - points) / 20)
    return float(np.trapezoid(np.sum(weights @ covariance * weights, axis=1), dx=0.01))


def _run() -> Evidence:
    (flow,) = system(_SCENARIO).forces.water.flows
    steps = {"T/14": _TIME / 14, "T/6": _TIME / 6}
    found = {name: _correlation(flow, step) for name, step in steps.items()}
    kept = _kept()
    checks = [
        Check(f"variance of {axis}, read every {name}", kept, each[0, index], 0.03)
        for name, each in found.items()
        for index, axis in enumerate("xz")
    ]
    checks += [
        Check(f"correlation after {lag:g} T, read every {name}", np.exp(-lag), value, 0.03)
        for name, each in found.items()
        for lag, value in zip(_LAGS, each[1:].mean(axis=1), strict=True)
    ]

    def draw(axes: Axes) -> None:
        lags = np.linspace(0.0, 3.0, 61)
        axes.plot(lags, np.exp(-lags), color=INK, label="exp(-lag/T)")
        for marker, (name, each), colour in zip(
            "ox", found.items(), (BLUE, VERMILLION), strict=True
        ):
            values = each.mean(axis=1)
            axes.plot([0, *_LAGS], values, marker, color=colour, ms=7, label=f"read every {name}")
        axes.set(xlabel="lag over correlation time", ylabel="correlation")
        key(axes)

    return Evidence(checks, None, {"": _SCENARIO}, draw)


CASE = Case(
    name="gauss-markov",
    title="A Gauss-Markov current has its variance and correlation, at any time step.",
    source="Ornstein-Uhlenbeck process: covariance sigma^2 exp(-lag/T). The current is a cubic "
    "spline through the process at T/20, whose variance follows from its weights.",
    method="A record of 20 000 correlation times, read at two steps that miss its points; variance "
    "over sigma^2.",
    reason="Over N = 20 000 correlation times the variance scatters by sqrt(1/N) = 0.7 %, a "
    "correlation by as much: four times that.",
    kind="exact",
    run=_run,
)
