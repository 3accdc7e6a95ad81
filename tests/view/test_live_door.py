"""The connection of a live page: other sites stay outside, and each wrong value has one line."""

import json
import random
import socket
import time
from contextlib import ExitStack, suppress

import numpy as np
import pytest

pytest.importorskip("websockets", reason="needs websockets")
from websockets.frames import Frame, Opcode
from websockets.sync.client import connect

from crinoid.view.live.page import Page
from crinoid.view.live.session import LiveSession
from helpers.live import LIVE

pytestmark = pytest.mark.slow

UPGRADE = (
    "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
)
DRAG = json.dumps({"name": "target", "value": [0.1, -0.3]})
JUNK = [None, True, float("nan"), float("inf"), 1e300, -1, -0.5, 10**15, [], [1.0], "", "x"]
JUNK += [[0.0, float("nan")], [1e12] * 2, [0.0, 0.0, 0.0], {}, {"value": -1}, [[[]]] * 4]


@pytest.fixture(scope="module")
def page():
    page = Page(LiveSession(LIVE), 0, str)
    yield page
    page.close()
    assert page.clock.error is None


@pytest.fixture
def session(page):
    return page.clock._session


def wait_for(condition):
    last = time.monotonic() + 120  # a session compiles first
    while not condition() and time.monotonic() < last:
        time.sleep(0.05)
    assert condition()


class Viewer:
    """A page without a browser."""

    def __init__(self, page):
        self.url, self.closing = page.url, ExitStack()
        self.frames, self.told = [], []

    def __enter__(self):
        address = self.url.replace("http", "ws")
        opened = connect(address, origin=self.url, max_size=None)
        self.connection = self.closing.enter_context(opened)
        return self

    def __exit__(self, *_):
        self.closing.close()

    def say(self, name, value=None):
        self.connection.send(json.dumps({"name": name, "value": value}))

    def take(self, message):
        """Take a message; return whether it is a frame."""
        if isinstance(message, str):
            self.told.append(json.loads(message))
            return False
        self.frames.append(np.frombuffer(message, "<f4"))
        return True

    def read(self, condition):
        """Read until a condition holds."""
        last = time.monotonic() + 60
        while not condition() and time.monotonic() < last:
            if self.take(self.connection.recv(timeout=60)):
                self.connection.send("seen")
        assert condition()

    def refusal(self, name, value=None):
        """Return the answer to a wrong value."""
        self.told.clear()
        self.say(name, value)
        self.read(lambda: any("refused" in each for each in self.told))
        return next(each["refused"] for each in self.told if "refused" in each)


def asked(page, *lines, frame=b""):
    """Return the status of the answer to a request, and send a message right behind it."""
    with socket.create_connection(("127.0.0.1", page.port), timeout=30) as plain:
        plain.sendall("\r\n".join(("GET / HTTP/1.1", *lines)).encode() + b"\r\n" + frame)
        status = int(plain.recv(100).split()[1])
        plain.settimeout(0.3)
        try:
            while plain.recv(100_000):
                pass
        except (TimeoutError, ConnectionError):
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
def test_only_the_page_itself_moves_the_target(page, session, host, origin, welcome):
    given = {"Host": host, "Origin": origin}
    lines = [f"{name}: {text.format(page.port)}" for name, text in given.items() if text]
    assert asked(page, *lines, "") == (200 if welcome else 403)
    frame = Frame(Opcode.TEXT, DRAG.encode()).serialize(mask=True)
    assert asked(page, *lines, UPGRADE, frame=frame) == (101 if welcome else 403)
    if welcome:
        wait_for(lambda: session._shift.any())
        session.drag(None)
    assert not session._shift.any()


@pytest.mark.parametrize(
    ("name", "value", "answer"),
    [
        ("current", 9, "current: got 9; must be 0 to 3"),
        ("current", None, "current: got None; must be 0 to 3"),
        ("target", [0.1], "target: got [0.1]; must be [x, z] in m"),
        ("pull", "up", 'pull: got "up"; must be "-x", "+x", "-z" or "+z"'),
        ("controller", 3, "controller: got 3; must be "),
        ("run", 1, "run: got 1; must be null"),
        ("nobody", 1, 'name: got "nobody"; must be "run", "reset", '),
    ],
)
def test_a_wrong_value_has_one_line_for_its_sender_only(page, name, value, answer):
    with Viewer(page) as viewer, Viewer(page) as other:
        assert viewer.refusal(name, value).startswith(answer)
        other.read(lambda: len(other.frames) > 1)
        assert not [each for each in other.told if "refused" in each]


