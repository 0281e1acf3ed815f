"""Look and layout of the page: in headless Chromium, where there is one."""

import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest
from browsing import LIMIT, again, box, highlights, picture_of, redness, see, tethered, unfold, wait_until
from PIL import Image

from balloon_warp import scenes
from balloon_warp.scene import Balloon, Ground, Scene, Water

pytest.importorskip("viser")
pytest.importorskip("playwright.sync_api")

from balloon_warp.viewer.notebook import Shown
from balloon_warp.viewer.presses import CLEAR
from balloon_warp.viewer.status import KEYS

MODELS = Path(scenes.__file__).parent


def test_the_balloon_shines(fresh, served):
    """The balloon mirrors the studio's lights: among its red there are spots nearly as bright as these."""
    see(fresh, served, lambda: redness(fresh) > 10_000, "the balloon is red")
    see(fresh, served, lambda: highlights(fresh) > 100, "it shines")


def test_the_page_says_that_what_was_asked_for_takes_long(fresh, served):
    """A notice shows while a request waits, as where other kernels compile. Then time goes on."""
    done = threading.Event()
    served.session.ask(lambda _: done.wait(LIMIT))
    try:
        wait_until(lambda: fresh.get_by_text("getting ready").count(), "the window says it")
    finally:
        done.set()
    wait_until(lambda: not fresh.get_by_text("getting ready").count(), "it says how fast time runs again")


def test_a_print_is_seen(fresh, served, tmp_path):
    """A pillow's print, half green and half blue, shows by its texture coordinates: green to the left."""
    image = np.zeros((8, 8, 3), np.uint8)
    image[:, :4, 1] = image[:, 4:, 2] = 255
    Image.fromarray(image).save(tmp_path / "halves.png")
    pillow = Balloon(mesh=MODELS / "pillow.obj", print=tmp_path / "halves.png", rotation=(70.0, 0.0, 0.0))
    served.session.load("pillow", lambda: Scene(balloon=[pillow], gravity=0.0))
    served.session.run(False)

    def columns() -> tuple[np.ndarray, np.ndarray]:
        red, green, blue = np.moveaxis(picture_of(fresh), 2, 0)
        return np.nonzero(green > 1.5 * np.maximum(red, blue))[1], np.nonzero(blue > 1.5 * np.maximum(red, green))[1]

    try:
        see(fresh, served, lambda: min(len(half) for half in columns()) > 1000, "both colors are seen")
        green, blue = columns()
        assert np.median(green) < np.median(blue)
    finally:
        served.session.load("ball", tethered)
        wait_until(lambda: served.session.picture.name == "ball", "the ball is back")


def test_contact_forces_are_arrows_where_a_scene_tells_them(fresh, served):
    """Contact forces are arrows, visible through the balloons; scenes without them have no box for that."""
    told = fresh.get_by_label("contact forces", exact=True)
    unfold(fresh, "Show", "smooth balloon")
    assert not told.is_visible()
    served.session.load("told", lambda: Scene(**{**dict(tethered()), "contacts": True, "ground": Ground(height=-0.45)}))
    try:
        wait_until(lambda: served.session.picture.name == "told", "the scene is there")
        wait_until(lambda: served.layers._presses._arrows.visible, "the ground presses it")
        assert served.layers._balloons[0].opacity == CLEAR
        unfold(fresh, "Show", "smooth balloon")
        again(told.click, lambda: not served.layers.shown["contacts"], "they are switched off")
        wait_until(lambda: not served.layers._presses._arrows.visible, "no arrow is left")
        assert served.layers._balloons[0].opacity is None
    finally:
        served.layers.shown["contacts"] = True
        served.session.load("ball", tethered)
        wait_until(lambda: served.session.picture.name == "ball", "the ball is back")


def test_water_is_seen_where_its_level_is(fresh, served):
    """Water tints what is below its level blue, red included. With the level below the ground only a line at the
    horizon is left, where the ground fades."""
    served.session.load("pool", lambda: tethered().model_copy(update={"water": Water(level=0.1, density=1.0)}))
    served.session.run(False)

    def blue() -> int:
        red, _, blue = np.moveaxis(picture_of(fresh), 2, 0)
        return int((blue > 1.2 * red).sum())

    try:
        see(fresh, served, lambda: blue() > 20_000, "water is seen")
        above = redness(fresh)
        served.session.set("water.level", -2.0)
        served.session.step_once()
        see(fresh, served, lambda: blue() < 1_000, "the ground hides it")
        assert redness(fresh) > 1.3 * above
    finally:
        served.session.load("ball", tethered)
        wait_until(lambda: served.session.picture.name == "ball", "the ball is back")


