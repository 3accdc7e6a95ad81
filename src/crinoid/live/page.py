"""The page of a session: a server on this machine only, its scene and its panel."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from typing import Any

import rich
import viser

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
    """A server that cannot be asked to show itself to the world."""

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refuse: the page stays on this machine."""
        return None


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

    Raises
    ------
    PortError
        If the port cannot be had.
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
    """Refuse a port that cannot be had.

    Raises
    ------
    PortError
        If there is no such port, or something else has it.
    """
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
    server = _Server(host=HOST, port=port, verbose=False)
    sockets = server._websock_server

    async def refuse(client: Any) -> None:
        """Hang up on pages of others, which a browser lets talk to this machine as well."""
        connection = sockets._live_connections[client.client_id]
        request = connection.request
        origin = None if request is None else request.headers.get("Origin")
        own = {f"http://{name}:{server.get_port()}" for name in (HOST, "localhost")}
        if origin not in {None, *own}:
            await connection.close()

    sockets.on_client_connect(refuse)
    return server
