"""The current of a scenario by itself: sampled at the arm at rest, and summed up in numbers."""

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from crinoid.analysis.measured_sea import SOURCES, sea_rows
from crinoid.analysis.sea_record import NO_MEAN, velocity_statistics
from crinoid.assembly.prepared import Prepared
from crinoid.compilation import ONCE, compiled
from crinoid.dynamics import System
from crinoid.foundation.axes import AXES
from crinoid.numerics.sea_statistics import STATISTICS
from crinoid.numerics.signals_and_systems import integral_time, spectrum, von_karman
from crinoid.recording import Recording
from crinoid.results.dataset import FORWARD, describe, described
from crinoid.scenario import Scenario

_STEADY = 1e-9  # a standard deviation of less than this part of the largest speed is round-off


def current_statistics(
    velocity: Float[np.ndarray, "time axis"], interval: float, axes: Sequence[str]
) -> dict[str, Any]:
    """Sum up a velocity (m/s) sampled at even intervals (s), by names with units.

    Besides `velocity_statistics`, by axis: the standard deviation over the size of the mean
    velocity, the integral time, and how far the mean velocity gets in that (Taylor's frozen
    turbulence). Not a number where there is none.
    """
    carried = float(np.linalg.norm(velocity.mean(axis=0)))
    if carried <= NO_MEAN * np.sqrt(np.mean(np.sum(velocity**2, axis=1))):
        carried = np.nan
    times, listed = _integral_times(velocity, interval), ", ".join(axes)
    return velocity_statistics(velocity, axes) | {
        f"intensity {listed} (%)": 100 * velocity.std(axis=0) / carried,
        f"integral time {listed} (s)": times,
        f"integral length {listed} (m)": carried * times,
    }


def _integral_times(
    velocity: Float[np.ndarray, "time axis"], interval: float
) -> Float[np.ndarray, " axis"]:
    """Return the integral time (s) of each component; not a number of a steady one."""
    round_off = _STEADY * np.abs(velocity).max()
    return np.array([
        integral_time(series, interval) if series.std() > round_off else np.nan
        for series in velocity.T
    ])  # fmt: skip


FLOW = "flow.nc"

PLACES = ("root", "tip")

_MOST = 100_000  # samples that are taken at most
_FEWEST = 64  # samples past the last ramp that make up statistics
_HEIGHTS = 161
_INSTANTS = 1000
_RANDOM = {"gauss-markov", "measured", "turbulence"}
"""Kinds of flow that have a spectrum worth comparing with that of turbulence."""


