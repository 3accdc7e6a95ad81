"""Statistics of random currents: a Gauss-Markov process and turbulence."""

from itertools import pairwise

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
from crinoid.view.figures.style import BLUE, INK, VERMILLION
from validation.case import Check, Evidence, case

_TIME, _MEAN, _DEVIATIONS = 0.5, np.array([0.3, -0.1]), np.array([0.2, 0.05])
_DURATION = 20_000 * _TIME
_LAGS = np.array([0.5, 1.0, 2.0])
"""Lags over the correlation time."""
_CURRENT = {
    "kind": "gauss-markov",
    "mean": _MEAN.tolist(),
    "standard_deviation": _DEVIATIONS.tolist(),
    "correlation_time": _TIME,
}
_SCENARIO = Scenario(arm={"nodes": 3}, flow=[_CURRENT], simulation={"duration": _DURATION})


@eqx.filter_jit
def _velocities(flow: Flow, times: Float[Array, " t"]) -> Float[Array, "t 2"]:
    return jax.vmap(lambda time: flow.velocity(jnp.zeros(2), time))(times)


def _correlation(flow: Flow, step: float) -> Float[np.ndarray, "lag axis"]:
    """Return variance and correlations at `_LAGS`, of a record read at steps of this size (s)."""
    record = np.asarray(_velocities(flow, jnp.arange(0.0, _DURATION, step)))
    wandering = (record - _MEAN) / _DEVIATIONS
    behind = [0, *np.round(_LAGS * _TIME / step).astype(int)]
    return np.stack([np.mean(wandering[n:] * wandering[: len(wandering) - n], 0) for n in behind])


def _kept() -> float:
    """Return the variance of a spline through the process at twentieths of the correlation time."""
    points = np.arange(121)
    weights = CubicSpline(points, np.eye(121))(np.linspace(60, 61, 101))
    covariance = np.exp(-np.abs(points[:, None] - points) / 20)
    return float(np.trapezoid(np.sum(weights @ covariance * weights, axis=1), dx=0.01))


@case(
    kind="exact",
    title="A Gauss-Markov current has its variance and correlation, at any time step.",
    source="Ornstein-Uhlenbeck process: covariance sigma^2 exp(-lag/T). The current is a cubic "
    "spline through the process at T/20, whose variance follows from its weights.",
    method="A record of 20 000 correlation times, read at two steps that miss its points; variance "
    "over sigma^2.",
    reason="Over N = 20 000 correlation times, variance and correlation scatter by sqrt(1/N) = "
    "0.7 %: four times that.",
)
def gauss_markov() -> Evidence:
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

    return Evidence(checks, None, {"": _SCENARIO}, draw)


_SPEED, _INTENSITY, _LENGTH, _SEEDS = 1.5, 0.2, 0.8, 32
_DEVIATION = _INTENSITY * _SPEED
_ENERGETIC = 1.339 * _LENGTH
"""Length L_e of von Karman's spectrum: L Gamma(1/3)/(sqrt(pi) Gamma(5/6)) (m)."""
_COUNT, _STEP = 8192, 4e-3
_BAND = 5.0, 60.0
"""Inertial range, wave numbers times L_e."""


def _scenario(seed: int) -> Scenario:
    table = {"kind": "turbulence", "mean": [_SPEED, 0.0, 0.0]}
    flow = table | {"intensity": _INTENSITY, "length_scale": _LENGTH}
    return Scenario(arm={"dimension": 3, "nodes": 3}, flow=[flow], seed=seed)


@eqx.filter_jit
def _records(flows: Flow) -> Float[Array, "seed t"]:
    """Return the velocity along the mean at the origin, less the mean (m/s)."""

    def one(flow: Flow) -> Float[Array, " t"]:
        times = _STEP * jnp.arange(_COUNT)
        return jax.vmap(lambda time: flow.velocity(jnp.zeros(3), time)[0])(times) - _SPEED

    return jax.lax.map(one, flows)


