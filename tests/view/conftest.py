"""What tests of several views share: coarse figures and a browser."""

import shutil

import pytest

from crinoid.view.figures.style import STYLE


@pytest.fixture(scope="module")
def coarse():
    """Draw with fewer dots: what is asserted does not depend on them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(STYLE, "savefig.dpi", 80)
        yield


@pytest.fixture(scope="module")
def browser():
    playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright")
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        pytest.skip("needs Debian's package chromium")
    software = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader"]
    software += ["--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
    with playwright.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=chromium, args=software)
        yield opened
        opened.close()
