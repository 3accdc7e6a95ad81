"""A recording of a session, and the result that comes of it."""

from __future__ import annotations

import math
import time
from copy import copy
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float

from crinoid.assembly.prepared import Prepared
from crinoid.dataset import chosen
from crinoid.dynamics import Outcome
from crinoid.live.knobs import Knobs, described
from crinoid.live.numbers import Pull
from crinoid.live.props import PULL, Props
from crinoid.loop_health import loop_notes
from crinoid.record import Record
from crinoid.result import Result
from crinoid.scenario import Scenario, ScenarioError
from crinoid.simulation.conclusion import builder, conclude
from crinoid.simulation.loop import LoopState
from crinoid.simulation.setup import Setup

__all__ = ["Situation", "Tape"]

_MOST_BYTES = 400_000_000
"""Bytes of instants that a recording may have: putting it together takes nearly three times it."""


class Situation(NamedTuple):
    """How a session runs at present."""

    scenario: Scenario
    """The scenario with the controller that is at work, without props."""
    setup: Setup
    knobs: Knobs
    props: Props
    thrown: bool
    """Whether the debris is no longer parked."""
    switched_on: float | None
    """When the controller took over (s); None if it is at work from the start."""
    target: Float[np.ndarray, " pose"] | None
    """Pose of the target in its own frame (m, rad), if it is not what the scenario says."""


