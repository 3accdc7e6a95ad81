"""Control panel of a session: numbers, sliders and buttons next to its scene."""

import time
from collections import deque
from html import escape
from typing import Any

import numpy as np
import viser
from viser import uplot

from crinoid.foundation.axes import ANGLES, AXES, CHANNELS
from crinoid.results.units import DEGREES, Unit, length_unit
from crinoid.view.figures.style import BLUE, GREY, VERMILLION
from crinoid.view.live.adjustable import AdjustableNumbers
from crinoid.view.live.clock import Action, RealTimeClock, SessionStatus
from crinoid.view.live.interactive import kinds_for
from crinoid.view.live.session import LiveSession

_NUMBERS, _CHART = 0.1, 0.25  # periods of the numbers and of the chart (s)
_SPAN = 20.0  # simulated time in the chart (s)
_LATELY = 0.5  # time for which a contact is shown (s)
_SLOW = 0.95  # real-time factor below which the page reports a delay
_MOST_TURBULENT = 3.0
_ERROR = "tip error (mm)"
_PULLS = (0.0, 4.0)  # range of the force of a pull, over `LiveSession.tip_force`


class ControlPanel:
    """Sliders, buttons and numbers of a session, of which only constants are read here."""

    def __init__(
        self, server: viser.ViserServer, session: LiveSession, clock: RealTimeClock
    ) -> None:
        self._gui, self._clock, self._scenario = server.gui, clock, session.scenario
        self._kinds, self._kind = kinds_for(session.scenario), session.kind
        self._debris, self._strength = session.bodies.debris is not None, session.tip_force
        self._shown, self._drawn, self._mode = 0.0, 0.0, (False, False)
        self._hit = (0.0, -np.inf)
        """Total duration of contact since the start, and time of the last one (s)."""
        self._errors: deque[tuple[float, float]] = deque()
        self._sliders: dict[str, Any] = {}
        server.gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
        server.gui.main_panel.dock_right()
        server.gui.set_panel_label(_plain(session.scenario.title or "crinoid live"))
        self._numbers, self._line = self._gui.add_html(""), self._gui.add_html("")
        self._go = self._add_button("Pause", clock.toggle_running)
        hint = "Back to the start; sliders stay as set."
        self._add_button("Reset", clock.reset, hint=hint)
        self._record = self._add_button("Record", clock.toggle_recording, color="red")
        self._add_numbers()
        self._add_control()
        self._add_disturbances()
        self._chart = self._gui.add_uplot(
            (np.zeros(2), np.zeros(2)),
            (uplot.Series(label="time (s)"), uplot.Series(label=_ERROR, stroke=BLUE, width=2)),
            scales={"x": uplot.Scale(time=False, auto=True), "y": uplot.Scale(auto=True)},
            legend=uplot.Legend(show=False),
            title=f"{_ERROR} over time (s)",
            height=160,
        )

    def show(self, status: SessionStatus) -> None:
        """Show an instant."""
        now, frame = time.perf_counter(), status.frame
        mode = status.running, status.recording is not None
        # a hit is over between two updates of the numbers
        if frame.touched > self._hit[0] or frame.touching:
            self._hit = (frame.touched, frame.time)
        elif frame.touched < self._hit[0]:
            self._hit = (frame.touched, -np.inf)
        while self._errors and self._errors[-1][0] > frame.time:
            self._errors.clear()  # it was reset
        if not self._errors or frame.time > self._errors[-1][0]:
            self._errors.append((frame.time, frame.error))
        while frame.time - self._errors[0][0] > _SPAN:
            self._errors.popleft()
        # another label of a button is shown without delay
        if now - self._shown > _NUMBERS or mode != self._mode or not status.running:
            self._show_numbers(status)
            self._shown, self._mode = now, mode
        if now - self._drawn > _CHART or not status.running:
            times, errors = np.array(self._errors).T
            self._chart.data = (times, 1e3 * errors)
            self._drawn = now

    def say(self, text: str, *, wrong: bool = False) -> None:
        """Show a message of one line."""
        colour = VERMILLION if wrong else BLUE
        style = f"color:{colour};font-size:0.85em;padding:0 1em 0.4em;overflow-wrap:anywhere"
        self._line.content = f'<div id="said" style="{style}">{escape(_plain(text))}</div>'

    def _show_numbers(self, status: SessionStatus) -> None:
        frame = status.frame
        late = ", behind the clock" if status.factor < _SLOW else ""
        speed = f"{status.factor:.2f} x real time{late}" if status.running else "paused"
        rows = [("time", f"{frame.time:.2f} s"), ("speed", speed)]
        rows.append(("tip error", length_unit(frame.error).text(frame.error)))
        axes = [AXES[3].index(axis) for axis in AXES[self._scenario.arm.dimension]]
        names = ", ".join(AXES[self._scenario.arm.dimension])
        tip = frame.nodes[-1][axes] + np.asarray(self._scenario.base.position)
        rows.append((f"tip {names}", f"{', '.join(f'{part:.3f}' for part in tip)} m"))
        water = frame.flow[-1][axes]
        rows.append((f"water {names}", f"{', '.join(f'{part:.3f}' for part in water)} m/s"))
        for name, value in zip(CHANNELS[len(axes)], frame.servo, strict=True):
            if name in self._scenario.base.channels.present:
                unit = DEGREES if name in ANGLES else Unit(1e3, "mm")
                rows.append((name, f"{value * unit.factor:.1f} {unit.name}"))
        if len(frame.obstacles):
            rows.append(("contact", "yes" if frame.time - self._hit[1] < _LATELY else "no"))
        cells = "".join(
            f'<tr><td style="color:{GREY};padding-right:1em;white-space:nowrap">{escape(name)}</td>'
            f'<td style="font-variant-numeric:tabular-nums">{escape(text)}</td></tr>'
            for name, text in rows
        )
        style = "font-size:0.85em;margin:0.2em 1em 0.4em;line-height:1.35"
        self._numbers.content = f'<table id="numbers" style="{style}">{cells}</table>'
        self._go.label = "Pause" if self._clock.running else "Run"
        recorded = f"Stop and save ({status.recording or 0.0:.1f} s)"
        self._record.label = "Record" if status.recording is None else recorded
        self.say(status.message, wrong=status.wrong)

    def _add_button(self, label: str, action: Action, **options: Any) -> Any:
        button = self._gui.add_button(label, **options)
        button.on_click(lambda _: self._clock.request(label, action))
        return button

    def _add_numbers(self) -> None:
        kinds = {flow.kind for flow in self._scenario.flow}
        with self._gui.add_folder("Water and arm"):
            if kinds:
                self._add_slider("current", "current", 0.0, 3.0, "of the velocity of all flows")
            if "turbulence" in kinds:
                shares = [getattr(flow, "intensity", 0.0) for flow in self._scenario.flow]
                most = float(np.floor(20 * min(_MOST_TURBULENT, 1 / max(shares))) / 20)
                self._add_slider("intensity", "turbulence", 0.0, most, "of its intensity")
                self._add_slider("length_scale", "eddies", 0.25, 4.0, "of their length scale")
            modulus = "of Young's modulus, or of EA, EI and GJ"
            self._add_slider("stiffness", "stiffness", 0.2, 5.0, modulus)

    def _add_control(self) -> None:
        with self._gui.add_folder("Control"):
            if len(self._kinds) > 1:
                choice = self._gui.add_dropdown("controller", self._kinds, initial_value=self._kind)
                choice.on_update(lambda _: self._switch(choice))
            self._add_slider("gains", "PID gains", 0.0, 3.0, "of kp, ki and kd")
            self._sliders["gains"].disabled = self._kind != "pid"
            back = self._gui.add_button("As described", hint="All sliders and the target back.")

            @back.on_click
            def _(_: Any) -> None:
                for slider in self._sliders.values():
                    slider.value = 1.0
                self._clock.request("target", lambda session: session.drag(None))

    def _switch(self, choice: Any) -> None:
        kind = str(choice.value)

        def switch(session: LiveSession) -> None:
            try:
                session.control(kind)
                self._clock.say("")
            finally:
                choice.value = session.kind
                self._sliders["gains"].disabled = session.kind != "pid"

        self.say(f"{kind} is set up, which may take a minute the first time")
        self._clock.request("controller", switch)

    def _add_disturbances(self) -> None:
        with self._gui.add_folder("Disturb"):
            self._add_button("Throw debris", LiveSession.throw, disabled=not self._debris)
            low, high = (each * self._strength for each in _PULLS)
            hint = "Force of a pull."
            force = self._gui.add_slider(
                "pull (N)", low, high, high / 40, self._strength, hint=hint
            )
            axes = AXES[self._scenario.arm.dimension]
            ways = {f"{sign}{axis}": (sign, axis) for axis in axes for sign in ("-", "+")}
            pull = self._gui.add_button_group("pull tip", tuple(ways))

            @pull.on_click
            def _(event: Any) -> None:
                sign, axis = ways[event.target.value]
                size = float(force.value) * (-1 if sign == "-" else 1)
                vector = [size if each == axis else 0.0 for each in axes]
                self._clock.request("pull", lambda session: session.pull(vector))

    def _add_slider(self, name: str, label: str, low: float, high: float, hint: str) -> None:
        start, hint = getattr(AdjustableNumbers(), name), f"A multiple {hint}."
        slider = self._sliders[name] = self._gui.add_slider(
            label, low, high, 0.05, start, hint=hint
        )

        @slider.on_update
        def _(_: Any) -> None:
            value = float(slider.value)
            self._clock.request(name, lambda session: session.adjust(**{name: value}))


def _plain(text: str) -> str:
    """Replace characters that control a terminal or break a line by blanks."""
    return "".join(each if each.isprintable() else " " for each in text)
