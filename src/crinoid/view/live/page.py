"""Page of a session: a server for this machine only, which sends the page and its frames."""

import asyncio
import logging
import os
import re
import secrets
import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from html import escape
from http import HTTPStatus
from typing import Any

import numpy as np
from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from crinoid.foundation.version import __version__
from crinoid.results.result import Result
from crinoid.results.scene.scene import REACH
from crinoid.scenario import refusal
from crinoid.view.live.charts import SPAN, LiveCharts
from crinoid.view.live.clock import RealTimeClock, SessionStatus
from crinoid.view.live.panel import ControlPanel
from crinoid.view.live.scene import LiveScene
from crinoid.view.live.session import LiveSession
from crinoid.view.page import parts
from crinoid.view.page.plots import plots_of
from crinoid.view.page.scene import animation_texts

_OURS = re.compile(r"(127\.0\.0\.1|localhost|\[::1\])(:\d+)?", re.IGNORECASE)
"""Names of this machine; any port, as `ssh -L` may forward another one."""
HOST = "127.0.0.1"  # this machine, which no other one reaches by that address
_AHEAD = 2  # frames that a page may have before it has drawn them
_LONGEST = 1000  # longest message of a page (bytes)
_KEYS = "Space pauses. Drag the ring at the target to move it."


class Page:
    """A session in browsers until `close`; until then only the page uses the session.

    A port of 0 is any free one; ``save`` saves a recording and returns one line with its folder.
    """

    def __init__(self, session: LiveSession, port: int, save: Callable[[Result], str]) -> None:
        check_port(port)
        first, scenario = session.look(), session.scenario
        self.clock = RealTimeClock(session, self._show, save)
        self._scenario, self._now, self._start = scenario, first, first
        self._scene = LiveScene(session, first)
        self._charts = LiveCharts(scenario, session.loop.system.inputs)
        self._panel, self._id = ControlPanel(session, self.clock), secrets.token_hex(8)
        self._connections: set[ServerConnection] = set()
        self._frame, self._text, self._changed = b"", "", asyncio.Event()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self._server: Server = self._wait(self._serve(port))
        self.port: int = next(iter(self._server.sockets)).getsockname()[1]
        self.url = f"http://{HOST}:{self.port}"
        self.clock.start()

    def close(self) -> None:
        """End the session and the server, and save a recording in progress."""
        self.clock.stop()
        self._server.close()
        self._wait(self._server.wait_closed())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def _wait(self, work: Any) -> Any:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result()

    async def _serve(self, port: int) -> Server:
        silent = logging.Logger("crinoid.live", logging.CRITICAL + 1)
        options: dict[str, Any] = {"max_size": _LONGEST, "compression": None, "logger": silent}
        return await serve(self._meet, HOST, port, process_request=self._answer, **options)

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Answer a request; None lets it become a connection for frames.

        A browser connects to this machine for any site, which it names (Origin). A site can also
        resolve its own name to the address of this machine (Host).
        """
        host, *more = request.headers.get_all("Host") or [""]
        sites = {*request.headers.get_all("Origin"), f"http://{host}"}
        if more or len(sites) > 1 or not _OURS.fullmatch(host):
            return connection.respond(HTTPStatus.FORBIDDEN, "refused: another site\n")
        if "Upgrade" in request.headers:
            return None
        if request.path != "/":
            return connection.respond(HTTPStatus.NOT_FOUND, "only / is here\n")
        found = connection.respond(HTTPStatus.OK, self.html())
        del found.headers["Content-Type"]
        found.headers["Content-Type"] = "text/html; charset=utf-8"
        found.headers["Cache-Control"] = "no-store"
        return found

    async def _meet(self, connection: ServerConnection) -> None:
        """Feed a page with frames, and do what it requests."""
        room = asyncio.BoundedSemaphore(_AHEAD)
        feeder = asyncio.create_task(self._feed(connection, room))
        self._connections.add(connection)
        self._count()
        try:
            with suppress(ConnectionClosed):
                async for message in connection:
                    if message == "seen":
                        with suppress(ValueError):
                            room.release()
                    elif mistake := self._panel.hear(message):
                        await connection.send(parts.json_of({"refused": mistake}))
                    else:
                        self._publish(self._panel.text(), self._frame)
        finally:
            feeder.cancel()
            self._connections.discard(connection)
            self._count()

    async def _feed(self, connection: ServerConnection, room: asyncio.Semaphore) -> None:
        """Send the newest frame whenever the page has drawn another; those between are dropped."""
        frame, text = b"", ""
        with suppress(ConnectionClosed):
            await connection.send(parts.json_of({"id": self._id}))
            while True:
                if self._text != text:
                    text = self._text
                    await connection.send(text)
                elif self._frame is not frame:
                    await room.acquire()
                    frame = self._frame
                    await connection.send(frame)
                else:
                    await self._changed.wait()

    def _count(self) -> None:
        """Count the viewers of the page; without any nothing is computed."""
        self.clock.viewers = len(self._connections)
        self.clock.wake()

    def _show(self, status: SessionStatus) -> None:
        """Show an instant; called on the clock's thread."""
        now = self._now = status.frame
        if now.time == 0:
            self._start = now
        given = [now.time], self._charts.numbers(now), now.pull, self._scene.numbers(now)
        numbers = np.concatenate(given)
        new = self._panel.text(status), numbers.astype("<f4").tobytes()
        self._loop.call_soon_threadsafe(self._publish, *new)

    def _publish(self, text: str, frame: bytes) -> None:
        self._text, self._frame = text, frame
        self._changed.set()
        self._changed = asyncio.Event()

    def html(self) -> str:
        """Return the page as HTML, with the present instant."""
        scenario, time = self._scenario, self._now.time
        arm = "arm in space" if scenario.arm.dimension == 3 else "planar arm"
        kind = f"live · {arm} · {scenario.arm.nodes} nodes"
        table: dict[str, Any] = {"id": self._id, "span": [time, time + SPAN], "kind": kind}
        table |= {"ghost": "Start", "reach": REACH}
        table["controls"] = [each._asdict() for each in self._panel.controls.values()]
        scene = self._scene.scene(self._now, self._start)
        plots = plots_of(self._charts.charts, 0.0, SPAN)
        bar = '<div class="bar" id="bar"></div>'
        texts, _ = animation_texts(scene, plots, bar, _KEYS, table)
        title = scenario.title or "crinoid live"
        body = parts.filled("live.html", title=escape(title), kind=escape(kind), **texts)
        scripts = [parts.bokeh_script(), parts.run_script("live")]
        return parts.html_page(body, scripts, title=title, version=__version__, kind="live")


def check_port(port: int) -> None:
    """Refuse a port that is unavailable."""
    with socket.socket() as trial:
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            trial.bind((HOST, port))
        except OSError as error:
            reason = os.strerror(error.errno or 0)
            hint = "Choose another port, or 0 for any free one."
            subject = f"got {port}, which is unavailable ({reason}). {hint}"
            raise refusal("--port", subject) from None
