"""Controls of a session on its page, the check of their values, and numbers as text."""

import json
import math
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from crinoid.foundation.axes import AXES
from crinoid.results.units import length_unit
from crinoid.scenario.errors import got, one_of
from crinoid.view.live.adjustable import AdjustableNumbers
from crinoid.view.live.clock import RealTimeClock, SessionStatus
from crinoid.view.live.interactive import kinds_for
from crinoid.view.live.session import LiveSession

_PERIOD = 0.1  # of the numbers (s)
_LATELY = 0.5  # time for which a contact is shown (s)
_SLOW, _LATE = 0.95, 2.0  # real-time factor below which, and time after which it is reported (s)
_LATE_HINT = "x real time: the machine is too slow. Try fewer arm.nodes or longer time steps"
_MOST_TURBULENT = 3.0
_FARTHEST = 1e6  # farthest place of a target (m)
_PULLS = (0.0, 4.0)  # range of the force of a pull, over `LiveSession.tip_force`


class Control(NamedTuple):
    """A button, a slider between two ends, or a choice of options at once or from a list."""

    name: str
    group: str
    kind: str  # `"button"`, `"slider"`, `"buttons"`, `"choice"` or `"target"`
    label: str
    hint: str = ""
    ends: tuple[float, float] = (0.0, 0.0)
    options: Sequence[str] = ()

    def mistake(self, value: Any) -> str:
        """Return what is wrong with a value; empty if nothing is."""
        low, high = self.ends
        if self.kind == "button":
            fits, must = value is None, "be null"
        elif self.kind == "slider":
            fits, must = _is_number(value, low, high), f"be {low:g} to {high:g}"
        elif self.kind == "target":
            axes, given = len(self.options), value if isinstance(value, list) else []
            fits = len(given) == axes and all(_is_number(each, low, high) for each in given)
            must = f"be [{', '.join(self.options)}] in m"
        else:
            fits, must = isinstance(value, str) and value in self.options, one_of(self.options)
            must = f"be {must}"
        return "" if fits else got(value, must)


def _is_number(value: Any, low: float, high: float) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and low <= value <= high


def controls_of(session: LiveSession) -> dict[str, Control]:
    """Return the controls of a session by name."""
    scenario, water, control, disturb = session.scenario, "Water and arm", "Control", "Disturb"
    kinds, axes = {flow.kind for flow in scenario.flow}, AXES[scenario.arm.dimension]
    shares = [getattr(flow, "intensity", 0.0) for flow in scenario.flow]
    most = math.floor(20 * min(_MOST_TURBULENT, 1 / max([*shares, 0.1]))) / 20
    low, high = (each * session.tip_force for each in _PULLS)
    ways, modes = [f"{sign}{axis}" for axis in axes for sign in "-+"], kinds_for(scenario)
    modulus = "A multiple of Young's modulus, or of EA, EI and GJ."
    eddies = "A multiple of their length scale."
    found = [
        Control("run", "", "button", "Pause"),
        Control("reset", "", "button", "Reset", "Back to the start; sliders stay as set."),
        Control("record", "", "button", "Record"),
        Control("current", water, "slider", "current", "A multiple of all flows.", (0.0, 3.0)),
        Control("intensity", water, "slider", "turbulence", "A multiple of it.", (0.0, most)),
        Control("length_scale", water, "slider", "eddies", eddies, (0.25, 4.0)),
        Control("stiffness", water, "slider", "stiffness", modulus, (0.2, 5.0)),
        Control("controller", control, "choice", "controller", options=modes),
        Control("gains", control, "slider", "PID gains", "Multiple of kp, ki, kd.", (0.0, 3.0)),
        Control("described", control, "button", "As described", "All sliders and target back."),
        Control("throw", disturb, "button", "Throw debris"),
        Control("force", disturb, "slider", "pull (N)", "Force of a pull.", (low, high)),
        Control("pull", disturb, "buttons", "pull tip", "Pull for a second.", options=ways),
        Control("target", "", "target", "target", ends=(-_FARTHEST, _FARTHEST), options=axes),
    ]
    without = [] if kinds else ["current"]
    without += [] if "turbulence" in kinds else ["intensity", "length_scale"]
    without += [] if len(modes) > 1 else ["controller"]
    return {each.name: each for each in found if each.name not in without}


