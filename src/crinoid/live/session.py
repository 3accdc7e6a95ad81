"""A scenario that is simulated piece by piece, while its numbers change."""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from crinoid.assembly.numbers import array
from crinoid.assembly.prepared import Prepared
from crinoid.dynamics import Books, Outcome
from crinoid.live.frame import Frame
from crinoid.live.knobs import Knobs
from crinoid.live.numbers import NO_PULL, Pull, changed, with_numbers
from crinoid.live.part import CAPACITY, Part
from crinoid.live.props import Props, launched, path_of, tip_force
from crinoid.live.tape import Situation, Tape
from crinoid.live.target import Shifted, shift_to
from crinoid.live.water import stirred
from crinoid.plausibility import doubts
from crinoid.programs import OFTEN, ONCE, compiled
from crinoid.record import Record
from crinoid.result import Result
from crinoid.scenario import Mistake, Scenario, ScenarioError
from crinoid.simulation.conclusion import builder
from crinoid.simulation.failure import command_failure, step_failure
from crinoid.simulation.loop import Loop, LoopState, Tally
from crinoid.simulation.run import begin
from crinoid.simulation.setup import find_start, require_one_case
from crinoid.simulation.stretch import record, stretch

__all__ = ["Session"]

_LATELY = 8
"""Instants that are looked back on where a step fails."""


