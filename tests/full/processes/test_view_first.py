"""First seconds of the page, and its notices while it prepares something: in headless Chromium."""

import threading

import numpy as np
import pytest
from asked_ahead import AskedAhead
from browsing import LIMIT, click_the_balloon, picture_of, see, tethered, wait_until

pytest.importorskip("viser")
pytest.importorskip("playwright.sync_api")

from balloon_warp.viewer.page import Page
from balloon_warp.viewer.server import free_port
from balloon_warp.viewer.session import Session


@pytest.mark.parametrize("size", [(1100, 600), (390, 844)])
def test_a_splash_is_seen_until_something_moves(browser, tmp_path, size):
    """A splash shows until something moves, at a desk and on a phone. Then kernels compile ahead."""
    page = Page(Session("ball", tethered(), "cpu", tmp_path), port=free_port("127.0.0.1", 0))
    page.ahead = asked = AskedAhead()
    page.layers.draw(page.session.picture)
    page.controls.follow(page.session.picture)
    window = browser.new_page(viewport={"width": size[0], "height": size[1]})
    window.set_default_timeout(1000.0 * LIMIT)
    window.goto(page.address)
    window.locator(".bw-status").wait_for(state="attached")
    splash = window.locator("#bw-splash")
    assert splash.is_visible()
    page.start()
    splash.wait_for(state="detached")
    assert page.session.picture.frame.number > 0
    wait_until(lambda: asked.scenes, "it compiles ahead")
    assert asked.scenes == [page.session.picture.model.scene]
    window.close()
    page.stop()


def test_a_sphere_is_seen_at_once(fresh, served):
    """A thrown sphere shows at once at its start, even while other kernels compile."""

    def blue() -> int:
        red, _, blue = np.moveaxis(picture_of(fresh), 2, 0)
        return int((blue > 1.5 * red).sum())

    done = threading.Event()
    served.session.ask(lambda _: done.wait(LIMIT))
    try:
        click_the_balloon(fresh, lambda: served.layers._coming, "a sphere is foreseen")
        see(fresh, served, lambda: blue() > 50, "it is seen")
        assert not served.session.picture.scene.sphere
        wait_until(lambda: fresh.locator("#bw-wait").inner_text().startswith("getting ready"), "it says why it waits")
    finally:
        done.set()
    wait_until(lambda: served.session.picture.scene.sphere, "it flies")
    wait_until(lambda: served.layers._coming is None, "there is one")
    wait_until(lambda: not fresh.locator("#bw-wait").is_visible(), "nothing waits")
