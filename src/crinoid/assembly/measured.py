"""From a measured current to the splines that play it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from crinoid.assembly.numbers import array
from crinoid.flow import MeasuredPoint, MeasuredProfile
from crinoid.flow.flow import panels_of
from crinoid.onset import Onset
from crinoid.spline import PiecewisePolynomial, between

if TYPE_CHECKING:
    from crinoid.recording import Recording  # xarray, slow to load


def measured(
    onset: Onset, recording: Recording, origin: tuple[float, ...]
) -> MeasuredPoint | MeasuredProfile:
    """Return the flow of a recording; that of one point is met at ``origin`` (m)."""
    from scipy.interpolate import CubicSpline  # slow to load, and few scenarios need it

    stage = recording.stage
    delay = stage.reach * float(np.linalg.norm(recording.slowness))

    def played(values: Float[np.ndarray, "time column"]) -> PiecewisePolynomial:
        spline = CubicSpline(recording.run_time, values)
        return PiecewisePolynomial(between(spline, -delay, stage.duration + delay))

    if recording.levels is None:
        return MeasuredPoint(
            onset,
            played(recording.velocity[:, 0]),
            array(origin),
            array(recording.slowness),
            carried=bool(np.any(recording.slowness)),
            panels=panels_of(float(onset.ramp_time), 4 * recording.interval * recording.time_scale),
        )
    values = recording.velocity
    slopes = CubicSpline(recording.levels, values, axis=1)(recording.levels, 1)
    # beyond the outermost levels nothing changes with height: so it ends there without a kink
    slopes[:, [0, -1]] = 0.0
    columns = np.stack([values, slopes], axis=2).reshape(len(values), -1)
    return MeasuredProfile(onset, played(columns), array(recording.levels))
