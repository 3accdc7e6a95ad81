"""Sea states of a file: significant height and peak period of the waves over time."""

import numpy as np
import xarray as xr

from crinoid.recording.numbers import Column
from crinoid.recording.series import values_in
from crinoid.recording.units import length_factor, time_factor

_HEIGHT = "sea_surface_wave_significant_height swh wvht vhm0 hs hm0 significant_wave_height"
_PERIODS = {
    "sea_surface_wave_period_at_variance_spectral_density_maximum pp1d dpd vtpk tp": 1.0,
    "sea_surface_wave_mean_period_from_variance_spectral_density_second_frequency_moment "
    "vtm02 apd": 1.286,
    "sea_surface_wave_mean_period_from_variance_spectral_density_inverse_frequency_moment "
    "vtm10 mwp": 1.107,
}
"""Names of periods, peak periods first, and the peak period over each: of a JONSWAP spectrum with a
peakedness of 3.3 over the mean one between zero crossings, and over the energy period."""
_MARKS = (99.0, 999.0)
"""Marks of missing values in files of NDBC."""


def read_sea_states(dataset: xr.Dataset, file: str, remarks: list[str]) -> xr.DataArray | None:
    """Return significant height (m) and peak period (s) over time, NaN where missing.

    Names are CF standard names, or those of NDBC, ERA5 and Copernicus; None without. A
    `ScenarioError` refuses waves at several places.
    """
    height = _named(dataset, _HEIGHT)
    found = ((_named(dataset, names), factor) for names, factor in _PERIODS.items())
    period, factor = next((each for each in found if each[0]), ("", 1.0))
    if not height or not period:
        return None
    whole = dataset.squeeze()
    sound = {name: whole[name].where(~whole[name].isin(_MARKS)) for name in (height, period)}
    columns = [
        Column("file", height, length_factor, "m", most=40.0),
        Column("file", period, time_factor, "s", most=60.0),
    ]
    values = values_in(whole.assign(sound), columns, whole[height], file, remarks)
    if factor > 1:
        remarks.append(f"{period} is a mean period: peak periods are {factor} times as long")
    values = np.where(values > 0, values, np.nan) * [1.0, factor]
    return xr.DataArray(values, dims=(*whole[height].dims, "quantity"))


def _named(dataset: xr.Dataset, names: str) -> str:
    """Return the first variable with one of some names; empty for none."""
    found = {str(each.attrs.get("standard_name")): str(n) for n, each in dataset.variables.items()}
    found |= {str(name).strip().lower(): str(name) for name in dataset.variables}
    return next((found[name] for name in names.split() if name in found), "")
