"""Spectral densities of the tip's error and of the loads on the base, from the time that counts."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.numerics.signals_and_systems import spectrum
from crinoid.results.errors import error_word, judged_or_all
from crinoid.results.result import Result
from crinoid.results.scene.data import base_word, in_space
from crinoid.results.scene.mount import Path
from crinoid.results.units import Unit, largest, length_unit, si_unit, without_round_off
from crinoid.view.figures.charts.chart import MEMBER_ROLES, Chart, Panel, Series, Trace

_LEAST_RECORDS = 16
_DECADES = 6  # of a spectral density, from its top

Frequencies = Float[np.ndarray, " frequency"]


def miss(run: Result, data: xr.Dataset) -> Path:
    """Return the displacement of the tip from its target in one of the members of a run (m)."""
    off = in_space(data, "tip_position") - in_space(data, "tip_target")
    return without_round_off(off, run.known_scenario.arm.length)


def fluctuation_spectrum(
    time: Series, values: Float[np.ndarray, "time axis"]
) -> tuple[Frequencies, Frequencies] | None:
    """Return frequencies (Hz) and the one-sided density of a fluctuation, in its unit squared a Hz.

    The sum over the components, by Welch's method; None if the run is too short. The last instant
    is left out if its interval differs from the others.
    """
    if time.size < _LEAST_RECORDS:
        return None
    interval = float(time[1] - time[0])
    even = np.isclose(np.diff(time), interval, rtol=1e-3)
    count = time.size if even.all() else int(np.argmin(even)) + 1
    if count < _LEAST_RECORDS or not np.isfinite(values[:count]).all():
        return None
    found = spectrum(values[:count, None, :], interval)
    return found.frequency, np.asarray(found.density.sum(axis=(1, 2)))


def spectrum_chart(run: Result) -> Chart:
    """Return the chart of the spectral density of the tip's error."""
    word = error_word(run.known_scenario).removeprefix("tip ").capitalize()
    return Chart("spectrum", f"{word} over frequency (Hz)", (spectrum_panel(run),))


def spectrum_panel(run: Result) -> Panel:
    """Return the spectral density of the tip's error, with and without control."""
    word = error_word(run.known_scenario)
    panel = Panel("tip_spectrum", f"density of\n{word}", tall=2.6)
    return _panel(run, panel, partial(miss, run), length_unit, word, "the tip does not move")


def load_chart(run: Result) -> Chart | None:
    """Return the spectral densities of force and moment on the base; None if neither has one."""
    base, panels = base_word(run.known_scenario), []
    for name, word, unit in (("base_force", "force", "N"), ("base_moment", "moment", "N m")):

        def load(data: xr.Dataset, name: str = name) -> Float[np.ndarray, "time axis"]:
            values = data[name].values if name in data else np.zeros(data.sizes["time"])
            return values.reshape(len(values), -1)

        panel = Panel(f"{name}_spectrum", f"density of the\n{word} on {base}", tall=2.6)
        panels.append(
            _panel(
                run, panel, load, partial(si_unit, name=unit), word, f"the {word} does not change"
            )
        )
    ends = [panel.over for panel in panels if panel.over]
    if not ends:
        return None
    over = min(low for low, _ in ends), max(high for _, high in ends)
    aligned = (replace(panel, over=panel.over and over) for panel in panels)
    return Chart("loads", f"Loads on the {base} over frequency (Hz)", tuple(aligned))


def _panel(
    run: Result,
    panel: Panel,
    values: Callable[[xr.Dataset], Float[np.ndarray, "time axis"]],
    unit_of: Callable[[float], Unit],
    name: str,
    still: str,
) -> Panel:
    """Return a panel with the densities of a quantity, with and without control."""
    judged = [each.dataset.isel(time=judged_or_all(each)) for _, each in run.members]
    found = [fluctuation_spectrum(data["time"].values, values(data)) for data in judged]
    known = [each for each in found if each is not None]
    top = largest(*(density for _, density in known))
    if not known or top == 0.0:
        return replace(panel, nothing=still if known else "too short for a spectrum")
    root = unit_of(top**0.5)
    traces = []
    for (who, _), each, role in zip(run.members, found, MEMBER_ROLES, strict=False):
        if each is not None:
            frequency, density = each
            shown = np.where(density > 0.0, density, np.nan)
            traces.append(Trace(who or name, frequency, shown, role))
    seen = [f[density > top / 10**_DECADES] for f, density in known]
    label = f"({root.name})²/Hz" if " " in root.name else f"{root.name}²/Hz"
    unit, low = Unit(root.factor**2, label), top / 10**_DECADES
    over = min(float(f[0]) for f, _ in known), 1.3 * max(float(f[-1]) for f in seen if f.size)
    return replace(panel, unit=unit, traces=tuple(traces), low=low, high=3 * top, over=over)
