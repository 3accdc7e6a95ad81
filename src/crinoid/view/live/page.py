"""Page of a session: a server for this machine only, its scene and its panel."""

import os
import re
import socket
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from http import HTTPStatus
from typing import Annotated, Any, Literal, Union
from unittest.mock import patch

import rich
import viser
import websockets.asyncio.server as websockets
from msgspec import DecodeError, Meta, defstruct
from msgspec.msgpack import Decoder
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import InvalidHandshake

from crinoid.results.result import Result
from crinoid.view.live.clock import RealTimeClock, SessionStatus
from crinoid.view.live.panel import ControlPanel
from crinoid.view.live.scene import LiveScene
from crinoid.view.live.session import LiveSession

_OURS = re.compile(r"(127\.0\.0\.1|localhost|\[::1\])(:\d+)?", re.IGNORECASE)
"""Names of this machine; any port, as `ssh -L` may forward another one."""

_Number = Annotated[float, Meta(ge=-1e6, le=1e6)]
_Place, _Turn = tuple[(_Number,) * 3], tuple[(_Number,) * 4]
_SIZES = ("fov", "near", "far", "image_height", "image_width")
_NODE = {"name": Literal["/target"], "owner": Literal[""]}
_MESSAGES: dict[str, dict[str, Any]] = {
    "ViewerCameraMessage": dict.fromkeys(_SIZES, _Number)
    | {"position": _Place, "look_at": _Place, "up_direction": _Place, "wxyz": _Turn},
    "GuiUpdateMessage": {"uuid": str, "updates": dict[Literal["value"], bool | _Number | str]},
    "TransformControlsUpdateMessage": _NODE | {"position": _Place, "wxyz": _Turn},
    "TransformControlsDragStartMessage": _NODE,
    "TransformControlsDragEndMessage": _NODE,
}
"""Fields of those messages of viser that the page uses."""
_KINDS = [
    defstruct(name, list(fields.items()), tag=name, forbid_unknown_fields=True)
    for name, fields in _MESSAGES.items()
]
_DECODER: Decoder[Any] = Decoder(Union[tuple(_KINDS)])  # noqa: UP007


def guarded_connection(offers: Callable[[str, object], bool]) -> type[ServerConnection]:
    """Return connections that refuse other sites, and drop values that an input does not offer.

    A browser connects to this machine for any site, which it names (Origin). A site can also
    resolve its own name to the address of this machine (Host).
    """

    class Door(ServerConnection):
        async def handshake(self, process_request: Any = None, *others: Any) -> None:
            def answer(connection: ServerConnection, request: Any) -> Any:
                host, *more = request.headers.get_all("Host") or [""]
                sites = {*request.headers.get_all("Origin"), f"http://{host}"}
                if more or len(sites) > 1 or not _OURS.fullmatch(host):
                    return connection.respond(HTTPStatus.FORBIDDEN, "refused: another site\n")
                return process_request(connection, request)

            with suppress(InvalidHandshake):  # which websockets would print
                await super().handshake(answer, *others)

        async def recv(self, decode: bool | None = None) -> Any:
            while True:
                raw = await super().recv(decode)
                with suppress(DecodeError, UnicodeDecodeError):
                    message = _DECODER.decode(raw if isinstance(raw, bytes) else b"")
                    turns = getattr(message, "updates", {})
                    if all(offers(message.uuid, value) for value in turns.values()):
                        return raw

    return Door


HOST = "127.0.0.1"  # this machine, which no other one reaches by that address


class PortError(ValueError):
    """A port that is unavailable."""


class LocalServer(viser.ViserServer):
    """A server for this machine only, which drops all messages that the page does not send."""

    def __init__(self, port: int) -> None:
        # viser does not pass on this option of websockets
        guarded = partial(websockets.serve, create_connection=guarded_connection(self._offers))
        with patch.object(websockets, "serve", side_effect=guarded) as serve:
            super().__init__(host=HOST, port=port, verbose=False)
        if not serve.called:
            self.stop()
            raise RuntimeError("this version of viser cannot guard its connections")

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Return no address, as the page is for this machine only."""
        return None

    def _offers(self, name: str, value: Any) -> bool:
        gui = vars(self).get("gui")
        handle = gui and gui._gui_input_handle_from_uuid.get(name)
        if not handle or handle.disabled:
            return False
        if isinstance(handle, viser.GuiSliderHandle):
            return isinstance(value, float) and handle.min <= value <= handle.max
        return value in getattr(handle, "options", (True,))


class Page:
    """A session in a browser until `close`; until then only the page uses the session.

    A port of 0 is any free one; ``save`` saves a recording and returns one line with its folder.
    """

    def __init__(self, session: LiveSession, port: int, save: Callable[[Result], str]) -> None:
        frame = session.look()
        self.clock = RealTimeClock(session, self._show, save)
        check_port(port)  # viser would silently choose another one
        rich.get_console().quiet = True  # viser would print through it
        os.environ.pop("_VISER_PORT_OVERRIDE", None)
        self.server: viser.ViserServer = LocalServer(port)
        self.url = f"http://{HOST}:{self.server.get_port()}"
        self._scene = LiveScene(
            self.server, session.scenario, session.bodies, frame, session.prepared.surfaces
        )
        self._panel = ControlPanel(self.server, session, self.clock)
        target = self._scene.target

        @target.on_update
        def _(event: Any) -> None:
            self._scene.dragged = event.phase != "end"
            where = [float(target.position[axis]) for axis in self._scene.axes]
            self.clock.request("target", lambda session: session.drag(where))

        self.server.on_client_connect(self._count)
        self.server.on_client_disconnect(self._count)
        self.clock.start()

    def close(self) -> None:
        """End the session and the server, and save a recording in progress."""
        self.clock.stop()
        self.server.stop()

    def _show(self, status: SessionStatus) -> None:
        self._scene.show(status.frame)
        self._panel.show(status)

    def _count(self, _: Any) -> None:
        """Count the viewers of the page; without any nothing is computed."""
        self.clock.viewers = len(self.server.get_clients())
        self.clock.wake()


def check_port(port: int) -> None:
    """Refuse a port that is unavailable."""
    with socket.socket() as trial:
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            trial.bind((HOST, port))
        except OSError as error:
            reason = os.strerror(error.errno or 0)
            hint = "Choose another port, or 0 for any free one."
            raise PortError(f"got {port}, which is unavailable ({reason}). {hint}") from None
