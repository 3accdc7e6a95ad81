"""Notes on a run: facts that a user should know and its numbers alone do not say."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float, Int

from crinoid.assembly.prepared import Prepared
from crinoid.dimensionless import MOTION, across, normal_velocity, spinning
from crinoid.dynamics import Grip, round_off_note
from crinoid.pieces import pieces
from crinoid.plausibility.facts import Facts
from crinoid.scenario import Scenario, Tool, shown
from crinoid.scenario.water import Water

_LOCK_IN = (4.0, 8.0)
"""Reduced velocities at which shedding follows a vibration (Williamson and Govardhan 2004)."""
_CYCLES = 3.0
"""Periods of a mode that lock-in must last: it takes some to build up, and swings reverse it."""
_SHEDDING = 50.0
"""Reynolds number above which vortices are shed (Williamson 1996: 49)."""
_WORTH = 0.05
"""Share of the time, and of the length, from which on something is worth a note."""
_SUBCRITICAL = (1e3, 1e5)
"""Reynolds numbers between which the drag coefficient of a cylinder hardly changes
(Sumer and Fredsoe 2006, chapter 2)."""
_FELT = 0.1
"""Share of the largest force on the base that drag must reach to be worth a note."""
_PRESSED = 0.01
"""Share of the arm's radius that a surface may come into it: its skin is as good as through."""
_AIR = 10.0
"""Density of water below which its drag damps no errors (kg/m3)."""
_ACCUMULATED = 0.1
"""Sum of the local errors of all steps, over the motion of the tip, from which on it is visible."""
_STRAIN = 0.5
"""Strain that no linear elasticity describes."""
_TORN = 10.0
"""Length of an edge over that at rest, or the inverse, that no rubber bears (Treloar 1975)."""

Strains = Float[np.ndarray, "time edge"]


def notes(dataset: xr.Dataset, scenario: Scenario) -> list[str]:
    """Return sentences about a finished run; none where there is nothing to say."""
    found = [
        _unread(dataset),
        _unstable(dataset, scenario),
        _stretch(dataset),
        _round_off(dataset, scenario),
        _vortices(dataset, scenario),
        _drag(dataset, scenario),
        _accumulated(dataset, scenario),
    ]
    return [*_pressed(dataset), *(note for note in found if note)]


def tool_notes(tool: Tool | None, grip: Grip | None) -> list[str]:
    """Return when touches had the tip take up its tool and let it go, a sentence each.

    ``grip`` is that of the end of a run; None where touches decide nothing.
    """
    if tool is None or grip is None:
        return []
    taken, dropped, told = float(grip.taken), float(grip.dropped), []
    part = f"did not touch the part {shown(tool.touched)} of the arm"
    if tool.take_at_touch is not None:
        touched = f"obstacle {tool.take_at_touch}"
        if np.isinf(taken):
            since = f" from {tool.from_:g} s on" if tool.from_ else ""
            return [f"the tool was never taken up: {touched} {part}{since}"]
        told.append(f"the tool was taken up at t = {taken:.6g} s, when {touched} was touched")
    if tool.drop_at_touch is not None:
        touched = f"obstacle {tool.drop_at_touch}"
        if dropped == (np.inf if tool.until is None else tool.until):
            told.append(f"the tool was not let go at a touch: {touched} {part} while it was held")
        else:
            told.append(f"the tool was let go at t = {dropped:.6g} s, when {touched} was touched")
    return told


def _accumulated(dataset: xr.Dataset, scenario: Scenario) -> str:
    """Return a note if local errors of the steps add up to a visible part of the motion of the tip.

    Feedback and contact damp these errors, and so does drag on a pinned arm: then there is no note.
    Material damping ends the effect of an error within ``1 / (zeta omega)`` of the first mode.
    """
    tip = dataset["tip_position"].transpose("time", "axis").values
    moved = float(np.linalg.norm(tip - tip[0], axis=1).max())
    dragged = scenario.base.mount == "pinned" and scenario.water.density > _AIR
    driven = scenario.control.kind != "none" or scenario.obstacle
    if dragged or driven or moved < 1e-6 * scenario.arm.length:
        return ""
    simulation, rate = scenario.simulation, 2 * np.pi * Facts(Prepared(scenario)).frequencies[0]
    memory = 2 / max(rate**2 * scenario.arm.damping_time, 1e-300)
    each = min(simulation.duration, float(memory)) / simulation.time_step
    share = float(dataset["step_error"].mean()) * each / moved
    if share <= _ACCUMULATED:
        return ""
    return (
        f"errors of the time steps may add up to {share:.0%} of the motion of the tip: "
        f"compare with simulation.time_step = {simulation.time_step / 2:.3g}"
    )


