"""Live simulation: a page in the browser, and a folder for each recording."""

import os
import sys
import time
import webbrowser
from itertools import count
from pathlib import Path

from crinoid.cli.command import console, stop
from crinoid.cli.display import say_notes
from crinoid.cli.finding import require_one
from crinoid.cli.folder import claimed, save
from crinoid.cli.interruption import Interruption
from crinoid.results.result import Result
from crinoid.scenario import Scenario

_DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")


def run_live(scenario: Scenario, folder: Path, *, port: int, browser: bool | None) -> str:
    """Simulate a scenario in a browser until Ctrl-C; return what went wrong, if anything."""
    try:
        import websockets  # noqa: F401
    except ImportError:
        stop('live needs websockets for its page: pip install "crinoid[live]"')
    from crinoid.view.live.interactive import StartError
    from crinoid.view.live.page import Page, check_port
    from crinoid.view.live.session import LiveSession

    require_one(scenario, "a live session")
    check_port(port)

    def keep(result: Result) -> str:
        names = (folder / f"recording-{number:02d}" for number in count(1))
        place = next(place for place in names if not place.exists())
        with claimed(place):
            paths, trouble = save(result, place, place)
        instants = result.dataset["time"].values
        span = f"t = {instants[0]:.4g} to {instants[-1]:.4g} s"
        return trouble or f"recorded {span}: crinoid report {paths[0].parent}"

    with Interruption() as interruption:
        try:
            with console.status("finding the equilibrium, and compiling"):
                session = LiveSession(scenario)
        except StartError as error:
            return str(error)
        say_notes(session.doubts)
        page = Page(session, port, keep)
        console.print(f"{page.url}  (Ctrl-C ends it)", soft_wrap=True)
        display = sys.platform in ("darwin", "win32") or any(map(os.environ.get, _DISPLAYS))
        if display if browser is None else browser:
            webbrowser.open(page.url)
        while not interruption.stop() and page.clock.error is None:
            time.sleep(0.1)
        page.close()
    if page.clock.error is not None:
        raise page.clock.error
    for line in page.clock.recordings:
        console.print(line, soft_wrap=True)
    return ""
