"""The door of the page: other sites stay outside, and junk changes nothing and prints nothing."""

import random
import socket
import time

import numpy as np
import pytest

viser = pytest.importorskip("viser", reason="needs viser")
from msgspec.msgpack import encode as encoded  # noqa: E402
from viser.infra import Message  # noqa: E402
from websockets.frames import Frame, Opcode  # noqa: E402
from websockets.sync.client import connect  # noqa: E402

from crinoid.view.live.page import Page  # noqa: E402
from crinoid.view.live.session import LiveSession  # noqa: E402
from helpers.live import LIVE  # noqa: E402

pytestmark = pytest.mark.slow

UPGRADE = (
    "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
    f"Sec-WebSocket-Protocol: viser-v{viser.__version__}\r\n"
)
FORWARD = {"wxyz": [1.0, 0.0, 0.0, 0.0]}
DRAG = {"type": "TransformControlsUpdateMessage", "name": "/target", "owner": ""}
DRAG |= {"position": [0.1, 0.0, -0.3]} | FORWARD
LOOK = {
    "type": "ViewerCameraMessage",
    **{key: [0.0, 0.0, 1.0] for key in ("position", "look_at", "up_direction")},
    **dict.fromkeys(("fov", "near", "far"), 1.0),
    **dict.fromkeys(("image_height", "image_width"), 600),
} | FORWARD
JUNK = [None, float("nan"), float("inf"), -float("inf"), 1e300, -1, -0.5, 10**15, b"x", [], [1.0]]
JUNK += ["", "x", "/target", [0.0, 0.0, float("nan")], [1e12] * 3, {}, {"value": -1}, [[[]]] * 4]


@pytest.fixture(scope="module")
def page():
    page = Page(LiveSession(LIVE), 0, str)
    yield page
    page.close()
    assert page.clock.error is None


def session_of(page):
    return page.clock._session


def wait_for(condition, again=lambda: None):
    last = time.monotonic() + 120  # a session compiles first
    while not condition() and time.monotonic() < last:
        time.sleep(0.2)
        again()
    assert condition()


def asked(page, *lines, frame=b"", until=lambda: True):
    """Return the status of the answer to a request, and send a message right behind it.

    A closed connection may lose the message: it stays open until a condition holds. A server that
    has not yet met its client may lose it too: it is sent again.
    """
    with socket.create_connection(("127.0.0.1", page.server.get_port()), timeout=30) as plain:
        text = "\r\n".join(("GET / HTTP/1.1", *lines))
        plain.sendall(text.encode() + b"\r\n" + frame)
        status = int(plain.recv(100).split()[1])
        wait_for(until, lambda: plain.sendall(frame))
        plain.settimeout(0.5)
        try:
            while plain.recv(100_000):
                pass
        except TimeoutError:
            pass
        return status


@pytest.mark.parametrize(
    ("host", "origin", "welcome"),
    [
        ("127.0.0.1:{}", None, True),
        ("127.0.0.1:{}", "http://127.0.0.1:{}", True),
        ("localhost:{}", "http://localhost:{}", True),
        ("localhost:9000", "http://localhost:9000", True),  # by `ssh -L 9000:127.0.0.1:8080`
        ("[::1]:{}", "http://[::1]:{}", True),
        ("127.0.0.1:{}", "http://evil.example", False),
        ("127.0.0.1:{}", "http://127.0.0.1:1", False),
        ("127.0.0.1:{}", "null", False),
        ("127.0.0.1:{}", "http://localhost:{}", False),
        ("evil.example:{}", None, False),
        ("evil.example:{}", "http://evil.example:{}", False),  # its name leads to this machine
        ("0.0.0.0:{}", "http://0.0.0.0:{}", False),
        ("localhost.evil.example:{}", None, False),
        ("localhost\r\nHost: localhost", None, False),
        (None, None, False),
    ],
)
def test_only_the_page_itself_moves_the_target(page, host, origin, welcome):
    given = {"Host": host, "Origin": origin}
    port = page.server.get_port()
    lines = [f"{name}: {text.format(port)}" for name, text in given.items() if text is not None]
    assert asked(page, *lines, "") == (200 if welcome else 403)
    frame = Frame(Opcode.BINARY, encoded(DRAG)).serialize(mask=True)

    def moved():
        return session_of(page)._shift.any() or not welcome

    status = asked(page, *lines, UPGRADE, frame=frame, until=moved)
    assert status == (101 if welcome else 403)
    if welcome:
        session_of(page).drag(None)
    assert not session_of(page)._shift.any()


