"""The current of a scenario at its arm, sampled: an `xarray.Dataset` with units."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from crinoid.assembly.prepared import Prepared
from crinoid.current.spectrum import spectrum, von_karman
from crinoid.current.statistics import statistics
from crinoid.dataset import describe
from crinoid.dynamics import System
from crinoid.programs import ONCE, compiled
from crinoid.recording import Recording
from crinoid.scenario import Scenario
from crinoid.space import AXES

FLOW = "flow.nc"

PLACES = ("root", "tip")

_DIRECTIONS = {2: "x forward, z up", 3: "x forward, y to port, z up"}
_MOST = 100_000
"""Samples that are taken at most."""
_FEWEST = 64
"""Samples past the last ramp that make up statistics."""
_HEIGHTS = 161
_INSTANTS = 1000
_RANDOM = {"gauss-markov", "measured", "turbulence"}
"""Kinds of flow that have a spectrum worth comparing with that of turbulence."""


def sample_current(prepared: Prepared) -> xr.Dataset:
    """Sample the current of a scenario at the arm at rest, without simulating anything.

    Returns
    -------
    xarray.Dataset
        Velocity over time at root and tip, its spectra, its mean and standard deviation over
        height above and below the root, and of measured profiles those at their levels. The
        attribute ``settled`` is the time (s) at which the last ramp is over: spectra, means and
        deviations are taken from there on. It is 0 where next to nothing of the run is left then,
        which ``notes`` say.
    """
    scenario, system = prepared.scenario, prepared.system
    times, interval = _times(scenario)
    settled, notes = _settled(scenario, times)
    root, tip = np.asarray(_ends(system))
    heights = _heights(prepared, min(root[-1], tip[-1]), max(root[-1], tip[-1]))
    column = np.tile(root, (heights.size, 1))
    column[:, -1] = heights

    velocity = _velocity(system, np.stack([root, tip]), times)
    late = times >= settled - 1e-9
    stride = max(1, late.sum() // _INSTANTS)
    profile = _velocity(system, column, times[late][::stride])
    holes = np.zeros(times.size, bool)
    for recording in prepared.recordings.values():
        holes |= recording.holes(times, min(root[-1], tip[-1]), max(root[-1], tip[-1]))
    frequency, density, sound, windows = spectrum(velocity[late], interval, holes[late])
    if sound < windows:
        which = f"over {sound} of {windows} windows: the others hold gaps that were filled"
        if not sound:
            which = "over gaps that were filled by straight lines: no window is without"
        notes.append(f"the spectra are means {which}")

    quantities: dict[str, tuple[tuple[str, ...], Any, str, str]] = {
        "flow_velocity": (
            ("time", "place", "axis"),
            velocity,
            "m s-1",
            "velocity of the undisturbed water",
        ),
        "flow_spectrum": (
            ("frequency", "place", "axis"),
            density,
            "m2 s-1",
            "one-sided spectral density of the velocity",
        ),
        "profile_mean": (("height", "axis"), profile.mean(axis=0), "m s-1", "mean velocity"),
        "profile_standard_deviation": (
            ("height", "axis"),
            profile.std(axis=0),
            "m s-1",
            "standard deviation of the velocity",
        ),
    }
    model, words = _model(system, scenario, frequency, velocity[late, 1], times[late])
    if model is not None:
        quantities["model_spectrum"] = (("frequency", "axis"), model, "m2 s-1", words)
    quantities |= _records(prepared.recordings, float(times[-1]))
    dataset = xr.Dataset(
        {
            name: (dims, values, {"units": units, "long_name": meaning})
            for name, (dims, values, units, meaning) in quantities.items()
        },
        coords={
            "time": ("time", times, {"units": "s", "long_name": "time", "axis": "T"}),
            "axis": ("axis", list(AXES[root.size]), {"long_name": _DIRECTIONS[root.size]}),
            "place": ("place", list(PLACES), {"long_name": "end of the arm at rest"}),
            "position": (
                ("place", "axis"),
                np.stack([root, tip]),
                {"units": "m", "long_name": "position of the ends"},
            ),
            "frequency": ("frequency", frequency, {"units": "Hz", "long_name": "frequency"}),
            "height": (
                "height",
                heights,
                {"units": "m", "long_name": "height z above or below the root", "positive": "up"},
            ),
        },
    )
    dataset.attrs = describe(scenario) | {
        "title": scenario.title or "current",
        "settled": settled,
        "notes": "\n".join([*prepared.notes(), *notes]),
    }
    if model is not None:
        dataset["model_spectrum"].attrs["comment"] = "as asked" if "asks" in words else "fitted"
    rates = [1 / record.interval / record.time_scale for record in prepared.recordings.values()]
    if rates:
        dataset["flow_spectrum"].attrs["record_rate_hz"] = min(rates)
    if scenario.water.depth is not None:
        dataset.attrs["depth"] = scenario.water.depth
    return dataset


@compiled(**ONCE)
def _ends(system: System) -> Float[Array, "place axis"]:
    shape = system.rest().position
    return system.forces.origin + shape[jnp.array([1, -1])]


def _velocity(
    system: System, points: Float[np.ndarray, "place axis"], times: Float[np.ndarray, " time"]
) -> Float[np.ndarray, "time place axis"]:
    return np.asarray(_over_time(system, jnp.asarray(points), jnp.asarray(times)))


@compiled(**ONCE)
def _over_time(system: System, points: Array, times: Array) -> Array:
    return jax.lax.map(
        lambda time: jax.vmap(system.forces.water.velocity, (0, None))(points, time), times
    )


@compiled(**ONCE)
def _displacements(system: System, times: Array) -> Array:
    """Return how far all that is the same everywhere has moved the water (m)."""
    nowhere = jnp.zeros(system.forces.origin.shape)
    flows = system.forces.water.flows
    moved = [jax.vmap(lambda time, each=each: nowhere + each.displacement(time)) for each in flows]
    return jnp.sum(jnp.stack([move(times) for move in moved]), axis=0)


def _times(scenario: Scenario) -> tuple[Float[np.ndarray, " time"], float]:
    """Return instants that a result would keep, or fewer, and the time between them (s)."""
    duration, interval = scenario.simulation.duration, scenario.output_interval
    interval *= np.ceil(duration / interval / _MOST)
    return np.arange(int(duration / interval + 1e-6) + 1) * interval, float(interval)


def _settled(scenario: Scenario, times: Float[np.ndarray, " time"]) -> tuple[float, list[str]]:
    """Return when the last ramp is over (s), or 0 if next to nothing follows; and what to say."""
    ends = [flow.start + flow.ramp_time for flow in scenario.flow if flow.ramp_time > 0]
    settled, last = max(ends, default=0.0), float(times[-1])
    if not settled:
        return 0.0, []
    if (times >= settled - 1e-9).sum() < _FEWEST:
        text = f"the current comes on until {settled:g} s and the run ends at {last:g} s: "
        return 0.0, [text + "means, deviations and spectra are those of its ramp too"]
    if settled > 0.5 * last:
        text = f"the current comes on until {settled:g} s: means, deviations and spectra are those "
        return settled, [text + f"of the last {last - settled:g} s only"]
    return settled, []


def _heights(prepared: Prepared, low: float, high: float) -> Float[np.ndarray, " height"]:
    """Return heights that hold the arm, the levels of profiles, and all of the water if known."""
    scenario = prepared.scenario
    if scenario.water.depth is not None:
        low, high = min(low, -scenario.water.depth), max(high, 0.0)
    else:
        low, high = low - 0.5 * scenario.arm.length, high + 0.5 * scenario.arm.length
    for recording in prepared.recordings.values():
        if recording.levels is not None:
            low, high = min(low, recording.levels[0]), max(high, recording.levels[-1])
    return np.linspace(low, high, _HEIGHTS)


def _model(
    system: System,
    scenario: Scenario,
    frequency: Float[np.ndarray, " frequency"],
    velocity: Float[np.ndarray, "time axis"],
    times: Float[np.ndarray, " time"],
) -> tuple[Float[np.ndarray, "frequency axis"] | None, str]:
    """Return the spectra that turbulence would have, and in words of which size.

    As the scenario asks for it, carried past at the RMS speed of all that is the same everywhere;
    failing that, of the same deviations and integral times.
    """
    interval = float(times[1] - times[0])
    asked = np.zeros((frequency.size, velocity.shape[1]))
    tables = [flow.model_dump() for flow in scenario.flow]
    for table in tables:
        if table["kind"] == "turbulence":
            moved = np.asarray(_displacements(system, jnp.asarray(times)))
            squares = np.mean((np.diff(moved, axis=0) / interval) ** 2, axis=0)
            if not squares.any():  # nothing carries its eddies past
                continue
            for axis, share in enumerate(squares / squares.sum()):
                asked[:, axis] += von_karman(
                    frequency,
                    table["intensity"] * float(np.linalg.norm(table["mean"])),
                    table["length_scale"] / float(np.sqrt(squares.sum())),
                    float(share),
                )
    if asked.any():
        return asked, "von Karman's spectrum, as the scenario asks for it"
    found = statistics(velocity, interval)
    if not _RANDOM & {table["kind"] for table in tables} or np.isnan(found.integral_time).all():
        return None, ""
    speed = float(np.linalg.norm(found.mean))
    fitted = np.zeros_like(asked)
    for axis in range(velocity.shape[1]):
        along = float(found.mean[axis] / speed) ** 2 if speed > 0 else 1.0
        # across the mean velocity an eddy is half as long
        passing = 2 * found.integral_time[axis] / (1 + along)
        fitted[:, axis] = von_karman(
            frequency, float(found.standard_deviation[axis]), float(passing), along
        )
    return fitted, "von Karman's spectrum of the same deviation and integral time"


def _records(
    recordings: Mapping[int, Recording], duration: float
) -> dict[str, tuple[tuple[str, ...], Any, str, str]]:
    """Return what measured profiles are in the mean at their levels, during the run."""
    found: dict[str, tuple[tuple[str, ...], Any, str, str]] = {}
    for index, recording in recordings.items():
        if recording.levels is None:
            continue
        name, level = f"record_{index}", f"level_{index}"
        played = (recording.run_time >= 0) & (recording.run_time <= duration)
        measured = recording.velocity[played].mean(axis=0)
        found[f"{name}_height"] = ((level,), recording.levels, "m", "height z of the levels")
        found[f"{name}_mean"] = ((level, "axis"), measured, "m s-1", "mean velocity as measured")
    return found
