"""Statistics of surface waves from the variance of each frequency and direction."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

_SHARE = 0.2  # share of the variance in the band about the peak of a spectrum

STATISTICS = (
    *("significant height (m)", "peak period (s)", "energy period (s)"),
    *("direction of travel (deg)", "directional spreading (deg)"),
)
"""Names and units of the statistics."""


class SeaStatistics(NamedTuple):
    """Statistics of surface waves."""

    height: float  # significant height: four standard deviations (m)
    peak_period: float
    """Period in the middle of the narrowest band with a fifth of the variance (s)."""
    energy_period: float  # mean period, weighted by the variance (s)
    direction: float  # mean direction of travel (rad); NaN where it is unknown
    spreading: float
    """Circular standard deviation of the direction (rad; Kuik et al. 1988), NaN as above."""

    @staticmethod
    def of(
        frequency: Float[np.ndarray, " f"],
        variance: Float[np.ndarray, "f ..."],
        direction: Float[np.ndarray, " direction"] | None = None,
    ) -> SeaStatistics:
        """Return the statistics of a variance (m2) at increasing frequencies (Hz).

        ``direction`` (rad) is that of each frequency, or of the second axis of ``variance``.
        """
        total, along = float(variance.sum()), variance.reshape(frequency.size, -1).sum(axis=1)
        edges = np.r_[frequency[0], 0.5 * (frequency[1:] + frequency[:-1]), frequency[-1]]
        starts, below = np.linspace(0.0, 1 - _SHARE, 1001), np.append(0.0, np.cumsum(along)) / total
        first, last = (np.interp(share, below, edges) for share in (starts, starts + _SHARE))
        narrow = int(np.argmin(last - first))
        vector = np.nan if direction is None else np.sum(variance * np.exp(1j * direction)) / total
        return SeaStatistics(
            height=4 * total**0.5,
            peak_period=float(2 / (first[narrow] + last[narrow])),
            energy_period=float(np.sum(along / frequency) / total),
            direction=float(np.angle(vector)),
            spreading=float(np.sqrt(2 * np.maximum(0.0, 1 - np.abs(vector)))),
        )

    @staticmethod
    def of_record(values: Float[np.ndarray, " time"], interval: float) -> SeaStatistics:
        """Return the statistics of an elevation (m) at even intervals (s), without its trend."""
        place = np.linspace(-1.0, 1.0, values.size)
        fluctuation = values - np.polynomial.Polynomial.fit(place, values, 2)(place)
        energy = np.abs(np.fft.rfft(fluctuation * np.hanning(values.size))[1:]) ** 2
        energy *= np.mean(fluctuation**2) / energy.sum()
        return SeaStatistics.of(np.fft.rfftfreq(values.size, interval)[1:], energy)

    def values(self) -> list[float]:
        """Return them in the units of `STATISTICS`."""
        return [*self[:3], *np.rad2deg(self[3:]).tolist()]

    def __str__(self) -> str:
        pairs = zip(STATISTICS, self.values(), strict=True)
        return ", ".join(f"{name} {value:.4g}" for name, value in pairs if not np.isnan(value))