class ControlPanel:
    """Controls and numbers of a session, of which only constants are read here."""

    def __init__(self, session: LiveSession, clock: RealTimeClock) -> None:
        self._clock, self._kind = clock, session.kind
        self._base = np.asarray(session.scenario.base.position)
        self._axes = AXES[session.scenario.arm.dimension]
        self._without = [] if session.bodies.debris is not None else ["throw"]
        self.controls = controls_of(session)
        self._numbers = set(AdjustableNumbers._fields) & self.controls.keys()
        self._values = dict.fromkeys(self._numbers, 1.0) | {"force": session.tip_force}
        self._actions = {
            "run": clock.toggle_running,
            "reset": clock.reset,
            "record": clock.toggle_recording,
            "throw": LiveSession.throw,
        }
        self._touched, self._hit = 0.0, -np.inf
        """Total duration of contact since the start, and time of the last one (s)."""
        self._shown, self._in_time, self._state = -np.inf, time.perf_counter(), (False, False)
        self._told: dict[str, Any] = {}

    def hear(self, message: str | bytes) -> str:
        """Do what a message of a page requests; return what is wrong with it, if anything."""
        try:
            said = json.loads(message)
        except (ValueError, RecursionError):
            said = None
        if not isinstance(said, dict) or set(said) != {"name", "value"}:
            return 'message: must be {"name": NAME, "value": VALUE}'
        name, value = said["name"], said["value"]
        if not isinstance(name, str) or name not in self.controls:
            return f"name: {got(name, f'be {one_of(self.controls)}')}"
        if name in self._off:
            return f"{name}: is switched off now"
        if mistake := self.controls[name].mistake(value):
            return f"{name}: {mistake}"
        self._do(name, value)
        return ""

    def text(self, status: SessionStatus | None = None) -> str:
        """Return the state of controls, numbers and message; without a status with the last."""
        if status is not None:
            self._look(status)
        said, wrong = self._clock.message
        values = self._values | {"controller": self._kind}
        said = _plain(said or self._told.get("late", ""))
        return json.dumps(
            self._told | {"values": values, "off": self._off, "said": said, "wrong": wrong}
        )

    @property
    def _off(self) -> list[str]:
        """Names of the controls that are switched off."""
        return self._without + ([] if self._kind == "pid" else ["gains"])

    def _look(self, status: SessionStatus) -> None:
        now, frame = time.perf_counter(), status.frame
        # a hit is over between two updates of the numbers
        if frame.touched != self._touched:
            self._hit = frame.time if frame.touched > self._touched else -np.inf
            self._touched = frame.touched
        if not 0 < status.factor < _SLOW:
            self._in_time = now
        # another label of a button is shown without delay
        state = status.running, status.recording is not None
        if now - self._shown < _PERIOD and state == self._state and status.running:
            return
        self._shown, self._state = now, state
        speed = f"{status.factor:.2f} x real time" if status.running else "paused"
        axes, names = [AXES[3].index(axis) for axis in self._axes], ", ".join(self._axes)
        tip, water = frame.nodes[-1][axes] + self._base, frame.flow[-1][axes]
        numbers = {
            "time": f"{frame.time:.2f} s",
            "speed": speed,
            "tip error": length_unit(frame.error).text(frame.error),
            f"tip {names}": f"{', '.join(f'{part:.3f}' for part in tip)} m",
            f"water {names}": f"{', '.join(f'{part:.3f}' for part in water)} m/s",
        }
        if len(frame.obstacles):
            numbers["contact"] = "yes" if frame.time - self._hit < _LATELY else "no"
        recorded = f"Stop and save ({status.recording or 0.0:.1f} s)"
        late = now - self._in_time > _LATE
        self._told = {
            "numbers": numbers,
            "late": f"{status.factor:.2f} {_LATE_HINT}" if late else "",
            "run": "Pause" if self._clock.running else "Run",
            "record": "Record" if status.recording is None else recorded,
        }

    def _do(self, name: str, value: Any) -> None:
        request = self._clock.request
        if name in self._actions:
            request(name, self._actions[name])
        elif name in self._values:
            self._values[name] = float(value)
            if name in self._numbers:
                request(name, lambda session: session.adjust(**{name: float(value)}))
        elif name == "target":
            request(name, lambda session: session.drag(value))
        elif name == "pull":
            size = self._values["force"] * (-1.0 if value[0] == "-" else 1.0)
            vector = [size if axis == value[1] else 0.0 for axis in self._axes]
            request(name, lambda session: session.pull(vector))
        elif name == "described":
            self._values |= dict.fromkeys(self._numbers, 1.0)
            request(name, self._restore)
        elif value != self._kind:
            self._kind = value
            self._clock.say(f"{value} is set up, which may take a minute the first time")
            request(name, lambda session: self._switch(session, value))

    def _restore(self, session: LiveSession) -> None:
        session.adjust(**dict.fromkeys(self._numbers, 1.0))
        session.drag(None)

    def _switch(self, session: LiveSession, kind: str) -> None:
        try:
            session.control(kind)
            self._clock.say("")
        finally:
            self._kind = session.kind


def _plain(text: str) -> str:
    """Replace characters that control a terminal or break a line by blanks."""
    return "".join(each if each.isprintable() else " " for each in text)
