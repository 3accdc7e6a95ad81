"""The page of a session in a browser: it moves, pauses, records, and speaks to nobody else."""

import re
import socket
import threading
import time

import equinox as eqx
import numpy as np
import pytest

pytest.importorskip("viser", reason="needs viser")

from crinoid.scenario import ScenarioError
from crinoid.view.live.page import Page, PortError
from crinoid.view.live.session import LiveSession
from helpers.browsing import Opened
from helpers.live import LIVE

pytestmark = pytest.mark.slow

HOSTILE = "<img src=x onerror=alert(1)> **bold** [a](http://example.org) {1+1}\x1b[31m\n# big"


@pytest.fixture(scope="module")
def session():
    return LiveSession(LIVE.with_values({"title": HOSTILE}))


class Served:
    def __init__(self, session):
        session.reset()
        self.kept, self.gone = [], threading.Event()
        self.page = Page(session, 0, self._keep)
        self.page.server.on_client_disconnect(lambda _: self.gone.set())

    def _keep(self, result):
        self.kept.append(result)
        return f"kept {HOSTILE}"


@pytest.fixture
def served(session):
    served = Served(session)
    yield served
    served.page.close()
    assert served.page.clock.error is None


def test_the_scene_has_the_arm_and_the_bodies_where_the_session_has_them(served, session):
    named, now = served.page.server.scene.get_handle_by_name, session.look()
    arm = named("/arm").vertices
    for corner in (np.min, np.max):
        np.testing.assert_allclose(corner(arm, axis=0), corner(now.nodes, axis=0), atol=0.03)
    for name, position in zip(("0", "debris"), now.obstacles, strict=True):
        np.testing.assert_allclose(named(f"/obstacle {name}").position, position, atol=1e-6)


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
    monkeypatch.setattr("crinoid.view.live.session.launch_paths", lambda *_: only)
    with pytest.raises(ScenarioError, match="debris: got obstacles around the arm; must have room"):
        session.throw()
    np.testing.assert_array_equal(session.look().obstacles[-1], other)
    session.reset()


def test_a_port_that_is_taken_is_refused(session):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(PortError, match=f"got {port}, which is unavailable"):
            Page(session, port, str)


def test_only_this_machine_is_served_and_nothing_moves_unseen(served):
    assert served.page.url.removeprefix("http://").split(":")[0] == "127.0.0.1"
    assert served.page.server.request_share_url() is None
    assert not served.page.clock.viewers
    assert served.page.clock.running


NOW = "parseFloat(document.querySelector('#numbers td + td').innerText)"


class Live(Opened):
    """The page of a session."""

    heard = ("error",)

    def __init__(self, browser, served):
        super().__init__(browser, served.page.url, "#numbers", 1000, 900)

    def told(self, name):
        """Return the number next to a name."""
        rows = dict(row.split("\t") for row in self.page.inner_text("#numbers").split("\n"))
        return rows[name]

    def time(self):
        return float(self.told("time").removesuffix(" s"))

    def click(self, name):
        self.page.get_by_role("button", name=re.compile(name)).first.click()

    def wait(self, script):
        self.page.wait_for_function(script, timeout=60_000)

    def wait_until(self, instant):
        """Wait for an instant to be shown."""
        self.wait(f"() => {NOW} > {instant}")


def test_a_session_moves_pauses_runs_on_and_rests_unseen(browser, served):
    with Live(browser, served) as page:
        page.wait_until(0.3)
        first, begun = page.told("tip x, z"), page.time()
        page.wait_until(begun + 0.4)
        assert page.told("tip x, z") != first
        page.click("^Pause$")
        page.wait("() => document.querySelector('#numbers').innerText.includes('paused')")
        stopped, tip = page.time(), page.told("tip x, z")
        page.page.wait_for_timeout(300)
        assert (page.time(), page.told("tip x, z")) == (stopped, tip)
        page.click("^Run$")
        page.wait_until(stopped + 0.3)
        assert page.complaints == []
        own = served.page.url.removeprefix("http://")
        assert not [each for each in page.requests if own not in each and each[:5] != "data:"]
    # the session rests while nobody looks
    assert served.gone.wait(timeout=60)
    last = time.monotonic() + 60
    while served.page.clock.viewers and time.monotonic() < last:
        time.sleep(0.01)  # both hear of it, on threads of their own
    assert served.page.clock.viewers == 0


def test_a_user_s_words_stay_text(browser, served):
    with Live(browser, served) as page:
        page.wait_until(0.1)
        assert page.page.get_by_text("<img src=x onerror=alert(1)>").count() >= 1
        page.click("^Record$")
        page.wait("() => /Stop and save/.test(document.body.innerText)")
        page.wait_until(page.time() + 0.2)
        page.click("^Stop and save")
        page.wait("() => document.querySelector('#said').innerText.includes('kept <img src=x')")
        assert page.page.locator("img[src=x]").count() == 0
        assert page.page.locator("#said b, #said strong, #said a, #said h1").count() == 0
        assert page.dialogs == []
    assert [result.status for result in served.kept] == ["ok"]


def test_buttons_and_sliders_reach_the_session(browser, served, session):
    with Live(browser, served) as page:
        page.wait_until(0.1)
        slider = page.page.get_by_role("textbox").first
        slider.fill("0")
        slider.press("Enter")
        page.wait("() => /water x, z\\s+-?0.000, -?0.000/.test(document.body.innerText)")
        page.click("^Throw debris$")
        page.wait("() => /contact\\s+yes/.test(document.body.innerText)")
        page.click(r"^\+z$")
        page.click("^As described$")
        page.wait("() => !/water x, z\\s+-?0.000, -?0.000/.test(document.body.innerText)")
        later = page.time()
        page.click("^Reset$")
        page.wait(f"() => {NOW} < {later}")
    assert session.numbers.current == 1.0
    assert session.state.state.gap.shape[0] == 2
