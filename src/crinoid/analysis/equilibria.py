"""Equilibria of an arm over one number of its scenario: bending curves and their hysteresis."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from crinoid.analysis.curve import Curve
from crinoid.assembly.plan import find_state
from crinoid.assembly.prepared import require_one_case
from crinoid.compilation import ONCE, compiled
from crinoid.dynamics import State, System
from crinoid.dynamics.resting import follow_equilibrium
from crinoid.dynamics.rows import BOUNDARY_NODES
from crinoid.foundation.status import Status
from crinoid.results.dataset import coordinates, describe, described
from crinoid.results.errors import angle_between
from crinoid.results.own_files import table_head
from crinoid.scenario.kinds import unit_at
from crinoid.scenario.library import Source, scenario_of
from crinoid.scenario.scenario import scenario_schema

CURVE = "curve.nc"  # file of the equilibria of `crinoid equilibrium --vary`
BRANCHES = ("forward", "backward")  # ways along the values: from the first to the last, and back

_SAME = 1e-5
"""Distance between the shapes of both branches over the length, below which they are one."""


def equilibria(scenario: Source, vary: str) -> xr.Dataset:
    """Find the equilibria of an arm while one number of its scenario changes slowly, and back.

    Each equilibrium starts from the one before (natural continuation). So the arm keeps to its
    branch, snaps where that ends, and tendons with friction stick and slide. The first one starts
    from the arm without load.

    Parameters
    ----------
    scenario : Scenario, str or path
        One case (`crinoid.Scenario.cases`), the name of a built-in scenario, or a file.
    vary : str
        Key and values, as in ``--vary``: ``"chamber.0.pressure=0:5e4:21"``, ``:log`` behind it for
        equal ratios, or numbers with commas between them.

    Returns
    -------
    xarray.Dataset
        Over ``branch``, forward and backward, and the key: ``tip_position`` (m), ``tip_turn``
        (rad), ``max_curvature`` (1/m), ``position`` of the nodes (m) and ``status``. Numbers of an
        equilibrium that was not found are NaN. If the way back is the same, ``branch`` has only
        the first. The turn is the angle of the tip's tangent from that of the arm without load.

    Raises
    ------
    ScenarioError
        If a value or a file that the scenario names is not valid.
    ValueError
        If the scenario describes several cases.

    Examples
    --------
    >>> scenario = crinoid.load("still-water", ["arm.nodes=5", "simulation.duration=0.2"])
    >>> curve = crinoid.equilibria(scenario, "load.0.force.1=0:0.3:3")  # N
    >>> curve.tip_position.sel(branch="forward", axis="z").round(2).values.tolist()
    [-10.0, -9.9, -9.83]
    """
    case = scenario_of(scenario)
    require_one_case(case)
    return find_equilibria(Curve.of(case, [vary]))


class _Shape(NamedTuple):
    position: Float[np.ndarray, "node axis"]  # in the world (m)
    turn: float
    curvature: float


def find_equilibria(
    curve: Curve,
    *,
    stop: Callable[[], bool] = lambda: False,
    report: Callable[[int, int], None] = lambda done, total: None,
) -> xr.Dataset:
    """Find the equilibria of a curve; see `equilibria`.

    Between them ``stop`` is asked whether to interrupt, and ``report`` receives how many of all are
    found.
    """
    count = len(curve.values)
    forward = [(0, place) for place in range(count)]
    way = forward + [(1, place) for place in reversed(range(count - 1))]
    status = np.full((2, count), Status.INTERRUPTED.value, object)
    found: dict[tuple[int, int], _Shape] = {}
    last: tuple[System, State] | None = None
    form = _form(curve.cases[0].system)
    alike = all(_form(case.system) == form for case in curve.cases)
    for done, (branch, place) in enumerate(way):
        if stop() or (branch and not alike):
            break
        system = curve.cases[place].system
        apart = last is None or not alike
        state, outcome = find_state(system, True) if apart else _follow(system, *last)
        if outcome.converged:
            last = system, state
            found[branch, place] = _shape(system, state)
            status[branch, place] = Status.OK.value
        else:
            where = outcome.imbalance(system.reference.nodes, system.forces.free)
            near = " near the last one" * (not apart)
            status[branch, place] = f"{Status.FAILED}: no equilibrium{near}, {where}"
        if (branch, place) == (0, count - 1):  # where the arm turns round
            status[1, place] = status[branch, place]
            found |= {(1, place): found[0, place]} if (0, place) in found else {}
        report(done + 1, len(way))
    begun = any(each != Status.INTERRUPTED.value for each in status[1, :-1])
    return _dataset(curve, found, status if begun else status[:1], alike)


def _form(system: System) -> tuple[Any, ...]:
    """Return the structure and the shapes on which a compiled program depends."""
    leaves, tree = jax.tree.flatten(system)
    return tree, tuple((np.shape(leaf), getattr(leaf, "dtype", None)) for leaf in leaves)


_follow = compiled(**ONCE)(follow_equilibrium)


@compiled(**ONCE)
def _seen(system: System, state: State) -> tuple[Array, Array, Array]:
    """Return the positions with and without load (m), and the curvatures (1/m)."""
    return state.position, system.rest(state.time).position, system.strains(state)


def _shape(system: System, state: State) -> _Shape:
    position, unloaded, strains = map(np.asarray, _seen(system, state))
    bent = np.linalg.norm(strains[:, :2], axis=1) if strains.ndim == 2 else np.abs(strains)
    ends = [_end(each) for each in (position, unloaded)]
    if position.shape[1] == 2:
        turn = ends[0] - ends[1]
    else:
        turn = angle_between(*(each[None] for each in ends))[0]
    nodes = position[BOUNDARY_NODES - 1 :] + np.asarray(system.forces.origin)
    return _Shape(nodes, float(turn), float(bent.max()))


def _end(position: Float[np.ndarray, "node axis"]) -> Any:
    """Return the direction of the tip: in space a vector, in the plane all turns along the arm."""
    edge = np.diff(position, axis=0)
    edge /= np.linalg.norm(edge, axis=1, keepdims=True)
    if position.shape[1] == 3:
        return 1.5 * edge[-1] - 0.5 * edge[-2]
    angle = np.unwrap(np.arctan2(edge[:, 1], edge[:, 0]))
    return 1.5 * angle[-1] - 0.5 * angle[-2]


def _dataset(
    curve: Curve, found: dict[tuple[int, int], _Shape], status: np.ndarray, alike: bool
) -> xr.Dataset:
    first = curve.cases[0]
    scenario, key = first.scenario, curve.key
    most = max(case.scenario.arm.nodes for case in curve.cases)
    axes, size = scenario.arm.dimension, status.shape
    position = np.full((*size, most, axes), np.nan)
    tip, turn, curvature = (np.full((*size, *more), np.nan) for more in ((axes,), (), ()))
    for place, shape in found.items():
        if place[0] < size[0]:
            position[place][: len(shape.position)] = shape.position
            tip[place], turn[place] = shape.position[-1], shape.turn
            curvature[place] = shape.curvature
    far = np.abs(np.diff(position, axis=0))
    if size[0] == 2 and np.array_equal(*status) and not np.any(far > _SAME * scenario.arm.length):
        position, tip, turn, curvature, status = (
            each[:1] for each in (position, tip, turn, curvature, status)
        )
    over = f"branch {key}"
    rows = [
        ("tip_position", f"{over} axis", "m", tip, "position of the tip"),
        ("tip_turn", over, "rad", turn, "angle of the tip's tangent from that of the arm without "
         "load" + (", upward positive" if axes == 2 else "")),
        ("max_curvature", over, "m-1", curvature, "largest curvature along the arm"),
        ("position", f"{over} node axis", "m", position, "positions of the nodes"),
        ("status", over, "", status.astype(str), "ok, or why there is no equilibrium"),
    ]  # fmt: skip
    kept = coordinates(axes, np.zeros(0), np.zeros(most), np.zeros(most))
    coords = {
        "axis": kept["axis"],
        "branch": ("branch", [*BRANCHES[: len(status)]], {"long_name": "way along the values"}),
        key: (key, curve.values, {"units": unit_at(scenario_schema(), key), "long_name": key}),
    }
    notes = first.notes()
    if not alike:
        notes.append(
            f"values of {key} need different programs: each equilibrium starts from the arm "
            "without load, and there is no way back"
        )
    about = {"status": _summed(status), "notes": "\n".join(notes), "varied": key}
    return xr.Dataset(described(rows), coords, describe(scenario) | about)


def _summed(status: np.ndarray) -> str:
    """Return the status of all equilibria."""
    words = status.ravel().tolist()
    good, total = words.count(Status.OK.value), len(words)
    if good == total:
        return Status.OK.value
    if Status.INTERRUPTED.value in words:
        return f"{Status.INTERRUPTED}: {good} of {total} equilibria are found"
    why = next(each for each in words if each.startswith(Status.FAILED))
    return f"{Status.FAILED}: {total - good} of {total} equilibria were not found ({why[8:]})"


def curve_table(data: xr.Dataset) -> str:
    """Return the equilibria as comma-separated values, a row each; an unknown number is empty."""
    key = data.attrs["varied"]
    unit = data[key].attrs["units"]
    heads = [f"{key} ({unit})" if unit else key, "branch"]
    heads += [f"tip_position.{axis} (m)" for axis in data["axis"].values]
    text = io.StringIO()
    text.write(table_head([*heads, "tip_turn (rad)", "max_curvature (m-1)", "status"]))
    writer = csv.writer(text)
    for branch in data["branch"].values:
        rows = data.sel(branch=branch)
        # in the order in which they were found
        places = range(rows.sizes[key])
        for place in places if branch == BRANCHES[0] else reversed(places):
            row = rows.isel({key: place})
            if (status := str(row["status"].item())) == Status.INTERRUPTED:
                continue
            numbers = [*row["tip_position"].values, row["tip_turn"], row["max_curvature"]]
            cells = ["" if np.isnan(each) else repr(float(each)) for each in numbers]
            writer.writerow([repr(float(row[key])), branch, *cells, status])
    return text.getvalue()