@eqx.filter_jit
def _jets(flows: Flow, points: Float[Array, "p 3"]) -> tuple[Array, Array]:
    """Return fluctuations (m/s) and gradients (1/s) of each flow at points."""

    def at(flow: Flow, point: Array) -> tuple[Array, Array]:
        def velocity(x: Array) -> Array:
            return flow.velocity(x, jnp.asarray(3.7))

        return velocity(point) - _SPEED * jnp.eye(3)[0], jax.jacfwd(velocity)(point)

    return jax.vmap(jax.vmap(at, (None, 0)), (0, None))(flows, points)


@case(
    kind="exact",
    title="Turbulence has no divergence, the wanted intensity, and a spectrum of slope -5/3.",
    source="Incompressible flow; von Karman 1948, Proc. Natl. Acad. Sci. 34, 530-539: longitudinal "
    "spectrum 2 sigma^2 L/pi (1 + (k L_e)^2)^(-5/6).",
    method=f"{_SEEDS} seeds, 256 modes: divergence by automatic differentiation and intensity at "
    "200 points, spectrum of 33 s at a point past which the mean carries the eddies, for k L_e "
    "from 5 to 60.",
    reason="Round-off leaves 1e-10 of the gradient. The energy of a draw is given; its share in a "
    "component scatters by a few percent. A slope over 12 bands scatters by 0.1; von Karman's is "
    "-1.66 there.",
)
def turbulence() -> Evidence:
    drawn = [system(_scenario(seed)).forces.water.flows[0] for seed in range(_SEEDS)]
    flows = jax.tree.map(lambda *leaves: jnp.stack(leaves), *drawn)
    points = np.random.default_rng(9).uniform(-300.0, 300.0, (200, 3))
    velocity, slopes = map(np.asarray, _jets(flows, jnp.asarray(points)))
    divergence = np.abs(np.trace(slopes, axis1=2, axis2=3)).max() / np.sqrt(np.mean(slopes**2))
    intensity = np.sqrt(np.mean(velocity**2, axis=(0, 1))) / _SPEED
    window = np.hanning(_COUNT)
    power = np.abs(np.fft.rfft(np.asarray(_records(flows)) * window, axis=1)) ** 2
    # what drifts past a point: wave number k = 2 pi f/U
    density = 2 * _STEP / np.sum(window**2) * power.mean(axis=0) * _SPEED / (2 * np.pi)
    number = 2 * np.pi * np.fft.rfftfreq(_COUNT, _STEP) / _SPEED * _ENERGETIC

    def mean(low: float, high: float) -> float:
        return float(density[(number > low) & (number < high)].mean())

    bands = np.geomspace(*_BAND, 13)
    middles = np.sqrt(bands[1:] * bands[:-1])
    means = np.array([mean(*pair) for pair in pairwise(bands)])
    slope, _ = np.polyfit(np.log(middles), np.log(means), 1)
    known = 2 * _DEVIATION**2 * _LENGTH / np.pi / (1 + number**2) ** (5 / 6)
    expected = np.interp(middles, number, known)
    level = float(np.mean(means / expected))
    checks = [
        Check("largest divergence over the RMS gradient", 0.0, float(divergence), 1e-10),
        *(
            Check(f"intensity of {axis}", _INTENSITY, value, 0.05, "1", True)
            for axis, value in zip("xyz", intensity, strict=True)
        ),
        Check("slope of the spectrum", -5 / 3, slope, 0.15),
        Check("level of the spectrum over von Karman's", 1.0, level, 0.1),
    ]

    def draw(axes: Axes) -> None:
        inside = (number > 0.3) & (number < 150)
        axes.loglog(number[inside], density[inside], color=BLUE, lw=0.6, label="crinoid")
        axes.loglog(middles, means, "o", color=VERMILLION, ms=4, label="in bands")
        axes.loglog(number[inside], known[inside], color=INK, ls="--", label="von Karman")
        axes.set(xlabel="wave number times L$_e$", ylim=(1e-7, 0.2))
        axes.set_ylabel("spectral density (m$^3$/s$^2$)")

    return Evidence(checks, None, {"": _scenario(0)}, draw)
