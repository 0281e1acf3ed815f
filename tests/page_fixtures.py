"""Page, and a window of a browser on it, that the tests of a file share."""

import shutil
from collections.abc import Iterator

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = "--headless --no-sandbox --disable-gpu --disable-gpu-watchdog --disable-quic --no-first-run"
FLAGS += " --disable-background-networking"


@pytest.fixture(scope="module")
def browser() -> Iterator:
    if not CHROMIUM:
        pytest.skip("needs Chromium")
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS.split())
        yield chromium
        chromium.close()


@pytest.fixture(scope="module")
def served(tmp_path_factory) -> Iterator:
    """Yield a page that plays a small balloon."""
    pytest.importorskip("viser")
    from browsing import tethered
    from strangers import page_of

    page = page_of(tethered(), tmp_path_factory.mktemp("recordings"))
    page.start()
    page.layers.show("shadow", False)  # which takes most of the time where no GPU draws
    yield page
    page.stop()


@pytest.fixture(scope="module")
def window(browser, served) -> Iterator:
    """Yield a window on the page, and require that everything it fetches comes from the page's own server."""
    from browsing import open_window

    fetched: list[str] = []
    window = open_window(browser, served, fetched)
    yield window
    window.close()
    assert fetched
    assert [url for url in fetched if not url.startswith((f"{served.address}/", "data:", "blob:"))] == []


@pytest.fixture
def fresh(window, served):
    """Return the window, with everything at its start, running."""
    from browsing import wait_until

    revision = served.session.picture.revision
    served.session.ask(lambda playground: setattr(playground, "keep_stable", True))
    served.session.set_speed(1.0)
    served.session.reset()
    wait_until(lambda: served.session.picture.revision > revision, "reset")
    wait_until(lambda: served.controls._bound[1] > revision, "the panel follows")
    wait_until(lambda: served.session.picture.frame.number > 3, "time goes on")
    served.controls.tool.value, served.controls.stable.value = "throws a sphere", True
    return window
