"""Notes on a finished run: strains, contact, vortices, drag, and errors of the solution."""

from collections.abc import Iterator

import numpy as np
import xarray as xr

from crinoid.assembly.facts import Facts
from crinoid.diagnostics.lock_in import lock_in_note
from crinoid.dynamics import GripState, round_off_note
from crinoid.elements.water import cylinder_drag
from crinoid.foundation.fixed_numbers import CANDIDATES
from crinoid.results.chunks import pieces
from crinoid.results.dimensionless import MOTION, length_share, normal_velocity
from crinoid.results.loads import largest_strain, stretch_of_edges
from crinoid.results.result import Result
from crinoid.scenario import Scenario, Tool, percent, shown
from crinoid.scenario.water import Water

_SUBCRITICAL = (1e3, 1e5)
"""Reynolds numbers between which the drag coefficient of a cylinder hardly changes
(Sumer and Fredsoe 2006, chapter 2)."""
_CRISIS = 2e5  # Reynolds number at which the drag of a smooth cylinder falls
_OFF = 1.5  # factor between a given drag coefficient and that of a cylinder that deserves a note
_DRAG_SHARE = 0.1  # share of the largest force on the base above which drag deserves a note
_PRESSED = 0.01  # penetration over the arm's radius above which contact deserves a note
_AIR = 10.0  # density of the fluid below which its drag damps no errors (kg/m3)
_ACCUMULATED = 0.1
"""Sum of the local errors of all steps, over the motion of the tip, above which it is visible."""
_STRAIN = 0.5  # strain above which linear elasticity is wrong
_TORN = 10.0
"""Length of an edge over that at rest, or the inverse, at which rubber tears (Treloar 1975)."""


def notes(dataset: xr.Dataset, facts: Facts) -> list[str]:
    """Return the notes on a finished run, a sentence each."""
    scenario = facts.scenario
    found = [
        _unread(dataset),
        _unstable(dataset, scenario),
        _stretch(dataset),
        _round_off(dataset, facts),
        lock_in_note(dataset, facts),
        _drag(dataset, scenario),
        _accumulated(dataset, facts),
    ]
    return [*_pressed(dataset), *(note for note in found if note)]


def tool_notes(tool: Tool | None, grip: GripState | None) -> list[str]:
    """Return when touches made the tip take or release its tool, a sentence each.

    ``grip`` is that at the end of a run; None where touches decide nothing.
    """
    if tool is None or grip is None:
        return []
    taken, dropped, found = float(grip.taken), float(grip.dropped), []
    part = f"did not touch the part {shown(tool.touched)} of the arm"
    if tool.take_at_touch is not None:
        touched = f"obstacle {tool.take_at_touch}"
        if np.isinf(taken):
            since = f" from {tool.from_:g} s on" if tool.from_ else ""
            return [f"the tip never took the tool: {touched} {part}{since}"]
        found.append(f"the tip took the tool at t = {taken:.6g} s, when it touched {touched}")
    if tool.drop_at_touch is not None:
        touched = f"obstacle {tool.drop_at_touch}"
        if dropped == (np.inf if tool.until is None else tool.until):
            found.append(f"no touch released the tool: {touched} {part} while the tip had it")
        else:
            then = f"at t = {dropped:.6g} s, when it touched {touched}"
            found.append(f"the tip released the tool {then}")
    return found


def _accumulated(dataset: xr.Dataset, facts: Facts) -> str:
    """Return a note if the local errors of the steps add up to a visible motion of the tip.

    Feedback and contact damp these errors, and so does drag on a pinned arm: then there is no note.
    Material damping ends the effect of an error within ``1 / (zeta omega)`` of the first mode.
    """
    scenario = facts.scenario
    tip = dataset["tip_position"].transpose("time", "axis").values
    moved = float(np.linalg.norm(tip - tip[0], axis=1).max())
    dragged = scenario.base.mount == "pinned" and scenario.water.density > _AIR
    driven = scenario.control.acts or scenario.obstacle
    if dragged or driven or moved < 1e-6 * scenario.arm.length:
        return ""
    simulation, rate = scenario.simulation, 2 * np.pi * facts.frequencies[0]
    memory = 1 / max(rate * facts.damping_ratio, 1e-300)
    each = min(simulation.duration, float(memory)) / simulation.time_step
    share = float(dataset["step_error"].mean()) * each / moved
    if share <= _ACCUMULATED:
        return ""
    return (
        f"errors of the time steps may add up to {percent(share)} of the motion of the tip. "
        f"Compare with simulation.time_step = {simulation.time_step / 2:.3g}."
    )