def sample_current(prepared: Prepared) -> xr.Dataset:
    """Sample the current of a scenario at the arm at rest, without simulating anything.

    The dataset has the velocity over time at root and tip, its spectra, its mean and standard
    deviation over height above and below the root, and of measured profiles those at their levels.
    The attribute ``settled`` is the time (s) at which the last ramp is over: spectra, means and
    deviations are taken from there on. It is 0 where next to nothing of the run is left then, which
    ``notes`` say.
    """
    scenario, system = prepared.scenario, prepared.system
    times, interval = _times(scenario)
    settled, notes = _settled(scenario, times)
    root, tip = np.asarray(_ends(system))
    heights = _heights(prepared, min(root[-1], tip[-1]), max(root[-1], tip[-1]))
    column = np.tile(root, (heights.size, 1))
    column[:, -1] = heights

    velocity = np.asarray(_velocity(system, jnp.stack([root, tip]), jnp.asarray(times)))
    late = times >= settled - 1e-9
    stride = max(1, late.sum() // _INSTANTS)
    late_times = jnp.asarray(times[late][::stride])
    profile = np.asarray(_velocity(system, jnp.asarray(column), late_times))
    holes = np.zeros(times.size, bool)
    for recording in prepared.recordings.values():
        holes |= recording.holes(times, min(root[-1], tip[-1]), max(root[-1], tip[-1]))
    frequency, density, sound, windows = spectrum(velocity[late], interval, holes[late])
    if sound < windows:
        which = f"over {sound} of {windows} windows: the others hold gaps that were filled"
        if not sound:
            which = "over gaps that were filled by straight lines: no window is without"
        notes.append(f"the spectra are means {which}")

    rows = [
        ("flow_velocity", "time place axis", "m s-1", velocity,
         "velocity of the undisturbed water"),
        ("flow_spectrum", "frequency place axis", "m2 s-1", density,
         "one-sided spectral density of the velocity"),
        ("profile_mean", "height axis", "m s-1", profile.mean(axis=0), "mean velocity"),
        ("profile_standard_deviation", "height axis", "m s-1", profile.std(axis=0),
         "standard deviation of the velocity"),
    ]  # fmt: skip
    model, words = _model(system, scenario, frequency, velocity[late, 1], times[late])
    if model is not None:
        rows.append(("model_spectrum", "frequency axis", "m2 s-1", model, words))
    rows += _records(prepared.recordings, float(times[-1])) + sea_rows(prepared)
    axes = root.size
    coords = described([
        ("time", "time", "s", times, "time"),
        ("axis", "axis", "", list(AXES[axes]), FORWARD[axes]),
        ("place", "place", "", list(PLACES), "end of the arm at rest"),
        ("position", "place axis", "m", np.stack([root, tip]), "position of the ends"),
        ("frequency", "frequency", "Hz", frequency, "frequency"),
        ("height", "height", "m", heights, "height z above or below the root"),
    ])  # fmt: skip
    coords["time"][2]["axis"], coords["height"][2]["positive"] = "T", "up"
    if prepared.seas:
        coords |= described(
            [
                ("source", "source", "", list(SOURCES), "of the waves: a file or a sum"),
                ("statistic", "statistic", "", list(STATISTICS), "statistic"),
            ]
        )
    dataset = xr.Dataset(described(rows), coords)
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


@compiled(**ONCE)
def _velocity(
    system: System, points: Float[Array, "place axis"], times: Float[Array, " time"]
) -> Float[Array, "time place axis"]:
    return jax.lax.map(
        lambda time: jax.vmap(system.forces.water.velocity, (0, None))(points, time), times
    )


@compiled(**ONCE)
def _displacements(system: System, times: Array) -> Array:
    """Return how far all that is the same everywhere has moved the water (m)."""
    nowhere, flows = jnp.zeros(system.forces.origin.shape), system.forces.water.flows
    return jax.vmap(lambda time: nowhere + sum(each.displacement(time) for each in flows))(times)


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
    integral_times = _integral_times(velocity, interval)
    if any("wave" in table["kind"] for table in tables):  # their spectrum is no turbulence's
        return None, ""
    if not _RANDOM & {table["kind"] for table in tables} or np.isnan(integral_times).all():
        return None, ""
    mean, deviation = velocity.mean(axis=0), velocity.std(axis=0)
    speed = float(np.linalg.norm(mean))
    fitted = np.zeros_like(asked)
    for axis in range(velocity.shape[1]):
        along = float(mean[axis] / speed) ** 2 if speed > 0 else 1.0
        # across the mean velocity an eddy is half as long
        passing = 2 * integral_times[axis] / (1 + along)
        fitted[:, axis] = von_karman(frequency, float(deviation[axis]), float(passing), along)
    return fitted, "von Karman's spectrum of the same deviation and integral time"


def _records(
    recordings: Mapping[int, Recording], duration: float
) -> list[tuple[str, str, str, Any, str]]:
    """Return rows of the mean of measured profiles at their levels, during the run."""
    found: list[tuple[str, str, str, Any, str]] = []
    for index, recording in recordings.items():
        if recording.levels is None:
            continue
        name, level = f"record_{index}", f"level_{index}"
        played = (recording.run_time >= 0) & (recording.run_time <= duration)
        measured = recording.velocity[played].mean(axis=0)
        found += [
            (f"{name}_height", level, "m", recording.levels, "height z of the levels"),
            (f"{name}_mean", f"{level} axis", "m s-1", measured, "mean velocity as measured"),
        ]
    return found
