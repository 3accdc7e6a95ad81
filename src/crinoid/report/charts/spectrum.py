"""Over which frequencies the error of the tip spreads."""

from __future__ import annotations

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.current.spectrum import spectrum
from crinoid.report.charts.chart import MEMBER_ROLES, Chart, Panel, Trace
from crinoid.report.run import Run
from crinoid.report.units import Unit, largest, length_unit
from crinoid.report.view import in_space

_LEAST_RECORDS = 16
_DECADES = 6  # of the spectral density, from its top


def miss(data: xr.Dataset) -> Float[np.ndarray, "time axis=3"]:
    """Return where the tip is, from where it should be (m)."""
    return in_space(data, "tip_position") - in_space(data, "tip_target")


def error_spectrum(
    time: Float[np.ndarray, " time"], off: Float[np.ndarray, "time axis=3"]
) -> tuple[Float[np.ndarray, " frequency"], Float[np.ndarray, " frequency"]] | None:
    """Return frequencies (Hz) and the one-sided density (m2/Hz) of the error's fluctuation.

    That of all its parts together, by Welch's method; none where the run is too short. The last
    instant is left out where it does not lie at the interval of the others.
    """
    if time.size < _LEAST_RECORDS:
        return None
    interval = float(time[1] - time[0])
    even = np.isclose(np.diff(time), interval, rtol=1e-3)
    count = time.size if even.all() else int(np.argmin(even)) + 1
    if count < _LEAST_RECORDS or not np.isfinite(off[:count]).all():
        return None
    found = spectrum(off[:count, None, :], interval)
    return found.frequency, np.asarray(found.density.sum(axis=(1, 2)))


def spectrum_chart(run: Run) -> Chart:
    """Return the spectral density of the tip's error by itself."""
    return Chart("spectrum", "Error over frequency (Hz)", (spectrum_panel(run),))


def spectrum_panel(run: Run) -> Panel:
    """Return the spectral density of the tip's error, with and without control."""
    found = [error_spectrum(data["time"].values, miss(data)) for _, data in run.members]
    known = [each for each in found if each is not None]
    top = largest(*(density for _, density in known))
    name, label = "tip_spectrum", "density of\nthe tip's error"
    if not known or top == 0.0:
        words = "the tip never errs" if known else "too short for a spectrum"
        return Panel(name, label, tall=2.6, nothing=words)
    squares = length_unit(top**0.5)
    traces = []
    for (who, _), each, role in zip(run.members, found, MEMBER_ROLES, strict=False):
        if each is not None:
            frequency, density = each
            values = np.where(density > 0.0, density, np.nan)
            behind = role == "free"
            traces.append(Trace(who or "tip error", frequency, values, role, behind=behind))
    seen = [f[density > top / 10**_DECADES] for f, density in known]
    return Panel(
        name,
        label,
        Unit(squares.factor**2, f"{squares.name}²/Hz"),
        tuple(traces),
        low=top / 10**_DECADES,
        high=3 * top,
        tall=2.6,
        over=(min(float(f[0]) for f, _ in known), 1.3 * max(float(f[-1]) for f in seen if f.size)),
    )
