"""The page of a session in a browser: it moves, pauses, records, and speaks to nobody else."""

import re
import socket
import time

import equinox as eqx
import numpy as np
import pytest

pytest.importorskip("websockets", reason="needs websockets")

from crinoid.scenario import ScenarioError
from crinoid.view.live.page import Page
from crinoid.view.live.session import LiveSession
from helpers.browsing import Opened
from helpers.live import LIVE

pytestmark = pytest.mark.slow

HOSTILE = "<img src=x onerror=alert(1)> **bold** [a](http://example.org) {1+1}\x1b[31m\n# big"


@pytest.fixture(scope="module")
def session():
    return LiveSession(LIVE.with_values({"title": HOSTILE}))


class Served:
    def __init__(self, session, port=0):
        session.reset()
        self.kept = []
        self.page = Page(session, port, self._keep)

    def _keep(self, result):
        self.kept.append(result)
        return f"kept {HOSTILE}"


@pytest.fixture
def served(session):
    served = Served(session)
    yield served
    served.page.close()
    assert served.page.clock.error is None


def test_debris_starts_where_no_obstacle_is_or_is_refused(session, monkeypatch):
    session.reset()
    session.throw()
    usual = session.look().obstacles[-1]
    session.reset()
    forces = session.loop.system.forces
    row = forces.rows.obstacle(0)
    session.state = eqx.tree_at(
        lambda c: c.state.motion.position,
        session.state,
        session.state.state.motion.position.at[row].set(usual[[0, 2]]),
    )
    session.throw()
    other = session.look().obstacles[-1]
    apart = session.bodies.debris.radius + session.scenario.obstacle[0].radius
    assert np.linalg.norm(other - usual) > apart
    only = [(usual[[0, 2]], np.zeros(2))]
    monkeypatch.setattr("crinoid.view.live.interactive.launch_paths", lambda *_: only)
    with pytest.raises(ScenarioError, match="debris: got obstacles around the arm; must have room"):
        session.throw()
    np.testing.assert_array_equal(session.look().obstacles[-1], other)
    session.reset()


def test_a_port_that_is_taken_is_refused(session):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(ScenarioError, match=f"--port: got {port}, which is unavailable"):
            Page(session, port, str)


def test_only_this_machine_is_served_and_nothing_moves_unseen(served):
    assert served.page.url.removeprefix("http://").split(":")[0] == "127.0.0.1"
    assert not served.page.clock.viewers
    assert served.page.clock.running


NOW = "parseFloat(document.querySelector('#now b').innerText)"


class Live(Opened):
    """The page of a session."""

    heard = ("error",)

    def __init__(self, browser, served):
        super().__init__(browser, served.page.url, "#now b", 1000, 900)

    def told(self, name):
        """Return the number next to a name."""
        entries = self.page.locator("#now > span").all_inner_texts()
        return next(each.removeprefix(name) for each in entries if each.startswith(name))

    def time(self):
        return float(self.told("time").removesuffix(" s"))

    def click(self, name):
        self.page.get_by_role("button", name=re.compile(name)).first.click()

    def slide(self, name, value):
        slider = self.page.locator("label.slider", has_text=name).locator("input")
        slider.evaluate(
            "(e, v) => { e.value = v; e.dispatchEvent(new Event('input')); }", str(value)
        )

    def wait(self, script):
        self.page.wait_for_function(script, timeout=60_000)

    def wait_until(self, instant):
        """Wait for an instant to be shown."""
        self.wait(f"() => {NOW} > {instant}")

    def pixels(self):
        """Return the picture of the arm."""
        return self.page.locator("#stage").screenshot()


def test_a_session_moves_pauses_runs_on_and_rests_unseen(browser, served):
    with Live(browser, served) as page:
        page.wait_until(0.3)
        first, begun, picture = page.told("tip x, z"), page.time(), page.pixels()
        page.wait_until(begun + 0.4)
        assert page.told("tip x, z") != first
        assert page.pixels() != picture
        page.click("^Pause$")
        page.wait("() => document.querySelector('#now').innerText.includes('paused')")
        stopped, tip = page.time(), page.told("tip x, z")
        page.page.wait_for_timeout(300)
        assert (page.time(), page.told("tip x, z")) == (stopped, tip)
        page.click("^Run$")
        page.wait_until(stopped + 0.3)
        assert page.complaints == []
        own = served.page.url.removeprefix("http://")
        assert not [each for each in page.requests if own not in each and each[:5] != "data:"]
    # the session rests while nobody looks
    last = time.monotonic() + 60
    while served.page.clock.viewers and time.monotonic() < last:
        time.sleep(0.01)
    assert served.page.clock.viewers == 0


def test_a_user_s_words_stay_text(browser, served):
    with Live(browser, served) as page:
        page.wait_until(0.1)
        assert page.page.get_by_text("<img src=x onerror=alert(1)>").count() >= 1
        page.click("^Record$")
        page.wait("() => /Stop and save/.test(document.body.innerText)")
        page.wait_until(page.time() + 0.2)
        page.click("^Stop and save")
        page.wait("() => document.querySelector('#message').innerText.includes('kept <img src=x')")
        assert page.page.locator("img[src=x]").count() == 0
        assert page.page.locator("#message *").count() == 0
        assert page.dialogs == []
    assert [result.status for result in served.kept] == ["ok"]


def test_controls_reach_the_session_and_a_lost_one_is_found_again(browser, session):
    served = Served(session)
    with Live(browser, served) as page:
        page.wait_until(0.1)
        page.slide("current", 0)
        page.wait("() => /water x, z\\s*-?0.000, -?0.000/.test(document.body.innerText)")
        page.click("^Throw debris$")
        page.wait("() => /contact\\s*yes/.test(document.body.innerText)")
        page.click(r"^\+z$")
        page.ask("crinoid.send('current', 9)")
        page.wait("() => document.querySelector('#message').innerText.includes('got 9; must be')")
        page.click("^As described$")
        page.wait("() => !/water x, z\\s*-?0.000, -?0.000/.test(document.body.innerText)")
        later = page.time()
        page.click("^Reset$")
        page.wait(f"() => {NOW} < {later}")
        x, y = page.ask(TARGET)
        page.page.mouse.move(x, y)
        page.page.mouse.down()
        page.page.mouse.move(x + 30, y, steps=3)
        page.page.mouse.up()
        last = time.monotonic() + 60
        while not session._shift.any() and time.monotonic() < last:
            page.page.wait_for_timeout(50)
        assert session._shift[0] > 0.01
        assert abs(session._shift[1]) < 1e-6
        served.page.close()
        page.wait("() => document.querySelector('#message').innerText.includes('has ended')")
        again = Served(session, served.page.port)
        page.page.wait_for_selector("#now b", timeout=60_000)
        page.wait("() => !document.querySelector('#message').innerText.includes('has ended')")
        again.page.close()
    assert session.numbers.current == 1.0
    assert session.state.state.gap.shape[0] == 2
    session.drag(None)


TARGET = """() => {
  const { scene } = crinoid, [x, y, z] = scene.members[0].now.target;
  const box = scene.canvas.getBoundingClientRect();
  const m = scene.camera.view(box.width / box.height).matrix;
  const [a, b, w] = [0, 1, 3].map((r) => m[r] * x + m[4 + r] * y + m[8 + r] * z + m[12 + r]);
  return [box.left + ((a / w + 1) * box.width) / 2, box.top + ((1 - b / w) * box.height) / 2];
}"""
