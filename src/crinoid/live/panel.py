"""The panel beside the scene: numbers to read, sliders and buttons."""

import time
from collections import deque
from html import escape
from typing import Any

import numpy as np
import viser
from viser import uplot

from crinoid.live.frame import Frame
from crinoid.live.knobs import Knobs
from crinoid.live.pace import Pace, Seen
from crinoid.live.part import kinds_for
from crinoid.live.session import Session
from crinoid.report.style import BLUE, GREY, VERMILLION
from crinoid.report.units import DEGREES, Unit, length_unit
from crinoid.space import ANGLES, AXES, CHANNELS

__all__ = ["Panel"]

_TELL = 0.1
"""Time between two looks at the numbers (s of the clock)."""
_DRAW = 0.25
"""And at the chart."""
_SPAN = 20.0
"""Simulated time that the chart goes back (s)."""
_LATELY = 0.5
"""How long a touch is told (s)."""
_SLOW = 0.95
"""Real-time factor below which it is said that it is slow."""
_MOST_TURBULENT = 3.0
_PULLS = (0.0, 4.0)
"""Range of the force of a pull, over the one that pulls the tip well aside."""


class Panel:
    """Sliders, buttons and numbers of a session.

    Parameters
    ----------
    server
        The page.
    session
        What is run; only what never changes of it is looked at here.
    pace
        What runs it.
    """

    def __init__(self, server: viser.ViserServer, session: Session, pace: Pace) -> None:
        self._gui, self._pace, self._scenario = server.gui, pace, session.scenario
        self._kinds, self._kind = kinds_for(session.scenario), session.kind
        self._debris, self._strength = session.props.debris is not None, session.tip_force
        self._told, self._drawn, self._seen = 0.0, 0.0, (False, False)
        self._hit = (0.0, -np.inf)
        """How long the arm was touched since the start, and when last (s)."""
        self._errors: deque[tuple[float, float]] = deque()
        self._sliders: dict[str, Any] = {}
        server.gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
        server.gui.main_panel.dock_right()
        server.gui.set_panel_label(_plain(session.scenario.title or "crinoid live"))
        self._numbers, self._line = self._gui.add_html(""), self._gui.add_html("")
        self._add_clock()
        self._add_numbers()
        self._add_control()
        self._add_disturbances()
        self._add_chart()

    def show(self, seen: Seen) -> None:
        """Show an instant."""
        now = time.perf_counter()
        self._feel(seen.frame)
        frame, state = seen.frame, (seen.running, seen.recording is not None)
        while self._errors and self._errors[-1][0] > frame.time:
            self._errors.clear()  # it was reset
        if not self._errors or frame.time > self._errors[-1][0]:
            self._errors.append((frame.time, frame.error))
        while frame.time - self._errors[0][0] > _SPAN:
            self._errors.popleft()
        # what changes what may be done is told at once
        if now - self._told > _TELL or state != self._seen or not seen.running:
            self._tell(seen)
            self._told, self._seen = now, state
        if now - self._drawn > _DRAW or not seen.running:
            times, errors = np.array(self._errors).T
            self._chart.data = (times, 1e3 * errors)
            self._drawn = now

    def _feel(self, frame: Frame) -> None:
        """Take down when the arm was last touched: a hit is over between two looks."""
        if frame.touched > self._hit[0] or frame.touching:
            self._hit = (frame.touched, frame.time)
        elif frame.touched < self._hit[0]:
            self._hit = (frame.touched, -np.inf)

    def say(self, text: str, *, wrong: bool = False) -> None:
        """Say something in a line."""
        colour = VERMILLION if wrong else BLUE
        style = f"color:{colour};font-size:0.85em;padding:0 1em 0.4em;overflow-wrap:anywhere"
        self._line.content = f'<div id="said" style="{style}">{escape(_plain(text))}</div>'

    def _tell(self, seen: Seen) -> None:
        frame = seen.frame
        rows = [("time", f"{frame.time:.2f} s"), ("speed", _speed(seen))]
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
        self._go.label = "Pause" if self._pace.running else "Run"
        recorded = f"Stop and save ({seen.recording or 0.0:.1f} s)"
        self._record.label = "Record" if seen.recording is None else recorded
        self.say(seen.said, wrong=seen.wrong)

    def _add_clock(self) -> None:
        self._go = self._gui.add_button("Pause")
        self._reset = self._gui.add_button("Reset", hint="Back to the start; sliders stay.")
        self._record = self._gui.add_button("Record", color="red")

        @self._go.on_click
        def _(_: Any) -> None:
            self._pace.running = not self._pace.running
            self._pace.ask("look", lambda session: None)

        @self._reset.on_click
        def _(_: Any) -> None:
            self._pace.ask("reset", self._pace.reset)

        @self._record.on_click
        def _(_: Any) -> None:
            self._pace.ask("record", self._pace.toggle_recording)

    def _add_numbers(self) -> None:
        kinds = {flow.kind for flow in self._scenario.flow}
        with self._gui.add_folder("Water and arm"):
            if kinds:
                self._add_slider("current", "current", 0.0, 3.0, "of the velocity of all flows")
            if "turbulence" in kinds:
                self._add_slider("intensity", "turbulence", 0.0, self._most, "of its intensity")
                self._add_slider("length_scale", "eddies", 0.25, 4.0, "of their length scale")
            modulus = "of Young's modulus, or of EA, EI and GJ"
            self._add_slider("stiffness", "stiffness", 0.2, 5.0, modulus)

    @property
    def _most(self) -> float:
        """Largest multiple of the intensity of turbulence that a scenario may have."""
        shares = [getattr(flow, "intensity", 0.0) for flow in self._scenario.flow]
        return float(np.floor(20 * min(_MOST_TURBULENT, 1 / max(shares))) / 20)

    def _add_control(self) -> None:
        with self._gui.add_folder("Control"):
            if len(self._kinds) > 1:
                choice = self._gui.add_dropdown("controller", self._kinds, initial_value=self._kind)

                @choice.on_update
                def _(_: Any) -> None:
                    self._switch(choice)

            self._add_slider("gains", "PID gains", 0.0, 3.0, "of kp, ki and kd")
            self._sliders["gains"].disabled = self._kind != "pid"
            back = self._gui.add_button("As described", hint="All sliders and the target back.")

            @back.on_click
            def _(_: Any) -> None:
                for slider in self._sliders.values():
                    slider.value = 1.0
                self._pace.ask("target", lambda session: session.drag(None))

    def _switch(self, choice: Any) -> None:
        kind = str(choice.value)

        def switch(session: Session) -> None:
            try:
                session.control(kind)
                self._pace.say("")
            finally:
                choice.value = session.kind
                self._sliders["gains"].disabled = session.kind != "pid"

        self.say(f"{kind} is set up, which may take a minute the first time")
        self._pace.ask("controller", switch)

    def _add_disturbances(self) -> None:
        with self._gui.add_folder("Disturb"):
            throw = self._gui.add_button("Throw debris", disabled=not self._debris)
            low, high = (each * self._strength for each in _PULLS)
            force = self._gui.add_slider(
                "pull (N)", low, high, high / 40, self._strength, hint="Force of a pull."
            )
            axes = AXES[self._scenario.arm.dimension]
            ways = {f"{sign}{axis}": (sign, axis) for axis in axes for sign in ("-", "+")}
            pull = self._gui.add_button_group("pull tip", tuple(ways))

            @throw.on_click
            def _(_: Any) -> None:
                self._pace.ask("throw", lambda session: session.throw())

            @pull.on_click
            def _(event: Any) -> None:
                sign, axis = ways[event.target.value]
                size = float(force.value) * (-1 if sign == "-" else 1)
                vector = [size if each == axis else 0.0 for each in axes]
                self._pace.ask("pull", lambda session: session.pull(vector))

    def _add_chart(self) -> None:
        self._chart = self._gui.add_uplot(
            (np.zeros(2), np.zeros(2)),
            (
                uplot.Series(label="time (s)"),
                uplot.Series(label="tip error (mm)", stroke=BLUE, width=2),
            ),
            scales={"x": uplot.Scale(time=False, auto=True), "y": uplot.Scale(auto=True)},
            legend=uplot.Legend(show=False),
            title="tip error (mm) over time (s)",
            height=160,
        )

    def _add_slider(self, knob: str, label: str, low: float, high: float, hint: str) -> None:
        slider = self._gui.add_slider(
            label, low, high, 0.05, getattr(Knobs(), knob), hint=f"A multiple {hint}."
        )
        self._sliders[knob] = slider

        @slider.on_update
        def _(_: Any) -> None:
            value = float(slider.value)
            self._pace.ask(knob, lambda session: session.turn(**{knob: value}))


def _speed(seen: Seen) -> str:
    if not seen.running:
        return "paused"
    text = f"{seen.factor:.2f} x real time"
    return f"{text}, behind the clock" if seen.factor < _SLOW else text


def _plain(text: str) -> str:
    """Return a text without what controls a terminal or breaks a line."""
    return "".join(each if each.isprintable() else " " for each in text)
