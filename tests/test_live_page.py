"""The page of a session in a browser: it moves, pauses, records, and speaks to nobody else."""

import re
import shutil
import socket
import sys
import threading
import time
from contextlib import contextmanager

import pytest

from crinoid.scenario import Scenario

pytest.importorskip("viser", reason="needs viser")
playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright")

from crinoid.live.page import Page, PortError  # noqa: E402
from crinoid.live.session import Session  # noqa: E402
from test_cli import call  # noqa: E402

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
SOFTWARE = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader"]
SOFTWARE += ["--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
HOSTILE = "<img src=x onerror=alert(1)> **bold** [a](http://example.org) {1+1}\x1b[31m\n# big"
SCENARIO = """
[arm]
nodes = 4
[base.channels.slide]
[[flow]]
kind = "sine"
amplitude = [0.3, 0.0]
frequency_hz = 0.5
[[obstacle]]
kind = "sphere"
position = [0.3, -9.5]
radius = 0.05
[control]
kind = "pid"
controlled = ["x"]
mapping = "identity"
[control.pid.slide]
kp = 0.2
"""


@pytest.fixture(scope="module")
def session():
    return Session(Scenario.from_toml(SCENARIO).with_values({"title": HOSTILE}))


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
    assert served.page.pace.error is None


def test_a_port_that_is_taken_or_none_is_refused(session):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(PortError, match=f"got {port}, which cannot be had"):
            Page(session, port, str)
    with pytest.raises(PortError, match="got 70000, takes 0"):
        Page(session, 70000, str)


def test_only_this_machine_is_served_and_nothing_shares_it(served):
    sockets = served.page.url.removeprefix("http://").split(":")
    assert sockets[0] == "127.0.0.1"
    assert served.page.server.request_share_url() is None


def test_nobody_looks_nothing_moves(served):
    assert not served.page.pace.watched
    assert served.page.pace.running


@pytest.fixture(scope="module")
def browser():
    if CHROMIUM is None:
        pytest.skip("needs Debian's package chromium")
    with playwright.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE)
        yield opened
        opened.close()


class Opened:
    """A page that is open, and what it complained of or asked for."""

    def __init__(self, page, url):
        self.page, self.complaints, self.requests, self.dialogs = page, [], [], []
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("console", self._hear)
        page.on("request", lambda request: self.requests.append(request.url))
        page.on("websocket", lambda socket: self.requests.append(socket.url))
        page.on("dialog", lambda dialog: self.dialogs.append(dialog.message))
        page.goto(url)
        page.wait_for_selector("#numbers", timeout=60_000)

    def _hear(self, message):
        if message.type == "error":
            self.complaints.append(message.text)

    def told(self, name):
        """Return the number that stands beside a name."""
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
        now = "parseFloat(document.querySelector('#numbers td + td').innerText)"
        self.wait(f"() => {now} > {instant}")

    def wait_for_word(self, word):
        self.wait(f"() => document.querySelector('#said').innerText.includes('{word}')")


@contextmanager
def opened(browser, served):
    context = browser.new_context(viewport={"width": 1000, "height": 900})
    try:
        yield Opened(context.new_page(), served.page.url)
    finally:
        context.close()


def test_it_moves_pauses_and_goes_on(browser, served):
    with opened(browser, served) as page:
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
        wrong = [each for each in page.requests if own not in each and not each.startswith("data:")]
        assert wrong == []


def test_what_a_user_wrote_is_text(browser, served):
    with opened(browser, served) as page:
        page.wait_until(0.1)
        assert page.page.get_by_text("<img src=x onerror=alert(1)>").count() >= 1
        page.click("^Record$")
        page.wait("() => /Stop and save/.test(document.body.innerText)")
        page.wait_until(page.time() + 0.2)
        page.click("^Stop and save")
        page.wait_for_word("kept <img src=x")
        assert page.page.locator("img[src=x]").count() == 0
        assert page.page.locator("#said b, #said strong, #said a, #said h1").count() == 0
        assert page.dialogs == []
    assert [result.status for result in served.kept] == ["ok"]


def test_buttons_and_sliders_reach_the_session(browser, served, session):
    with opened(browser, served) as page:
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
        page.wait(
            f"() => parseFloat(document.querySelector('#numbers td + td').innerText) < {later}"
        )
    assert session.knobs.current == 1.0
    assert session.state.state.gap.shape[0] == 2


def test_it_rests_where_nobody_looks(browser, served, session):
    with opened(browser, served) as page:
        page.wait_until(0.1)
    assert served.gone.wait(timeout=60)
    last = time.monotonic() + 60
    while served.page.pace.watched and time.monotonic() < last:
        time.sleep(0.01)  # both hear of it, on threads of their own
    assert served.page.pace.watched == 0


def test_mistakes_are_told_before_anything_is_computed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    told = call("live", "still-water", "--port", 70000)
    assert told.exit_code == 2
    assert "--port: got 70000, takes 0 (any that is free) to 65535" in told.output
    (tmp_path / "many.toml").write_text('[vary]\n"arm.length" = [0.4, 0.5]\n')
    told = call("live", "many.toml")
    assert (told.exit_code, "vary: a live session is of one case" in told.output) == (2, True)
    monkeypatch.setitem(sys.modules, "viser", None)
    told = call("live", "still-water")
    assert told.exit_code == 2
    assert 'pip install "crinoid[live]"' in told.output
    assert [each.name for each in tmp_path.iterdir()] == ["many.toml"]
