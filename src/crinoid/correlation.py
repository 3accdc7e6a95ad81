"""How long a random series remembers itself."""

import numpy as np
from jaxtyping import Float


def integral_time(series: Float[np.ndarray, " time"], interval: float) -> float:
    """Return the integral of the autocorrelation up to where it first crosses zero (s).

    Past there it is mostly noise: a record is finite, and its mean has been taken off.
    """
    fluctuation = series - series.mean()
    # twice as long, so that the end does not meet the start (Wiener and Khinchin)
    spectrum = np.abs(np.fft.rfft(fluctuation, 2 * series.size)) ** 2
    correlation = np.fft.irfft(spectrum)[: series.size]
    correlation = correlation / correlation[0]
    negative = np.flatnonzero(correlation <= 0)  # there are some: all of them add up to -1/2
    last = int(negative[0])
    before, after = correlation[last - 1], correlation[last]
    to_zero = before / (before - after)
    whole = correlation[:last].sum() - 0.5 * (correlation[0] + before)
    return float(interval * (whole + 0.5 * before * to_zero))
