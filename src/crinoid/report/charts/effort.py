"""Work of the solver: how many iterations of Newton's method a step took."""

import numpy as np
import xarray as xr

from crinoid.report.charts.chart import MEMBER_ROLES, Chart, Panel, Trace
from crinoid.report.run import Run
from crinoid.report.units import largest


def effort_chart(run: Run) -> Chart:
    """Return Newton iterations a step, with and without control."""
    traces = []
    for (label, data), role in zip(run.members, MEMBER_ROLES, strict=False):
        found = _iterations(data)
        if found is not None:
            time, behind = data["time"].values, role == "free"
            traces.append(Trace(label, time, found, role, behind=behind))
    top = largest(*(trace.values for trace in traces))
    panel = Panel(
        "newton_iterations",
        "Newton iterations\na step",
        None,
        tuple(traces),
        low=0.0,
        high=1.08 * top or 1.0,
        tall=1.6,
        nothing="" if traces else "no iterations recorded",
    )
    return Chart("effort", "Solver", (panel,))


def _iterations(data: xr.Dataset) -> np.ndarray | None:
    """Return iterations a step since the instant before; 0 where there was none."""
    if not {"newton_iterations", "steps"} <= set(data):
        return None
    steps = np.asarray(data["steps"].values, float)
    spent = np.asarray(data["newton_iterations"].values, float)
    return np.divide(spent, steps, out=np.zeros_like(spent), where=steps > 0)
