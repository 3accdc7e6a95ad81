"""Figure of the cycles of curvature: how many have at least a range."""

import numpy as np
from matplotlib.figure import Figure

from crinoid.results.loads import BendingCycles, bending_cycles
from crinoid.results.result import Result
from crinoid.results.units import length_unit
from crinoid.view.figures import style
from crinoid.view.figures.charts.chart import MEMBER_ROLES
from crinoid.view.figures.paper import colour


def has_cycles(run: Result) -> bool:
    """Whether the arm bends to and fro."""
    return any(found.number > 0 for found in _cycles(run).values())


def draw_cycles(run: Result) -> Figure:
    """Draw the cumulative number of cycles over their range, where the range is largest."""
    figure = Figure(figsize=(style.WIDTH, 3.4), layout="constrained")
    axes = figure.subplots()
    for (who, found), role in zip(_cycles(run).items(), MEMBER_ROLES, strict=False):
        if not found.number:
            continue
        place = length_unit(run.known_scenario.arm.length).text(found.station)
        words = f"{found.number:g} cycles {place} from the root, equivalent range "
        words += f"{found.equivalent_range:.3g} 1/m"
        ranges, counts = np.append(found.ranges, 0.0), np.cumsum(found.counts)
        label = ": ".join(part for part in (who, words) if part)
        axes.stairs(counts[::-1], ranges[::-1], color=colour(role), label=label, baseline=None)
    axes.set(xlabel="range of curvature (1/m)", ylabel="cycles of at least this range")
    axes.set_yscale("log")
    axes.set_xlim(left=0.0)
    style.key(axes, 1)
    style.head(figure, run.title, run.status)
    return figure


def _cycles(run: Result) -> dict[str, BendingCycles]:
    found = {who: bending_cycles(each) for who, each in run.members}
    return {who: each for who, each in found.items() if each is not None}
