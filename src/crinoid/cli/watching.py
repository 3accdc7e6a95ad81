"""Simulating while one watches: a page in the browser, and a folder for each recording."""

import os
import sys
import time
import webbrowser
from itertools import count
from pathlib import Path

from rich.console import Console

from crinoid.cli.finding import prepare_one
from crinoid.cli.folder import claimed, save
from crinoid.cli.interruption import Interruption
from crinoid.cli.lines import say_notes
from crinoid.cli.options import stop
from crinoid.result import Result
from crinoid.scenario import Mistake, Scenario, ScenarioError


def run_live(
    scenario: Scenario, folder: Path, *, port: int, browser: bool | None, console: Console
) -> str:
    """Simulate a scenario in a browser until Ctrl-C; return what went wrong, if anything."""
    try:
        import viser  # noqa: F401
    except ImportError:
        stop('live shows its page with viser: pip install "crinoid[live]"')
    from crinoid.live.page import Page, PortError, check_port
    from crinoid.live.part import StartError
    from crinoid.live.session import Session

    prepare_one(scenario, "a live session")
    try:
        check_port(port)
    except PortError as error:
        raise ScenarioError([Mistake("--port", str(error))]) from None

    def keep(result: Result) -> str:
        place = _next(folder)
        with claimed(place):
            paths, trouble = save(result, place, place)
        where = f"crinoid report {paths[0].parent}" if paths else ""
        return trouble or f"recorded {_span(result)}: {where}"

    with Interruption() as interruption:
        try:
            with console.status("finding the equilibrium, and compiling"):
                session = Session(scenario)
        except StartError as error:
            return str(error)
        say_notes(console, session.doubts)
        page = Page(session, port, keep)
        console.print(f"{page.url}  (Ctrl-C ends it)", soft_wrap=True)
        if browser if browser is not None else _has_display():
            webbrowser.open(page.url)
        while not interruption.stop() and page.pace.error is None:
            time.sleep(0.1)
        page.close()
    if page.pace.error is not None:
        raise page.pace.error
    for line in page.pace.kept:
        console.print(line, soft_wrap=True)
    return ""


def _next(folder: Path) -> Path:
    """Return the next folder that is not there yet."""
    names = (folder / f"recording-{number:02d}" for number in count(1))
    return next(place for place in names if not place.exists())


def _span(result: Result) -> str:
    time = result.dataset["time"].values
    return f"t = {time[0]:.4g} to {time[-1]:.4g} s"


def _has_display() -> bool:
    """Tell whether there is a screen that a browser could open on."""
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