def _pressed(dataset: xr.Dataset) -> list[str]:
    if "contact_closest" not in dataset:
        return []
    closest = dataset["contact_closest"].values[-1]
    radius = float(dataset["diameter"].min()) / 2
    return [
        f"obstacle {index} pressed {-1e3 * gap:.2g} mm into the arm, harder than its surface is "
        "made for: leave the arm room to give way, or let the obstacle be slower or lighter"
        for index, gap in enumerate(closest)
        if gap < -_PRESSED * radius
    ]


def _unread(dataset: xr.Dataset) -> str:
    for piece in pieces(dataset, ["sensor_reading"]) if "sensor_reading" in dataset else ():
        for time, reading in np.argwhere(~np.isfinite(piece["sensor_reading"].values)):
            name, since = piece["reading"].values[reading], float(piece["time"][time])
            return f"the sensor reading {name} is not finite at t = {since:.6g} s"
    return ""


def _unstable(dataset: xr.Dataset, scenario: Scenario) -> str:
    if scenario.simulation.start != "equilibrium" or "natural_frequency" not in dataset:
        return ""
    count = int((dataset["natural_frequency"] == 0).sum())
    if not count:
        return ""
    which = "its slowest mode" if count == 1 else f"its {count} slowest modes"
    return (
        f"the equilibrium at the start does not bring the arm back when it is pushed in {which}: "
        "these loads may leave it none that does"
    )


def _stretch(dataset: xr.Dataset) -> str:
    longest, shortest = -np.inf, np.inf
    for _, strain in _strains(dataset):
        longest, shortest = max(longest, float(strain.max())), min(shortest, float(strain.min()))
    if max(longest, -shortest) <= _STRAIN:
        return ""
    how = f"stretched by up to {longest:.0%}"
    if -shortest > longest:
        how = f"squeezed by up to {-shortest:.0%}"
    return f"the arm is {how}: its linear elasticity does not hold there"


def torn(dataset: xr.Dataset) -> str:
    """Say when an edge first is as long, or as short, as no material lets it be; empty if never."""
    for time, strain in _strains(dataset):
        least = np.maximum(1 + strain.min(axis=1), np.finfo(float).tiny)
        share = np.maximum(1 + strain.max(axis=1), 1 / least)
        if share.max() > _TORN:
            first = int(np.argmax(share > _TORN))
            what = f"an edge of the arm is {share[first]:.3g} times longer or shorter than at rest"
            remedy = "a larger arm.youngs_modulus or arm.section.EA, or weaker loads"
            when = f"failed at t = {time[first]:.6g} s"
            return f"{when}: {what}, and no arm bears {_TORN:g}; try {remedy}"
    return ""


def _strains(dataset: xr.Dataset) -> Iterator[tuple[Float[np.ndarray, " time"], Strains]]:
    """Yield instants (s) with the strain of each edge, a piece of the run at a time."""
    for piece in pieces(dataset, ["position"]):
        edges = np.linalg.norm(np.diff(piece["position"].values, axis=1), axis=2)
        yield piece["time"].values, edges / np.diff(dataset["arc_length"].values) - 1


def _round_off(dataset: xr.Dataset, scenario: Scenario) -> str:
    facts = Facts(Prepared(scenario))
    largest = float(np.linalg.norm(dataset["base_force"].values, axis=1).max())
    bending = float(facts.bending.min())
    return round_off_note(facts.stretching, bending, facts.length, facts.edge, largest)


def _vortices(dataset: xr.Dataset, scenario: Scenario) -> str:
    if "reduced_velocity" not in dataset:
        return ""
    time, diameter = dataset["time"].values, dataset["diameter"].values
    modes = _bending(dataset)
    frequency = dataset["natural_frequency"].sel(mode=modes).values
    lasting = [Lasting(time, _CYCLES / each) for each in frequency]
    for piece in pieces(dataset, MOTION):
        speed = np.linalg.norm(normal_velocity(piece), axis=2)
        sheds = speed * diameter > _SHEDDING * scenario.water.kinematic_viscosity
        for each, its in zip(frequency, lasting, strict=True):
            reduced = speed / (each * diameter)
            its.follow(sheds & (reduced > _LOCK_IN[0]) & (reduced < _LOCK_IN[1]))
    struck = []
    for mode, each, its in zip(modes, frequency, lasting, strict=True):
        part = its.share(_length_share(dataset))
        at = part > _WORTH
        if at.mean() > _WORTH:
            struck.append(
                f"mode {mode} ({each:.2g} Hz) for {at.mean():.0%} of the time on "
                f"{part[at].mean():.0%} of the length"
            )
    if not struck:
        return ""
    where = "out of the plane of the arm"
    if dataset.sizes["axis"] == 3:
        where = "across both arm and current"
    return (
        f"vortex shedding may lock in to {', '.join(struck)} (4 < U/fd < 8); its lift, {where}, "
        "is not modelled"
    )