def test_all_viewers_see_the_same_and_one_that_draws_nothing_delays_nobody(page):
    with Viewer(page) as viewer, Viewer(page) as slow:
        viewer.say("stiffness", 2.0)
        slow.read(lambda: any(each.get("values", {}).get("stiffness") == 2.0 for each in slow.told))
        begun = len(viewer.frames)
        viewer.read(lambda: len(viewer.frames) >= begun + 12)
        times = [frame[0] for frame in viewer.frames[begun:]]
        assert sorted(times) == times
        assert times[-1] > times[0]
        slow.frames.clear()
        with suppress(TimeoutError):  # it gets nothing more before it has drawn
            while len(slow.frames) <= 2:
                slow.take(slow.connection.recv(timeout=1.0))
        assert len(slow.frames) <= 2
        slow.frames.clear()
        slow.connection.send("seen")
        slow.read(lambda: slow.frames)
        assert slow.frames[0][0] >= times[-1]  # the newest one: others were dropped
        viewer.say("described")
        viewer.read(lambda: viewer.told[-1].get("values", {}).get("stiffness") == 1.0)


def test_a_frame_has_the_arm_and_the_bodies_where_the_session_has_them(page, session):
    with Viewer(page) as viewer:
        viewer.say("run")
        viewer.read(lambda: viewer.told and viewer.told[-1].get("run") == "Run")
        now = session.look()
        viewer.read(lambda: viewer.frames and abs(viewer.frames[-1][0] - now.time) < 1e-4)
        frame, traces, nodes = viewer.frames[-1], 4, len(now.nodes)
        assert frame[1] == pytest.approx(1e3 * now.error, rel=1e-4)
        root, offset = np.split(frame[1 + traces + 3 :][: 3 + 2 * nodes], [3])
        np.testing.assert_allclose(root, now.nodes[0], atol=1e-6)
        shape = root[[0, 2]] + offset.reshape(nodes, 2)
        np.testing.assert_allclose(shape, now.nodes[:, [0, 2]], atol=1e-6)
        table = page._scene.scene(now, now).members[0]
        assert [each.kind for each in table.obstacles] == ["sphere", "sphere"]
        after = 1 + traces + 3 + 3 + 2 * nodes + 3 + 3 + 3 + 9 + 1 + 2 * nodes
        places = frame[after:][:12].reshape(2, 2, 3)[:, 0]
        np.testing.assert_allclose(places, now.obstacles, rtol=1e-6)
        viewer.say("run")


def junk_of(page, dice):
    """Return messages, none of which the page offers."""
    yield from ({"name": name, "value": each} for name in ("x", None, 3, []) for each in JUNK)
    for control in page._panel.controls.values():
        wrong = [each for each in JUNK if control.mistake(each)]
        assert len(wrong) > 8
        yield from ({"name": control.name, "value": each} for each in wrong)
        yield {"name": control.name}
        yield {"name": control.name, "value": None, "more": 1}
    yield from (*JUNK, "text", ["[" * 400])


def test_junk_changes_nothing_prints_nothing_and_does_not_hang(page, session, capfd, recwarn):
    dice = random.Random(4)
    before = (session.kind, session._pull, session._shift.tolist(), session.numbers)
    messages = [json.dumps(each) for each in junk_of(page, dice)]
    messages += [dice.randbytes(dice.randrange(40)) for _ in range(100)] + ["[" * 900]
    messages += [each[: dice.randrange(len(each))] for each in messages[:200:7]]
    dice.shuffle(messages)
    with socket.create_connection(("127.0.0.1", page.port)) as plain:
        plain.sendall(b"no request\r\n\r\n")
    with Viewer(page) as viewer:
        for message in messages:
            viewer.connection.send(message)
        answered = len([each for each in messages if each != "seen"])
        viewer.read(lambda: sum("refused" in each for each in viewer.told) >= answered)
        assert before == (session.kind, session._pull, session._shift.tolist(), session.numbers)
        assert page.clock.running
        viewer.say("pull", "+x")
        wait_for(lambda: session._pull.force)
        viewer.connection.send("x" * 2000)  # longer than any message of the page
    assert np.sign(session._pull.force).tolist() == [1.0, 0.0]
    assert page.clock.error is None
    assert capfd.readouterr() == ("", "")
    assert [str(each.message) for each in recwarn] == []
