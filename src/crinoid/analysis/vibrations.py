"""Small vibrations of a scenario's arm in air, in still water and in the mean current."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Array, Bool, Float

from crinoid.assembly.arrays import array
from crinoid.assembly.prepared import Prepared, at_rest
from crinoid.compilation import ONCE, compiled
from crinoid.dynamics import (
    DampedModes,
    ModesError,
    Outcome,
    Relaxing,
    SmallMotions,
    System,
    find_relaxing_modes,
)
from crinoid.dynamics.rows import BOUNDARY_NODES
from crinoid.dynamics.tangent import LineStiffness
from crinoid.foundation.status import Status
from crinoid.results.dataset import coordinates, describe, described
from crinoid.results.dimensionless import bending
from crinoid.scenario import Scenario
from crinoid.scenario.errors import got, refusal
from crinoid.scenario.library import Source

MODES = "modes.nc"

COUNT = 6  # how many modes are looked for, unless said

_GROWS = -1e-6  # damping ratio below which a vibration grows, and round-off does not account for it


class Vibration(NamedTuple):
    """An arm at rest in a medium, and its small vibrations there."""

    position: Float[np.ndarray, "node axis"]  # in the world (m)
    current: tuple[float, ...]  # velocity of the water (m/s)
    modes: DampedModes


def modes(scenario: Source, *, count: int = COUNT, in_air: bool = False) -> xr.Dataset:
    """Find the slowest small vibrations of an arm: frequencies, damping ratios and shapes.

    In air, in still water and in the mean current, each about the equilibrium that the arm has
    there at t = 0. In air is without any water: weight without buoyancy. The mean current is that
    of all flows together at full strength, steady and the same everywhere. The base is held, also
    where the submarine floats, and so are the drives of actuators.

    Parameters
    ----------
    scenario : Scenario, str or path
        One case (`crinoid.Scenario.cases`), the name of a built-in scenario, or a file.
    count : int
        How many modes in each medium.
    in_air : bool
        Whether to leave out the water.

    Returns
    -------
    xarray.Dataset
        ``frequency`` (Hz), ``damping_ratio`` and ``decay_rate`` (1/s) over medium and mode, shapes
        and positions at rest over medium, mode, node and axis, with units and meanings. The
        attribute ``notes`` says what there is to know of them.

    Raises
    ------
    ScenarioError
        If a file that the scenario names is not valid, or the arm has fewer modes.
    ModesError
        If the arm has no equilibrium in a medium, or its modes could not be found.

    Examples
    --------
    >>> scenario = crinoid.load("still-water", ["arm.nodes=5", "simulation.duration=0.2"])
    >>> found = crinoid.modes(scenario, count=2)
    >>> found.frequency.sel(medium="air").round(1).values.tolist()  # Hz
    [0.9, 2.9]
    """
    prepared = Prepared(scenario)
    prepared.check()
    dataset, trouble = find_vibrations(prepared, count=count, in_air=in_air)
    if trouble or dataset is None:
        raise ModesError(trouble)
    return dataset


def find_vibrations(
    prepared: Prepared, *, count: int, in_air: bool
) -> tuple[xr.Dataset | None, str]:
    """Find modes of a checked case in its media, or in air only; say why some are missing."""
    scenario = prepared.scenario
    most = (scenario.arm.nodes - 1) * (2 if scenario.arm.dimension == 2 else 4)
    if not 1 <= count <= most:
        text = got(count, f"be 1 to {most}, the degrees of freedom of {scenario.arm.nodes} nodes")
        raise refusal("--count", text)
    current = prepared.facts.mean_current
    found: dict[str, Vibration] = {}
    troubles = []
    for medium, case in _media(scenario, current, in_air).items():
        flowing = current if medium == "mean current" else (0.0,) * len(current)
        try:
            found[medium] = _vibration(case, flowing, count)
        except ModesError as error:
            troubles.append(f"{_in(medium)}: {error}")
    trouble = f"failed {'; '.join(troubles)}" if troubles else ""
    if not found:
        return None, trouble
    dataset = _dataset(prepared, found)
    found_notes = [*prepared.notes(), *_notes(scenario, dataset), *_unsettled(found)]
    dataset.attrs |= {"status": trouble or Status.OK.value, "notes": "\n".join(found_notes)}
    return dataset, trouble


def _in(medium: str) -> str:
    return f"in the {medium}" if medium == "mean current" else f"in {medium}"


def _media(scenario: Scenario, current: tuple[float, ...], in_air: bool) -> dict[str, Scenario]:
    """Return the same arm in each medium: with one uniform current, which is 0 but in the last."""
    still = [{"kind": "uniform", "velocity": [0.0] * len(current)}]
    hull = None if scenario.hull is None else {"hull": scenario.hull.model_dump()}
    case = at_rest(scenario).with_values({"vehicle": hull, "flow": still})
    found = {"air": case.with_values({"water.density": 0.0, "water.linear_drag": 0.0})}
    if in_air or scenario.water.density == 0:
        return found
    found["still water"] = case
    if any(current):
        found["mean current"] = case.with_values({"flow.0.velocity": list(current)})
    return found


def _vibration(scenario: Scenario, current: tuple[float, ...], count: int) -> Vibration:
    system = Prepared(scenario).system
    position, outcome, small, lines = _at_rest(system, array(current))
    if not outcome.converged:
        where = outcome.imbalance(system.reference.nodes, system.forces.free)
        text = f"no static equilibrium found, {where}; try loads that are weaker"
        raise ModesError(f"{text}, a stiffer arm, or more arm.nodes")
    relaxing, stretch = None, system.forces.stretch
    if small.elastic is not None and stretch is not None:
        relaxing = Relaxing(small.elastic, np.asarray(stretch.material.relaxation)[0])
    found = find_relaxing_modes(
        relaxing, small.stiffness_in_current, small.damping_in_current, small.mass, count, lines
    )
    return Vibration(np.asarray(position), current, found)


@compiled(**ONCE)
def _at_rest(
    system: System, current: Float[Array, " d"]
) -> tuple[Float[Array, "node d"], Outcome, SmallMotions, LineStiffness | None]:
    state, outcome = system.find_equilibrium()
    small = system.small_motions(state, current)
    position = system.forces.origin + state.position[BOUNDARY_NODES - 1 :]
    return position, outcome, small, system.influence(state).lines


def _dataset(prepared: Prepared, found: dict[str, Vibration]) -> xr.Dataset:
    """Put what was found into a dataset; modes that a medium has not are NaN."""
    scenario = prepared.scenario
    axes, media = scenario.arm.dimension, list(found)
    most = max((vibration.modes.frequency.size for vibration in found.values()), default=0)
    along = np.append(0.0, np.cumsum(np.asarray(prepared.system.reference.rest_length)))

    def stacked(name: str) -> np.ndarray:
        values = [getattr(vibration.modes, name) for vibration in found.values()]
        stack = np.full((len(media), most, *values[0].shape[1:]), np.nan, values[0].dtype)
        for row, each in zip(stack, values, strict=True):
            row[: each.shape[0]] = each
        return stack

    shapes = stacked("shape")
    later = "a quarter of a period later, where they do not move in phase"
    rows = [
        ("frequency", "medium mode", "Hz", stacked("frequency"),
         "frequency of the damped vibration, 0 where the arm does not swing"),
        ("damping_ratio", "medium mode", "1", stacked("damping_ratio"),
         "damping over critical damping, negative where the vibration grows"),
        ("decay_rate", "medium mode", "s-1", stacked("decay_rate"),
         "rate at which the vibration decays, negative where it grows"),
        ("shape", "medium mode node axis", "1", shapes[..., :axes].real,
         "how the nodes move in a mode, 1 at most"),
        ("shape_quadrature", "medium mode node axis", "1", -shapes[..., :axes].imag,
         f"how the nodes move {later}"),
        ("position", "medium node axis", "m",
         np.reshape([each.position for each in found.values()], (len(media), -1, axes)),
         "position of the nodes at rest"),
        ("current", "medium axis", "m s-1",
         np.reshape([each.current for each in found.values()], (len(media), axes)),
         "velocity of the water"),
    ]  # fmt: skip
    if "still water" in media:
        water = found["still water"]
        first = water.modes.frequency
        speed = np.outer(first, prepared.facts.lock_in) * prepared.facts.diameter
        locks = (first > 0) & _bending(water, np.asarray(scenario.arm.diameters))
        speed = np.where(locks[:, None], speed, np.nan)
        speed = np.pad(speed, ((0, most - first.size), (0, 0)), constant_values=np.nan)
        rows.append(
            ("lock_in_speed", "mode end", "m s-1", speed,
             "speeds of a current across the arm between which vortices lock in to a bending mode"),
        )  # fmt: skip
    if axes == 3:
        spins = shapes[..., 1:, 3]
        rows += [
            ("spin", "medium mode edge", "rad m-1", spins.real,
             "how the edges spin about themselves in a mode, for 1 m of shape"),
            ("spin_quadrature", "medium mode edge", "rad m-1", -spins.imag,
             f"how the edges spin {later}"),
        ]  # fmt: skip
    kept = coordinates(axes, np.zeros(0), along, np.asarray(scenario.arm.diameters))
    coords = {name: kept[name] for name in ("axis", "arc_length", "diameter")}
    coords |= {
        "medium": ("medium", media, {"long_name": "what the arm is in"}),
        "mode": ("mode", np.arange(1, most + 1), {"long_name": "slowest first"}),
    }
    return xr.Dataset(described(rows), coords, describe(scenario))


def _bending(
    vibration: Vibration, diameter: Float[np.ndarray, " node"]
) -> Bool[np.ndarray, " mode"]:
    """Return which modes vortices can push: those that move the arm across itself."""
    edges = np.diff(vibration.position, axis=0)
    tangent = edges / np.linalg.norm(edges, axis=1, keepdims=True)
    axes, shape = edges.shape[1], vibration.modes.shape
    spin = shape[:, 1:, axes] if axes == 3 else None
    return bending(shape[..., :axes], spin, tangent, diameter)


def _unsettled(found: dict[str, Vibration]) -> list[str]:
    """Return which modes are left out, a sentence for each medium."""
    notes = []
    for medium, vibration in found.items():
        if left := np.flatnonzero(np.isnan(vibration.modes.frequency)).tolist():
            modes = f"mode{'s' * (len(left) > 1)} {', '.join(str(index + 1) for index in left)}"
            why = "the material damps so strongly that no rate settles"
            notes.append(f"{_in(medium)} {modes} left out: {why}")
    return notes


def _notes(scenario: Scenario, dataset: xr.Dataset) -> list[str]:
    found = []
    if scenario.floats:
        found.append("the submarine floats; these are modes of its arm while the base is held")
    media = [str(medium) for medium in dataset["medium"].values]
    if "still water" in media and scenario.flow and "mean current" not in media:
        found.append("the current has no mean: modes in it are those in still water")
    if "still water" in media and scenario.water.drag_normal > 0:
        found.append(
            "in still water drag, which is quadratic, damps no small vibration: what damps is the "
            "material" + " and water.linear_drag" * (scenario.water.linear_drag > 0)
        )
    for medium in media:
        here = dataset.sel(medium=medium)
        for mode in here["mode"].values:
            names = ("damping_ratio", "frequency", "decay_rate")
            ratio, frequency, rate = (float(here[name].sel(mode=mode)) for name in names)
            if ratio < _GROWS:
                how = f"swings at {frequency:.3g} Hz and " if frequency > 0 else ""
                away = "grows" if frequency > 0 else "leaves without swinging"
                found.append(
                    f"{_in(medium)} mode {mode} {how}{away}, by a factor of e in "
                    f"{-1 / rate:.3g} s: the equilibrium does not hold"
                )
            elif np.isnan(ratio) and frequency == 0:
                found.append(f"{_in(medium)} nothing drives mode {mode} back or away")
    return found