def _bending(dataset: xr.Dataset) -> list[int]:
    """Return the modes that move the arm across itself rather than along, or about, itself."""
    shape = dataset["mode_shape"].values
    normal = across(shape, dataset["tangent"].isel(time=[0]).values)
    bends = np.sum(normal**2, axis=(1, 2)) > 0.5 * np.sum(shape**2, axis=(1, 2))
    spin = dataset["mode_spin"].values if "mode_spin" in dataset else None
    bends &= ~spinning(shape, spin, dataset["diameter"].values)
    return [int(mode) for mode in dataset["mode"].values[bends]]


class Lasting:
    """A condition that holds at nodes for some time on end, told of instants in pieces.

    Parameters
    ----------
    time
        All instants (s).
    least
        For how long it must be true to count (s).
    """

    def __init__(self, time: Float[np.ndarray, " time"], least: float) -> None:
        self._time, self._least = time, least
        self._told = 0
        self._since: Int[np.ndarray, " node"] = np.zeros(0, int)
        """From which instant on it has been true; -1 where it is not."""
        self._spans: list[Int[np.ndarray, "span 3"]] = []
        """Node, first instant and the one after the last."""

    def follow(self, inside: Bool[np.ndarray, "time node"]) -> None:
        """Go on with what is true at the instants that follow."""
        if not self._told:
            self._since = np.full(inside.shape[1], -1)
        before = self._since >= 0
        edges = np.diff(np.concatenate([before[None], inside]).astype(np.int8), axis=0).T
        (node, begin), (_, end) = np.nonzero(edges == 1), np.nonzero(edges == -1)
        # spans begin and end by turns at each node: put the open ones first
        nodes = np.concatenate([np.flatnonzero(before), node])
        begins = np.concatenate([self._since[before], begin + self._told])
        order = np.lexsort((begins, nodes))
        nodes, begins = nodes[order], begins[order]
        last = np.append(nodes[1:] != nodes[:-1], True)[: nodes.size]
        still = last & inside[-1, nodes]
        self._since = np.full(inside.shape[1], -1)
        self._since[nodes[still]] = begins[still]
        self._add(nodes[~still], begins[~still], end + self._told)
        self._told += inside.shape[0]

    def share(self, of: Float[np.ndarray, " node"]) -> Float[np.ndarray, " time"]:
        """Return the sum over the nodes where it is true for long enough, at each instant."""
        open_ = np.flatnonzero(self._since >= 0)
        self._add(open_, self._since[open_], np.full(open_.size, self._told))
        node, begin, end = np.concatenate(self._spans).T
        marks = np.zeros((2, self._told + 1))
        np.add.at(marks[0], begin, of[node])
        np.add.at(marks[1], end, of[node])
        return np.cumsum(marks[0] - marks[1])[:-1]

    def _add(self, node: np.ndarray, begin: np.ndarray, end: np.ndarray) -> None:
        long = self._time[end - 1] - self._time[begin] >= self._least
        self._spans.append(np.stack([node[long], begin[long], end[long]], axis=1))


def _drag(dataset: xr.Dataset, scenario: Scenario) -> str:
    water = scenario.water
    if "reynolds_number" not in dataset or water.drag_normal != Water().drag_normal:
        return ""
    diameter = dataset["diameter"].values
    total = most = reached = outside = 0.0
    for piece in pieces(dataset, MOTION):
        speed = np.linalg.norm(normal_velocity(piece), axis=2)
        drag = diameter * speed**2 * _length_share(dataset)
        reynolds = speed * diameter / water.kinematic_viscosity
        beyond = (reynolds < _SUBCRITICAL[0]) | (reynolds > _SUBCRITICAL[1])
        total, most = total + drag.sum(), max(most, drag.sum(axis=1).max())
        reached, outside = reached + np.sum(reynolds * drag), outside + np.sum(drag[beyond])
    length = float(dataset["arc_length"][-1])
    largest = 0.5 * water.density * water.drag_normal * length * most
    if largest < _FELT * np.linalg.norm(dataset["base_force"].values, axis=1).max() or not largest:
        return ""
    if outside <= 0.5 * total:
        return ""
    return (
        f"most of the drag acts at Reynolds numbers near {reached / total:.2g}; "
        f"the default water.drag_normal = {water.drag_normal:g} is for 1e3 to 1e5"
    )


def _length_share(dataset: xr.Dataset) -> Float[np.ndarray, " node"]:
    """Return the share of the arm's length that each node owns."""
    arc_length = dataset["arc_length"].values
    return np.convolve(np.diff(arc_length), [0.5, 0.5]) / arc_length[-1]
