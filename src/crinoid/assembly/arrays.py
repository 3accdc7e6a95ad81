"""Arrays from the numbers of a scenario: loads and flows, and the tables of other parts."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from crinoid.assembly.door import build_part, part_name, require
from crinoid.elements import Element
from crinoid.flow import Flow, MeasuredPoint, MeasuredProfile
from crinoid.flow.flow import panels_of
from crinoid.numerics.piecewise import PiecewisePolynomial, between
from crinoid.numerics.ramp import Onset
from crinoid.scenario import FlowTable, Load, LoadTable, Scenario, got, refusal
from crinoid.scenario.errors import gathered
from crinoid.scenario.kinds import is_own
from crinoid.scenario.model import Model

if TYPE_CHECKING:
    from crinoid.recording import Recording, Sea

_Group = TypeVar("_Group", bound=eqx.Module)
Numbers = dict[str, Any]
Builder = Callable[..., Element]  # builds an element from a rod and numbers by name


def array(value: object) -> Array:
    """Return an array of floats, for which nothing need be compiled."""
    return jax.device_put(np.asarray(value, float))


def array_of_plain(value: object) -> Any:
    """Return a number or a tuple of numbers as an array, and anything else as it is."""
    return array(value) if isinstance(value, float | tuple) else value


def from_table(group: type[_Group], table: Model, **others: Any) -> _Group:
    """Fill a group of numbers from the keys of a table with the same names; ``others`` are given.

    Integers, texts and None stay as they are; other numbers become arrays.
    """
    keys = [field.name for field in dataclasses.fields(group) if field.name not in others]
    return group(**{key: array_of_plain(getattr(table, key)) for key in keys}, **others)


def from_tables(tables: Sequence[Model], *keys: str) -> dict[str, Array]:
    """Return an array of the numbers of tables by key, 0 of a table without one."""
    return {key: array([getattr(each, key, None) or 0.0 for each in tables]) for key in keys}


def onset(table: LoadTable | FlowTable) -> Onset:
    """Return when and how a load or a flow sets in, and when a load is taken off.

    Parameters
    ----------
    table : LoadTable or FlowTable
        Table of a scenario, such as ``scenario.load[0]``.

    Returns
    -------
    Onset

    Examples
    --------
    The load of this scenario is taken off after 0.5 s:

    >>> onset = crinoid.load_onset(crinoid.load("still-water").load[0])
    >>> float(onset(0.2)), float(onset(0.7))
    (1.0, 0.0)
    >>> crinoid.flow_onset is crinoid.load_onset
    True
    """
    stop = getattr(table, "stop", None)
    return Onset(*map(array, (table.start, table.ramp_time, np.inf if stop is None else stop)))


load_onset = flow_onset = onset


def load_numbers(load: Load, index: int, scenario: Scenario) -> tuple[Builder, Numbers]:
    """Return what builds the element of load ``index``, and its arguments after the rod."""
    builder, numbers = build_part(f"load {index}", 2, load.build, scenario)
    bound = (getattr(builder, "args", ()), getattr(builder, "keywords", {}))  # of a partial
    leaves = jax.tree.leaves((numbers, bound), is_leaf=lambda each: isinstance(each, Onset))
    if not any(isinstance(each, Onset) for each in leaves):
        for key in ("start", "ramp_time", "stop"):
            if value := getattr(load, key):
                hint = f"Kind {load.kind} has no onset: its build does not return load_onset(self)."
                raise refusal(f"load.{index}.{key}", got(value, "be left out", hint))
    return builder, {name: array_of_plain(value) for name, value in numbers.items()}


def build_flow(
    scenario: Scenario, index: int, flow: FlowTable, recording: Recording | Sea | None = None
) -> Flow:
    """Return the flow at ``index`` of a scenario; a measured one from what was read of it."""
    # two random flows of one scenario are not the same
    seed = np.random.SeedSequence(scenario.seed, spawn_key=(index,))
    given = (np.random.default_rng(seed), *(() if recording is None else (recording,)))
    made = partial(build_part, f"flow {index}", Flow, flow.build, scenario, *given)
    key = f"flow.{index}" if is_own(flow) else ""
    built = gathered({key: made})[key]
    if flow.uniform_mean is not None and built.uniform_mean is None:
        text = "got None; must be the mean velocity, as that of its table: waves ride on it"
        require(False, f"{part_name(built, f'flow {index}')} uniform_mean", text)
    return built


def measured(
    onset: Onset, recording: Recording, scenario: Scenario
) -> MeasuredPoint | MeasuredProfile:
    """Return the flow of a recording, which is met without delay at the base of a scenario."""
    from scipy.interpolate import CubicSpline  # slow to load, and few scenarios need it

    origin, end = array(scenario.base.position), scenario.simulation.duration + recording.delay

    def played(values: Float[np.ndarray, "time column"]) -> PiecewisePolynomial:
        spline = CubicSpline(recording.run_time, values)
        return PiecewisePolynomial(between(spline, -recording.delay, end))

    if recording.levels is None:
        return MeasuredPoint(
            onset,
            played(recording.velocity[:, 0]),
            origin,
            array(recording.slowness),
            carried=recording.carried,
            panels=panels_of(float(onset.ramp_time), 4 * recording.interval * recording.time_scale),
        )
    values = recording.velocity
    slopes = CubicSpline(recording.levels, values, axis=1)(recording.levels, 1)
    columns = np.stack([values, slopes], axis=2).reshape(len(values), -1)
    travels = (origin, array(recording.slowness)) if np.any(recording.slowness) else ()
    return MeasuredProfile(onset, played(columns), array(recording.levels), *travels)
