"""Chart of contact with obstacles, the arm itself and a hull: times, forces and distances."""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from crinoid.results.loads import far_contact
from crinoid.results.metrics import FAR_CONTACTS
from crinoid.results.result import Result
from crinoid.results.scene.data import find_obstacles
from crinoid.results.units import largest, length_unit, si_unit
from crinoid.view.figures.charts.chart import ZERO, Chart, IntervalRow, Panel, Series, Trace

_VARIABLES = (
    *("obstacle_position", "contact_force", "contact_impulse"),
    *("contact_time", "contact_gap", "contact_closest"),
)

_FORCE = Panel("contact_force", "contact\nforce", low=0.0, tall=2.2, columns=3)
_FEW = 50  # saved forces below which peaks are not cut off


class _Body(NamedTuple):
    """An obstacle that the arm may touch, the arm itself or the hull."""

    name: str  # in the rows of times
    short: str  # name of its curves
    order: int  # number of its colour
    behind: bool  # whether it belongs to the run without control
    time: Series
    held: Bool[np.ndarray, " interval"]  # whether it was in contact from one instant to the next
    lasted: float  # time in contact (s)
    force: Series
    mean: Series  # mean force between instants (N); known of obstacles
    gap: Series
    closest: float


def contact_chart(run: Result) -> Chart | None:
    """Return times, forces and distances of contacts; None where the result has no contacts."""
    data = set(run.dataset)
    far = ({f"{part}_force", f"{part}_gap"} <= data for part in FAR_CONTACTS)
    if not (set(_VARIABLES) <= data or any(far)):
        return None
    bodies = [body for label, each in run.members for body in _bodies(label, each)]
    bodies.sort(key=lambda body: body.order)
    return Chart("contact", "Contact", (_when(bodies), _force(bodies), _gap(bodies)))


def _bodies(label: str, result: Result) -> Iterator[_Body]:
    data, count = result.dataset, 0
    time = data["time"].values

    def named(name: str, short: str, order: int) -> tuple[str, str, int, bool, Series]:
        """Return what all bodies have; those of the run without control share a name."""
        if label == "without control":
            return label, f"{short} without", order, True, time
        return name, short, order, False, time

    if set(_VARIABLES) <= set(data):
        count, steps = data.sizes["obstacle"], np.diff(time)
        names = [each.label for each in find_obstacles(result)]
        for index in range(count):
            found = data.isel(obstacle=index)
            total, pushed = found["contact_time"].values, found["contact_impulse"].values
            # of the mean force between records no hit is too short
            mean = np.linalg.norm(np.diff(pushed, axis=0), axis=1) / steps
            force = np.linalg.norm(found["contact_force"].values, axis=1)
            gap, closest = found["contact_gap"].values, float(found["contact_closest"].values[-1])
            about = named(names[index], f"{index}", index)
            yield _Body(*about, np.diff(total) > 0.0, float(total[-1]), force, mean, gap, closest)
    for index, (part, words) in enumerate(FAR_CONTACTS.items()):
        if (far := far_contact(result, part)) is None:
            continue
        name, short = f"the arm {words}" if part == "self" else words, words.split()[-1]
        about, none = named(name, short, count + index), np.zeros(0)
        yield _Body(*about, far.held, far.time, far.force, none, far.gap, far.smallest_gap)


def _when(bodies: list[_Body]) -> Panel:
    rows = []
    for body in bodies:
        time, held = body.time, body.held
        lasted = f"{body.lasted:.3g} s" if body.lasted else "never"
        if time.size == 1:  # an equilibrium lasts no time
            lasted = "yes" if body.force[0] else "no"
        spans = np.stack([time[:-1][held], time[1:][held]], axis=1)
        if len(spans):  # intervals that follow each other are joined
            apart = np.flatnonzero(spans[1:, 0] > spans[:-1, 1])
            begins, ends = spans[np.append(0, apart + 1), 0], spans[np.append(apart, -1), 1]
            spans = np.stack([begins, ends], axis=1)
        name = f"{body.name}: {lasted}"
        rows.append(IntervalRow(name, spans, f"series {body.order}", body.behind))
    tall = 0.55 + 0.17 * len(rows)
    return Panel("contact_when", "in contact", rows=tuple(rows), tall=tall)


def _force(bodies: list[_Body]) -> Panel:
    top = largest(*(values for body in bodies for values in (body.force, body.mean)))
    unit, traces, filled = si_unit(top, "N"), [], False
    for body in bodies:
        if not largest(body.force, body.mean):
            continue
        role = f"series {body.order}"
        if len(body.mean):
            level = np.append(body.mean, body.mean[-1])
            words = f"{body.short}, mean between records"
            traces.append(Trace(words, body.time, level, role, "filled", body.behind, quiet=True))
            filled = True
        summary = f"\u2264 {unit.text(largest(body.force))}"
        traces.append(
            Trace(body.short, body.time, body.force, role, reference=body.behind, summary=summary)
        )
    limit = _spike_limit([body.force for body in bodies])
    panel = replace(_FORCE, unit=unit, traces=tuple(traces), high=limit if top else 1.0)
    left_out = "" if limit is None else f"peaks of up to {unit.text(top)} are cut off"
    panel = replace(panel, nothing="" if top else "nothing presses", left_out=left_out)
    return replace(panel, also=(("mean between records", "filled"),) if filled else ())


def _spike_limit(forces: list[Series]) -> float | None:
    """Return a limit of forces (N) that few and short peaks exceed by far, if there are such."""
    together = np.concatenate(forces)
    held = together[together > 0.0]
    if held.size < _FEW:
        return None
    usual = 1.5 * float(np.quantile(held, 0.98))
    return usual if float(held.max()) > 2 * usual else None


def _gap(bodies: list[_Body]) -> Panel:
    traces = []
    for body in bodies:
        summary = f"\u2265 {length_unit(abs(body.closest)).text(body.closest)}"
        role = f"series {body.order}"
        traces.append(
            Trace(body.short, body.time, body.gap, role, reference=body.behind, summary=summary)
        )
    unit = length_unit(largest(*(body.gap for body in bodies)))
    label = "distance from\nthe arm"
    return Panel("contact_gap", label, unit, tuple(traces), ZERO, tall=2.0, columns=3)
