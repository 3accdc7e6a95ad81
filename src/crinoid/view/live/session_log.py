"""The recording of a session: its instants, its events, and the result of both."""

from __future__ import annotations

import math
import time
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float

from crinoid.assembly.prepared import Prepared
from crinoid.diagnostics.control_loop import loop_notes
from crinoid.dynamics import Outcome
from crinoid.results.dataset import chosen
from crinoid.results.record import Record
from crinoid.results.result import Result
from crinoid.results.scene.data import Point, Points, in_three
from crinoid.scenario import Scenario, ScenarioError
from crinoid.simulation.chunk import one_instant
from crinoid.simulation.conclusion import conclude, dataset_builder
from crinoid.simulation.loop import LoopState
from crinoid.simulation.setup import Setup
from crinoid.view.live.adjustable import PULL, AdjustableNumbers, Pull, adjusted_scenario
from crinoid.view.live.interactive import InteractiveBodies


class Snapshot(NamedTuple):
    """One instant: SI units, three axes, positions relative to that of the base."""

    time: float
    nodes: Points  # positions of the nodes, the root first
    flow: Points  # velocity of the water at the nodes
    curvature: Float[np.ndarray, " node"]  # signed in the plane (1/m)
    speed: Float[np.ndarray, " node"]  # m/s
    target: Point
    error: float  # distance of the tip from the target
    obstacles: Points  # positions of the obstacles, the debris last
    axes: Points  # directions fixed to them, where some are free
    touched: float  # total duration of contact of the arm with them since the start (s)
    holding: bool  # whether the tip carries its tool
    pull: Point  # force of a pull at the tip
    servo: Float[np.ndarray, " channel"]  # positions of the base's servos (m, rad)
    drive: Float[np.ndarray, " input"]  # drives of the actuators, each in its unit
    pose: Float[np.ndarray, " channel"]  # displacement of the base (m, rad)
    vehicle: Float[np.ndarray, " channel"] | None  # that of a submarine that floats

    @staticmethod
    def of(now: Record, origin: Float[np.ndarray, " d"], pull: Any) -> Snapshot:
        """Return the snapshot of a record of an arm whose base is at ``origin`` (m)."""
        axes = len(origin)
        apart = np.asarray(now.tip)[:axes] - np.asarray(now.reference)[:axes]
        places, axes_now, touch = now.obstacle_position, now.obstacle_axis, now.touch
        bent = np.asarray(now.curvature)
        return Snapshot(
            time=float(now.time),
            nodes=in_three(now.position),
            flow=in_three(now.flow_velocity),
            curvature=bent if bent.ndim == 1 else np.linalg.norm(bent, axis=1),
            speed=np.linalg.norm(np.asarray(now.velocity), axis=1),
            target=in_three(np.asarray(now.reference)[:axes] - origin),
            error=float(np.linalg.norm(apart)),
            obstacles=np.zeros((0, 3)) if places is None else in_three(places),
            axes=np.zeros((0, 3)) if axes_now is None else in_three(axes_now),
            touched=0.0 if touch is None else float(np.sum(np.asarray(touch.duration))),
            holding=now.held is not None and bool(now.held),
            pull=in_three(pull) if len(pull) else np.zeros(3),
            servo=np.asarray(now.servo),
            drive=np.zeros(0) if now.drive is None else np.asarray(now.drive),
            pose=np.asarray(now.pose),
            vehicle=None if now.vehicle is None else np.asarray(now.vehicle.pose),
        )


_MOST_BYTES = 400_000_000
"""Most bytes of instants in a recording; concatenation needs nearly three times as many."""


class SessionState(NamedTuple):
    """State of a session, as the result of a recording needs it."""

    scenario: Scenario  # the scenario with the present controller, without interactive bodies
    setup: Setup
    numbers: AdjustableNumbers
    bodies: InteractiveBodies
    thrown: bool  # whether the debris is no longer parked
    switched_on: float | None  # time at which the controller took over (s); None from the start
    target: Float[np.ndarray, " pose"] | None
    """Pose of the target in its own frame (m, rad), where it differs from the scenario's."""