class Session:
    """A scenario that runs for as long as it is told to, with knobs.

    Nothing is compiled anew when a knob is turned, the target is dragged, debris is thrown or the
    tip is pulled: only for a kind of controller that was not there before.

    Parameters
    ----------
    scenario
        One case.
    """

    def __init__(self, scenario: Scenario) -> None:
        require_one_case(scenario)
        self.scenario, self.prepared = scenario, Prepared(scenario)
        self.prepared.check()
        _ = self.prepared.digests
        self.doubts = doubts(self.prepared)
        """Notes on odd numbers of the scenario, a sentence each."""
        self.props = Props.beside(scenario)
        self.kind = scenario.control.kind
        """Kind of controller that is at work."""
        self._parts: dict[str, Part] = {}
        self._part = self._under(self.kind)
        self.knobs, self.halted = Knobs(), ""
        """Why it does not go on; empty if it does."""
        self._tape: Tape | None = None
        self._shift = np.zeros(scenario.arm.dimension)
        self._lately: deque[Record] = deque(maxlen=_LATELY)
        self._failed: Outcome | None = None
        self.tip_force = tip_force(self._part.loop.system)
        """A force that pulls the tip well aside (N)."""
        self.reset()
        self._compile()

    @property
    def time(self) -> float:
        """Simulated time (s)."""
        return float(self._carry.state.time)

    @property
    def state(self) -> LoopState:
        """State of the closed loop."""
        return self._carry

    @property
    def loop(self) -> Loop:
        """The closed loop as it is now."""
        return self._loop

    @property
    def recording(self) -> float | None:
        """How long it has been recorded (s); None if it is not."""
        return None if self._tape is None else self.time - self._tape.start

    @property
    def recording_is_full(self) -> bool:
        """Whether no more can be recorded."""
        return self._tape is not None and self._tape.full

    def reset(self) -> str:
        """Go back to the start: knobs, target and kind of controller stay.

        Where knobs were turned it starts as a scenario with these numbers would. Returns a note if
        there is no such equilibrium, so that it starts from that of the scenario.
        """
        self._pull, self._thrown = NO_PULL, False
        self._switched_on: float | None = None
        self._flows = self._stirred(None)
        self.halted, self._failed = "", None
        self._lately.clear()
        self._renew()
        state, note = self._part.setup.state, ""
        if self.knobs.turned:
            loaded = self.scenario.simulation.start == "equilibrium"
            mapped = self._part.setup.plan.jacobian is not None
            mean = array(self._part.setup.plan.current)
            found, outcome, *_ = find_start(self._loop.system, mean, loaded, mapped)
            state = found if outcome.converged else state
            if not outcome.converged:
                note = "no equilibrium with these numbers: it starts from that of the scenario"
        if self.props.debris is not None:
            system = self._loop.system
            parked = array(self.props.debris.parked) - system.forces.origin
            state = launched(system, state, parked, 0.0 * parked)
        self._carry, first = begin(self._loop, state)
        self._lately.append(_one(first))
        return note

    def advance(self, steps: int) -> int:
        """Go on by some time steps, or up to one that fails; return how many there were."""
        if self.halted:
            return 0
        done, stride = int(self._carry.steps), self._stride
        total = round(self.props.duration / self.scenario.simulation.time_step)
        end = min(done + min(steps, CAPACITY * stride), total)
        self._carry, kept, new, outcome = stretch(
            self._loop, self._carry, jnp.asarray(end, int), jnp.asarray(stride, int), CAPACITY
        )
        if int(new):
            some = jax.tree.map(lambda x: np.asarray(x)[: int(new)], kept)
            self._lately.append(some)
            if self._tape is not None:
                self._tape.take(some)
        if not outcome.converged and end > done:
            self._failed, self.halted = outcome, self._failure(outcome)
        elif end == total:
            self.halted = f"over at t = {self.time:.6g} s: the session ends here, Reset begins anew"
        return int(self._carry.steps) - done

    def look(self) -> Frame:
        """Look at the present instant."""
        pulls = self._pull.force and self._pull.start <= self.time < self._pull.stop
        origin = np.asarray(self._loop.system.forces.origin)
        return Frame.of(self.record(), origin, self._pull.force if pulls else ())

    def record(self) -> Record:
        """Return all numbers of the present instant."""
        return _look(self._loop, self._carry)

    def turn(self, **values: float) -> None:
        """Turn knobs (`crinoid.live.knobs.Knobs`)."""
        self.knobs = replace(self.knobs, **values)
        if not int(self._carry.steps) and self._tape is None and not self._thrown:
            self.reset()
            return
        self._flows = self._stirred(self._flows if self.time > 0 else None)
        self._renew()
        self._note(*values)

    def drag(self, place: Sequence[float] | None) -> None:
        """Drag the target to a place, relative to where the base is set (m); None: back."""
        if place is None:
            self._shift = np.zeros_like(self._shift)
        else:
            origin = np.asarray(self._loop.system.forces.origin)
            assert isinstance(self._loop.target, Shifted)
            self._shift = shift_to(self._loop.target, origin + np.asarray(place), self.time)
        self._renew()
        self._note("target")

    def pull(self, force: Sequence[float]) -> None:
        """Pull at the tip for a second with a force (N)."""
        self._pull = Pull(tuple(map(float, force)), self.time)
        self._renew()
        if self._tape is not None:
            self._tape.pulls.append(self._pull)

    def throw(self) -> None:
        """Throw debris at the arm; what was thrown before comes back for it."""
        debris, arm = self.props.debris, self.scenario.arm
        if debris is None:
            text = "the arm has no surface that could be hit"
            raise ScenarioError([Mistake("debris", text)])
        place, velocity = path_of(debris, self._carry.state, arm.length, max(arm.diameters))
        self._thrown = True
        self._renew()
        state = launched(self._loop.system, self._carry.state, array(place), array(velocity))
        self._carry = eqx.tree_at(lambda c: c.state, self._carry, state)
        if self._tape is not None:
            self._tape.thrown.append(self.time)

    def control(self, kind: str) -> None:
        """Switch to another kind of controller, with default gains if there are none."""
        if kind == self.kind:
            return
        part = self._under(kind)
        self._part, self.kind = part, kind
        self._switched_on = self.time if self.time > 0 else None
        self._flows = self._stirred(self._flows if self.time > 0 else None)
        self._renew()
        before, (fresh, _) = self._carry, begin(self._loop, self._carry.state)
        self._carry = fresh
        if self.time > 0:
            self._carry = replace(before, memory=fresh.memory, ticks=fresh.ticks)
        self._compile()
        self._note("controller")

    def start_recording(self) -> None:
        """Record from the next instant that is saved on."""
        late = int(self._carry.steps) % self._stride
        if late:
            self.advance(self._stride - late)
        if self.halted:
            return
        if self.time > 0:
            self._carry = _opened(self._loop, self._carry)
        self._tape = Tape(self.record(), self._situation)

    def stop_recording(self) -> Result | None:
        """Return what was recorded; None if that is less than one interval of the output."""
        tape, self._tape = self._tape, None
        if tape is None or tape.instants < 2:
            return None
        return tape.finish(self.prepared, self._situation, self._carry, self._failed)

    @property
    def _stride(self) -> int:
        return self.scenario.output_steps

    @property
    def _situation(self) -> Situation:
        target, part = None, self._part
        if self._shift.any() or self.knobs.turned:  # which move what is initial
            target = np.asarray(self._loop.target.in_frame(self._carry.state.time))
        setup = part.setup._replace(doubts=self.doubts if self._is_own else [])
        if not self._is_own or self.knobs.turned:
            setup = setup._replace(loop_doubts=[])
        return Situation(
            part.scenario,
            setup,
            self.knobs,
            self.props,
            self._thrown,
            self._switched_on,
            target,
        )

    @property
    def _is_own(self) -> bool:
        return self.kind == self.scenario.control.kind

    def _under(self, kind: str) -> Part:
        if kind not in self._parts:
            self._parts[kind] = Part.of(self.scenario, self.props, kind)
        return self._parts[kind]

    def _stirred(self, now: Sequence[Any] | None) -> tuple[Any, ...]:
        place = np.asarray(self.scenario.base.position)
        time = 0.0 if now is None else self.time
        return stirred(self._part.flows, now, self.knobs, place, time)

    def _renew(self) -> None:
        """Bring the loop up to date with all that was changed."""
        part = self._part
        switches = part.switches(
            parked=not self._thrown,
            shift=self._shift,
            since=self._switched_on,
        )
        parameters = changed(part.parameters, self.knobs, self._flows, self._pull)
        debris = self.props.debris is not None
        self._loop = with_numbers(part.loop, parameters, switches, debris)

    def _compile(self) -> None:
        """Compile the step: what follows keeps pace."""
        steps, one = self._carry.steps, jnp.asarray(self._stride, int)
        jax.block_until_ready(stretch(self._loop, self._carry, steps, one, CAPACITY))
        _opened(self._loop, self._carry)
        if self.props.debris is not None:
            nowhere = array(np.zeros(self.scenario.arm.dimension))
            launched(self._loop.system, self._carry.state, nowhere, nowhere)
        self.look()

    def _note(self, *names: str) -> None:
        if self._tape is not None:
            for name in names:
                self._tape.changed(name, self.time)

    def _failure(self, outcome: Outcome) -> str:
        system, command = self._loop.system, np.asarray(self._carry.command).tolist()
        trouble = command_failure(system.inputs, command, self.time)
        if trouble:
            return trouble
        whole = jax.tree.map(lambda *parts: np.concatenate(parts), *self._lately)
        dataset = builder(self.prepared, self._part.setup)(whole, None)
        return step_failure(self.scenario, system, self._carry.state, outcome, dataset, None)


_look = compiled(**OFTEN)(record)


@compiled(**ONCE)
def _opened(loop: Loop, carry: LoopState) -> LoopState:
    """Return a state with new books: works and impulses count from now on."""
    books = Books.of(loop.system.forces, carry.state)
    opened = replace(carry, books=books, tally=Tally.of_nothing())
    return jax.tree.map(lambda x: jax.lax.convert_element_type(x, x.dtype), opened)


def _one(now: Record) -> Record:
    return jax.tree.map(lambda x: np.asarray(x)[None], now)
