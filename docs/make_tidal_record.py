"""Write the record that the built-in scenario `tidal-channel` plays.

    python docs/make_tidal_record.py

It is synthetic: random components with von Karman's spectra, in the layout of a record of an
acoustic Doppler velocimeter, so that a measured file can take its place. Its numbers are those of
such a record: Admiralty Inlet, Nortek Vector, June 2012, instrument axes, 600 s in block means at
8 Hz of seconds 600 to 1200 of `examples/data/dolfyn/vector_data01.VEC` of MHKiT-Python
(BSD-3-Clause). They were read off

    crinoid flow adv.toml

for v and for w, where `adv.toml` plays that file for 595 s as it is, but for a low-pass filter:

    [[flow]]
    kind = "measured"
    file = "admiralty_inlet_adv.nc"
    velocity = ["u", "w"]
    low_pass_hz = 0.3

The filter keeps out the white noise of the instrument, which hides the spectrum of u from about
0.5 Hz on and is no current; this record has none. In the original v swings at 0.2 Hz along with
the mooring that the instrument hung from; here the same deviation is spread as turbulence would.
And of u the original has more from 0.1 to 1 Hz: two to four times the spectral density of this.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

import crinoid.scenario
from crinoid.numerics.signals_and_systems import integral_time, von_karman

RECORD = Path(crinoid.scenario.__file__).parent / "library" / "tidal-channel.nc"

LENGTH, RATE = 600.0, 8.0  # s, Hz

# mean (m/s), standard deviation (m/s), integral time (s); 1 along the mean current, 0 across it
COMPONENTS = {
    "u": (-0.932, 0.038, 14.2, 1.0),
    "v": (-0.025, 0.113, 0.86, 0.0),
    "w": (-0.055, 0.047, 74.0, 0.0),
}

# A record this short has statistics of its own: of the seeds from 0 on, the first one whose
# deviations and integral times are within a tenth of those above.
SEED = 4714


def synthetic(seed: int) -> dict[str, np.ndarray]:
    """Return the components (m/s), each with the mean that it should have.

    Gaussian, by random Fourier coefficients of a record ten times as long, of which a tenth is
    cut out: it neither repeats itself nor lacks what is slower than itself.
    """
    random = np.random.default_rng(seed)
    count = int(LENGTH * RATE)
    frequency = np.fft.rfftfreq(10 * count, 1 / RATE)
    # of white noise with a density of 1 m2 s-2/Hz, one-sided
    level = np.sqrt(10 * count * RATE / 4)
    found = {}
    for name, (mean, deviation, time, along) in COMPONENTS.items():
        # across the mean current, an eddy takes twice its integral time to pass
        density = von_karman(frequency, deviation, (2 - along) * time, along)
        real, imaginary = random.normal(size=(2, frequency.size))
        series = np.fft.irfft(level * np.sqrt(density) * (real + 1j * imaginary))[:count]
        found[name] = mean + series - series.mean()
    return found


def deviates(series: dict[str, np.ndarray]) -> float:
    """Return by how much deviations and integral times are off, as a part of what they should be.

    The deviation is that about the mean of the record, as it was when the numbers were read off.
    """
    return max(
        abs(found / wanted - 1)
        for name, (_, deviation, time, _) in COMPONENTS.items()
        for found, wanted in (
            (series[name].std(), deviation),
            (integral_time(series[name], 1 / RATE), time),
        )
    )


def record(series: dict[str, np.ndarray]) -> xr.Dataset:
    """Return the file's content."""
    time = np.arange(int(LENGTH * RATE)) / RATE
    variables = {
        name: (
            "time",
            values.astype(np.float32),
            {"units": "m s-1", "long_name": f"velocity along instrument axis {name}"},
        )
        for name, values in series.items()
    }
    return xr.Dataset(
        variables,
        {"time": ("time", time, {"units": "s", "long_name": "time since start of the segment"})},
        {
            "Conventions": "CF-1.11",
            "title": "Synthetic stand-in for a record in a tidal channel (not measured)",
            "source": "docs/make_tidal_record.py of crinoid: von Karman spectra, of the mean, "
            "standard deviation and integral time of each component in the MHKiT-Python example "
            "record of Admiralty Inlet (Nortek Vector, June 2012)",
        },
    )


if __name__ == "__main__":
    series = synthetic(SEED)
    encoding = {name: {"zlib": True, "complevel": 9} for name in series}
    record(series).to_netcdf(RECORD, engine="netcdf4", encoding=encoding)
    print(f"wrote {RECORD}; deviations and integral times within {deviates(series):.1%}")