def test_a_viser_that_bypasses_the_door_serves_nothing(page, monkeypatch):
    stopped = []
    monkeypatch.setattr(viser.ViserServer, "__init__", lambda *_, **__: None)
    monkeypatch.setattr(viser.ViserServer, "stop", lambda server: stopped.append(server))
    with pytest.raises(RuntimeError, match="cannot guard its connections"):
        Page(session_of(page), 0, str)
    assert len(stopped) == 1


def update(uuid, updates):
    return {"type": "GuiUpdateMessage", "uuid": uuid, "updates": updates}


def junk_of(page, dice):
    """Return messages of each kind that viser has, none of which the page offers."""
    handles = page.server.gui._gui_input_handle_from_uuid
    for kind in Message.get_subclasses():
        names = list(getattr(kind, "__dataclass_fields__", {}))
        for _ in range(4):
            yield {"type": kind.__name__} | {name: dice.choice(JUNK) for name in names}
    for name, value in DRAG.items():
        yield from (DRAG | {name: each} for each in JUNK if each != value)
    yield DRAG | {"more": 1}
    yield {name: value for name, value in DRAG.items() if name != "wxyz"}
    yield DRAG | {"position": [1e7, 0.0, 0.0]}
    for uuid, handle in handles.items():
        yield from (update(uuid, {"value": each}) for each in [*JUNK, 1e3, "Pull"])
        if not handle._impl.is_button:
            yield update(uuid, {"value": True})
        yield update(uuid, {"label": "mine", "order": 1})
    yield from (update("nobody", {"value": 1.0}), {"type": "Nothing"}, 3)


def test_junk_changes_nothing_prints_nothing_and_does_not_hang(page, capfd, recwarn):
    dice, session = random.Random(4), session_of(page)
    before = (session.kind, session._pull, session._shift.tolist())
    messages = [encoded(each) for each in junk_of(page, dice)]
    messages += [dice.randbytes(dice.randrange(40)) for _ in range(200)]
    messages += [each[: dice.randrange(len(each))] for each in messages[::7]]
    dice.shuffle(messages)
    with socket.create_connection(("127.0.0.1", page.server.get_port())) as plain:
        plain.sendall(b"no request\r\n\r\n")
    url, protocols = page.url.replace("http", "ws"), [f"viser-v{viser.__version__}"]
    with connect(url, origin=page.url, subprotocols=protocols, max_size=None) as connection:
        connection.send(encoded(LOOK))  # from then on it counts as one who looks
        wait_for(lambda: page.clock.viewers)
        connection.send("a text")
        for message in messages:
            connection.send(message)
        connection.send(encoded(update(page._panel._sliders["current"]._impl.uuid, {"value": 2})))
        wait_for(lambda: session.numbers.current == 2.0)
        assert (session.kind, session._pull, session._shift.tolist()) == before
        assert page.clock.running
        handles = page.server.gui._gui_input_handle_from_uuid.items()
        ways = next(uuid for uuid, each in handles if "+x" in getattr(each, "options", ()))
        for value in ("up", "+x"):
            connection.send(encoded(update(ways, {"value": value})))
        wait_for(lambda: session._pull.force)
    assert session.numbers.changed_names == ("current",)
    assert np.sign(session._pull.force).tolist() == [1.0, 0.0]
    assert page.clock.error is None
    assert capfd.readouterr() == ("", "")
    assert [str(each.message) for each in recwarn] == []