def _pressed(dataset: xr.Dataset) -> Iterator[str]:
    """Yield notes on contacts in which the arm was pressed deeper than their model is valid."""
    radius = float(dataset["diameter"].min()) / 2

    def deep(contact: str, gap: float, remedy: str) -> Iterator[str]:
        if gap < -_PRESSED * radius:
            yield (
                f"{contact} by {-1e3 * gap:.2g} mm, beyond the valid range of the contact model. "
                f"{remedy}"
            )

    if "contact_closest" in dataset:
        remedy = "Give the arm clearance, or make the obstacle slower or lighter."
        for index, gap in enumerate(dataset["contact_closest"].values[-1]):
            yield from deep(f"obstacle {index} penetrated the arm", gap, remedy)
    if "self_gap" in dataset:
        remedy = "Use more arm.nodes or weaker actuators."
        yield from deep("the arm penetrated itself", float(dataset["self_gap"].min()), remedy)
        most, pairs = CANDIDATES * dataset.sizes["edge"], int(dataset["self_pairs"].max())
        if pairs > most:
            yield (
                f"{pairs} pairs of edges pressed on each other at once. The solver counts the "
                f"nearest {most}, so forces are missing. Use fewer arm.nodes."
            )
    if "hull_gap" in dataset:
        remedy = "Use more arm.nodes, weaker actuators, or channels that turn it less."
        yield from deep("the arm penetrated the hull", float(dataset["hull_gap"].min()), remedy)


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
        f"the equilibrium at the start is unstable in {which}. A stable equilibrium may not exist "
        "under these loads."
    )


def _stretch(dataset: xr.Dataset) -> str:
    longest, shortest = -np.inf, np.inf
    for piece in pieces(dataset, ["position"]):
        strain = stretch_of_edges(piece)
        longest, shortest = max(longest, float(strain.max())), min(shortest, float(strain.min()))
    if max(longest, -shortest) <= _STRAIN:
        surface = largest_strain(Result(dataset))
        if surface is None or not surface.value > _STRAIN:
            return ""
        return (
            f"the largest strain at the surface is {surface.value:.0%}, beyond the valid range of "
            "linear elasticity"
        )
    stretched = longest >= -shortest
    how = f"stretched by {longest:.0%}" if stretched else f"compressed by {-shortest:.0%}"
    return f"the arm is {how}, beyond the valid range of linear elasticity"


def tear_failure(dataset: xr.Dataset) -> str:
    """Return the failure of a run in which an edge tears; empty if none does."""
    for piece in pieces(dataset, ["position"]):
        time, strain = piece["time"].values, stretch_of_edges(piece)
        least = np.maximum(1 + strain.min(axis=1), np.finfo(float).tiny)
        share = np.maximum(1 + strain.max(axis=1), 1 / least)
        if share.max() > _TORN:
            first = int(np.argmax(share > _TORN))
            return (
                f"failed at t = {time[first]:.6g} s: an edge of the arm is {share[first]:.3g} "
                f"times longer or shorter than at rest, and the limit is {_TORN:g}; try a larger "
                "arm.youngs_modulus or arm.section.EA, or weaker loads"
            )
    return ""


def _round_off(dataset: xr.Dataset, facts: Facts) -> str:
    largest = float(np.linalg.norm(dataset["base_force"].values, axis=1).max())
    bending = float(facts.bending.min())
    return round_off_note(facts.stretching, bending, facts.length, facts.edge, largest)


def _drag(dataset: xr.Dataset, scenario: Scenario) -> str:
    water = scenario.water
    if "reynolds_number" not in dataset:
        return ""
    literature = water.coefficients == "literature"
    diameter = dataset["diameter"].values
    total = most = reached = outside = off = known = 0.0
    for piece in pieces(dataset, MOTION):
        speed = np.linalg.norm(normal_velocity(piece), axis=2)
        drag = diameter * speed**2 * length_share(dataset)
        reynolds = speed * diameter / water.kinematic_viscosity
        cylinder = cylinder_drag(np.maximum(reynolds, 1e-4))
        beyond = (reynolds < _SUBCRITICAL[0]) | (reynolds > _SUBCRITICAL[1])
        ratio = water.drag_normal / cylinder
        wrong = (ratio > _OFF) | (ratio < 1 / _OFF)
        if literature:
            beyond = wrong = reynolds > _CRISIS
            drag = drag * cylinder
        total, most = total + drag.sum(), max(most, drag.sum(axis=1).max())
        reached, outside = reached + np.sum(reynolds * drag), outside + np.sum(drag[beyond])
        off, known = off + np.sum(drag[wrong]), known + np.sum(cylinder * drag)
    length = float(dataset["arc_length"][-1])
    largest = 0.5 * water.density * (1.0 if literature else water.drag_normal) * length * most
    force = np.linalg.norm(dataset["base_force"].values, axis=1).max()
    if not largest or largest < _DRAG_SHARE * force:
        return ""
    at = f"most of the drag acts at Reynolds numbers near {reached / total:.2g}"
    if literature and outside > 0.5 * total:
        return f"{at}; that of the literature is for up to 2e5, where it falls steeply"
    if not literature and off > 0.5 * total:
        return (
            f"{at}, where a smooth cylinder has a drag coefficient of {known / total:.2g} and "
            f'water.drag_normal is {water.drag_normal:g}; water.coefficients = "literature" has it'
        )
    if outside <= 0.5 * total or water.drag_normal != Water().drag_normal:
        return ""
    return f"{at}; the default water.drag_normal = {water.drag_normal:g} is for 1e3 to 1e5"