def test_the_panel_leaves_the_balloon_in_the_middle_of_the_view(fresh, served):
    """The view ends where the panel begins at a desk, and where the drawer does on a phone, folded or not."""
    see(fresh, served, lambda: redness(fresh) > 10_000, "the balloon is red")
    free, panel = box(fresh, "canvas[data-engine]"), fresh.get_by_text("Reset", exact=True).bounding_box()
    assert 0 < free["x"] + free["width"] <= panel["x"]
    fresh.set_viewport_size({"width": 390, "height": 844})
    try:
        drawer = '[style*="max-height: 60%"]'
        wait_until(lambda: 0 < box(fresh, drawer)["height"] < 100, "the drawer is folded")
        wait_until(lambda: above(fresh, drawer), "the view is above")
        fresh.locator(f'{drawer} [style*="cursor: pointer"]').first.click()
        wait_until(lambda: box(fresh, drawer)["height"] > 300, "the drawer opens")
        wait_until(lambda: above(fresh, drawer), "the view is above")
        assert box(fresh, drawer)["width"] == 390
    finally:
        fresh.set_viewport_size({"width": 1100, "height": 600})
    fresh.get_by_text("Reset", exact=True).wait_for()


def test_keys_are_on_a_sheet(fresh, served):
    fresh.mouse.click(20, 400, button="right")
    fresh.keyboard.press("?")
    sheet = fresh.locator(".bw-sheet")
    sheet.wait_for()
    assert sheet.locator("tr").count() == len(KEYS)
    fresh.keyboard.press("?")
    sheet.wait_for(state="detached")
    button = box(fresh, ".bw-keys-button")
    fresh.mouse.click(button["x"] + button["width"] / 2, button["y"] + button["height"] / 2)
    sheet.wait_for()
    fresh.keyboard.press("Escape")
    sheet.wait_for(state="detached")


def test_the_camera_follows(fresh, served):
    """The camera follows the balloon after F, and stays after F again."""
    [client] = served.server.get_clients().values()
    camera, follows = client.camera, lambda: served.follower.follows(client)

    def beside() -> float:
        return float(np.linalg.norm(np.array(camera.look_at) - served.session.picture.frame.points[0].mean(axis=0)))

    fresh.mouse.click(20, 400, button="right")
    fresh.keyboard.press("f")
    wait_until(follows, "it follows")
    served.session.ask(lambda playground: playground.cut_all())  # and so it rises
    served.session.set("balloon.helium", 30.0)
    start = served.session.picture.frame.points[0].mean(axis=0)[1]
    wait_until(lambda: served.session.picture.frame.points[0].mean(axis=0)[1] > start + 2.0, "it rises")
    wait_until(lambda: beside() < 0.3, "the camera rises along")
    fresh.keyboard.press("f")
    wait_until(lambda: not follows(), "it stays")
    wait_until(lambda: beside() > 1.0, "the balloon goes on")
    served.session.reset()
    wait_until(lambda: served.session.picture.frame.points[0].mean(axis=0)[1] < start + 0.5, "it is back")
    for _ in range(2):  # look at it, and stay, for whoever comes next
        fresh.keyboard.press("f")
    wait_until(lambda: beside() < 0.3 and not follows(), "the camera is back")


def test_a_notebook_shows_the_page(browser, fresh, served):
    """A notebook of this machine may frame the page; one from elsewhere may not."""
    html = Shown(served, ("100%", 400))._repr_html_()

    class Notebook(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(html.encode())

        def log_message(self, format: str, *args: object) -> None:
            """Log nothing."""

    with ThreadingHTTPServer(("127.0.0.1", 0), Notebook) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        notebook, said = browser.new_page(), []
        notebook.on("console", lambda message: said.append(message.text))
        notebook.goto(f"http://elsewhere.localhost:{server.server_port}")
        wait_until(lambda: notebook.wait_for_timeout(20) or any("frame-ancestors" in text for text in said), "refused")
        notebook.goto(f"http://localhost:{server.server_port}")
        notebook.frame_locator("iframe").get_by_text("Reset", exact=True).wait_for(timeout=1000.0 * LIMIT)
        notebook.close()
        server.shutdown()
    wait_until(lambda: len(served.server.get_clients()) == 1, "the notebook is closed")


def above(window, drawer: str) -> bool:
    """Return whether the view ends where the drawer begins, to a pixel."""
    return abs(box(window, "canvas[data-engine]")["height"] - box(window, drawer)["y"]) <= 1.0
