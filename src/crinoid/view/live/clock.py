"""Real-time clock of a session, which runs on its own thread."""

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from crinoid.results.result import Result
from crinoid.scenario import ScenarioError
from crinoid.view.live.interactive import StartError
from crinoid.view.live.session import LiveSession
from crinoid.view.live.session_log import Snapshot

_PERIOD = 1 / 30  # time between two frames (s)
_BUSY = 0.03  # longest computing time of a frame (s)
_MOST_LATE = 0.25  # longest delay that is caught up with (s)
_WINDOW = 1.5  # time over which the real-time factor is a mean (s)

Action = Callable[[LiveSession], None]


class SessionStatus(NamedTuple):
    """One instant of a session, and its pace."""

    frame: Snapshot
    factor: float  # simulated time over elapsed time; 0 while it is paused
    running: bool
    recording: float | None  # duration of the recording (s)


Show = Callable[[SessionStatus], None]


class RealTimeClock:
    """Clock that advances a session in real time while it has viewers, on its own thread.

    From `start` to `stop` only that thread uses the session, and calls ``show`` with each frame;
    ``save`` saves a recording and returns one line that names its folder.
    """

    def __init__(self, session: LiveSession, show: Show, save: Callable[[Result], str]) -> None:
        self._session, self._show, self._save = session, show, save
        self._actions: dict[object, Action] = {}
        self._lock, self._woken = threading.Lock(), threading.Event()
        self._ended = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._marks: deque[tuple[float, float]] = deque()
        self._batch = 1  # steps of one call: few where each is slow
        self.message = "", False  # the last one, of one line, and whether it reports a failure
        self.running = True  # whether it runs rather than pauses
        self.viewers = 0  # number of viewers; without any it is at rest
        self.recordings: list[str] = []  # a line for each recording
        self.error: BaseException | None = None  # the error that ended the thread, if one did

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread after the present steps, and save a recording in progress."""
        self._ended = True
        self._woken.set()
        self._thread.join()

    def request(self, name: object, action: Action) -> None:
        """Request an action between two steps; of several with one name the last is done."""
        with self._lock:
            self._actions.pop(name, None)
            self._actions[name] = action
        self._woken.set()

    def wake(self) -> None:
        """Make the thread check for changes immediately."""
        self._woken.set()

    def say(self, text: str, *, wrong: bool = False) -> None:
        """Set the message of the page."""
        self.message = text, wrong

    def toggle_running(self, session: LiveSession) -> None:
        """Pause or continue."""
        self.running = not self.running

    def toggle_recording(self, session: LiveSession) -> None:
        """Start or save a recording."""
        if session.recording is None:
            session.start_recording()
            if session.recording is not None:
                self.say("")
        else:
            self._save_recording()

    def reset(self, session: LiveSession) -> None:
        """Reset the session and run it; a recording in progress is saved before."""
        saved = session.recording is not None
        if saved:
            self._save_recording()
        note = session.reset()
        if note or not saved:
            self.say(note)
        self._marks.clear()
        self.running = True

    def _run(self) -> None:
        try:
            self._show(self._status())
            late = 0.0
            while not self._ended:
                start = time.perf_counter()
                self._woken.clear()
                acted = self._act()
                if not self._moves:
                    self._marks.clear()
                    if acted:
                        self._show(self._status())
                    self._woken.wait()
                    late = 0.0
                    continue
                late = self._advance(late)
                self._show(self._status())
                rest = _PERIOD - (time.perf_counter() - start)
                if rest > 0:
                    time.sleep(rest)
                late += min(time.perf_counter() - start, _MOST_LATE)
            if self._session.recording is not None:
                self._save_recording()
        except BaseException as error:  # raised again by the caller of `start`
            self.error = error

    @property
    def _moves(self) -> bool:
        return self.running and self.viewers > 0 and not self._session.halted

    def _advance(self, late: float) -> float:
        """Advance by the elapsed time; return the rest of it."""
        session, step = self._session, self._session.scenario.simulation.time_step
        start = time.perf_counter()
        while late >= step and time.perf_counter() - start < _BUSY:
            done = session.advance(max(1, min(int(late / step), self._batch)))
            late -= done * step
            if session.halted:
                self.say(session.halted, wrong=session.halted.startswith("failed"))
                break
        spent = time.perf_counter() - start
        if spent > _BUSY:
            self._batch = max(1, self._batch // 2)
        elif spent < _BUSY / 3:
            self._batch = min(64, 2 * self._batch)
        now = time.perf_counter()
        self._marks.append((now, session.time))
        while len(self._marks) > 2 and now - self._marks[1][0] > _WINDOW:
            self._marks.popleft()
        if session.recording_is_full or (session.halted and session.recording is not None):
            self._save_recording()
        return min(late, _MOST_LATE)

    def _act(self) -> bool:
        with self._lock:
            actions, self._actions = self._actions, {}
        for action in actions.values():
            try:
                action(self._session)
            except ScenarioError as error:
                self.say(" ".join(error.lines), wrong=True)
            except (StartError, OSError) as error:
                self.say(str(error), wrong=True)
        return bool(actions)

    def _save_recording(self) -> None:
        halted = self._session.halted
        result = self._session.stop_recording()
        text = "nothing was recorded: the recording was too short"
        if result is not None:
            text = self._save(result)
            self.recordings.append(text)
        self.say(f"{halted} {text}" if halted else text, wrong=bool(halted))

    def _status(self) -> SessionStatus:
        marks, factor = self._marks, 0.0
        if len(marks) > 1 and marks[-1][0] > marks[0][0]:
            factor = (marks[-1][1] - marks[0][1]) / (marks[-1][0] - marks[0][0])
        look, recording = self._session.look(), self._session.recording
        factor = factor if self._moves else 0.0
        return SessionStatus(look, factor, self._moves, recording)
