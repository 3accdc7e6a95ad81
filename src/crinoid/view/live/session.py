"""Live session: a simulation in steps whose numbers can be changed."""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import numpy as np

from crinoid.assembly.arrays import array
from crinoid.assembly.plan import find_state
from crinoid.assembly.prepared import Prepared
from crinoid.compilation import ONCE, compiled
from crinoid.diagnostics.plausibility import plausibility_warnings
from crinoid.dynamics import EnergyAccount, Outcome, StepStatistics
from crinoid.results.record import Record
from crinoid.results.result import Result
from crinoid.scenario import Mistake, Scenario, ScenarioError
from crinoid.simulation.chunk import one_instant
from crinoid.simulation.conclusion import command_failure, dataset_builder, step_failure
from crinoid.simulation.loop import Loop, LoopState
from crinoid.simulation.run import begin
from crinoid.simulation.stepped_run import SteppedRun
from crinoid.view.live import adjustable, interactive
from crinoid.view.live.session_log import SessionLog, SessionState, Snapshot

_LATELY = 8  # most calls whose instants explain a step that fails


class LiveSession(SteppedRun):
    """A simulation of one case that advances on request and whose numbers can be changed.

    Adjusted numbers, a dragged target, debris and pulls compile nothing; only a new kind of
    controller does.
    """

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario.output_steps, interactive.CAPACITY)
        self.scenario, self.prepared = scenario, Prepared(scenario)
        self.prepared.check()
        _ = self.prepared.digests
        self.doubts = plausibility_warnings(self.prepared)
        """Notes on implausible numbers of the scenario, a sentence each."""
        self.bodies = interactive.InteractiveBodies.suited_to(scenario, self.prepared.surfaces)
        self.kind = scenario.control.kind  # kind of the present controller
        self._by_kind: dict[str, interactive.ControlledScenario] = {}
        self._controlled = self._with_controller(self.kind)
        self.numbers, self.halted = adjustable.AdjustableNumbers(), ""
        """Reason for which the session has stopped; empty while it runs."""
        self._log: SessionLog | None = None
        self._shift = np.zeros(scenario.arm.dimension)
        self._lately: deque[Record] = deque(maxlen=_LATELY)
        self.tip_force = interactive.tip_force(self._controlled.loop.system)
        """A force that deflects the tip by a third of the arm's length (N)."""
        self.reset()
        self._compile()

    @property
    def recording(self) -> float | None:
        """Duration of the recording (s); None without one."""
        return None if self._log is None else self.time - self._log.start

    @property
    def recording_is_full(self) -> bool:
        """Whether the recording has reached its largest size."""
        return self._log is not None and self._log.full

    def reset(self) -> str:
        """Return to the start with the present numbers, target and kind of controller.

        Returns a note where adjusted numbers have no equilibrium: it starts from the scenario's.
        """
        self._pull, self._thrown = adjustable.NO_PULL, False
        self._switched_on: float | None = None
        self._flows = self._adjusted_flows(None)
        self.halted, self.failed = "", None
        self._lately.clear()
        self._renew()
        state, note = self._controlled.setup.state, ""
        if self.numbers.changed_names:
            loaded = self.scenario.simulation.start == "equilibrium"
            found, outcome = find_state(self.loop.system, loaded)
            state = found if outcome.converged else state
            if not outcome.converged:
                note = "no equilibrium with these numbers; starts from that of the scenario"
        if self.bodies.debris is not None:
            system = self.loop.system
            parked = array(self.bodies.debris.parked) - system.forces.origin
            state, _ = interactive.launch(system, state, parked, 0.0 * parked)
        self.state, first = begin(self.loop, state)
        self._lately.append(one_instant(first))
        return note

    def advance(self, steps: int) -> int:
        """Advance by time steps, or until one fails; return their number."""
        if self.halted:
            return 0
        done, total = self.steps, round(self.bodies.duration / self.scenario.simulation.time_step)
        some = self.advance_to(min(done + steps, total))
        if some is not None:
            self._lately.append(some)
            if self._log is not None:
                self._log.append(some)
        if self.failed is not None:
            self.halted = f"{self._failure(self.failed)}. Press Reset."
        elif self.steps == total:
            self.halted = f"over at t = {self.time:.6g} s: the session ends here. Press Reset."
        return self.steps - done

    def look(self) -> Snapshot:
        """Return the snapshot of the present instant."""
        pulls = self._pull.force and self._pull.start <= self.time < self._pull.stop
        origin = np.asarray(self.loop.system.forces.origin)
        return Snapshot.of(self.record(), origin, self._pull.force if pulls else ())

    def adjust(self, **values: float) -> None:
        """Change numbers (`crinoid.view.live.adjustable.AdjustableNumbers`)."""
        self.numbers = self.numbers._replace(**values)
        if not self.steps and self._log is None and not self._thrown:
            self.reset()
            return
        self._flows = self._adjusted_flows(self._flows if self.time > 0 else None)
        self._renew()
        self._note(*values)

    def drag(self, place: Sequence[float] | None) -> None:
        """Drag the target to a place relative to the base (m), or back with None."""
        if place is None:
            self._shift = np.zeros_like(self._shift)
        else:
            there = np.asarray(self.loop.system.forces.origin) + np.asarray(place)
            assert isinstance(self.loop.target, interactive.ShiftedTarget)
            self._shift = interactive.shift_to(self.loop.target, there, self.time)
        self._renew()
        self._note("target")

    def pull(self, force: Sequence[float]) -> None:
        """Pull at the tip with a force (N) for one second."""
        self._pull = adjustable.Pull(tuple(map(float, force)), self.time)
        self._renew()
        if self._log is not None:
            self._log.pulls.append(self._pull)

    def throw(self) -> None:
        """Throw debris at the arm; there is only one piece, which is thrown again."""
        debris, arm = self.bodies.debris, self.scenario.arm
        if debris is None:
            must = "have an arm with a surface to hit, and room for debris far from it"
            raise ScenarioError([Mistake("debris", f"got a scenario without it; must {must}")])
        for path in interactive.launch_paths(debris, self.state.state, arm):
            state, free = interactive.launch(self.loop.system, self.state.state, *map(array, path))
            if free:
                break
        else:
            must = "have room at 0.45 lengths of the arm from it"
            raise ScenarioError([Mistake("debris", f"got obstacles around the arm; must {must}")])
        self._thrown = True
        self._renew()
        self.state = eqx.tree_at(lambda c: c.state, self.state, state)
        if self._log is not None:
            self._log.thrown.append(self.time)

    def control(self, kind: str) -> None:
        """Switch to another kind of controller; the run goes on, with default gains if need be."""
        if kind == self.kind:
            return
        controlled = self._with_controller(kind)
        self._controlled, self.kind = controlled, kind
        self._switched_on = self.time if self.time > 0 else None
        self._flows = self._adjusted_flows(self._flows if self.time > 0 else None)
        self._renew()
        before, (fresh, _) = self.state, begin(self.loop, self.state.state)
        self.state = fresh
        if self.time > 0:
            self.state = replace(before, memory=fresh.memory, ticks=fresh.ticks)
        self._compile()
        self._note("controller")

    def start_recording(self) -> None:
        """Record from the next saved instant on."""
        late = self.steps % self._stride
        if late:
            self.advance(self._stride - late)
        if self.halted:
            return
        if self.time > 0:
            self.state = _opened(self.loop, self.state)
        self._log = SessionLog(self.record(), self._state_now)

    def stop_recording(self) -> Result | None:
        """Return the result of the recording; None if it is shorter than an output interval."""
        log, self._log = self._log, None
        if log is None or log.instants < 2:
            return None
        return log.result(self.prepared, self._state_now, self.state, self.failed)

    @property
    def _state_now(self) -> SessionState:
        target, controlled = None, self._controlled
        if self._shift.any() or self.numbers.changed_names:  # which move an initial target
            target = np.asarray(self.loop.target.in_frame(self.state.state.time))
        setup = controlled.setup._replace(warnings=self.doubts if self._is_own else [])
        if not self._is_own or self.numbers.changed_names:
            setup = setup._replace(loop_warnings=[])
        scenario, thrown, on = controlled.scenario, self._thrown, self._switched_on
        return SessionState(scenario, setup, self.numbers, self.bodies, thrown, on, target)

    @property
    def _is_own(self) -> bool:
        return self.kind == self.scenario.control.kind

    def _with_controller(self, kind: str) -> interactive.ControlledScenario:
        if kind not in self._by_kind:
            self._by_kind[kind] = interactive.ControlledScenario.of(
                self.scenario, self.bodies, kind
            )
        return self._by_kind[kind]

    def _adjusted_flows(self, now: Sequence[Any] | None) -> tuple[Any, ...]:
        place = np.asarray(self.scenario.base.position)
        time = 0.0 if now is None else self.time
        return adjustable.adjusted_flows(self._controlled.flows, now, self.numbers, place, time)

    def _renew(self) -> None:
        controlled, debris = self._controlled, self.bodies.debris is not None
        parked, shift, since = not self._thrown, self._shift, self._switched_on
        loop_numbers = controlled.loop_numbers(parked=parked, shift=shift, since=since)
        own = controlled.parameters
        parameters = adjustable.adjusted_parameters(own, self.numbers, self._flows, self._pull)
        self.loop = adjustable.with_numbers(controlled.loop, parameters, loop_numbers, debris)

    def _compile(self) -> None:
        """Compile all programs, so that a later call is fast."""
        self.compile()
        _opened(self.loop, self.state)
        if self.bodies.debris is not None:
            nowhere = array(np.zeros(self.scenario.arm.dimension))
            interactive.launch(self.loop.system, self.state.state, nowhere, nowhere)
        self.look()

    def _note(self, *names: str) -> None:
        if self._log is not None:
            for name in names:
                self._log.note_change(name, self.time)

    def _failure(self, outcome: Outcome) -> str:
        system, command = self.loop.system, np.asarray(self.state.command).tolist()
        trouble = command_failure(system.inputs, command, self.time)
        if trouble:
            return trouble
        whole = jax.tree.map(lambda *parts: np.concatenate(parts), *self._lately)
        build = dataset_builder(self._controlled.setup._replace(prepared=self.prepared))
        data = build(whole, None)
        return step_failure(self.scenario, system, self.state.state, outcome, data, None)


@compiled(**ONCE)
def _opened(loop: Loop, carry: LoopState) -> LoopState:
    """Return a state whose works and impulses are zero."""
    account = EnergyAccount.of(loop.system.forces, carry.state)
    opened = replace(carry, books=account, tally=StepStatistics.of_nothing())
    return jax.tree.map(lambda x: jax.lax.convert_element_type(x, x.dtype), opened)
