"""The door of the page: which requests come in, and which messages of a browser."""

import re
from collections.abc import Callable
from contextlib import suppress
from http import HTTPStatus
from typing import Annotated, Any, Literal, Union

from msgspec import DecodeError, Meta, defstruct
from msgspec.msgpack import Decoder
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import InvalidHandshake

__all__ = ["door"]

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
"""Fields of the messages of viser that the page makes use of."""
_KINDS = [
    defstruct(name, list(fields.items()), tag=name, forbid_unknown_fields=True)
    for name, fields in _MESSAGES.items()
]
_DECODER: Decoder[Any] = Decoder(Union[tuple(_KINDS)])  # noqa: UP007


def door(offers: Callable[[str, object], bool]) -> type[ServerConnection]:
    """Return connections that refuse other sites, and drop values that an input does not offer.

    A browser connects to this machine for each site, and says which one asks (Origin). A site
    may also give its own name to the address of this machine (Host).
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