class Tape:
    """Instants of a session from one on, and what was changed meanwhile.

    Parameters
    ----------
    first
        The first instant.
    situation
        How the session runs then.
    """

    def __init__(self, first: Record, situation: Situation) -> None:
        self._records = [_one(first)]
        self._held = 0
        self._first, self._begun = situation, time.perf_counter()
        self._changes: dict[str, list[float]] = {}
        self.pulls: list[Pull] = []
        self.thrown: list[float] = []
        """Times at which the debris was thrown (s)."""

    @property
    def full(self) -> bool:
        """Whether it takes no more."""
        return self._held > _MOST_BYTES

    @property
    def start(self) -> float:
        """Time of the first instant (s)."""
        return float(self._records[0].time[0])

    @property
    def instants(self) -> int:
        """Number of instants so far."""
        return sum(len(each.time) for each in self._records)

    def take(self, kept: Record) -> None:
        """Take some more instants."""
        self._records.append(kept)
        self._held += sum(leaf.nbytes for leaf in jax.tree.leaves(kept))

    def changed(self, name: str, when: float) -> None:
        """Take down that something was changed at a time (s)."""
        times = self._changes.setdefault(name, [when, when])
        times[1] = when

    def finish(
        self,
        prepared: Prepared,
        now: Situation,
        carry: LoopState,
        failed: Outcome | None,
    ) -> Result:
        """Return the result of what was recorded.

        Parameters
        ----------
        prepared
            The scenario of the session.
        now
            How the session runs now.
        carry
            The state at the end.
        failed
            The outcome of a step that failed, if one did.
        """
        whole = jax.tree.map(lambda *parts: np.concatenate(parts), *self._records)
        if now.props.debris is not None and not now.thrown:
            whole = _without_last(whole)
        scenario, told = self._scenario(now, whole)
        prepared = copy(prepared)  # its files are not read again
        prepared.scenario = scenario
        setup = now.setup
        if now.knobs.stiffness != 1.0 or self._first.knobs.stiffness != 1.0:
            setup = setup._replace(modes=None)  # they are those of another arm
        dataset = builder(prepared, setup)(whole, None)
        balanced = not {"stiffness", "current"} & set(self._changes)
        spent = time.perf_counter() - self._begun
        result = conclude(prepared, setup, carry, dataset, "", failed, spent, with_ledger=balanced)
        notes = [*result.notes, *loop_notes(result), *told]
        result.dataset.attrs["notes"] = "\n".join(notes)
        # its state has props that the scenario has not: nothing goes on from it
        return Result(chosen(result.dataset, scenario.output.variables))

    def _scenario(self, now: Situation, whole: Record) -> tuple[Scenario, list[str]]:
        """Return the scenario as it was in the end, and what it does not tell."""
        found, told = described(now.scenario, now.knobs)
        end, document = float(f"{float(whole.time[-1]):.10g}"), now.scenario.to_dict()
        changes: list[dict[str, Any]] = [{"simulation.duration": end}]
        if now.scenario.control.kind != "none":
            changes.append({"control.compare": False})
            if now.switched_on is not None:
                changes.append({"control.start": now.switched_on})
        if now.target is not None:
            changes.append(self._target(now.scenario, now.target, told))
        if self.pulls:
            loads = [_load(pull) for pull in self.pulls]
            changes.append({"load": [*document.get("load", []), *loads]})
        if now.thrown and now.props.debris is not None:
            assert whole.obstacle_position is not None
            assert whole.obstacle_velocity is not None
            origin = np.asarray(now.setup.loop.system.forces.origin)
            place, velocity = whole.obstacle_position[0, -1], whole.obstacle_velocity[0, -1]
            table = now.props.debris.table(place + origin, velocity)
            others = document.get("obstacle", [])
            changes.append({"obstacle": [*others, table]})
            when = " and ".join(f"{each:.4g}" for each in self.thrown)
            if when:
                told.append(
                    f"obstacle {len(others)} is debris that waits far away and is thrown at "
                    f"t = {when} s, which the scenario does not tell"
                )
        for values in changes:
            try:
                found = found.with_values(values)
            except ScenarioError as error:
                told.append(f"the scenario does not tell it: {error.lines[0]}")
        return found, [*told, *self._told(now)]

    def _target(
        self, scenario: Scenario, pose: Float[np.ndarray, " pose"], told: list[str]
    ) -> dict[str, Any]:
        """Return a target's keys; tell of one that moves."""
        axes = scenario.arm.dimension
        if scenario.target.moves:
            told.append("the path of the target is not where the scenario has it")
            return {}
        turned = pose[axes:].tolist()
        direction: dict[str, Any] = {"target.angle_deg": math.degrees(turned[0])}
        if axes == 3:
            direction = {"target.direction": turned}
        return {"target.tip": pose[:axes].tolist()} | direction

    def _told(self, now: Situation) -> list[str]:
        """Say how it is not what the scenario would give from its start."""
        told = []
        if self.start > 0:
            told.append(
                f"recorded live from t = {self.start:.4g} s on, from the state of that moment; "
                "numbers may have been changed before"
            )
        if self._changes:
            names = ", ".join(f"{name} ({_span(*times)})" for name, times in self._changes.items())
            text = f"changed by hand while it was recorded: {names}"
            told.append(f"{text}; the scenario has what was so at the end")
        return told


def _load(pull: Pull) -> dict[str, Any]:
    force = [float(part) for part in pull.force]
    times = {"start": pull.start, "ramp_time": PULL["ramp_time"], "stop": pull.stop}
    return {"kind": "tip", "force": force, **times}


def _span(first: float, last: float) -> str:
    if first == last:
        return f"t = {first:.4g} s"
    return f"t = {first:.4g} to {last:.4g} s"


def _one(record: Record) -> Record:
    return jax.tree.map(lambda x: np.asarray(x)[None], record)


def _without_last(whole: Record) -> Record:
    """Return records without the last of their obstacles."""
    assert whole.gap is not None
    names = ("obstacle_position", "obstacle_velocity", "gap", "touch")
    parts = [getattr(whole, name) for name in names]
    if whole.gap.shape[1] == 1:
        kept = [None] * len(parts)
    else:
        kept = jax.tree.map(lambda x: x[:, :-1], parts)
    return eqx.tree_at(
        lambda x: [getattr(x, name) for name in names], whole, kept, is_leaf=lambda x: x is None
    )
