"""The door of the page: which requests come in, and which messages of a browser."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import suppress
from http import HTTPStatus
from typing import Annotated, Any, Literal, TypeAlias

from msgspec import DecodeError, Meta, Struct
from msgspec.msgpack import Decoder
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import InvalidHandshake
from websockets.http11 import Request

__all__ = ["Drag", "Heard", "Turn", "door"]

_OURS = re.compile(r"(127\.0\.0\.1|localhost|\[::1\])(:\d+)?", re.IGNORECASE)
"""Names of this machine; any port, as `ssh -L` may forward another one."""

_Number = Annotated[float, Meta(ge=-1e9, le=1e9)]
_Three: TypeAlias = tuple[_Number, _Number, _Number]
_Four: TypeAlias = tuple[_Number, _Number, _Number, _Number]


class _Message(Struct, forbid_unknown_fields=True):
    """What a browser sends; tags and fields are those of viser."""


class _Look(_Message, tag="ViewerCameraMessage"):
    wxyz: _Four
    position: _Three
    look_at: _Three
    up_direction: _Three
    fov: _Number
    near: _Number
    far: _Number
    image_height: _Number
    image_width: _Number


class Turn(_Message, tag="GuiUpdateMessage"):
    """A new value of a slider, a choice or a button."""

    uuid: str
    updates: dict[Literal["value"], bool | float | str]


class Drag(_Message, tag="TransformControlsUpdateMessage"):
    """A new place of the target."""

    name: Literal["/target"]
    wxyz: _Four
    position: _Three
    owner: Literal[""] = ""


class _Grasp(_Message, tag="TransformControlsDragStartMessage"):
    name: Literal["/target"]
    owner: Literal[""] = ""


class _Release(_Grasp, tag="TransformControlsDragEndMessage"): ...


Heard: TypeAlias = _Look | Turn | Drag | _Grasp | _Release
_DECODER = Decoder(Heard)


def door(offers: Callable[[Heard], bool]) -> type[ServerConnection]:
    """Return connections that refuse other sites, and drop what the page does not offer.

    A browser lets each site connect to this machine, and says which one asks (Origin). It also
    lets a site give its own name to the address of this machine (Host).
    """

    class Door(ServerConnection):
        async def handshake(self, process_request: Any = None, *others: Any) -> None:
            def answer(connection: ServerConnection, request: Request) -> Any:
                hosts = request.headers.get_all("Host")
                origins = request.headers.get_all("Origin")
                named = len(hosts) == 1 and _OURS.fullmatch(hosts[0])
                if named and all(each == f"http://{hosts[0]}" for each in origins):
                    return process_request(connection, request)
                return connection.respond(HTTPStatus.FORBIDDEN, "refused: another site\n")

            with suppress(InvalidHandshake):  # which websockets would print
                await super().handshake(answer, *others)

        async def recv(self, decode: bool | None = None) -> Any:
            while True:
                raw = await super().recv(decode)
                with suppress(DecodeError, UnicodeDecodeError):
                    if isinstance(raw, bytes) and offers(_DECODER.decode(raw)):
                        return raw

    return Door