class SessionLog:
    """Instants and events of a session; made of its first instant and its state then."""

    def __init__(self, first: Record, state: SessionState) -> None:
        self._records, self._bytes = [one_instant(first)], 0
        self._first, self._started = state, time.perf_counter()
        self._changes: dict[str, list[float]] = {}
        self.pulls: list[Pull] = []
        self.thrown: list[float] = []  # times at which the debris was thrown (s)

    @property
    def full(self) -> bool:
        """Whether it has reached its largest size."""
        return self._bytes > _MOST_BYTES

    @property
    def start(self) -> float:
        """Time of the first instant (s)."""
        return float(self._records[0].time[0])

    @property
    def instants(self) -> int:
        """Number of instants so far."""
        return sum(len(each.time) for each in self._records)

    def append(self, records: Record) -> None:
        """Append instants."""
        self._records.append(records)
        self._bytes += sum(leaf.nbytes for leaf in jax.tree.leaves(records))

    def note_change(self, name: str, when: float) -> None:
        """Log a change of a number at a time (s)."""
        self._changes.setdefault(name, [when, when])[1] = when

    def result(
        self, prepared: Prepared, now: SessionState, carry: LoopState, failed: Outcome | None
    ) -> Result:
        """Return the result, from the states of session and loop at the end or a failed step."""
        whole = jax.tree.map(lambda *parts: np.concatenate(parts), *self._records)
        scenario, notes = self._scenario(now, whole)
        if now.bodies.debris is not None and not now.thrown:
            whole = _without_last_obstacle(
                whole, free=any(obstacle.free for obstacle in scenario.obstacle)
            )
        setup = now.setup._replace(prepared=prepared.with_scenario(scenario))
        if now.numbers.stiffness != 1.0 or self._first.numbers.stiffness != 1.0:
            setup = setup._replace(modes=None)  # they are those of another arm
        dataset = dataset_builder(setup)(whole, None)
        balanced = not {"stiffness", "current"} & set(self._changes)
        spent = time.perf_counter() - self._started
        result = conclude(setup, carry, dataset, "", failed, spent, with_ledger=balanced)
        notes = [*result.notes, *loop_notes(result), *notes]
        result.dataset.attrs["notes"] = "\n".join(notes)
        # its state has bodies that the scenario lacks, so it is not saved for --resume
        return Result(chosen(result.dataset, scenario.output.variables))

    def _scenario(self, now: SessionState, whole: Record) -> tuple[Scenario, list[str]]:
        """Return the scenario at the end, and notes on its differences from the recording."""
        found, notes = adjusted_scenario(now.scenario, now.numbers)
        document = now.scenario.to_dict()
        duration = float(f"{float(whole.time[-1]):.10g}")
        changes: list[dict[str, Any]] = [{"simulation.duration": duration}]
        if now.scenario.control.acts:
            changes.append({"control.compare": False})
            if now.switched_on is not None:
                changes.append({"control.start": now.switched_on})
        if now.target is not None and now.scenario.target.moves:
            notes.append("the path of the target is shifted from that of the scenario")
        elif now.target is not None:
            axes = now.scenario.arm.dimension
            tip, direction = now.target[:axes].tolist(), now.target[axes:].tolist()
            changes.append({"target.tip": tip, "target.direction": direction})
            if axes == 2:
                angle = math.degrees(direction[0])
                changes[-1] = {"target.tip": tip, "target.angle_deg": angle}
        if self.pulls:
            loads = document.get("load", [])
            for pull in self.pulls:
                times = {"start": pull.start, "ramp_time": PULL["ramp_time"], "stop": pull.stop}
                loads.append({"kind": "tip", "force": list(pull.force)} | times)
            changes.append({"load": loads})
        if now.thrown and now.bodies.debris is not None:
            assert whole.obstacle_position is not None
            assert whole.obstacle_velocity is not None
            origin = np.asarray(now.setup.loop.system.forces.origin)
            place, velocity = whole.obstacle_position[0, -1], whole.obstacle_velocity[0, -1]
            table = now.bodies.debris.table(place + origin, velocity)
            others = document.get("obstacle", [])
            changes.append({"obstacle": [*others, table]})
            if self.thrown:
                when = " and ".join(f"{each:.4g}" for each in self.thrown)
                until = f"until it is thrown at t = {when} s, which no key describes"
                notes.append(f"obstacle {len(others)} is debris that is parked far away {until}")
        for values in changes:
            try:
                found = found.with_values(values)
            except ScenarioError as error:
                notes.append(f"the scenario does not describe the recording: {error.lines[0]}")
        if self.start > 0:
            text = f"recorded live from t = {self.start:.4g} s on, from the state at that time"
            notes.append(f"{text}; numbers may have been changed before")
        if self._changes:
            names = ", ".join(
                f"{name} (t = {first:.4g}{'' if first == last else f' to {last:.4g}'} s)"
                for name, (first, last) in self._changes.items()
            )
            text = f"changed by hand during the recording: {names}"
            notes.append(f"{text}; the scenario has the last values")
        return found, notes


def _without_last_obstacle(whole: Record, *, free: bool) -> Record:
    """Return a record without debris, with rotations if other obstacles are ``free``."""
    assert whole.gap is not None
    names = ["obstacle_position", "obstacle_velocity", "gap", "touch"]
    names += ["obstacle_spin", "obstacle_axis"]
    parts: list[Any] = [getattr(whole, name) for name in names]
    alone = whole.gap.shape[1] == 1
    rest = [None] * len(parts) if alone else jax.tree.map(lambda x: x[:, :-1], parts)
    if not free:
        rest[-2:] = [None, None]
    return eqx.tree_at(
        lambda x: [getattr(x, name) for name in names], whole, rest, is_leaf=lambda x: x is None
    )
