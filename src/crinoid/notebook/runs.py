"""A result as the figures see it."""

from __future__ import annotations

import xarray as xr

from crinoid.report.run import Run, with_shapes
from crinoid.result import Result


def run_of(result: Result) -> Run:
    """Return a result and the one without control, as far as their shapes are finite.

    Raises
    ------
    ReportError
        If there is no finite shape.
    """
    other = result.uncontrolled
    return Run(_shown(result.dataset), None if other is None else _shown(other.dataset))


def _shown(data: xr.Dataset) -> xr.Dataset:
    return with_shapes(data, "result") if "position" in data else data
