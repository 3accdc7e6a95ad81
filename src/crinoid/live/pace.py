"""A session that keeps pace with the clock, on a thread of its own."""

import threading
import time
from collections import deque
from collections.abc import Callable
from contextvars import copy_context
from typing import NamedTuple

from crinoid.live.frame import Frame
from crinoid.live.part import StartError
from crinoid.live.session import Session
from crinoid.result import Result
from crinoid.scenario import ScenarioError

__all__ = ["Pace", "Seen"]

_PERIOD = 1 / 30
"""Time between two frames (s)."""
_BUSY = 0.03
"""Time of the clock that the steps of a frame may take (s), where it cannot keep pace."""
_MOST_LATE = 0.25
"""Time of the clock that is caught up with (s); what is more is lost."""
_WINDOW = 1.5
"""Time over which the real-time factor is a mean (s)."""

Action = Callable[[Session], None]


class Seen(NamedTuple):
    """One instant of a session, and how it goes."""

    frame: Frame
    factor: float
    """Simulated time over that of the clock; 0 where it rests."""
    running: bool
    recording: float | None
    """How long it has been recorded (s)."""
    said: str
    """A line about what went wrong, or was done; empty for nothing."""
    wrong: bool
    """Whether that is something that went wrong."""


class Pace:
    """Runs a session in real time while somebody looks, and does what is asked between steps.

    Parameters
    ----------
    session
        What is run; from `start` to `stop` nobody else may use it.
    show
        Called with each frame, on the thread of the session.
    keep
        Saves a recording and says in a line where it is.
    """

    def __init__(
        self, session: Session, show: Callable[[Seen], None], keep: Callable[[Result], str]
    ) -> None:
        self._session, self._show, self._keep = session, show, keep
        self._actions: dict[object, Action] = {}
        self._lock, self._woken = threading.Lock(), threading.Event()
        self._ended = False
        # in the context of who made it, which tells where programs are kept
        run = copy_context().run
        self._thread = threading.Thread(target=run, args=[self._run], daemon=True)
        self._marks: deque[tuple[float, float]] = deque()
        self._said, self._wrong = "", False
        self._at_once = 1
        """Steps of one call: few where each takes long."""
        self.running = True
        """Whether it runs, rather than pauses."""
        self.watched = 0
        """How many look at it: where nobody does it rests."""
        self.kept: list[str] = []
        """A line for each recording."""
        self.error: BaseException | None = None
        """An error that ended the thread; None if there was none."""

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread after the steps that it is at; a recording under way is saved."""
        self._ended = True
        self._woken.set()
        self._thread.join()

    def ask(self, name: object, action: Action) -> None:
        """Have something done between two steps; of the same name only what was asked last."""
        with self._lock:
            self._actions.pop(name, None)
            self._actions[name] = action
        self._woken.set()

    def wake(self) -> None:
        """Look at once at what has changed."""
        self._woken.set()

    def say(self, text: str, *, wrong: bool = False) -> None:
        """Say something on the page, until something else is said."""
        self._said, self._wrong = text, wrong

    def toggle_recording(self, session: Session) -> None:
        """Begin to record, or save what was recorded."""
        if session.recording is None:
            session.start_recording()
            if session.recording is not None:
                self.say("")
        else:
            self._save()

    def reset(self, session: Session) -> None:
        """Go back to the start and on from there; a recording under way is saved before."""
        saved = session.recording is not None
        if saved:
            self._save()
        note = session.reset()
        if note or not saved:
            self.say(note)
        self._marks.clear()
        self.running = True

    def _run(self) -> None:
        try:
            self._show(self._seen())
            late = 0.0
            while not self._ended:
                begun = time.perf_counter()
                self._woken.clear()
                acted = self._act()
                if not self._moves:
                    self._marks.clear()
                    if acted:
                        self._show(self._seen())
                    self._woken.wait()
                    late = 0.0
                    continue
                late = self._advance(late)
                self._show(self._seen())
                rest = _PERIOD - (time.perf_counter() - begun)
                if rest > 0:
                    time.sleep(rest)
                late += min(time.perf_counter() - begun, _MOST_LATE)
            if self._session.recording is not None:
                self._save()
        except BaseException as error:  # told by who waits for the thread
            self.error = error

    @property
    def _moves(self) -> bool:
        return self.running and self.watched > 0 and not self._session.halted

    def _advance(self, late: float) -> float:
        """Go on by the time that has passed; return what is left of it."""
        session, step = self._session, self._session.scenario.simulation.time_step
        begun = time.perf_counter()
        while late >= step and time.perf_counter() - begun < _BUSY:
            done = session.advance(max(1, min(int(late / step), self._at_once)))
            late -= done * step
            if session.halted:
                self.say(session.halted, wrong=session.halted.startswith("failed"))
                break
        spent = time.perf_counter() - begun
        if spent > _BUSY:
            self._at_once = max(1, self._at_once // 2)
        elif spent < _BUSY / 3:
            self._at_once = min(64, 2 * self._at_once)
        now = time.perf_counter()
        self._marks.append((now, session.time))
        while len(self._marks) > 2 and now - self._marks[1][0] > _WINDOW:
            self._marks.popleft()
        if session.recording_is_full or (session.halted and session.recording is not None):
            self._save()
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

    def _save(self) -> None:
        halted = self._session.halted
        result = self._session.stop_recording()
        text = "nothing was recorded: it was too short"
        if result is not None:
            text = self._keep(result)
            self.kept.append(text)
        self.say(f"{halted}; {text}" if halted else text, wrong=bool(halted))

    def _seen(self) -> Seen:
        marks, factor = self._marks, 0.0
        if len(marks) > 1 and marks[-1][0] > marks[0][0]:
            factor = (marks[-1][1] - marks[0][1]) / (marks[-1][0] - marks[0][0])
        return Seen(
            self._session.look(),
            factor if self._moves else 0.0,
            self._moves,
            self._session.recording,
            self._said,
            self._wrong,
        )
