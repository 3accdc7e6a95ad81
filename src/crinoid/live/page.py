"""The page of a session: a server on this machine only, its scene and its panel."""

import os
import socket
from collections.abc import Callable
from functools import partial
from typing import Any
from unittest.mock import patch

import rich
import viser
import websockets.asyncio.server as websockets

from crinoid.live.door import door
from crinoid.live.pace import Pace, Seen
from crinoid.live.panel import Panel
from crinoid.live.scene import Scene
from crinoid.live.session import Session
from crinoid.result import Result

__all__ = ["HOST", "Page", "PortError", "check_port"]

HOST = "127.0.0.1"
"""This machine: nobody else can reach the page."""


class PortError(ValueError):
    """A port that cannot be had."""


class _Server(viser.ViserServer):
    """A server that nobody else reaches, and that no message from outside can upset."""

    def __init__(self, port: int) -> None:
        # websockets has an option for what makes connections, which viser does not pass on
        guarded = partial(websockets.serve, create_connection=door(self._offers))
        with patch.object(websockets, "serve", side_effect=guarded) as serve:
            super().__init__(host=HOST, port=port, verbose=False)
        if not serve.called:
            self.stop()
            raise RuntimeError("this viser lets nothing guard its connections")

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refuse: the page stays on this machine."""
        return None

    def _offers(self, name: str, value: Any) -> bool:
        """Tell whether an input of the page offers a value."""
        gui = vars(self).get("gui")
        handle = gui and gui._gui_input_handle_from_uuid.get(name)
        if not handle or handle.disabled:
            return False
        if isinstance(handle, viser.GuiSliderHandle):
            return isinstance(value, float) and handle.min <= value <= handle.max
        return value in getattr(handle, "options", (True,))


class Page:
    """A session in a browser, from when it is made until `close`.

    Parameters
    ----------
    session
        What is run; nobody else may use it meanwhile.
    port
        Where it is served; 0: wherever there is room.
    keep
        Saves a recording and says in a line where it is.
    """

    def __init__(self, session: Session, port: int, keep: Callable[[Result], str]) -> None:
        frame = session.look()
        self.pace = Pace(session, self._show, keep)
        self.server = _serve(port)
        """The server, of viser."""
        self.url = f"http://{HOST}:{self.server.get_port()}"
        self._scene = Scene(self.server, session.scenario, session.props, frame)
        self._panel = Panel(self.server, session, self.pace)
        self._let_drag()
        self.server.on_client_connect(self._count)
        self.server.on_client_disconnect(self._count)
        self.pace.start()

    def close(self) -> None:
        """End the session and the server; a recording under way is saved."""
        self.pace.stop()
        self.server.stop()

    def _show(self, seen: Seen) -> None:
        self._scene.show(seen.frame)
        self._panel.show(seen)

    def _count(self, _: Any) -> None:
        """Take down how many look at the page: where nobody does nothing is computed."""
        self.pace.watched = len(self.server.get_clients())
        self.pace.wake()

    def _let_drag(self) -> None:
        target = self._scene.target

        @target.on_update
        def _(event: Any) -> None:
            self._scene.dragged = event.phase != "end"
            place = [float(part) for part in target.position]
            where = [place[axis] for axis in self._scene.axes]
            self.pace.ask("target", lambda session: session.drag(where))


def check_port(port: int) -> None:
    """Refuse a port that cannot be had."""
    if not 0 <= port <= 65535:
        raise PortError(f"got {port}, takes 0 (any that is free) to 65535")
    with socket.socket() as trial:
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            trial.bind((HOST, port))
        except OSError as error:
            reason = os.strerror(error.errno or 0)
            text = f"got {port}, which cannot be had ({reason}); takes another, or 0 for any"
            raise PortError(text) from None


def _serve(port: int) -> viser.ViserServer:
    """Start a server; where the port is taken viser would go to another one without a word."""
    check_port(port)
    rich.get_console().quiet = True  # viser would speak through it
    os.environ.pop("_VISER_PORT_OVERRIDE", None)
    return _Server(port)
